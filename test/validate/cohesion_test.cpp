#include "cohesion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numeric>
#include <string>
#include <utility>

#include "reference_table.h"
#include "tip.h"

using namespace calligraphy_brush::validate;

namespace {

CohesionPairParameters pairOf(const Row& row) {
  CohesionPairParameters p;
  p.nodes = 40;
  p.spacing = row.at("d_m");
  p.energy = row.at("w_J_per_m");
  p.bending = row.at("B_Nm2");
  return p;
}

/// The rows of one surface tension [N/m].
std::vector<Row> rowsOf(double gamma) {
  std::vector<Row> rows;
  for (const Row& row : readReference("pair_of_hairs"))
    if (row.at("gamma_N_per_m") == gamma) rows.push_back(row);
  EXPECT_EQ(rows.size(), 5U);
  return rows;
}

}  // namespace

TEST(CohesionPair, IsDryAsFarAsTheExactPeelingSolutionSays) {
  for (const double gamma : {0.072}) {
    const Row row = rowsOf(gamma)[3];
    for (const double over : {1.45, 2.0}) {
      CohesionPairParameters p = pairOf(row);
      p.length = over * row.at("L_dry_exact_m");
      const CohesionPairResult result = cohesionPair(p);
      EXPECT_TRUE(result.stuck);
      EXPECT_NEAR(result.dry_length / row.at("L_dry_exact_m"), 1.0, 0.03) << gamma << " " << over;
      // Whatever the law: sqrt(w B).
      EXPECT_NEAR(result.root_moment / std::sqrt(p.energy * p.bending), 1.0, 0.05) << gamma;
      EXPECT_LT(result.pulled_from, result.dry_length);
      EXPECT_GT(result.first_contact, result.dry_length);
    }
  }
}

TEST(CohesionPair, DryLengthGoesWithTheRootOfTheSpacingAndTheFourthRootOfTheStiffness) {
  // Of lengths that leave the nodes to lie differently in each shape, and about as many in the dry part.
  CohesionPairParameters p = pairOf(rowsOf(0.05)[3]);
  p.length = 0.016;
  const double dry = cohesionPair(p).dry_length;
  CohesionPairParameters closer = p;
  closer.spacing = p.spacing / 5.0;
  closer.length = 0.0085;
  EXPECT_NEAR(std::log(dry / cohesionPair(closer).dry_length) / std::log(5.0), 0.5, 0.015);
  CohesionPairParameters softer = p;
  softer.bending = p.bending / 25.0;
  softer.length = 0.0085;
  EXPECT_NEAR(std::log(dry / cohesionPair(softer).dry_length) / std::log(25.0), 0.25, 0.0075);
}

TEST(CohesionPair, HasLessEnergyThanApartFromTheCollapseLengthOn) {
  const Row row = rowsOf(0.03)[2];
  CohesionPairParameters p = pairOf(row);
  p.length = 0.97 * row.at("L_collapse_m");
  const CohesionPairResult shorter = cohesionPair(p);
  EXPECT_TRUE(shorter.holds);
  EXPECT_FALSE(shorter.stuck);
  p.length = 1.03 * row.at("L_collapse_m");
  EXPECT_TRUE(cohesionPair(p).stuck);
}

TEST(CohesionPair, PartsWhereItIsShorterThanDry) {
  const Row row = rowsOf(0.03)[2];
  CohesionPairParameters p = pairOf(row);
  // What liquid of a finite range pulls at the very ends holds down to about 0.7 of it, at no gain.
  p.length = 0.85 * row.at("L_dry_exact_m");
  EXPECT_FALSE(cohesionPair(p).stuck);
  p.length = 0.6 * row.at("L_dry_exact_m");
  const CohesionPairResult result = cohesionPair(p);
  EXPECT_TRUE(result.converged);
  EXPECT_FALSE(result.holds);
  EXPECT_FALSE(result.stuck);
  EXPECT_TRUE(std::isnan(result.dry_length));
}

namespace {

double meanSize(const CohesionRowResult& row) {
  return static_cast<double>(std::accumulate(row.group_sizes.begin(), row.group_sizes.end(), 0)) /
         static_cast<double>(row.group_sizes.size());
}

}  // namespace

TEST(CohesionRow, GroupsGrowWithTheLengthToFourThirdsAsInTheTable) {
  // Of κ = γ = 1 and d = 0.01: w = 2, for the liquid of a pair has two sides.
  std::vector<double> x, y;
  for (const Row& row : readReference("bundle_scaling")) {
    CohesionRowParameters p;
    p.bending = 1.0;
    p.energy = 2.0;
    p.spacing = 0.01;
    p.length = row.at("L_N_lamellae");
    const CohesionRowResult result = cohesionRow(p);
    EXPECT_EQ(std::accumulate(result.group_sizes.begin(), result.group_sizes.end(), 0), p.count);
    // What clings at the very ends only lets go: seams close from a length of 1.2 L_N on.
    EXPECT_NEAR(meanSize(result) / row.at("N"), std::pow(1.0 / 1.2, 4.0 / 3.0), 0.1) << row.at("N");
    x.push_back(std::log(p.length));
    y.push_back(std::log(meanSize(result)));
  }
  ASSERT_EQ(x.size(), 3U);
  // Of equal steps the line of least squares goes by the first and the last.
  EXPECT_NEAR((y[2] - y[0]) / (x[2] - x[0]), 4.0 / 3.0, 0.1 * 4.0 / 3.0);
}

TEST(CohesionRow, SizesHangOnTheLengthOverTheDryLengthAlone) {
  for (const double spacing : {5e-5, 4e-4}) {
    CohesionRowParameters p;
    p.spacing = spacing;
    p.bending *= 3.0;
    const double dry = std::pow(9.0 * p.bending * spacing * spacing / p.energy, 0.25);
    p.length = dry * std::pow(2.0, 0.75);  // that of groups of 4
    const CohesionRowResult result = cohesionRow(p);
    EXPECT_NEAR(result.predicted, 4.0, 1e-9);
    EXPECT_NEAR(meanSize(result), 4.0 * std::pow(1.0 / 1.2, 4.0 / 3.0), 0.4) << spacing;
  }
}

TEST(TipShape, WetClosesBelowAThirdAndDryStaysAtRest) {
  for (const auto& [brush, rods] : {std::pair("pointed", 128), std::pair("small", 64),
                                    std::pair("medium", 128), std::pair("large", 256)}) {
    SCOPED_TRACE(brush);
    TipShapeParameters p;
    p.brush = std::string(CALLIGRAPHY_BRUSH_SOURCE_DIR) + "/config/brushes/" + brush + ".yaml";
    for (const double ink : {0.25, 1.0}) {
      p.ink = ink;
      const TipShapeResult wet = tipShape(p);
      EXPECT_EQ(wet.groups, 1) << ink;
      EXPECT_LT(wet.end_diameter, wet.rest_diameter / 3.0) << ink;
    }
    p.ink = 0.0;
    const TipShapeResult dry = tipShape(p);
    EXPECT_EQ(dry.groups, rods);
    EXPECT_NEAR(dry.end_diameter / dry.rest_diameter, 1.0, 0.05);
  }
}

TEST(TipShape, HangsTogetherTheMoreTheMoreInkThereIsAndCloses) {
  TipShapeParameters p;
  p.brush = std::string(CALLIGRAPHY_BRUSH_SOURCE_DIR) + "/config/brushes/pointed.yaml";
  int groups = 1000;
  for (const double ink : {0.0001, 0.003, 0.03, 0.25, 1.0}) {
    p.ink = ink;
    const TipShapeResult result = tipShape(p);
    EXPECT_LE(result.groups, groups) << ink;
    EXPECT_LT(result.ends_diameter, result.rest_ends_diameter) << ink;
    if (ink >= 0.03) {
      EXPECT_LT(result.end_diameter, result.rest_diameter / 3.0) << ink;
    }
    groups = result.groups;
  }
  EXPECT_EQ(groups, 1);
}

TEST(TipShape, IsDrawnRodByRod) {
  TipShapeParameters p;
  p.rods = 8;
  p.depth = 0.01;
  p.duration = 0.05;
  p.picture = testing::TempDir() + "tip_shape.svg";
  tipShape(p);
  std::ifstream file(p.picture);
  const std::string svg{std::istreambuf_iterator<char>(file), {}};
  std::filesystem::remove(p.picture);
  EXPECT_NE(svg.find("\"rod_7\""), std::string::npos);
  EXPECT_EQ(svg.find("\"rod_8\""), std::string::npos);
  EXPECT_NE(svg.find("\"sheet\""), std::string::npos);
  EXPECT_EQ(svg.find("nan"), std::string::npos);
}

TEST(TipShape, PressedDryPartsAndTheWetterTheLess) {
  TipShapeParameters p;
  p.depth = 0.01;
  p.brush = std::string(CALLIGRAPHY_BRUSH_SOURCE_DIR) + "/config/brushes/medium.yaml";
  std::vector<TipShapeResult> results;
  for (const double ink : {0.0, 0.003, 0.25, 1.0}) {
    p.ink = ink;
    results.push_back(tipShape(p));
    if (results.size() > 1) {
      EXPECT_LE(results.back().groups, results[results.size() - 2].groups) << ink;
    }
  }
  EXPECT_GT(results.front().groups, 20);
  EXPECT_LT(results.front().group_sizes.front(), 64);
  EXPECT_LT(results.back().groups, 5);  // one, and a stray rod or two
  EXPECT_GT(results.back().group_sizes.front(), 96);
}
