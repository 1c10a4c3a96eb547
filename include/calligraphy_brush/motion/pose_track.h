#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>

#include "calligraphy_brush/motion/motion_parameters.h"

namespace calligraphy_brush {

/// Pose X_PH of the brush handle H in the paper frame P at a time stamp.
struct HandlePose {
  std::int64_t stamp_ns = 0;                                        ///< time since any epoch [ns]
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< p_PH [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< R_PH; identity: upright
};

/// Why a pose was taken or refused.
enum class PoseVerdict {
  kAccepted,
  kNotFinite,       ///< NaN or infinity in position or orientation
  kOutOfReach,      ///< further than MotionParameters::max_distance from the sheet's corner
  kZeroQuaternion,  ///< orientation of length below 1e-3: no direction in it
  kNotLater,        ///< stamp not after the newest accepted pose
  kTooFast,         ///< would need more than MotionParameters::max_speed or max_angular_speed
};

/// "accepted", "not finite", ...: for logs.
const char* toString(PoseVerdict verdict);

/// Time-ordered handle poses, and the C1 motion through them.
///
/// Causal: the motion between two poses depends on those up to the later one and on nothing after
/// it, so a live stroke and its replay are the same. Velocity at pose k is the backward difference
/// to pose k − 1; position is the cubic Hermite curve through poses and velocities, orientation the
/// cumulative cubic Bézier quaternion curve of Kim, Kim & Shin 1995 (A General Construction Scheme
/// for Unit Quaternion Curves with Simple High Order Derivatives, section 4.2), C1 as well.
class PoseTrack {
 public:
  explicit PoseTrack(const MotionParameters& parameters);

  /// Appends a pose, or refuses it and leaves the track as it was. Quaternions of any length
  /// ≥ 1e-3 are normalised.
  PoseVerdict add(HandlePose pose);

  /// What can be said of a pose without knowing those before it: kAccepted, kNotFinite, kOutOfReach
  /// or kZeroQuaternion.
  PoseVerdict checkAlone(const HandlePose& pose) const;

  bool empty() const { return poses_.empty(); }
  const HandlePose& newest() const { return poses_.back().pose; }
  const HandlePose& oldest() const { return poses_.front().pose; }

  /// Pose at a time; clamped to the oldest and the newest pose. Precondition: not empty.
  HandlePose at(std::int64_t stamp_ns) const;

  /// Forgets poses that no time ≥ stamp_ns needs.
  void forgetBefore(std::int64_t stamp_ns);

  /// Forgets everything: the next pose starts a new track, anywhere and at any time.
  void clear() { poses_.clear(); }

 private:
  struct Knot {
    HandlePose pose;
    Eigen::Vector3d velocity;          // [m/s], in P
    Eigen::Vector3d angular_velocity;  // [rad/s], in H
  };

  MotionParameters parameters_;
  std::deque<Knot> poses_;
};

}  // namespace calligraphy_brush
