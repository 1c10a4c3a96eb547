#include <gtest/gtest.h>

#include <cmath>

#include "calligraphy_brush/brush/brush_model.h"

using namespace calligraphy_brush;

namespace {
constexpr double kPi = 3.14159265358979323846;
}

TEST(Brush, HasItsHairs) {
  BrushParameters p;
  p.hair_taper = 1.0;
  p.point = 0.0;
  p.length_scatter = 0.0;
  p.cone = 0.0;
  p.convergence = 0.0;
  const BrushModel brush = makeBrush(p);
  ASSERT_EQ(brush.rods.size(), static_cast<std::size_t>(p.rod_count));
  double mass = 0, stiffness = 0;
  for (const RodModel& rod : brush.rods) {
    EXPECT_EQ(rod.nodeCount(), p.node_count);
    EXPECT_DOUBLE_EQ(rod.length, p.tip_length);
    for (const double m : rod.node_mass) mass += m;
    stiffness += rod.bending_stiffness[3];
  }
  const double area = kPi * p.hair_radius * p.hair_radius;
  EXPECT_NEAR(mass, p.hair_count * area * p.density * p.tip_length, 1e-9 * mass);
  EXPECT_NEAR(stiffness, p.hair_count * p.youngs_modulus * area * p.hair_radius * p.hair_radius / 4,
              1e-9 * stiffness);
}

TEST(Brush, IsLongestAtItsCoreAndFitsItsFerrule) {
  const BrushParameters p;
  const BrushModel brush = makeBrush(p);
  EXPECT_NEAR(brush.tip_length, p.tip_length, 1e-3 * p.tip_length);
  EXPECT_DOUBLE_EQ(brush.rods.front().length, p.tip_length);
  for (const RodModel& rod : brush.rods) {
    EXPECT_LE(rod.root_H.norm(), 0.5 * p.root_diameter);
    EXPECT_LE(rod.length, p.tip_length);
    EXPECT_NEAR(rod.direction_H.norm(), 1.0, 1e-14);
    EXPECT_LE(-rod.direction_H.z() * rod.length, brush.tip_length + 1e-15);
    EXPECT_GT(rod.ink_capacity, 0.0);
  }
  EXPECT_LT(brush.rods.back().length, (1 - 0.9 * p.cone) * p.tip_length);
}

TEST(Brush, IsTheSameForTheSameSeedAndAnotherForAnother) {
  BrushParameters p;
  const BrushModel a = makeBrush(p), b = makeBrush(p);
  p.seed = 2;
  const BrushModel c = makeBrush(p);
  int differing = 0;
  for (std::size_t k = 0; k < a.rods.size(); ++k) {
    EXPECT_EQ(a.rods[k].length, b.rods[k].length);
    EXPECT_EQ(a.rods[k].root_H, b.rods[k].root_H);
    differing += a.rods[k].length != c.rods[k].length;
  }
  EXPECT_GT(differing, static_cast<int>(a.rods.size()) / 2);
}

TEST(Brush, SaysWhatIsWrongWithItsParameters) {
  BrushParameters p;
  p.rod_count = 0;
  p.youngs_modulus = std::nan("");
  try {
    makeBrush(p);
    FAIL() << "accepted";
  } catch (const ParameterError& error) {
    EXPECT_EQ(error.problems().size(), 2U);
    EXPECT_NE(std::string(error.what()).find("rod_count = 0"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("youngs_modulus = nan"), std::string::npos);
  }
}
