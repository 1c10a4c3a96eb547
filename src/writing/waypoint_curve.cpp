#include "calligraphy_brush/writing/waypoint_curve.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

constexpr double kLimit = 3.0;

/// Slope at the middle of three points of the parabola through them.
template <class Value>
Value parabolaSlope(const Value& slope_before, double h_before, const Value& slope_after,
                    double h_after) {
  return (slope_before * h_after + slope_after * h_before) / (h_before + h_after);
}

double monotoneSlope(double slope_before, double h_before, double slope_after, double h_after) {
  if (slope_before * slope_after <= 0) return 0.0;
  const double bound = kLimit * std::min(std::abs(slope_before), std::abs(slope_after));
  return std::clamp(parabolaSlope(slope_before, h_before, slope_after, h_after), -bound, bound);
}

}  // namespace

std::vector<double> monotoneTangents(const std::vector<double>& x, const std::vector<double>& y) {
  const std::size_t n = x.size();
  std::vector<double> tangents(n, 0.0);
  if (n < 2) return tangents;
  const auto slope = [&](std::size_t k) { return (y[k + 1] - y[k]) / (x[k + 1] - x[k]); };
  tangents.front() = slope(0);
  tangents.back() = slope(n - 2);
  for (std::size_t k = 1; k + 1 < n; ++k)
    tangents[k] = monotoneSlope(slope(k - 1), x[k] - x[k - 1], slope(k), x[k + 1] - x[k]);
  return tangents;
}

WaypointCurve::WaypointCurve(std::vector<Waypoint> waypoints, double arm)
    : waypoints_(std::move(waypoints)) {
  if (waypoints_.empty()) throw std::invalid_argument("a curve needs a waypoint");
  const std::size_t n = waypoints_.size();
  Waypoint weight;
  weight << 1.0, 1.0, 1.0, arm, arm, arm;
  knots_.assign(n, 0.0);
  for (std::size_t k = 1; k < n; ++k) {
    const double distance = weight.cwiseProduct(waypoints_[k] - waypoints_[k - 1]).norm();
    knots_[k] = knots_[k - 1] + std::sqrt(std::max(distance, 1e-6));
  }

  tangents_.assign(n, Waypoint::Zero());
  if (n < 2) return;
  const auto step = [&](std::size_t k) { return knots_[k + 1] - knots_[k]; };
  const auto slope = [&](std::size_t k) {
    return Waypoint((waypoints_[k + 1] - waypoints_[k]) / step(k));
  };
  tangents_.front() = slope(0);
  tangents_.back() = slope(n - 2);
  for (std::size_t k = 1; k + 1 < n; ++k) {
    const Waypoint before = slope(k - 1), after = slope(k);
    Eigen::Vector2d along =
        parabolaSlope<Eigen::Vector2d>(before.head<2>(), step(k - 1), after.head<2>(), step(k));
    const double bound = kLimit * std::min(before.head<2>().norm(), after.head<2>().norm());
    if (along.norm() > bound) along *= bound / along.norm();
    tangents_[k].head<2>() = along;
    for (int i = 2; i < 6; ++i)
      tangents_[k][i] = monotoneSlope(before[i], step(k - 1), after[i], step(k));
  }
}

std::size_t WaypointCurve::segmentOf(double u) const {
  const auto after = std::upper_bound(knots_.begin(), knots_.end(), u);
  const auto index = static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, after - knots_.begin() - 1));
  return std::min(index, knots_.size() - 2);
}

Waypoint WaypointCurve::at(double u) const {
  if (waypoints_.size() == 1 || u <= 0) return waypoints_.front();
  if (u >= end()) return waypoints_.back();
  const std::size_t k = segmentOf(u);
  return hermite<Waypoint>(u - knots_[k], knots_[k + 1] - knots_[k], waypoints_[k], tangents_[k],
                           waypoints_[k + 1], tangents_[k + 1]);
}

Waypoint WaypointCurve::slopeAt(double u) const {
  if (waypoints_.size() == 1) return Waypoint::Zero();
  const std::size_t k = segmentOf(u);
  const double h = knots_[k + 1] - knots_[k];
  return hermiteSlope<Waypoint>(std::clamp(u - knots_[k], 0.0, h), h, waypoints_[k], tangents_[k],
                                waypoints_[k + 1], tangents_[k + 1]);
}

}  // namespace calligraphy_brush
