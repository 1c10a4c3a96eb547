#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/score/mask.h"

namespace calligraphy_brush {

/// A stroke that a robot was told to make: a cubic Bézier curve of its tip, in the stroke's own frame
/// (starts at 0, 0; y up), with depths and tilts that are piecewise linear in the curve's parameter
/// through t = 0, 0.333, 0.666, 1.
struct RecordedStroke {
  int number = 0;                          ///< in the file
  std::array<Eigen::Vector2d, 4> place{};  ///< control points [m]
  std::array<double, 4> depth{};           ///< of the handle below first touch [m]
  std::array<double, 4> tilt{};            ///< of the shaft, to the left of the way it goes [rad]

  Eigen::Vector2d placeAt(double t) const;             ///< [m]
  Eigen::Vector2d headingAt(double t) const;           ///< unit; +x where the curve has none
  double depthAt(double t) const;                      ///< [m]
  double tiltAt(double t) const;                       ///< [rad]
  double middleDepth() const { return depthAt(0.5); }  ///< [m]
  /// How far the middle of the curve is from the line through its ends, > 0 to the left [m].
  double bend() const;
};

/// Recorded strokes with a photograph of each, as tiles of one picture.
///
/// A folder of three files. strokes.csv: a line a stroke with columns stroke and, for i = 0..3, xi_m,
/// yi_m, zi_norm (times depth_range_mm), tilti_rad. meta.json: n, cols, tile_w_px, tile_h_px, px_per_mm,
/// origin_px (of the stroke's frame in a tile, rows from above), depth_range_mm. strokes.png: the tiles,
/// row by row, dark where there is paint.
struct RecordedSet {
  std::vector<RecordedStroke> strokes;
  int columns = 1, tile_width_px = 1, tile_height_px = 1;
  double px_per_mm = 1.0;
  Eigen::Vector2d origin_px = Eigen::Vector2d::Zero();
  GreyPicture tiles;

  double width() const { return 1e-3 * tile_width_px / px_per_mm; }    ///< of a tile [m]
  double height() const { return 1e-3 * tile_height_px / px_per_mm; }  ///< [m]
  /// Of the stroke's frame, from a tile's lower left corner [m].
  Eigen::Vector2d origin() const {
    return 1e-3 / px_per_mm * Eigen::Vector2d(origin_px.x(), tile_height_px - origin_px.y());
  }
};

/// Throws std::runtime_error with file, line and reason.
RecordedSet readRecordedSet(const std::string& folder);

/// The painted area of a stroke, `index` into set.strokes, at a resolution: paint within 3 mm of the
/// path and what is joined to that, without its holes, for wet paint reflects light and looks white
/// there. Lower left corner and size are those of the tile.
Mask photographOf(const RecordedSet& set, std::size_t index, double px_per_mm);

/// How the arm moved that made the strokes.
struct ArmMotion {
  double speed = 0.02;       ///< along the path [m/s]
  double clearance = 0.005;  ///< above first touch: it comes straight down from there and goes there [m]
  double air_speed = 0.05;   ///< down and up [m/s]
  double period = 0.008;     ///< of the poses [s]
  /// 0: along the curve. Else straight from one to the next of so many points of the curve, at equal
  /// steps of its parameter, and over another one above each end, as an arm is driven by waypoints.
  int waypoints = 0;
  double corner = 0.005;    ///< from a waypoint, at most, at which the arm begins to turn to the next [m]
  double approach = 0.005;  ///< of the waypoint before the first above that [m]
  double departure = 0.01;  ///< of the waypoint after the last above that [m]
  /// Of the brush's point from where the arm's program has it: how it is held, and the camera [m].
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();
};

/// Poses of the handle for a stroke whose frame's origin is at `origin` [m] of the sheet and that is
/// turned about it by `turn` [rad]. tip_length [m] is BrushModel::tip_length.
std::vector<HandlePose> posesOf(const RecordedStroke& stroke, const ArmMotion& motion,
                                const Eigen::Vector2d& origin, double turn, double tip_length);

}  // namespace calligraphy_brush
