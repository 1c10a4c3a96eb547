#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "rod_scene.h"

using namespace calligraphy_brush;

namespace {

constexpr double kPi = 3.14159265358979323846;

/// The same rod, of which the model says nothing that would let it go without frames.
RodModel withFrames(RodModel rod) {
  rod.bending_stiffness_2 = rod.bending_stiffness;
  rod.twisting_stiffness = rod.bending_stiffness;
  for (double& stiffness : rod.twisting_stiffness) stiffness *= 0.7;
  return rod;
}

}  // namespace

// Straight, isotropic, free-tipped rods take the kernel without frames: nothing may tell.
class BothKernels : public testing::TestWithParam<std::tuple<const char*, const char*, const char*>> {};

TEST_P(BothKernels, AgreeOnWhatBothCanDo) {
  RodParameters rods = exactRods(0.001);
  std::tie(rods.scheme, rods.bending_law, rods.clamp) = GetParam();
  ContactParameters contact;
  contact.multiplier_updates = 200;
  contact.tolerance = 1e-13;
  const RodModel plain = makeUniformRod(kReferenceLength, kReferenceBending, kReferenceDensity, 12);
  ASSERT_FALSE(plain.needsFrames());
  ASSERT_TRUE(withFrames(plain).needsFrames());
  const auto a = makeTuft(oneRod(plain), rods, contact);
  const auto b = makeTuft(oneRod(withFrames(plain)), rods, contact);
  // Swung in the air, pressed, and drawn away sideways.
  const auto pose = [](int step) {
    const double press = std::clamp((step - 200) / 200.0, 0.0, 1.0);
    return handleAt(
        {0.0002 * std::max(0, step - 450), 0.005 * std::sin(0.02 * step), 0.055 - 0.02 * press},
        0.3 + 0.2 * std::sin(0.03 * step));
  };
  a->place(pose(0));
  b->place(pose(0));
  double worst = 0;
  for (int step = 1; step < 700; ++step) {
    EXPECT_EQ(a->step(pose(step)).unconverged, 0);
    EXPECT_EQ(b->step(pose(step)).unconverged, 0);
    for (int node = 0; node < 12; ++node)
      worst = std::max(worst, (a->nodePosition(0, node) - b->nodePosition(0, node)).norm());
  }
  EXPECT_LT(worst, 1e-9 * kReferenceLength);
  EXPECT_LT((a->rodWrench(0) - b->rodWrench(0)).norm(), 1e-7 * a->rodWrench(0).norm());
}

INSTANTIATE_TEST_SUITE_P(Schemes, BothKernels,
                         testing::Combine(testing::Values("backward_euler", "bdf2"),
                                          testing::Values("tangent", "arc", "sine"),
                                          testing::Values("half", "corrected")));

TEST(FramedRods, GoBackToTheirNaturalShape) {
  // Joints that turn by κ̄ l each: a polygon round a circle, and a helix where they twist as well.
  const int n = 40;
  const double length = 1.0, l = length / (n - 1);
  for (const double twist : {0.0, 6.0}) {
    RodModel rod = withFrames(makeUniformRod(length, 1.0, 1.0, n));
    rod.natural_strain.assign(n - 1, Eigen::Vector3d(0, 4.0, twist));
    RodParameters rods = exactRods(0.05);
    rods.gravity = 0;
    rods.damping = 5;
    rods.scheme = "backward_euler";
    ContactParameters contact;
    contact.paper = false;
    const auto tuft = makeTuft(oneRod(rod), rods, contact);
    const Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    tuft->place(X);
    ASSERT_GT(settle(*tuft, X, n, 1e-13, 20000), 0);
    for (int node = 1; node + 2 < n; ++node) {
      const Eigen::Vector3d e0 = tuft->nodePosition(0, node) - tuft->nodePosition(0, node - 1);
      const Eigen::Vector3d e1 = tuft->nodePosition(0, node + 1) - tuft->nodePosition(0, node);
      EXPECT_NEAR(2 * std::tan(0.5 * std::acos(std::min(1.0, e0.dot(e1) / (l * l)))), 4.0 * l, 1e-7);
      const Eigen::Vector3d e2 = tuft->nodePosition(0, node + 2) - tuft->nodePosition(0, node + 1);
      const Eigen::Vector3d b0 = e0.cross(e1), b1 = e1.cross(e2);
      const double torsion = std::atan2(b0.cross(b1).dot(e1) / l, b0.dot(b1));
      EXPECT_NEAR(torsion, twist * l, 1e-7);
    }
    EXPECT_LT(tuft->rodWrench(0).norm(), 1e-8);
  }
}

TEST(FramedRods, BendAboutTheirSofterAxis) {
  // A dead load along the diagonal of the two principal axes bends the rod towards the softer one.
  RodModel rod = withFrames(makeUniformRod(1.0, 1.0, 1.0, 20));
  for (double& stiffness : rod.bending_stiffness_2) stiffness = 50.0;
  RodParameters rods = exactRods(0.05);
  rods.gravity = 0.1;
  rods.damping = 5;
  rods.scheme = "backward_euler";
  ContactParameters contact;
  contact.paper = false;
  const auto tuft = makeTuft(oneRod(rod), rods, contact);
  Eigen::Isometry3d X = handleAt({0, 0, 0}, -kPi / 2);  // along +x
  X.linear() = X.linear() * Eigen::AngleAxisd(kPi / 4, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  tuft->place(X);
  ASSERT_GT(settle(*tuft, X, 20, 1e-13, 20000), 0);
  // Small deflections: w L⁴/(8 EI) along each axis, the load's part on each being 1/√2.
  const Eigen::Vector3d tip = tuft->nodePosition(0, 19);
  const double soft = 0.1 / std::sqrt(2.0) / 8, stiff = soft / 50;
  EXPECT_NEAR(std::abs(tip.y()), (soft - stiff) / std::sqrt(2.0), 2e-2 * soft);
  EXPECT_NEAR(tip.z(), -(soft + stiff) / std::sqrt(2.0), 2e-2 * soft);
}

TEST(FramedRods, HoldTheFarEndWhereItIsClamped) {
  RodModel rod = withFrames(makeUniformRod(1.0, 1.0, 1.0, 30));
  rod.end_clamped = true;
  RodParameters rods = exactRods(0.05);
  rods.gravity = 0;
  rods.damping = 20;
  rods.scheme = "backward_euler";
  ContactParameters contact;
  contact.paper = false;
  contact.multiplier_updates = 50;
  contact.tolerance = 1e-12;
  const auto tuft = makeTuft(oneRod(rod), rods, contact);
  const Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  tuft->place(X);
  const auto end = [&](double u) {
    Eigen::Isometry3d E = handleAt({0.1 * u, 0, -1.0 + 0.2 * u});
    // At rest the frame's third axis points down the rod.
    E.linear() = (Eigen::Matrix3d() << 1, 0, 0, 0, -1, 0, 0, 0, -1).finished() *
                 Eigen::AngleAxisd(1.5 * u, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    return E;
  };
  for (int step = 1; step <= 400; ++step) {
    tuft->moveEnd(0, end(std::min(1.0, step / 200.0)));
    EXPECT_EQ(tuft->step(X).unconverged, 0);
    EXPECT_LT((tuft->nodePosition(0, 29) - end(std::min(1.0, step / 200.0)).translation()).norm(),
              1e-10);
  }
  // Forces at the two clamps are in balance.
  EXPECT_LT((tuft->rodWrench(0).head<3>() + tuft->endForce(0)).norm(), 1e-6 * tuft->endForce(0).norm());
  EXPECT_GT(tuft->endForce(0).norm(), 1.0);
  EXPECT_THROW(makeTuft(referenceRod(5), rods, contact)->moveEnd(0, X), std::invalid_argument);
}
