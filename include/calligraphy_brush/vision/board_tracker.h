#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calligraphy_brush/vision/board_parameters.h"

namespace calligraphy_brush {

/// A pinhole camera with lens distortion, as sensor_msgs/CameraInfo has it.
struct CameraModel {
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  ///< [px]; pixel (0, 0) has its middle at (0, 0)
  std::vector<double> distortion;                 ///< plumb_bob or rational_polynomial: 0, 4, 5 or 8
};

/// A marker of the board and its corners in the handle's frame [m]: as the marker is printed, upper
/// left, upper right, lower right, lower left.
struct BoardMarker {
  int id = 0;
  std::array<Eigen::Vector3d, 4> corners_H;
};

/// All markers of a board. Throws ParameterError: out of range, or more markers than the dictionary has.
std::vector<BoardMarker> makeBoard(const BoardParameters& parameters);

/// Where a board was seen.
struct BoardSighting {
  Eigen::Isometry3d X_CH = Eigen::Isometry3d::Identity();  ///< handle in the camera's optical frame
  int marker_count = 0;                                    ///< that the pose rests on
  double residual_px = 0.0;  ///< root mean square of seen minus projected corners [px]
};

/// Finds the pose of a board in grey pictures. Knows no ROS and no clock.
///
/// Corners: ArUco (Garrido-Jurado et al. 2014, Automatic generation and detection of highly reliable
/// fiducial markers under occlusion), refined to where lines fitted along the markers' edges meet.
/// Pose: minimum of the reprojection error by Levenberg–Marquardt. It begins from both poses that a flat
/// target allows (Collins & Bartoli 2014, Infinitesimal Plane-based Pose Estimation) or, where several
/// faces are seen, from SQPnP (Terzakis & Lourakis 2020); the least residual wins.
class BoardTracker {
 public:
  /// Throws ParameterError.
  explicit BoardTracker(const TrackerParameters& parameters);
  ~BoardTracker();

  /// The board in a picture of width × height bytes, rows `stride` bytes apart; or nothing, and why.
  /// Throws std::invalid_argument for a camera without focal length or with a number of distortion
  /// coefficients that no model has.
  std::optional<BoardSighting> find(const std::uint8_t* grey, int width, int height, std::size_t stride,
                                    const CameraModel& camera, std::string& problem) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace calligraphy_brush
