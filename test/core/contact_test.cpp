#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "rod_scene.h"

using namespace calligraphy_brush;

namespace {

constexpr double kPi = 3.14159265358979323846;

/// A weightless rod, L = B = 1, pressed quasi-statically in the plane y = 0 to a depth, its handle
/// tilted so that the tip slides towards +x, and then dragged.
struct PressedRod {
  PressedRod(double tilt_deg, double friction, int node_count)
      : nodes(node_count), tilt(tilt_deg * kPi / 180) {
    // So much damping that the tip comes to rest from one side: past its rest it would stick there.
    RodParameters rods = exactRods(0.1);
    rods.scheme = "backward_euler";
    rods.gravity = 0;
    rods.damping = 300.0;
    ContactParameters contact;
    contact.paper_friction = friction;
    contact.multiplier_updates = 200;
    contact.tolerance = 1e-12;
    tuft = makeTuft(oneRod(makeUniformRod(1.0, 1.0, 1.0, nodes)), rods, contact);
    tuft->place(pose(0, 0));
  }

  Eigen::Isometry3d pose(double depth, double x) const {
    return handleAt({x, 0, std::cos(tilt) - depth}, -tilt);
  }
  void press(double depth) {
    for (int step = 1; step <= 2000; ++step)
      tuft->step(pose(depth * (1 - std::pow(1 - step / 2000.0, 4)), 0));
    for (int step = 0; step < 2000; ++step) tuft->step(pose(depth, 0));
  }
  Eigen::Vector3d force() const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (int node = 0; node < nodes; ++node) sum += tuft->contactForce(0, node);
    return sum;
  }

  int nodes;
  double tilt;
  std::unique_ptr<Tuft> tuft;
};

struct Pressed {
  double tilt_deg, friction, depth;
  int nodes;
  double normal, offset;
};

}  // namespace

// Exact discrete solutions of a pressed rod that slides, made outside this project.
class Press : public testing::TestWithParam<Pressed> {};

TEST_P(Press, PushesAsHardAsTheReferenceSays) {
  const Pressed& p = GetParam();
  PressedRod rod(p.tilt_deg, p.friction, p.nodes);
  rod.press(p.depth);
  EXPECT_NEAR(rod.force().z(), p.normal, 1e-5 * p.normal);
  EXPECT_NEAR(rod.force().x(), -p.friction * p.normal, 1e-5 * p.normal);
  EXPECT_NEAR(rod.tuft->nodePosition(0, p.nodes - 1).x(), p.offset, 1e-5);
  for (int node = 0; node < p.nodes; ++node) EXPECT_GE(rod.tuft->nodePosition(0, node).z(), -1e-9);
}

INSTANTIATE_TEST_SUITE_P(Reference, Press,
                         testing::Values(Pressed{30, 0, 0.1, 10, 0.767372167418, 0.638210439048},
                                         Pressed{30, 0, 0.5, 20, 2.07264068717, 0.883581232703},
                                         Pressed{30, 0, 0.6, 10, 3.33132364509, 0.914041147907},
                                         Pressed{30, 0, 0.7, 20, 8.56550899496, 0.946053964202},
                                         Pressed{30, 0.2, 0.1, 20, 0.991251747511, 0.638043119144},
                                         Pressed{30, 0.2, 0.3, 10, 1.70844007097, 0.800602324037},
                                         Pressed{30, 0.2, 0.7, 20, 9.18397961498, 0.945622960624}));

TEST(PaperContact, DragsAsHardAsTheReferenceSays) {
  // Handle dragged to −x at constant depth, the hair trailing: friction now points along +x.
  PressedRod rod(30, 0.2, 20);
  rod.press(0.3);
  for (int step = 1; step <= 4000; ++step)
    rod.tuft->step(rod.pose(0.3, -0.05 * (1 - std::pow(1 - step / 4000.0, 4))));
  // Friction opposes the motion all the way.
  EXPECT_NEAR(rod.force().x(), 0.2 * rod.force().z(), 1e-6);
  EXPECT_NEAR(rod.force().z(), 1.35455850002, 2e-4);
}

TEST(PaperContact, SticksWithoutCreeping) {
  PressedRod rod(30, 1.0, 16);  // µ > tan 30°: the tip never slides
  rod.press(0.02);
  const Eigen::Vector3d stuck = rod.tuft->nodePosition(0, 15);
  EXPECT_NEAR(stuck.x(), std::sin(rod.tilt), 2e-4);  // where it first touched
  const Eigen::Vector3d f = rod.force();
  EXPECT_LT(std::hypot(f.x(), f.y()), f.z());
  for (int step = 0; step < 20000; ++step) rod.tuft->step(rod.pose(0.02, 0));
  EXPECT_LT((rod.tuft->nodePosition(0, 15) - stuck).norm(), 1e-10);
}

TEST(PaperContact, LetsGoWithoutPulling) {
  PressedRod rod(30, 0.3, 16);
  rod.press(0.2);
  double lowest = 1;
  for (int step = 1; step <= 1000; ++step) {
    rod.tuft->step(rod.pose(0.2 - 0.4 * step / 1000, 0));
    EXPECT_GE(rod.force().z(), 0.0);
    lowest = std::min(lowest, rod.tuft->rodOnPaper(0).lowest);
  }
  EXPECT_EQ(rod.force(), Eigen::Vector3d(0, 0, 0));
  EXPECT_GT(lowest, -1e-6);
  // Straight again.
  for (int step = 0; step < 20000; ++step) rod.tuft->step(rod.pose(-0.2, 0));
  const Eigen::Vector3d tip = rod.tuft->nodePosition(0, 15) - rod.pose(-0.2, 0).translation();
  EXPECT_NEAR(tip.x(), 0.5, 1e-6);
}

TEST(PaperContact, WrenchIsTheSumOfTheContactForces) {
  PressedRod rod(30, 0.4, 16);
  rod.press(0.3);
  const auto wrench = rod.tuft->rodWrench(0);
  Eigen::Vector3d force = rod.force(), torque = Eigen::Vector3d::Zero();
  const Eigen::Vector3d handle = rod.pose(0.3, 0).translation();
  for (int node = 0; node < 16; ++node)
    torque += (rod.tuft->nodePosition(0, node) - handle).cross(rod.tuft->contactForce(0, node));
  EXPECT_LT((wrench.head<3>() - force).norm(), 1e-6 * force.norm());
  EXPECT_LT((wrench.tail<3>() - torque).norm(), 1e-6 * torque.norm());
}

TEST(PaperContact, WithOneUpdateAStepIsWithinAPercentOfTheSolvedCone) {
  // As it runs while writing: pressed 10 mm and dragged, one multiplier update a step.
  std::vector<double> normal;
  for (const int updates : {1, 100}) {
    RodParameters rods;
    rods.precision = "double";
    ContactParameters contact;
    contact.multiplier_updates = updates;
    const auto tuft = makeTuft(referenceRod(16), rods, contact);
    const auto pose = [](int step) {
      return handleAt({0.00005 * std::max(0, step - 400), 0, 0.045 - 0.01 * std::min(1.0, step / 400.0)},
                      0.35);
    };
    tuft->place(pose(0));
    for (int step = 1; step < 1500; ++step) tuft->step(pose(step));
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (int node = 0; node < 16; ++node) sum += tuft->contactForce(0, node);
    normal.push_back(sum.z());
    EXPECT_NEAR(std::hypot(sum.x(), sum.y()), 0.3 * sum.z(), 0.003 * sum.z());
    EXPECT_GT(tuft->rodOnPaper(0).lowest, -2e-6);
  }
  EXPECT_NEAR(normal[0], normal[1], 0.01 * normal[1]);
}

TEST(PaperContact, FrictionOpposesTheWayThatANodeSlides) {
  // Drawn round a circle in the usual steps: whatever lags behind the slip shows as an angle to it.
  constexpr double kRadius = 0.03, kRate = 20.0;  // [m], [rad/s]
  const auto tuft = makeTuft(referenceRod(16), RodParameters{}, ContactParameters{});
  const auto pose = [](int step) {
    const double angle = kRate * 1e-3 * std::max(0, step - 400);
    return handleAt({kRadius * std::cos(angle), kRadius * std::sin(angle),
                     0.045 - 0.01 * std::min(1.0, step / 400.0)},
                    0.35);
  };
  tuft->place(pose(0));
  double sum = 0.0, worst = 0.0;
  int count = 0;
  for (int step = 1; step < 1400; ++step) {
    const Eigen::Vector3d before = tuft->nodePosition(0, 15);
    tuft->step(pose(step));
    const Eigen::Vector3d force = tuft->contactForce(0, 15);
    if (step < 800 || !(force.z() > 0.0)) continue;
    const Eigen::Vector2d slip = (tuft->nodePosition(0, 15) - before).head<2>(), back = -force.head<2>();
    const double angle = std::atan2(back.x() * slip.y() - back.y() * slip.x(), back.dot(slip));
    sum += angle;
    worst = std::max(worst, std::abs(angle));
    ++count;
  }
  ASSERT_GT(count, 300);
  std::printf("friction behind the slip: %.4f rad on average, %.4f at most\n", sum / count, worst);
  EXPECT_LT(std::abs(sum / count), 0.5 * kRate * 1e-3);  // half a step
  EXPECT_LT(worst, 2.0 * kRate * 1e-3);
}

TEST(PaperContact, LeavingTheSheetOutWhereItIsOutOfReachChangesNothing) {
  // Above the sheet the kernel without contact runs; nothing may tell.
  RodParameters rods = exactRods(0.001);
  ContactParameters with, without;
  without.paper = false;
  const auto a = makeTuft(referenceRod(16), rods, with), b = makeTuft(referenceRod(16), rods, without);
  const auto pose = [](int step) {
    return handleAt({0.01 * std::sin(0.1 * step), 0, 0.048}, 0.2 * std::sin(0.05 * step));
  };
  a->place(pose(0));
  b->place(pose(0));
  for (int step = 1; step < 1000; ++step) {
    a->step(pose(step));
    b->step(pose(step));
    for (int node = 0; node < 16; ++node) ASSERT_EQ(a->nodePosition(0, node), b->nodePosition(0, node));
  }
}
