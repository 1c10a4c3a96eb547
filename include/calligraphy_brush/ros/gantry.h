#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>

#include "calligraphy_brush/motion/pose_track.h"

/// The simulated arm of config/robots/gantry.urdf: kinematics in closed form.
namespace calligraphy_brush {

/// Joints of the gantry, from the sheet to the brush; metres, then radians.
constexpr std::array<const char*, 6> kGantryJoints = {"slide_x",    "slide_y",     "slide_z",
                                                      "wrist_roll", "wrist_pitch", "wrist_yaw"};

/// From the ferrule up the shaft to where the axes of the wrist meet [m]; the joint "grip" of the URDF.
constexpr double kGantryGrip = 0.2;

/// Positions of the joints that put the handle at a pose of the paper frame.
///
///   p_W = p + R (0, 0, grip),  R = Rx(roll) Ry(pitch) Rz(yaw)
///
/// p_W: centre of the wrist [m]. Exact but for rounding; pitch in [−π/2, π/2]. A shaft along the
/// paper's x has no unique roll and yaw: roll is then what atan2 makes of rounding, and the pose is
/// right all the same. Precondition: a unit quaternion.
inline std::array<double, 6> gantryJoints(const HandlePose& pose) {
  const Eigen::Matrix3d R = pose.orientation.toRotationMatrix();
  const Eigen::Vector3d wrist = pose.position + kGantryGrip * R.col(2);
  const double roll = std::atan2(-R(1, 2), R(2, 2));
  // Of what roll leaves, so that they stay exact at the singular pose: Rx(−roll) R = Ry(pitch) Rz(yaw).
  const Eigen::Matrix3d rest = Eigen::AngleAxisd(-roll, Eigen::Vector3d::UnitX()).toRotationMatrix() * R;
  const double pitch = std::atan2(rest(0, 2), rest(2, 2));
  const double yaw = std::atan2(rest(1, 0), rest(1, 1));
  return {wrist.x(), wrist.y(), wrist.z(), roll, pitch, yaw};
}

}  // namespace calligraphy_brush
