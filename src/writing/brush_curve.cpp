#include "calligraphy_brush/writing/brush_curve.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "calligraphy_brush/sim/simulator.h"

namespace calligraphy_brush {
namespace {

/// Least-squares fit of a sequence that never falls (pool adjacent violators).
std::vector<double> levelled(const std::vector<double>& values) {
  struct Block {
    double sum;
    int count;
    double mean() const { return sum / count; }
  };
  std::vector<Block> blocks;
  for (const double value : values) {
    blocks.push_back({value, 1});
    while (blocks.size() > 1 && blocks[blocks.size() - 2].mean() > blocks.back().mean()) {
      const Block last = blocks.back();
      blocks.pop_back();
      blocks.back().sum += last.sum;
      blocks.back().count += last.count;
    }
  }
  std::vector<double> fit;
  for (const Block& block : blocks)
    fit.insert(fit.end(), static_cast<std::size_t>(block.count), block.mean());
  return fit;
}

/// Piecewise linear y(x) over points of rising x, clamped at both ends.
double interpolate(const std::vector<BrushCurvePoint>& points, double BrushCurvePoint::*x_of,
                   double BrushCurvePoint::*y_of, double x) {
  if (!(x > points.front().*x_of)) return points.front().*y_of;
  if (x >= points.back().*x_of) return points.back().*y_of;
  const auto after =
      std::upper_bound(points.begin(), points.end(), x,
                       [&](double value, const BrushCurvePoint& p) { return value < p.*x_of; });
  const BrushCurvePoint &a = *(after - 1), &b = *after;
  return a.*y_of + (b.*y_of - a.*y_of) * (x - a.*x_of) / (b.*x_of - a.*x_of);
}

/// A brush that is dragged along +x over a long sheet, one pose every 4 ms.
class Drag {
 public:
  Drag(const SimulatorParameters& parameters, double y, double speed, double tilt)
      : simulator_(parameters),
        orientation_(Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitY())),
        tip_H_(0.0, 0.0, -simulator_.brush().tip_length),
        y_(y),
        step_(speed * kPeriod) {}

  Simulator& simulator() { return simulator_; }
  /// Where the point of the undeformed brush is [m].
  double place() const { return (simulator_.handlePose().position + orientation_ * tip_H_).x(); }

  /// Goes on to x [m], while the depth changes linearly to `depth` [m].
  void to(double x, double depth) {
    const double x0 = x_, depth0 = depth_;
    const int count = std::max(1, static_cast<int>(std::ceil((x - x0) / step_)));
    for (int k = 1; k <= count; ++k) {
      const double part = static_cast<double>(k) / count;
      x_ = x0 + part * (x - x0);
      depth_ = depth0 + part * (depth - depth0);
      HandlePose pose;
      pose.stamp_ns = stamp_ns_ += static_cast<std::int64_t>(kPeriod * 1e9);
      pose.orientation = orientation_;
      pose.position = Eigen::Vector3d(x_, y_, -depth_) - orientation_ * tip_H_;
      simulator_.addPose(pose);
      simulator_.advance();
    }
  }
  void startAt(double x, double depth) {
    x_ = x;
    depth_ = depth;
    to(x, depth);
  }

 private:
  static constexpr double kPeriod = 0.004;  // [s]

  Simulator simulator_;
  Eigen::Quaterniond orientation_;
  Eigen::Vector3d tip_H_;
  double y_, step_;
  double x_ = 0.0, depth_ = 0.0;
  std::int64_t stamp_ns_ = 0;
};

/// Columns that have ink, and their mean weighted by the number of inked pixels.
struct Footprint {
  double first, last, centre;  // [m]
};

class InkGauge {
 public:
  InkGauge(const Paper& paper, double threshold) : paper_(paper), threshold_(threshold) {}

  std::optional<Footprint> footprint() const {
    double sum = 0.0, moment = 0.0;
    int first = -1, last = -1;
    for (int column = 0; column < paper_.width_px(); ++column) {
      int inked = 0;
      for (int row = 0; row < paper_.height_px(); ++row)
        if (static_cast<double>(paper_.ink(column, row)) > threshold_) ++inked;
      if (inked == 0) continue;
      if (first < 0) first = column;
      last = column;
      sum += inked;
      moment += inked * (column + 0.5);
    }
    if (first < 0) return std::nullopt;
    const double pixel = paper_.pixelSize();
    return Footprint{first * pixel, (last + 1) * pixel, moment / sum * pixel};
  }

  /// Median over the columns between two places of the extent from the lowest to the highest ink [m].
  double medianWidth(double from, double to) const {
    std::vector<double> widths;
    for (int column = 0; column < paper_.width_px(); ++column) {
      const double x = (column + 0.5) * paper_.pixelSize();
      if (x < from || x > to) continue;
      int lowest = -1, highest = -2;
      for (int row = 0; row < paper_.height_px(); ++row) {
        if (!(static_cast<double>(paper_.ink(column, row)) > threshold_)) continue;
        if (lowest < 0) lowest = row;
        highest = row;
      }
      widths.push_back((highest - lowest + 1) * paper_.pixelSize());
    }
    if (widths.empty()) return 0.0;
    const auto middle = widths.begin() + static_cast<std::ptrdiff_t>(widths.size() / 2);
    std::nth_element(widths.begin(), middle, widths.end());
    return *middle;
  }

 private:
  const Paper& paper_;
  double threshold_;
};

}  // namespace

BrushCurve::BrushCurve(std::vector<BrushCurvePoint> points) : points_(std::move(points)) {
  std::sort(points_.begin(), points_.end(),
            [](const BrushCurvePoint& a, const BrushCurvePoint& b) { return a.depth < b.depth; });
  std::vector<double> widths, lags;
  for (std::size_t k = 0; k < points_.size(); ++k) {
    const BrushCurvePoint& p = points_[k];
    if (!std::isfinite(p.depth) || !std::isfinite(p.width) || !std::isfinite(p.lag) || p.depth <= 0)
      throw std::invalid_argument("a point of a brush curve is not finite, or has no depth");
    if (k > 0 && p.depth == points_[k - 1].depth)
      throw std::invalid_argument("a brush curve has two points of the same depth");
    widths.push_back(std::max(0.0, p.width));
    lags.push_back(std::max(0.0, p.lag));
  }
  widths = levelled(widths);
  lags = levelled(lags);

  std::vector<BrushCurvePoint> rising{{0.0, 0.0, 0.0}};
  for (std::size_t k = 0; k < points_.size(); ++k) {
    // Of depths with one width, the least: it is the depth that the inverse gives.
    if (widths[k] > rising.back().width) rising.push_back({points_[k].depth, widths[k], lags[k]});
  }
  if (rising.size() < 2) throw std::invalid_argument("a brush curve has no width at any depth");
  points_ = std::move(rising);
}

double BrushCurve::width(double depth) const {
  return interpolate(points_, &BrushCurvePoint::depth, &BrushCurvePoint::width, depth);
}

double BrushCurve::lag(double depth) const {
  return interpolate(points_, &BrushCurvePoint::depth, &BrushCurvePoint::lag, depth);
}

double BrushCurve::depth(double width) const {
  return interpolate(points_, &BrushCurvePoint::width, &BrushCurvePoint::depth, width);
}

std::vector<BrushCurvePoint> measureBrushPoints(const SimulatorParameters& parameters, double tilt,
                                                int stages, double deepest) {
  if (stages < 1 || !(deepest > 0 && deepest <= 0.8) || !(tilt >= 0 && tilt <= 1))
    throw std::invalid_argument(
        "a brush curve needs a stage, a depth in (0, 0.8] tip lengths, a tilt in [0, 1] rad");
  checkParameters(parameters);
  SimulatorParameters lab = parameters;
  const double length = lab.brush.tip_length;
  const double margin = 1.2 * length;
  // As long as the longest possible run; two metres are the largest sheet.
  lab.paper.width = std::min(2.0, 2.0 * margin + stages * 1.9 * length);
  lab.paper.height = std::min(2.0, 3.0 * lab.brush.root_diameter + 0.5 * length);
  lab.paper.px_per_mm = std::clamp(0.36 / length, 0.5, 40.0);
  const double threshold = 0.5 * lab.paper.dark_thickness;
  constexpr double kSpeed = 0.04;  // [m/s]

  Drag drag(lab, 0.5 * lab.paper.height, kSpeed, tilt);
  const InkGauge gauge(drag.simulator().paper(), threshold);
  std::vector<BrushCurvePoint> points;
  double x = margin;
  drag.startAt(x, -0.02 * length);
  for (int stage = 1; stage <= stages; ++stage) {
    // Closer together where the brush only just touches: there the width changes most.
    const double depth = deepest * length * std::pow(static_cast<double>(stage) / stages, 1.5);
    if (x + 1.9 * length > lab.paper.width) break;
    drag.to(x += 0.1 * length, depth);
    drag.to(x += 0.5 * length, depth);

    drag.simulator().dip();
    drag.simulator().clearPaper();
    const double place_before = drag.place();
    drag.to(x += kSpeed * 0.008, depth);
    const auto print = gauge.footprint();
    if (!print) continue;
    const double lag = 0.5 * (place_before + drag.place()) - print->centre;
    const double front_lag = drag.place() - print->last, tail_lag = place_before - print->first;

    drag.to(x += (tail_lag - front_lag) + 0.2 * length, depth);
    const double quarter = 0.05 * length;
    const double width =
        gauge.medianWidth(place_before - front_lag + quarter, drag.place() - tail_lag - quarter);
    if (width > 0) points.push_back({depth, width, lag});
  }
  if (points.empty()) throw std::runtime_error("the brush leaves no line at any depth");
  return points;
}

BrushCurve measureBrushCurve(const SimulatorParameters& parameters, double tilt, int stages,
                             double deepest) {
  return BrushCurve(measureBrushPoints(parameters, tilt, stages, deepest));
}

}  // namespace calligraphy_brush
