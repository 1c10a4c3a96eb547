#pragma once

#include <vector>

#include "calligraphy_brush/sim/simulator_parameters.h"

namespace calligraphy_brush {

/// What a brush leaves when it is dragged straight at a depth.
struct BrushCurvePoint {
  double depth;  ///< of the handle below the height of first touch [m]
  double width;  ///< of the line [m]
  double lag;    ///< of the middle of the footprint behind the handle, along the drag [m]
};

/// Line width and trailing lag of a brush over its depth: continuous, piecewise linear from (0, 0, 0),
/// with strictly rising width and lag that never falls, so that width → depth is one value.
class BrushCurve {
 public:
  /// Points in any order; widths (and lags) that fall with depth are levelled by the pool-adjacent-
  /// violators method, which is the least-squares fit under that order. Throws std::invalid_argument if
  /// a number is not finite, a depth ≤ 0 or given twice, or no point has a width.
  explicit BrushCurve(std::vector<BrushCurvePoint> points);

  /// Width of the line at a depth [m]; 0 for depth ≤ 0, that of the deepest point beyond it.
  double width(double depth) const;
  /// Lag of the mark's middle at a depth [m], clamped like width.
  double lag(double depth) const;
  /// Depth that gives a width [m]; 0 for width ≤ 0, maxDepth() for width ≥ maxWidth().
  double depth(double width) const;

  double maxDepth() const { return points_.back().depth; }
  double maxWidth() const { return points_.back().width; }
  const std::vector<BrushCurvePoint>& points() const { return points_; }

 private:
  std::vector<BrushCurvePoint> points_;  // (0, 0, 0) first
};

/// Measures the curve by running the simulator: the brush, full of ink and leaning by `tilt` [rad] the
/// way it goes, is dragged along a straight line at 0.04 m/s and pressed deeper from stage to stage, up
/// to `deepest` × tip length.
///
/// In each stage, after a drag over half the tip's length, the sheet is cleared: what two steps leave is
/// the footprint, whose centroid gives the lag; what a further drag leaves between the two ends is the
/// line, whose median width is taken. Ink counts where it is above 0.5 dark_thickness.
/// With a tilt, depth and lag count from where and at what height the point of the undeformed brush is.
/// 0 < deepest ≤ 0.8; stages ≥ 1; 0 ≤ tilt ≤ 1. Throws ParameterError if the parameters are out of range
/// and std::runtime_error if the brush leaves no line at any depth.
std::vector<BrushCurvePoint> measureBrushPoints(const SimulatorParameters& parameters, double tilt = 0.0,
                                                int stages = 10, double deepest = 0.4);

/// The same as a curve.
BrushCurve measureBrushCurve(const SimulatorParameters& parameters, double tilt = 0.0, int stages = 10,
                             double deepest = 0.4);

}  // namespace calligraphy_brush
