#include "buckling.h"

#include <cmath>

#include "reference_table.h"

using namespace calligraphy_brush::validate;

namespace {

constexpr double kPi = 3.14159265358979323846;

LateralBucklingResult tipOver(const Row& row, int nodes) {
  LateralBucklingParameters p;
  p.tau = row.at("tau");
  p.stiffness_ratio = row.at("stiffness_ratio");
  p.nodes = nodes;
  return lateralBuckling(p);
}

bool isStable(double tau, double curvature, double gamma) {
  BendTwistParameters p;
  p.tau = tau;
  p.natural_curvature = curvature;
  p.gamma = gamma;
  const BendTwistResult result = bendTwist(p);
  EXPECT_TRUE(result.converged) << "tau " << tau << " curvature " << curvature << " gamma " << gamma;
  // A stable rod comes back from the blow, another does not.
  EXPECT_EQ(std::abs(result.tip.y()) < 1e-6, result.planar_stable);
  return result.planar_stable;
}

}  // namespace

TEST(LateralBuckling, BeginsAtTheLoadOfTheContinuousStrip) {
  for (const Row& row : readReference("lateral_buckling")) {
    const LateralBucklingResult result = tipOver(row, LateralBucklingParameters{}.nodes);
    EXPECT_TRUE(result.converged);
    EXPECT_NEAR(result.critical_load / row.at("critical_load"), 1.0, 0.005)
        << "tau " << row.at("tau") << " ratio " << row.at("stiffness_ratio");
  }
}

TEST(LateralBuckling, NearsItWithOrderTwo) {
  for (const Row& row : readReference("lateral_buckling")) {
    if (row.at("stiffness_ratio") != 0.05 && row.at("stiffness_ratio") != 0.0001) continue;
    std::vector<double> errors;
    for (const int nodes : {39, 77, 153})
      errors.push_back(std::abs(tipOver(row, nodes).critical_load - row.at("critical_load")));
    EXPECT_NEAR(std::log2(errors[0] / errors[1]), 2.0, 0.15);
    EXPECT_NEAR(std::log2(errors[1] / errors[2]), 2.0, 0.15);
  }
}

TEST(LateralBuckling, IsFoundInFloatToo) {
  LateralBucklingParameters p;
  const double exact = lateralBuckling(p).critical_load;
  p.precision = "float";
  const LateralBucklingResult single = lateralBuckling(p);
  EXPECT_TRUE(single.converged);
  EXPECT_NEAR(single.critical_load, exact, 1e-4 * exact);
}

TEST(LateralBuckling, DoesNotHappenToAStripAsStiffSidewaysAsUpright) {
  LateralBucklingParameters p;
  p.stiffness_ratio = 1;
  const LateralBucklingResult result = lateralBuckling(p);
  EXPECT_TRUE(result.converged);
  EXPECT_TRUE(std::isnan(result.critical_load));
}

TEST(BendTwist, LeavesThePlaneWhereTheContinuousRodDoes) {
  for (const Row& row : readReference("bend_twist")) {
    const double tau = row.at("tau"), curvature = row.at("natural_curvature");
    const double gamma1 = row.at("gamma1"), gamma2 = row.at("gamma2");
    SCOPED_TRACE(testing::Message() << "tau " << tau << " curvature " << curvature);
    if (gamma1 == gamma2) {  // the least curvature that does
      EXPECT_TRUE(isStable(tau, 0.98 * curvature, gamma1));
      EXPECT_FALSE(isStable(tau, 1.02 * curvature, gamma1));
      continue;
    }
    EXPECT_TRUE(isStable(tau, curvature, 0.98 * gamma1));
    EXPECT_FALSE(isStable(tau, curvature, 1.02 * gamma1));
    if (gamma2 == 0) continue;
    EXPECT_FALSE(isStable(tau, curvature, 0.98 * gamma2));
    EXPECT_TRUE(isStable(tau, curvature, 1.02 * gamma2));
  }
}

TEST(BendTwist, WithoutWeightIsTheCurl) {
  BendTwistParameters p;
  p.gamma = 0;
  const BendTwistResult result = bendTwist(p);
  EXPECT_TRUE(result.planar_stable);
  const double K = p.natural_curvature;
  EXPECT_NEAR(std::abs(result.tip.x()), (1 - std::cos(K)) / K, 1e-3);
  EXPECT_NEAR(result.tip.z(), -std::sin(K) / K, 1e-3);
}

TEST(Ring, LeavesItsPlaneAtMichellsTwist) {
  for (const Row& row : readReference("ring")) {
    std::vector<double> errors;
    for (const int nodes : {30, 59}) {
      RingParameters p;
      p.stiffness_ratio = row.at("stiffness_ratio");
      p.nodes = nodes;
      const RingResult result = ring(p);
      EXPECT_TRUE(result.converged);
      errors.push_back(std::abs(result.critical_twist / row.at("critical_twist") - 1));
    }
    EXPECT_LT(errors[0], 5e-3) << row.at("stiffness_ratio");
    EXPECT_LT(errors[1], 1.5e-3) << row.at("stiffness_ratio");
  }
}

TEST(Ring, RefusesFewerNodesThanItsTwistNeeds) {
  RingParameters p;
  p.stiffness_ratio = 0.1;
  p.nodes = 20;
  EXPECT_THROW(ring(p), std::invalid_argument);
}

TEST(Helix, IsThatOfTheContinuousRod) {
  for (const Row& row : readReference("helix")) {
    HelixParameters p;
    p.length = row.at("length");
    p.bending = row.at("bending");
    p.twisting = row.at("twisting");
    p.slack = row.at("slack");
    p.turns = row.at("twist") / (2 * kPi);
    const HelixResult result = helix(p);
    EXPECT_TRUE(result.converged);
    EXPECT_NEAR(result.max_angle / row.at("max_angle"), 1.0, 2e-3) << "turns " << p.turns;
    EXPECT_NEAR(result.moment / row.at("moment"), 1.0, p.length == 100 ? 5e-4 : 3e-3)
        << "turns " << p.turns;
  }
}

TEST(Helix, WithoutTwistIsAnElastica) {
  // Buckled between clamps by the slack: of first order in the angle a, phi = a sin(2 pi s), and the
  // slack is a²/4.
  HelixParameters p;
  p.length = p.bending = p.twisting = 1;
  p.turns = 0;
  p.slack = 1e-4;
  p.nodes = 80;
  const HelixResult result = helix(p);
  EXPECT_TRUE(result.converged);
  EXPECT_NEAR(result.max_angle, 0.02, 1e-5);
  EXPECT_NEAR(result.moment, 0.0, 1e-9);
}

TEST(Helix, RefusesTooMuchSlackAndTooFewNodes) {
  HelixParameters p;
  p.slack = 51;
  EXPECT_THROW(helix(p), std::invalid_argument);
  p.slack = 3;
  p.nodes = 50;
  EXPECT_THROW(helix(p), std::invalid_argument);
}
