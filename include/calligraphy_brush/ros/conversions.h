#pragma once

#include <calligraphy_brush/ParameterValues.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/time.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdint>
#include <string>

#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/paper/paper.h"
#include "calligraphy_brush/sim/simulator.h"

/// Messages from values and values from messages: pure functions, usable without a master.
namespace calligraphy_brush {

/// Nanoseconds since the epoch of the time. Exact.
std::int64_t toNanoseconds(const ros::Time& time);

/// Inverse of toNanoseconds on what ros::Time can hold, 0 .. 2³² s; clamped to that.
ros::Time toRosTime(std::int64_t stamp_ns);

/// The pose as it stands in the message: the frame is the caller's business, and nothing is checked
/// or normalised, so that PoseTrack sees (and refuses) what was really sent.
HandlePose toHandlePose(const geometry_msgs::PoseStamped& message);

/// Inverse of toHandlePose, exact to the bit.
geometry_msgs::PoseStamped toPoseStamped(const HandlePose& pose, const std::string& frame);

/// The pose X_PH of a handle given as X_FH, from X_PF. The stamp is the pose's; nothing is
/// checked or normalised: a zero or NaN quaternion stays what it is and is refused as that.
HandlePose transformed(const geometry_msgs::TransformStamped& X_PF, const HandlePose& pose_F);

/// The handle where a transform from the paper frame to the handle's puts it. Exact to the bit.
HandlePose toHandlePose(const geometry_msgs::TransformStamped& X_PH);

/// X_PH as a transform from paper_frame to handle_frame.
geometry_msgs::TransformStamped toTransformStamped(const HandlePose& pose,
                                                   const std::string& paper_frame,
                                                   const std::string& handle_frame);

/// All parameters that decide a stroke, without a header.
ParameterValues toParameterValues(const SimulatorParameters& parameters);

/// Inverse of toParameterValues, exact to the bit. Parameters that the message lacks keep their
/// defaults. Throws ParameterError naming each one that is unknown, of a wrong type or out of range.
SimulatorParameters toSimulatorParameters(const ParameterValues& message);

/// Force [N] and torque [N m] on the handle, in the frame of the header.
geometry_msgs::WrenchStamped toWrenchStamped(const HandleWrench& wrench, const std_msgs::Header& header);

/// The picture of the sheet, mono8, top row first: 255 is paper, 0 is black ink.
sensor_msgs::Image toImage(const Paper& paper, const std_msgs::Header& header);

/// The picture as a map lying on the sheet, for stock rviz: 0 is paper, 100 is black ink, row 0 is
/// the lowest (least y).
///
/// `picture` is mono8 as from toImage; pixel_size [m]. Rounds 256 greys to 101.
nav_msgs::OccupancyGrid toOccupancyGrid(const sensor_msgs::Image& picture, double pixel_size);

/// What to show of the brush in 3D: all rods as one LINE_LIST, each node from hair to black by its ink;
/// the nodes that the sheet pushes as POINTS; ferrule and shaft; the force of the tuft on the handle as
/// an arrow at the shaft's upper end, 4 m/N and at most 15 cm, that begins there if it pulls and ends
/// there if it pushes; and the edge of the sheet. Without brush (before the first pose) only the sheet
/// is shown and the rest is deleted. Positions in the frame of the header, which must be the paper's.
visualization_msgs::MarkerArray toMarkers(const Simulator& simulator, bool with_brush,
                                          const std_msgs::Header& header);

}  // namespace calligraphy_brush
