#include "calligraphy_brush/writing/schedule.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace calligraphy_brush {
namespace {

constexpr double kSpacing = 0.1e-3;         // of nodes [m]
constexpr double kLeastSpeed = 1e-3;        // [m/s]: keeps a geometric corner from taking for ever
constexpr double kLargestTimedSpeed = 5.0;  // [m/s]
constexpr double kAngleArm = 0.005;         // way of a turn on the spot over its angle [m]

/// Place of the handle's origin, without the constant tip length in z.
Eigen::Vector3d handlePlace(const Waypoint& point, double tip_length) {
  const double tilt = point.segment<2>(3).norm();
  const double ratio = tilt > 1e-9 ? std::sin(tilt) / tilt : 1.0;
  return {point[0] + tip_length * ratio * point[3], point[1] + tip_length * ratio * point[4], -point[2]};
}

}  // namespace

void Schedule::sample(const WaypointCurve& curve, const std::vector<double>& speeds,
                      const ScheduleLimits& limits) {
  std::vector<Eigen::Vector3d> place;
  Waypoint previous;
  const auto add = [&](double u, double speed) {
    const Waypoint point = curve.at(u);
    place.push_back(handlePlace(point, limits.tip_length));
    double step = 0.0;
    if (place.size() > 1)
      step = std::hypot((place.back() - place[place.size() - 2]).norm(),
                        kAngleArm * (point.tail<3>() - previous.tail<3>()).norm());
    way_.push_back(way_.empty() ? 0.0 : way_.back() + step);
    u_.push_back(u);
    speed_.push_back(speed);
    previous = point;
  };
  for (int k = 0; k < curve.waypointCount(); ++k) {
    node_of_waypoint_.push_back(u_.size());
    // A node between two wishes takes the lower one.
    const auto index = static_cast<std::size_t>(k);
    add(curve.knot(k), k > 0 ? std::min(speeds[index - 1], speeds[index]) : speeds[index]);
    if (k + 1 == curve.waypointCount()) break;
    const Waypoint chord = curve.at(curve.knot(k + 1)) - curve.at(curve.knot(k));
    const double length = chord.head<3>().norm() + limits.tip_length * chord.tail<3>().norm();
    const int cells = std::clamp(static_cast<int>(std::ceil(length / kSpacing)), 2, 5000);
    for (int c = 1; c < cells; ++c)
      add(curve.knot(k) + (curve.knot(k + 1) - curve.knot(k)) * c / cells, speeds[index]);
  }
  // v² κ ≤ a, with the curvature κ of three nodes: turn over mean length.
  for (std::size_t j = 1; j + 1 < place.size(); ++j) {
    const Eigen::Vector3d before = place[j] - place[j - 1], after = place[j + 1] - place[j];
    const double length = 0.5 * (before.norm() + after.norm());
    if (before.norm() < 1e-9 || after.norm() < 1e-9) continue;
    const double turn = std::atan2(before.cross(after).norm(), before.dot(after));
    if (turn > 1e-9) speed_[j] = std::min(speed_[j], std::sqrt(limits.acceleration * length / turn));
  }
}

void Schedule::limitSpeeds(std::size_t first, std::size_t last, double acceleration) {
  const auto reach = [&](std::size_t from, std::size_t to) {
    const double gain = 2.0 * acceleration * std::abs(way_[to] - way_[from]);
    speed_[to] =
        std::max(kLeastSpeed, std::min(speed_[to], std::sqrt(speed_[from] * speed_[from] + gain)));
  };
  for (std::size_t j = first; j < last; ++j) reach(j, j + 1);
  for (std::size_t j = last; j > first; --j) reach(j, j - 1);
}

Schedule::Schedule(const WaypointCurve& curve, const std::vector<double>& speeds,
                   const std::vector<std::optional<double>>& times, const std::vector<int>& runs,
                   const ScheduleLimits& limits) {
  sample(curve, speeds, limits);
  speed_.front() = speed_.back() = 0.0;

  // Timed pieces first: their speeds at both ends bind the free ones between.
  std::vector<Piece> timed;
  for (std::size_t k = 0; k < times.size();) {
    if (!times[k]) {
      ++k;
      continue;
    }
    Piece piece;
    piece.first = node_of_waypoint_[k];
    const int run = runs[k];
    std::size_t latest = k;
    for (; k < times.size() && (!times[k] || runs[k] == run); ++k) {
      if (runs[k] != run) break;
      if (!times[k]) continue;
      piece.time.push_back(*times[k] - *times[latest] + (piece.time.empty() ? 0.0 : piece.time.back()));
      piece.way.push_back(way_[node_of_waypoint_[k]]);
      latest = k;
    }
    k = latest + 1;
    piece.last = node_of_waypoint_[latest];
    if (piece.time.size() < 2) continue;
    for (std::size_t i = 1; i < piece.time.size(); ++i) {
      const double speed = (piece.way[i] - piece.way[i - 1]) / (piece.time[i] - piece.time[i - 1]);
      if (!(speed <= kLargestTimedSpeed))
        throw std::invalid_argument("the times of a stroke ask for " + std::to_string(speed) + " m/s");
    }
    piece.slope = monotoneTangents(piece.time, piece.way);
    speed_[piece.first] = piece.slope.front();
    speed_[piece.last] = piece.slope.back();
    timed.push_back(std::move(piece));
  }

  double time = 0.0;
  std::size_t node = 0;
  const auto addFree = [&](std::size_t until, bool on_grid) {
    Piece piece;
    piece.first = node;
    piece.last = until;
    limitSpeeds(node, until, limits.acceleration);
    piece.node_time.push_back(0.0);
    for (std::size_t j = node; j < until; ++j) {
      const double sum = std::max(kLeastSpeed, speed_[j] + speed_[j + 1]);
      piece.node_time.push_back(piece.node_time.back() + 2.0 * (way_[j + 1] - way_[j]) / sum);
    }
    piece.begin = time;
    piece.end = time + piece.node_time.back();
    if (on_grid) {
      // The next piece begins with a pose: this one is slowed down by less than one period.
      const double wanted = std::ceil(piece.end / limits.period - 1e-9) * limits.period;
      const double stretch = piece.end > time ? (wanted - time) / (piece.end - time) : 1.0;
      for (double& t : piece.node_time) t *= stretch;
      piece.end = wanted;
    }
    time = piece.end;
    pieces_.push_back(std::move(piece));
  };
  for (Piece& piece : timed) {
    if (piece.first > node) addFree(piece.first, true);
    piece.begin = time;
    piece.end = time += piece.time.back();
    node = piece.last;
    pieces_.push_back(std::move(piece));
  }
  if (node + 1 < u_.size()) addFree(u_.size() - 1, false);
}

double Schedule::parameterAtWay(double way) const {
  const auto after = std::upper_bound(way_.begin(), way_.end(), way);
  if (after == way_.begin()) return u_.front();
  if (after == way_.end()) return u_.back();
  const auto j = static_cast<std::size_t>(after - way_.begin());
  return u_[j - 1] + (u_[j] - u_[j - 1]) * (way - way_[j - 1]) / (way_[j] - way_[j - 1]);
}

double Schedule::parameterAt(double time) const {
  if (pieces_.empty() || time <= 0) return u_.front();
  if (time >= duration()) return u_.back();
  const auto found = std::upper_bound(pieces_.begin(), pieces_.end(), time,
                                      [](double t, const Piece& piece) { return t < piece.end; });
  const Piece& piece = *found;
  const double local = std::max(0.0, time - piece.begin);
  if (!piece.time.empty()) {
    const auto after = std::upper_bound(piece.time.begin() + 1, piece.time.end() - 1, local);
    const auto i = static_cast<std::size_t>(after - piece.time.begin());
    const double way = hermite(local - piece.time[i - 1], piece.time[i] - piece.time[i - 1],
                               piece.way[i - 1], piece.slope[i - 1], piece.way[i], piece.slope[i]);
    // Two nodes can have one way: a time that is a knot's shall give that knot.
    if (local == piece.time[i - 1] && i == 1) return u_[piece.first];
    return parameterAtWay(way);
  }
  const auto after = std::upper_bound(piece.node_time.begin() + 1, piece.node_time.end() - 1, local);
  const auto c = static_cast<std::size_t>(after - piece.node_time.begin());
  const std::size_t j = piece.first + c;  // the cell is from node j − 1 to j
  const double cell = piece.node_time[c] - piece.node_time[c - 1];
  if (!(cell > 0)) return u_[j];
  // Constant acceleration over the cell: way = v0 t + a t²/2, v1 = v0 + a cell.
  const double t = (local - piece.node_time[c - 1]) / cell;
  const double v0 = speed_[j - 1], v1 = speed_[j];
  const double part = v0 + v1 > 0 ? (2.0 * v0 * t + (v1 - v0) * t * t) / (v0 + v1) : t;
  return u_[j - 1] + (u_[j] - u_[j - 1]) * part;
}

}  // namespace calligraphy_brush
