#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "calligraphy_brush/vision/board_tracker.h"

namespace calligraphy_brush {

/// What is wrong with a camera's pictures.
struct CameraFaults {
  double blur = 0.0;   ///< standard deviation [px]
  double noise = 0.0;  ///< standard deviation [grey of 255]
};

/// A camera at `distance` [m] from the middle of the board that looks at it from an azimuth and an
/// elevation [rad] in the handle's frame, turned by `roll` about its axis. Returns X_CH.
inline Eigen::Isometry3d lookAtBoard(const BoardParameters& board, double distance, double azimuth,
                                     double elevation, double roll) {
  const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                  std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
  const Eigen::Vector3d middle(0.0, 0.0, board.height);
  Eigen::Matrix3d R_HC;  // optical frame: x right, y down, z forward
  R_HC.col(2) = -direction;
  R_HC.col(0) = R_HC.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
  R_HC.col(1) = R_HC.col(2).cross(R_HC.col(0));
  Eigen::Isometry3d X_HC = Eigen::Isometry3d::Identity();
  X_HC.linear() = R_HC * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ());
  X_HC.translation() = middle + distance * direction;
  return X_HC.inverse();
}

/// The board as the camera sees it: each marker through its own homography, 4 x 4 samples a pixel, then
/// the lens' distortion, blur and noise. Faces turned away and what others hide are not shown.
inline cv::Mat renderBoard(const BoardParameters& board, const Eigen::Isometry3d& X_CH,
                           const CameraModel& camera, int width, int height, const CameraFaults& faults,
                           std::uint32_t seed) {
  constexpr int samples = 4;
  constexpr int marker_px = 240;
  const auto dictionary = cv::aruco::getPredefinedDictionary(
      board.dictionary == "6x6_250" ? cv::aruco::DICT_6X6_250 : cv::aruco::DICT_4X4_50);
  const int margin = static_cast<int>(0.6 * board.separation / board.marker_length * marker_px);
  cv::Mat fine(height * samples, width * samples, CV_8UC1, cv::Scalar(110));
  for (const BoardMarker& marker : makeBoard(board)) {
    std::vector<Eigen::Vector3d> corners_C;
    for (const Eigen::Vector3d& corner_H : marker.corners_H) corners_C.push_back(X_CH * corner_H);
    // Clockwise from outside: the normal points at the camera if the face does.
    const Eigen::Vector3d normal =
        (corners_C[3] - corners_C[0]).cross(corners_C[1] - corners_C[0]).normalized();
    if (normal.dot(-corners_C[0].normalized()) < 0.1) continue;

    cv::Mat printed, texture;
    cv::aruco::drawMarker(dictionary, marker.id, marker_px, printed, 1);
    cv::copyMakeBorder(printed, texture, margin, margin, margin, margin, cv::BORDER_CONSTANT, 255);
    texture = 25 + 0.8 * texture;  // ink is not black, paper not white
    std::vector<cv::Point2f> from, to;
    const float a = static_cast<float>(margin) - 0.5F, b = a + marker_px;
    from = {{a, a}, {b, a}, {b, b}, {a, b}};
    for (const Eigen::Vector3d& p : corners_C)
      to.emplace_back(
          static_cast<float>(samples * (camera.fx * p.x() / p.z() + camera.cx) + 0.5 * (samples - 1)),
          static_cast<float>(samples * (camera.fy * p.y() / p.z() + camera.cy) + 0.5 * (samples - 1)));
    cv::Rect box = cv::boundingRect(to);
    const int around = box.width / 3 + 8;
    box = cv::Rect(box.x - around, box.y - around, box.width + 2 * around, box.height + 2 * around) &
          cv::Rect(0, 0, fine.cols, fine.rows);
    if (box.empty()) continue;
    for (cv::Point2f& point : to)
      point -= cv::Point2f(static_cast<float>(box.x), static_cast<float>(box.y));
    cv::Mat part = fine(box);
    cv::warpPerspective(texture, part, cv::getPerspectiveTransform(from, to), box.size(), cv::INTER_AREA,
                        cv::BORDER_TRANSPARENT);
  }
  cv::Mat picture;
  cv::resize(fine, picture, {width, height}, 0, 0, cv::INTER_AREA);

  if (!camera.distortion.empty()) {
    const cv::Matx33d K(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
    std::vector<cv::Point2f> seen, ideal;
    for (int row = 0; row < height; ++row)
      for (int column = 0; column < width; ++column)
        seen.emplace_back(static_cast<float>(column), static_cast<float>(row));
    cv::undistortPoints(seen, ideal, K, camera.distortion, cv::noArray(), K);
    const cv::Mat map(height, width, CV_32FC2, ideal.data());
    cv::Mat distorted;
    cv::remap(picture, distorted, map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    picture = distorted;
  }
  if (faults.blur > 0.0) cv::GaussianBlur(picture, picture, {0, 0}, faults.blur);
  if (faults.noise > 0.0) {
    std::mt19937 random(seed);
    std::normal_distribution<double> grey(0.0, faults.noise);
    for (int row = 0; row < height; ++row)
      for (int column = 0; column < width; ++column) {
        std::uint8_t& pixel = picture.at<std::uint8_t>(row, column);
        pixel = cv::saturate_cast<std::uint8_t>(pixel + grey(random));
      }
  }
  return picture;
}

}  // namespace calligraphy_brush
