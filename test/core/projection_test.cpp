#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "rod_scene.h"

using namespace calligraphy_brush;

namespace {

constexpr double kPi = 3.14159265358979323846;

RodParameters projection(double time_step) {
  RodParameters rods;
  rods.scheme = "projection";
  rods.bending_law = "tangent";
  rods.time_step = time_step;
  rods.tolerance = 1e-8;
  return rods;
}

/// Highest frequency [rad/s] of small motions of a uniform rod whose first edge is fixed.
double highestFrequency(double length, double bending, double density, int n) {
  const double l = length / (n - 1);
  // Turn of joint 1 .. n − 2, by the sideways way of nodes 2 .. n − 1 over the root of their mass.
  Eigen::MatrixXd turn = Eigen::MatrixXd::Zero(n - 2, n - 2);
  for (int joint = 1; joint <= n - 2; ++joint)
    for (const auto& [node, weight] : {std::pair{joint - 1, 1.0}, {joint, -2.0}, {joint + 1, 1.0}})
      if (node >= 2)
        turn(joint - 1, node - 2) = weight / l / std::sqrt(density * l * (node == n - 1 ? 0.5 : 1.0));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(bending / l * turn.transpose() * turn);
  return std::sqrt(solver.eigenvalues().maxCoeff());
}

double referenceLimit(int n) {
  return 2 / highestFrequency(kReferenceLength, kReferenceBending, kReferenceDensity, n);
}

/// How far the reference rod's tip slides [m] from where it first touched, pressed 10 mm at 30°.
double slideOfPressedTip(const RodParameters& rods, double friction,
                         double* friction_over_push = nullptr) {
  const int n = 10;
  ContactParameters contact;
  contact.paper_friction = friction;
  contact.multiplier_updates = 100;
  contact.tolerance = 1e-9;
  const auto tuft = makeTuft(referenceRod(n), rods, contact);
  const double tilt = kPi / 6;
  const auto pose = [&](double t) {
    const double depth = 0.01 * std::min(1.0, t / 0.2);
    return handleAt({0, 0, kReferenceLength * std::cos(tilt) - depth}, -tilt);
  };
  tuft->place(pose(0));
  const double start = tuft->nodePosition(0, n - 1).x();
  const int steps = static_cast<int>(std::lround(0.6 / rods.time_step));
  for (int step = 1; step <= steps; ++step) tuft->step(pose(step * rods.time_step));
  const Eigen::Vector3d force = tuft->contactForce(0, n - 1);
  EXPECT_GT(force.z(), 0.0);
  if (friction_over_push) *friction_over_push = std::hypot(force.x(), force.y()) / force.z();
  return tuft->nodePosition(0, n - 1).x() - start;
}

}  // namespace

// Exact minimisers of the discrete energy (κ = 2 tan(turn/2), first edge fixed, horizontal), made
// outside this project.
struct FixedEdgeCantilever {
  double gamma;
  int nodes;
  double tip_x, tip_z;
};

class ProjectedCantilever : public testing::TestWithParam<FixedEdgeCantilever> {};

TEST_P(ProjectedCantilever, SettlesWhereTheReferenceSaysAsTheStepGoesToZero) {
  // Fast projection takes the direction of the constraints' forces on the way to the end of the step,
  // so its shape at rest depends on the step: second order.
  const FixedEdgeCantilever& c = GetParam();
  const Eigen::Vector3d exact(c.tip_x, 0.0, c.tip_z);
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, -kPi / 2);
  std::vector<Eigen::Vector3d> tips;
  for (const double part : {0.05, 0.025}) {
    RodParameters rods = projection(part * 2 / highestFrequency(1, 1, 1, c.nodes));
    rods.gravity = c.gamma;
    rods.damping = 4.0;
    rods.tolerance = 1e-13;
    ContactParameters contact;
    contact.paper = false;
    const auto tuft = makeTuft(oneRod(makeUniformRod(1.0, 1.0, 1.0, c.nodes)), rods, contact);
    tuft->place(X);
    ASSERT_GT(settle(*tuft, X, c.nodes, 1e-13, 1000000), 0);
    tips.push_back(tuft->nodePosition(0, c.nodes - 1));

    const auto wrench = tuft->rodWrench(0);
    EXPECT_NEAR(wrench[2], -c.gamma, 3e-2 * part * part * c.gamma);
    double moment = 0;
    for (int node = 0; node < c.nodes; ++node) {
      const double mass = (node == 0 || node == c.nodes - 1 ? 0.5 : 1.0) / (c.nodes - 1);
      moment += mass * c.gamma * tuft->nodePosition(0, node).x();
    }
    EXPECT_NEAR(wrench[4], moment, 3e-1 * part * part * moment);
  }
  EXPECT_LT((tips[0] - exact).norm(), 2e-5);
  EXPECT_LT((tips[1] - exact).norm(), (tips[0] - exact).norm() / 3 + 1e-7);
  EXPECT_LT(((4 * tips[1] - tips[0]) / 3 - exact).norm(), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Reference, ProjectedCantilever,
                         testing::Values(FixedEdgeCantilever{0.9684309375, 10, 0.99449247065,
                                                             -0.0948253787702},
                                         FixedEdgeCantilever{10, 5, 0.826447027549, -0.47127302036},
                                         FixedEdgeCantilever{10, 10, 0.732852455911, -0.607554111536},
                                         FixedEdgeCantilever{100, 10, 0.248947599147, -0.855499468609}));

TEST(Projection, HoldsItsConstraintsInEveryStep) {
  const int n = 10;
  const double l = kReferenceLength / (n - 1);
  const RodParameters rods = projection(0.0002);
  const auto tuft = makeTuft(referenceRod(n), rods, ContactParameters{});
  const auto pose = [](double t) {
    return handleAt({0.02 * std::sin(10 * t), 0, 0.05 - 0.02 * std::sin(3 * t)},
                    -0.5 - 0.1 * std::sin(8 * t));
  };
  tuft->place(pose(0));
  double stretch = 0, root = 0, depth = 0;
  int touching = 0;
  for (int step = 1; step < 5000; ++step) {
    const Eigen::Isometry3d X = pose(step * rods.time_step);
    ASSERT_EQ(tuft->step(X).unconverged, 0) << step;
    const Eigen::Vector3d next = X * Eigen::Vector3d(0, 0, -l);
    root = std::max({root, (tuft->nodePosition(0, 0) - X.translation()).norm(),
                     (tuft->nodePosition(0, 1) - next).norm()});
    for (int node = 0; node + 1 < n; ++node)
      stretch = std::max(
          stretch, std::abs((tuft->nodePosition(0, node + 1) - tuft->nodePosition(0, node)).norm() - l));
    depth = std::max(depth, -tuft->rodOnPaper(0).lowest);
    touching += tuft->rodOnPaper(0).touching > 0;
    for (int node = 0; node < n; ++node) ASSERT_GE(tuft->contactForce(0, node).z(), 0.0);
  }
  EXPECT_GT(touching, 1000);
  EXPECT_LE(root, 2e-8 * l);
  EXPECT_LE(stretch, 1.01e-8 * l);
  EXPECT_LE(depth, 1e-8 * l);
}

TEST(Projection, IsStableJustBelowTheExplicitLimitAndNotAboveIt) {
  EXPECT_NEAR(referenceLimit(8), 0.72e-3, 0.01e-3);
  EXPECT_NEAR(referenceLimit(10), 0.43e-3, 0.01e-3);
  EXPECT_NEAR(referenceLimit(16), 0.15e-3, 0.01e-3);
  for (const int n : {8, 10, 16}) {
    for (const double part : {0.8, 1.5}) {
      const RodParameters rods = projection(part * referenceLimit(n));
      ContactParameters contact;
      contact.paper = false;
      const auto tuft = makeTuft(referenceRod(n), rods, contact);
      const Eigen::Isometry3d X = handleAt({0, 0, 0}, -kPi / 2);
      tuft->place(X);
      const int steps = static_cast<int>(0.5 / rods.time_step);
      int failed = 0;
      double fastest = 0;
      for (int step = 0; step < steps; ++step) {
        const Eigen::Vector3d before = tuft->nodePosition(0, n - 1);
        failed += tuft->step(X).unconverged;
        const double speed = (tuft->nodePosition(0, n - 1) - before).norm() / rods.time_step;
        fastest = std::isfinite(speed) ? std::max(fastest, speed) : 1e9;
      }
      if (part < 1) {
        EXPECT_EQ(failed, 0) << n;
        EXPECT_LT(fastest, 1.0) << n;  // the fall of the tip reaches a third of a metre a second
      } else {
        EXPECT_TRUE(failed > 0 || fastest > 10.0) << n;
      }
    }
  }
}

TEST(Projection, SlidesWhereTheConeWouldHold) {
  // At 30° a coefficient above tan 30° holds the tip where it touched; so it is with exact friction.
  RodParameters exact;
  exact.precision = "double";
  EXPECT_LT(std::abs(slideOfPressedTip(exact, 10.0)), 2e-4);

  const double frictionless = slideOfPressedTip(projection(0.0002), 0.0);
  EXPECT_GT(frictionless, 0.003);
  double ratio = 0;
  EXPECT_NEAR(slideOfPressedTip(projection(0.0002), 10.0, &ratio), frictionless, 0.05 * frictionless);
  EXPECT_LT(ratio, 0.1);  // friction has next to nothing left to stop
}

TEST(Projection, FrictionIsBoundByTheConeAndOpposesTheMotion) {
  const int n = 10;
  const RodParameters rods = projection(0.0002);
  ContactParameters contact;
  contact.paper_friction = 0.2;
  const auto tuft = makeTuft(referenceRod(n), rods, contact);
  const auto pose = [](double t) {
    return handleAt({-0.1 * t, 0, 0.04 - 0.03 * std::min(t, 0.2)}, -kPi / 6);
  };
  tuft->place(pose(0));
  int steps_with_friction = 0;
  for (int step = 1; step < 2500; ++step) {
    const Eigen::Vector3d before = tuft->nodePosition(0, n - 1);
    tuft->step(pose(step * rods.time_step));
    const Eigen::Vector3d force = tuft->contactForce(0, n - 1);
    if (force.z() == 0) continue;
    ASSERT_LE(std::hypot(force.x(), force.y()), 0.2 * force.z() * (1 + 1e-12));
    ASSERT_LE(force.head<2>().dot((tuft->nodePosition(0, n - 1) - before).head<2>()), 0.0);
    ++steps_with_friction;
  }
  EXPECT_GT(steps_with_friction, 1000);
}

TEST(Projection, GivesTheSameBitsForAnyNumberOfThreads) {
  BrushModel brush;
  for (int i = 0; i < 7; ++i) brush.rods.push_back(makeUniformRod(0.045 - 0.001 * i, 1.8e-7, 2e-4, 8));
  std::vector<std::uint64_t> hashes;
  for (const int threads : {1, 3}) {
    RodParameters rods = projection(0.0003);
    rods.threads = threads;
    const auto tuft = makeTuft(brush, rods, ContactParameters{});
    for (int step = 0; step < 300; ++step) tuft->step(handleAt({0.0001 * step, 0, 0.04}, -0.4));
    hashes.push_back(tuft->hash(1));
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}
