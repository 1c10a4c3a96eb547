#include "calligraphy_brush/vision/board_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <string>

#include "render_board.h"

// Pictures with a known pose: rendered through known intrinsics, with blur, noise and a lens.

namespace calligraphy_brush {
namespace {

constexpr int kWidth = 1280, kHeight = 720;

CameraModel makeCamera(bool distorted) {
  CameraModel camera;
  camera.fx = 950.0;
  camera.fy = 948.0;
  camera.cx = 645.3;
  camera.cy = 352.8;
  if (distorted) camera.distortion = {-0.28, 0.09, 0.0007, -0.0011, -0.012};
  return camera;
}

struct Errors {
  double position = 0.0;  // of the handle's origin, where the tuft leaves the ferrule [m]
  double angle = 0.0;     // [rad]
};

Errors compare(const Eigen::Isometry3d& found, const Eigen::Isometry3d& truth) {
  return {(found.translation() - truth.translation()).norm(),
          Eigen::Quaterniond(found.linear()).angularDistance(Eigen::Quaterniond(truth.linear()))};
}

/// The largest errors over random views at a distance; the board must be found in each.
Errors worstOf(const TrackerParameters& parameters, const CameraModel& camera,
               const CameraFaults& faults, double distance, int views) {
  const BoardTracker tracker(parameters);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  std::vector<double> positions, angles;
  for (int view = 0; view < views; ++view) {
    const Eigen::Isometry3d truth = lookAtBoard(parameters.board, distance, 3.14 * number(random),
                                                0.5 + 0.4 * number(random), 0.3 * number(random));
    const cv::Mat picture = renderBoard(parameters.board, truth, camera, kWidth, kHeight, faults,
                                        static_cast<std::uint32_t>(view));
    if (const char* folder = std::getenv("CALLIGRAPHY_PICTURES"))
      cv::imwrite(std::string(folder) + "/board_" + std::to_string(view) + ".png", picture);
    std::string problem;
    const auto found = tracker.find(picture.data, kWidth, kHeight, picture.step, camera, problem);
    EXPECT_TRUE(found) << "view " << view << ": " << problem;
    if (!found) continue;
    const Errors errors = compare(found->X_CH, truth);
    positions.push_back(errors.position);
    angles.push_back(errors.angle);
    EXPECT_LT(errors.position, 1e-3) << "view " << view << ", " << found->marker_count << " markers";
    EXPECT_LT(errors.angle, 3.14159 / 180.0) << "view " << view;
  }
  if (positions.empty()) return {1e9, 1e9};
  std::sort(positions.begin(), positions.end());
  std::sort(angles.begin(), angles.end());
  std::printf(
      "%d views at %.2f m, blur %.1f px, noise %.0f, %s lens: position median %.3f, worst %.3f mm; "
      "angle median %.3f, worst %.3f deg\n",
      views, distance, faults.blur, faults.noise, camera.distortion.empty() ? "ideal" : "distorting",
      1e3 * positions[positions.size() / 2], 1e3 * positions.back(), 57.2958 * angles[angles.size() / 2],
      57.2958 * angles.back());
  return {positions.back(), angles.back()};
}

TEST(BoardTracker, FindsThePoseInCleanPictures) {
  worstOf({}, makeCamera(false), {0.5, 0.0}, 0.5, 12);
}

TEST(BoardTracker, FindsThePoseThroughADistortingLensWithBlurAndNoise) {
  worstOf({}, makeCamera(true), {1.0, 5.0}, 0.5, 16);
}

TEST(BoardTracker, ALensThatIsNotToldOfIsNotBelieved) {
  TrackerParameters parameters;
  Eigen::Isometry3d truth = lookAtBoard(parameters.board, 0.4, 0.7, 0.5, 0.0);
  truth.pretranslate(Eigen::Vector3d(0.17, -0.08, 0.0));  // to a corner of the picture
  const cv::Mat picture = renderBoard(parameters.board, truth, makeCamera(true), kWidth, kHeight, {}, 0);
  parameters.max_residual_px = 0.4;
  std::string problem;
  EXPECT_FALSE(BoardTracker(parameters)
                   .find(picture.data, kWidth, kHeight, picture.step, makeCamera(false), problem));
  EXPECT_NE(problem.find("tracker/max_residual_px"), std::string::npos) << problem;
}

TEST(BoardTracker, AFlatBoardIsNotTakenForItsMirrorPose) {
  TrackerParameters parameters;
  parameters.board.faces = 1;
  parameters.board.columns = 3;
  parameters.board.rows = 3;
  parameters.board.dictionary = "6x6_250";
  const BoardTracker tracker(parameters);
  for (const double azimuth : {-0.6, -0.3, 0.3, 0.6}) {
    const Eigen::Isometry3d truth = lookAtBoard(parameters.board, 0.5, azimuth, 0.3, 0.1);
    const cv::Mat picture =
        renderBoard(parameters.board, truth, makeCamera(true), kWidth, kHeight, {1.0, 5.0}, 1);
    std::string problem;
    const auto found =
        tracker.find(picture.data, kWidth, kHeight, picture.step, makeCamera(true), problem);
    ASSERT_TRUE(found) << problem;
    EXPECT_EQ(found->marker_count, 9);
    EXPECT_LT(compare(found->X_CH, truth).position, 1e-3) << azimuth;
    EXPECT_LT(compare(found->X_CH, truth).angle, 3.14159 / 180.0) << azimuth;
  }
}

TEST(BoardTracker, WithoutABoardThereIsNoPose) {
  const BoardTracker tracker{TrackerParameters()};
  const cv::Mat grey(kHeight, kWidth, CV_8UC1, cv::Scalar(110));
  std::string problem;
  EXPECT_FALSE(tracker.find(grey.data, kWidth, kHeight, grey.step, makeCamera(false), problem));
  EXPECT_NE(problem.find("0 markers"), std::string::npos) << problem;
  EXPECT_THROW(tracker.find(grey.data, kWidth, kHeight, grey.step, CameraModel(), problem),
               std::invalid_argument);
  CameraModel odd = makeCamera(false);
  odd.distortion.assign(3, 0.0);
  EXPECT_THROW(tracker.find(grey.data, kWidth, kHeight, grey.step, odd, problem), std::invalid_argument);
}

TEST(Board, MarkersLookOutwardsAndDoNotOverlap) {
  const BoardParameters parameters;
  const auto board = makeBoard(parameters);
  ASSERT_EQ(board.size(), 12U);
  for (const BoardMarker& marker : board) {
    const auto& c = marker.corners_H;
    EXPECT_NEAR((c[1] - c[0]).norm(), parameters.marker_length, 1e-12);
    EXPECT_NEAR((c[3] - c[0]).norm(), parameters.marker_length, 1e-12);
    EXPECT_GT(c[0].z(), c[3].z());
    const Eigen::Vector3d middle = 0.25 * (c[0] + c[1] + c[2] + c[3]);
    const Eigen::Vector3d outward(middle.x(), middle.y(), 0.0);
    EXPECT_GT((c[3] - c[0]).cross(c[1] - c[0]).dot(outward), 0.0);
  }
  BoardParameters many;
  many.faces = 12;
  many.rows = 5;
  EXPECT_THROW(makeBoard(many), ParameterError);
}

}  // namespace
}  // namespace calligraphy_brush
