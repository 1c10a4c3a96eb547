#include "calligraphy_brush/vision/board_tracker.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

cv::aruco::PREDEFINED_DICTIONARY_NAME findDictionary(const std::string& name) {
  if (name == "5x5_100") return cv::aruco::DICT_5X5_100;
  if (name == "6x6_250") return cv::aruco::DICT_6X6_250;
  if (name == "apriltag_36h11") return cv::aruco::DICT_APRILTAG_36h11;
  return cv::aruco::DICT_4X4_50;
}

Eigen::Isometry3d toIsometry(const cv::Mat& rotation_vector, const cv::Mat& translation) {
  cv::Mat rotation;
  cv::Rodrigues(rotation_vector, rotation);
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  Eigen::Matrix3d R;
  cv::cv2eigen(rotation, R);
  X.linear() = R;
  X.translation() =
      Eigen::Vector3d(translation.at<double>(0), translation.at<double>(1), translation.at<double>(2));
  return X;
}

/// Grey value between pixels, bilinear; false outside of the picture.
bool sample(const cv::Mat& picture, const cv::Point2d& at, double& grey) {
  const int x = static_cast<int>(std::floor(at.x)), y = static_cast<int>(std::floor(at.y));
  if (x < 0 || y < 0 || x + 1 >= picture.cols || y + 1 >= picture.rows) return false;
  const double u = at.x - x, v = at.y - y;
  const std::uint8_t* upper = picture.ptr<std::uint8_t>(y) + x;
  const std::uint8_t* lower = picture.ptr<std::uint8_t>(y + 1) + x;
  grey = (1 - v) * ((1 - u) * upper[0] + u * upper[1]) + v * ((1 - u) * lower[0] + u * lower[1]);
  return true;
}

/// The line along the edge between dark and light near the straight from a to b; `outward` is the unit
/// normal to the light side, `reach` how far the edge may be to either side [px]. False if there is
/// none.
bool fitEdge(const cv::Mat& picture, const cv::Point2d& a, const cv::Point2d& b,
             const cv::Point2d& outward, double reach, cv::Vec4f& line) {
  constexpr double kStep = 0.25;    // across the edge [px]
  constexpr double kCorner = 0.12;  // of the side at either end, where blur rounds it
  const int count = std::max(8, static_cast<int>(cv::norm(b - a)));
  const int half = static_cast<int>(std::ceil(reach / kStep));
  std::vector<cv::Point2f> points;
  for (int k = 0; k < count; ++k) {
    const cv::Point2d middle = a + (kCorner + (1.0 - 2.0 * kCorner) * (k + 0.5) / count) * (b - a);
    double before = 0.0, now = 0.0, sum = 0.0, moment = 0.0;
    bool inside = sample(picture, middle - kStep * (half + 0.5) * outward, before);
    for (int j = -half; j <= half && inside; ++j, before = now) {
      inside = sample(picture, middle + kStep * (j + 0.5) * outward, now);
      const double rise = std::max(0.0, now - before);
      sum += rise * rise;
      moment += rise * rise * kStep * j;
    }
    if (inside && sum > 1.0) points.emplace_back(middle + moment / sum * outward);
  }
  if (points.size() < 6) return false;
  cv::fitLine(points, line, cv::DIST_HUBER, 0, 0.01, 0.01);
  return true;
}

/// Corners of a marker where lines along its four sides meet: blur rounds a corner, and draws it
/// inwards, but moves no edge. Leaves them as they are if that fails or leads astray.
bool refineCorners(const cv::Mat& picture, std::vector<cv::Point2f>& corners) {
  constexpr double kLeastAcross = 25.0;  // [px]; the frame and the white around it are 4 px or more
  std::array<cv::Point2d, 4> refined;
  for (std::size_t c = 0; c < 4; ++c) refined[c] = corners[c];
  for (int pass = 0; pass < 3; ++pass) {
    std::array<cv::Vec4f, 4> lines;
    for (std::size_t c = 0; c < 4; ++c) {
      const cv::Point2d a = refined[c], b = refined[(c + 1) % 4];
      const cv::Point2d along = (b - a) / std::max(1e-9, cv::norm(b - a));
      const cv::Point2d outward(along.y, -along.x);  // corners go clockwise on the screen
      // How wide the marker is across this side: its black frame is a sixth of that or less, and the
      // white around it about as much.
      const cv::Point2d other = 0.5 * (refined[(c + 2) % 4] + refined[(c + 3) % 4] - a - b);
      const double across = std::abs(other.dot(outward));
      if (across < kLeastAcross) return false;
      const double reach = std::min(0.1 * across, 5.0);
      if (!fitEdge(picture, a, b, outward, reach, lines[c])) return false;
    }
    for (std::size_t c = 0; c < 4; ++c) {
      const cv::Vec4f& p = lines[(c + 3) % 4];  // the side that ends in this corner
      const cv::Vec4f& q = lines[c];
      const double cross = double{p[0]} * q[1] - double{p[1]} * q[0];
      if (std::abs(cross) < 0.05) return false;
      const double s = ((double{q[2]} - p[2]) * q[1] - (double{q[3]} - p[3]) * q[0]) / cross;
      refined[c] = cv::Point2d(p[2] + s * p[0], p[3] + s * p[1]);
    }
  }
  for (std::size_t c = 0; c < 4; ++c)
    if (!(cv::norm(refined[c] - cv::Point2d(corners[c])) < 4.0)) return false;
  for (std::size_t c = 0; c < 4; ++c) corners[c] = refined[c];
  return true;
}

/// A marker of the board that was read.
struct SeenMarker {
  int face = 0;
  std::array<cv::Point3d, 4> points_H;
  std::array<cv::Point2d, 4> seen;
  double residual_px = 0.0;  // root mean square of its corners, of the last solution
};

/// The pose with the least residual over all markers, and each marker's own.
std::optional<BoardSighting> solvePose(std::vector<SeenMarker>& markers, const cv::Matx33d& K,
                                       const cv::Mat& distortion) {
  std::vector<cv::Point3d> points_H;
  std::vector<cv::Point2d> seen;
  bool flat = true;
  for (const SeenMarker& marker : markers) {
    points_H.insert(points_H.end(), marker.points_H.begin(), marker.points_H.end());
    seen.insert(seen.end(), marker.seen.begin(), marker.seen.end());
    flat = flat && marker.face == markers.front().face;
  }
  std::vector<cv::Mat> rotations, translations;
  cv::solvePnPGeneric(points_H, seen, K, distortion, rotations, translations, false,
                      flat ? cv::SOLVEPNP_IPPE : cv::SOLVEPNP_SQPNP);
  std::optional<BoardSighting> best;
  for (std::size_t k = 0; k < rotations.size(); ++k) {
    cv::solvePnPRefineLM(points_H, seen, K, distortion, rotations[k], translations[k],
                         {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 1e-9});
    std::vector<cv::Point2d> projected;
    cv::projectPoints(points_H, rotations[k], translations[k], K, distortion, projected);
    std::vector<double> squares(markers.size(), 0.0);  // of each marker
    double sum = 0.0;
    for (std::size_t c = 0; c < seen.size(); ++c) {
      const cv::Point2d error = seen[c] - projected[c];
      squares[c / 4] += error.dot(error);
      sum += error.dot(error);
    }
    BoardSighting sighting;
    sighting.X_CH = toIsometry(rotations[k], translations[k]);
    sighting.marker_count = static_cast<int>(markers.size());
    sighting.residual_px = std::sqrt(sum / static_cast<double>(seen.size()));
    if (!sighting.X_CH.matrix().allFinite() || (best && best->residual_px <= sighting.residual_px))
      continue;
    best = sighting;
    for (std::size_t m = 0; m < markers.size(); ++m)
      markers[m].residual_px = std::sqrt(0.25 * squares[m]);
  }
  return best;
}

}  // namespace

std::vector<BoardMarker> makeBoard(const BoardParameters& board) {
  checkParameters(board);
  const int count = board.faces * board.columns * board.rows;
  const int known = cv::aruco::getPredefinedDictionary(findDictionary(board.dictionary))->bytesList.rows;
  if (board.first_id + count > known)
    throw ParameterError({"board/first_id + faces x columns x rows = " +
                          std::to_string(board.first_id + count) + " is more than the " +
                          std::to_string(known) + " markers of board/dictionary " + board.dictionary});
  std::vector<BoardMarker> markers;
  const double pitch = board.marker_length + board.separation;
  for (int face = 0; face < board.faces; ++face) {
    // Axes of the face: right as one looks at it, up, and towards the onlooker.
    const Eigen::AngleAxisd turn(2.0 * std::acos(-1.0) * face / board.faces, Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d outward = turn * Eigen::Vector3d::UnitX();
    const Eigen::Vector3d right = turn * Eigen::Vector3d::UnitY();
    const Eigen::Vector3d up =
        std::cos(board.elevation) * Eigen::Vector3d::UnitZ() - std::sin(board.elevation) * outward;
    const Eigen::Vector3d middle = board.radius * outward + board.height * Eigen::Vector3d::UnitZ();
    for (int row = 0; row < board.rows; ++row)
      for (int column = 0; column < board.columns; ++column) {
        const double x = pitch * (column - 0.5 * (board.columns - 1));
        const double y = pitch * (0.5 * (board.rows - 1) - row);
        const double half = 0.5 * board.marker_length;
        const auto at = [&](double dx, double dy) -> Eigen::Vector3d {
          return middle + (x + dx) * right + (y + dy) * up;
        };
        markers.push_back({board.first_id + static_cast<int>(markers.size()),
                           {at(-half, half), at(half, half), at(half, -half), at(-half, -half)}});
      }
  }
  return markers;
}

struct BoardTracker::Implementation {
  explicit Implementation(const TrackerParameters& p)
      : parameters(p),
        dictionary(cv::aruco::getPredefinedDictionary(findDictionary(p.board.dictionary))) {
    for (const BoardMarker& marker : makeBoard(p.board)) markers[marker.id] = marker;
    detector = cv::aruco::DetectorParameters::create();
    detector->cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;  // refineCorners does
  }

  TrackerParameters parameters;
  cv::Ptr<cv::aruco::Dictionary> dictionary;
  cv::Ptr<cv::aruco::DetectorParameters> detector;
  std::map<int, BoardMarker> markers;
};

BoardTracker::BoardTracker(const TrackerParameters& parameters) {
  checkParameters(parameters);
  implementation_ = std::make_unique<Implementation>(parameters);
}
BoardTracker::~BoardTracker() = default;

std::optional<BoardSighting> BoardTracker::find(const std::uint8_t* grey, int width, int height,
                                                std::size_t stride, const CameraModel& camera,
                                                std::string& problem) const {
  const Implementation& s = *implementation_;
  const std::size_t coefficients = camera.distortion.size();
  if (!(camera.fx > 0.0) || !(camera.fy > 0.0))
    throw std::invalid_argument("the camera is not calibrated: no focal length in its camera_info");
  if (coefficients != 0 && coefficients != 4 && coefficients != 5 && coefficients != 8)
    throw std::invalid_argument("camera_info has " + std::to_string(coefficients) +
                                " distortion coefficients; known are 0, 4, 5 and 8");
  // OpenCV reads only; its type knows no constant pixels.
  const cv::Mat picture(height, width, CV_8UC1, const_cast<std::uint8_t*>(grey), stride);

  std::vector<int> ids;
  std::vector<std::vector<cv::Point2f>> corners;
  cv::aruco::detectMarkers(picture, s.dictionary, corners, ids, s.detector);

  std::vector<SeenMarker> markers;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const auto marker = s.markers.find(ids[k]);
    if (marker == s.markers.end() || !refineCorners(picture, corners[k])) continue;
    SeenMarker one;
    one.face =
        (ids[k] - s.parameters.board.first_id) / (s.parameters.board.columns * s.parameters.board.rows);
    for (std::size_t c = 0; c < 4; ++c) {
      const Eigen::Vector3d& p = marker->second.corners_H[c];
      one.points_H[c] = {p.x(), p.y(), p.z()};
      one.seen[c] = corners[k][c];
    }
    markers.push_back(one);
  }
  const auto count = static_cast<int>(markers.size());
  if (count < s.parameters.min_markers) {
    problem = std::to_string(count) + " markers of the board in the picture, tracker/min_markers is " +
              std::to_string(s.parameters.min_markers);
    return std::nullopt;
  }

  const cv::Matx33d K(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const cv::Mat distortion(camera.distortion, true);
  std::optional<BoardSighting> best;
  try {
    best = solvePose(markers, K, distortion);
    // A marker that something covers in part can be read and be wrong: the others tell.
    while (best && static_cast<int>(markers.size()) > std::max(3, s.parameters.min_markers)) {
      const auto byResidual = [](const SeenMarker& m, const SeenMarker& n) {
        return m.residual_px < n.residual_px;
      };
      std::sort(markers.begin(), markers.end(), byResidual);
      if (markers.back().residual_px < 0.15 + 3.0 * markers[markers.size() / 2].residual_px) break;
      markers.pop_back();
      best = solvePose(markers, K, distortion);
    }
  } catch (const cv::Exception& error) {
    problem = "no pose for these corners: " + error.err;
    return std::nullopt;
  }
  if (!best) {
    problem = "no pose for these corners";
  } else if (!(best->residual_px <= s.parameters.max_residual_px)) {
    problem = "corners are " + std::to_string(best->residual_px) +
              " px from where the board would have them, tracker/max_residual_px is " +
              std::to_string(s.parameters.max_residual_px);
    best.reset();
  }
  return best;
}

}  // namespace calligraphy_brush
