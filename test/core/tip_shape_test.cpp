#include "calligraphy_brush/sim/tip_shape.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rod_scene.h"

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;

RodModel rodAt(double x, double y, double length) {
  RodModel rod = makeUniformRod(length, kReferenceBending, kReferenceDensity, 9);
  rod.root_H = {x, y, 0};
  rod.node_radius.assign(9, 2e-4);
  return rod;
}

double widthOf(const BrushModel& brush, const Eigen::Isometry3d& X) {
  const auto tuft = makeTuft(brush, RodParameters{}, ContactParameters{});
  tuft->place(X);
  return endWidth(brush, *tuft);
}

TEST(EndWidth, IsThatOfADiscOfRodsHoweverTheHandleIsTurned) {
  BrushModel brush;
  for (int k = 0; k < 12; ++k)
    brush.rods.push_back(rodAt(3e-3 * std::cos(k * kPi / 6), 3e-3 * std::sin(k * kPi / 6), 0.04));
  for (const double angle : {0.0, 0.4, 1.3}) {
    Eigen::Isometry3d X = handleAt({0.01, 0.02, 0.1}, angle);
    X.rotate(Eigen::AngleAxisd(0.7 * angle, Eigen::Vector3d::UnitZ()));
    EXPECT_NEAR(widthOf(brush, X), 6.4e-3, 2e-3 * 6.4e-3) << angle;
  }
}

TEST(EndWidth, KnowsTheWidestDirectionOfAFlatTip) {
  BrushModel brush;
  for (int k = -4; k <= 4; ++k) brush.rods.push_back(rodAt(1e-3 * k, 0.5e-3 * k, 0.04));
  EXPECT_NEAR(widthOf(brush, handleAt({0, 0, 0.1})), 8e-3 * std::sqrt(1.25) + 4e-4, 1e-5);
}

TEST(EndWidth, LeavesOutRodsThatEndBeforeIt) {
  BrushModel brush;
  brush.rods = {rodAt(0, 0, 0.04), rodAt(2e-3, 0, 0.037), rodAt(9e-3, 0, 0.035)};
  EXPECT_NEAR(widthOf(brush, handleAt({0, 0, 0.1})), 2.4e-3, 1e-6);
}

TEST(EndWidth, FallsToWhereLeaningRodsMeet) {
  BrushModel brush;
  for (const double side : {-1.0, 1.0}) {
    brush.rods.push_back(rodAt(side * 4e-3, 0, 0.04));
    brush.rods.back().direction_H = Eigen::Vector3d(-side * 4e-3, 0, -0.04).normalized();
  }
  // A tenth before the end they are a tenth of what they were at the root apart.
  const double lean = 4.0 / std::hypot(4.0, 40.0);
  EXPECT_NEAR(widthOf(brush, handleAt({0, 0, 0.1})), 2 * (4e-3 - 0.9 * 0.04 * lean) + 4e-4, 1e-5);
}

TEST(TipShape, CountsRodsThatDoNotFeelEachOtherOneByOne) {
  BrushModel brush;
  for (int k = 0; k < 5; ++k) brush.rods.push_back(rodAt(1e-4 * k, 0, 0.04));
  for (const bool bundles : {false, true}) {
    ContactParameters contact;
    contact.bundles = bundles;
    contact.paper = false;
    const auto tuft = makeTuft(brush, RodParameters{}, contact);
    const Eigen::Isometry3d X = handleAt({0, 0, 0.1});
    tuft->place(X);
    tuft->setInk(std::vector<double>(45, 1.0));
    tuft->step(X);
    EXPECT_EQ(findTipShape(brush, *tuft).groups, bundles ? 1 : 5);
  }
}

}  // namespace
}  // namespace calligraphy_brush
