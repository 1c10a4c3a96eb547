#include "calligraphy_brush/motion/pose_track.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Rotation vector of q [rad], of length ≤ π.
Vector3d rotationVector(const Quaterniond& q) {
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * (q.w() < 0 ? -1.0 : 1.0) * q.vec();
  const double half_angle = q.w() < 0 ? std::atan2(-sine, -q.w()) : std::atan2(sine, q.w());
  return 2.0 * half_angle / sine * q.vec();
}

/// Inverse of rotationVector.
Quaterniond rotation(const Vector3d& vector) {
  const double angle = vector.norm();
  const double sinc = angle < 1e-12 ? 0.5 : std::sin(0.5 * angle) / angle;
  Quaterniond q;
  q.w() = std::cos(0.5 * angle);
  q.vec() = sinc * vector;
  return q;
}

constexpr double kSecondsPerNanosecond = 1e-9;

double secondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * kSecondsPerNanosecond;
}

}  // namespace

const char* toString(PoseVerdict verdict) {
  switch (verdict) {
    case PoseVerdict::kAccepted: return "accepted";
    case PoseVerdict::kNotFinite: return "position or orientation is not finite";
    case PoseVerdict::kOutOfReach: return "position is further away than motion/max_distance";
    case PoseVerdict::kZeroQuaternion: return "orientation quaternion has no length";
    case PoseVerdict::kNotLater: return "time stamp is not after the pose before it";
    case PoseVerdict::kTooFast: return "jump faster than motion/max_speed or motion/max_angular_speed";
  }
  return "unknown";
}

PoseTrack::PoseTrack(const MotionParameters& parameters) : parameters_(parameters) {
  checkParameters(parameters);
}

PoseVerdict PoseTrack::checkAlone(const HandlePose& pose) const {
  const double length = pose.orientation.norm();
  if (!pose.position.allFinite() || !std::isfinite(length)) return PoseVerdict::kNotFinite;
  if (!(pose.position.norm() <= parameters_.max_distance)) return PoseVerdict::kOutOfReach;
  return length < 1e-3 ? PoseVerdict::kZeroQuaternion : PoseVerdict::kAccepted;
}

PoseVerdict PoseTrack::add(HandlePose pose) {
  const PoseVerdict alone = checkAlone(pose);
  if (alone != PoseVerdict::kAccepted) return alone;
  pose.orientation.normalize();

  Knot knot{pose, Vector3d::Zero(), Vector3d::Zero()};
  if (!poses_.empty()) {
    const HandlePose& before = poses_.back().pose;
    if (pose.stamp_ns <= before.stamp_ns) return PoseVerdict::kNotLater;
    const double dt = secondsBetween(before.stamp_ns, pose.stamp_ns);
    knot.velocity = (pose.position - before.position) / dt;
    knot.angular_velocity = rotationVector(before.orientation.conjugate() * pose.orientation) / dt;
    if (!(knot.velocity.norm() <= parameters_.max_speed) ||
        !(knot.angular_velocity.norm() <= parameters_.max_angular_speed))
      return PoseVerdict::kTooFast;
  }
  poses_.push_back(knot);
  return PoseVerdict::kAccepted;
}

HandlePose PoseTrack::at(std::int64_t stamp_ns) const {
  const auto after =
      std::upper_bound(poses_.begin(), poses_.end(), stamp_ns,
                       [](std::int64_t stamp, const Knot& knot) { return stamp < knot.pose.stamp_ns; });
  if (after == poses_.begin()) return poses_.front().pose;
  if (after == poses_.end()) return poses_.back().pose;
  const Knot& a = *(after - 1);
  const Knot& b = *after;

  const double dt = secondsBetween(a.pose.stamp_ns, b.pose.stamp_ns);
  const double s = secondsBetween(a.pose.stamp_ns, stamp_ns) / dt;
  const double r = 1.0 - s;
  // Bernstein polynomials of degree 3, and their partial sums from the right.
  const double b1 = 3.0 * s * r * r, b2 = 3.0 * s * s * r, b3 = s * s * s;

  HandlePose pose;
  pose.stamp_ns = stamp_ns;
  const Vector3d control_a = a.pose.position + a.velocity * (dt / 3.0);
  const Vector3d control_b = b.pose.position - b.velocity * (dt / 3.0);
  pose.position = r * r * r * a.pose.position + b1 * control_a + b2 * control_b + b3 * b.pose.position;

  const Vector3d turn_a = a.angular_velocity * (dt / 3.0);
  const Vector3d turn_b = b.angular_velocity * (dt / 3.0);
  const Vector3d turn_middle = rotationVector(rotation(-turn_a) * a.pose.orientation.conjugate() *
                                              b.pose.orientation * rotation(-turn_b));
  pose.orientation = a.pose.orientation * rotation(turn_a * (b1 + b2 + b3)) *
                     rotation(turn_middle * (b2 + b3)) * rotation(turn_b * b3);
  pose.orientation.normalize();
  return pose;
}

void PoseTrack::forgetBefore(std::int64_t stamp_ns) {
  while (poses_.size() > 2 && poses_[1].pose.stamp_ns <= stamp_ns) poses_.pop_front();
}

}  // namespace calligraphy_brush
