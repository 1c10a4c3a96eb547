#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "calligraphy_brush/motion/pose_track.h"

using namespace calligraphy_brush;

namespace {

constexpr std::int64_t kMillisecond = 1000000;

HandlePose poseAt(std::int64_t milliseconds, double x, double angle = 0.0) {
  HandlePose pose;
  pose.stamp_ns = milliseconds * kMillisecond;
  pose.position = {x, 2 * x, 0.05};
  pose.orientation = Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, 3).normalized());
  return pose;
}

}  // namespace

TEST(PoseTrack, GoesThroughEveryPose) {
  PoseTrack track{MotionParameters{}};
  for (int k = 0; k < 20; ++k)
    ASSERT_EQ(track.add(poseAt(8 * k + k % 3, 0.0001 * k * k, 0.1 * k)), PoseVerdict::kAccepted);
  for (int k = 0; k < 20; ++k) {
    const HandlePose want = poseAt(8 * k + k % 3, 0.0001 * k * k, 0.1 * k);
    const HandlePose got = track.at(want.stamp_ns);
    EXPECT_LT((got.position - want.position).norm(), 1e-15);
    EXPECT_LT(got.orientation.angularDistance(want.orientation), 1e-7);
  }
}

TEST(PoseTrack, HasNoKinksInPositionOrOrientation) {
  PoseTrack track{MotionParameters{}};
  for (int k = 0; k < 12; ++k)
    track.add(poseAt(8 * k, 0.01 * std::sin(0.9 * k), 0.3 * std::cos(1.3 * k)));
  const std::int64_t d = 1000;  // 1 µs
  for (int k = 1; k < 11; ++k) {
    const std::int64_t t = 8 * k * kMillisecond;
    const auto before = track.at(t - d), at = track.at(t), after = track.at(t + d);
    const double jump =
        ((after.position - at.position) - (at.position - before.position)).norm() / (d * 1e-9);
    EXPECT_LT(jump, 1e-2) << k;  // [m/s]; between poses the speed differs by metres a second
    const Eigen::Quaterniond first = before.orientation.conjugate() * at.orientation;
    const Eigen::Quaterniond second = at.orientation.conjugate() * after.orientation;
    EXPECT_LT((first.vec() - second.vec()).norm() * 2 / (d * 1e-9), 0.5) << k;  // [rad/s]
  }
}

TEST(PoseTrack, KeepsConstantVelocityAndRotation) {
  PoseTrack track{MotionParameters{}};
  for (int k = 0; k < 6; ++k) track.add(poseAt(10 * k, 0.002 * k, 0.2 * k));
  for (int ms = 10; ms <= 50; ++ms) {
    const HandlePose want = poseAt(ms, 0.0002 * ms, 0.02 * ms);
    EXPECT_LT((track.at(want.stamp_ns).position - want.position).norm(), 1e-14);
    EXPECT_LT(track.at(want.stamp_ns).orientation.angularDistance(want.orientation), 1e-7);
  }
}

TEST(PoseTrack, DoesNotDependOnWhatComesLater) {
  PoseTrack early{MotionParameters{}}, late{MotionParameters{}};
  for (int k = 0; k < 8; ++k) {
    early.add(poseAt(8 * k, 0.001 * k * k));
    late.add(poseAt(8 * k, 0.001 * k * k));
  }
  late.add(poseAt(64, -0.03));
  late.forgetBefore(40 * kMillisecond);
  for (std::int64_t t = 40 * kMillisecond; t <= 56 * kMillisecond; t += 100000)
    EXPECT_EQ(early.at(t).position, late.at(t).position);
}

TEST(PoseTrack, RefusesBadPosesAndStaysAsItWas) {
  PoseTrack track{MotionParameters{}};
  ASSERT_EQ(track.add(poseAt(0, 0)), PoseVerdict::kAccepted);
  ASSERT_EQ(track.add(poseAt(8, 0.001)), PoseVerdict::kAccepted);
  const double nan = std::numeric_limits<double>::quiet_NaN();

  HandlePose bad = poseAt(16, 0.002);
  bad.position.y() = nan;
  EXPECT_EQ(track.add(bad), PoseVerdict::kNotFinite);
  bad = poseAt(16, 0.002);
  bad.orientation.w() = std::numeric_limits<double>::infinity();
  EXPECT_EQ(track.add(bad), PoseVerdict::kNotFinite);
  bad = poseAt(16, 0.002);
  bad.position.x() = 1e300;
  EXPECT_EQ(track.add(bad), PoseVerdict::kOutOfReach);
  bad = poseAt(16, 0.002);
  bad.orientation.coeffs().setZero();
  EXPECT_EQ(track.add(bad), PoseVerdict::kZeroQuaternion);
  EXPECT_EQ(track.add(poseAt(8, 0.002)), PoseVerdict::kNotLater);
  EXPECT_EQ(track.add(poseAt(3, 0.002)), PoseVerdict::kNotLater);
  EXPECT_EQ(track.add(poseAt(16, 0.5)), PoseVerdict::kTooFast);
  EXPECT_EQ(track.add(poseAt(9, 0.001, 3.0)), PoseVerdict::kTooFast);

  EXPECT_EQ(track.newest().stamp_ns, 8 * kMillisecond);
  EXPECT_EQ(track.add(poseAt(16, 0.002)), PoseVerdict::kAccepted);
}

TEST(PoseTrack, NormalisesQuaternions) {
  PoseTrack track{MotionParameters{}};
  HandlePose pose = poseAt(0, 0, 0.4);
  pose.orientation.coeffs() *= 7.0;
  ASSERT_EQ(track.add(pose), PoseVerdict::kAccepted);
  EXPECT_NEAR(track.at(0).orientation.norm(), 1.0, 1e-15);
}
