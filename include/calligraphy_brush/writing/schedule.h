#pragma once

#include <optional>
#include <vector>

#include "calligraphy_brush/writing/waypoint_curve.h"

namespace calligraphy_brush {

/// Limits and wishes for the motion along a curve.
struct ScheduleLimits {
  double acceleration = 1.0;  ///< along the path and across it [m/s²], > 0
  double period = 0.008;      ///< of the poses [s]; runs with given times begin on a multiple of it
  double tip_length = 0.0;    ///< [m]: the handle's path, and so its speed, depends on it
};

/// When a motion is where on its curve: u over t, with t = 0 at rest at the start.
///
/// Where waypoints have times, the way s [m] of the handle is the monotone cubic of time through them.
/// Elsewhere its speed is the largest v(s) with v ≤ the wished speed, v² |curvature| ≤ a and
/// |dv²/ds| ≤ 2 a, from rest to rest, integrated exactly over cells of constant acceleration.
class Schedule {
 public:
  /// speeds: wished speed from each waypoint to the next [m/s]. times: of waypoints, for each run of
  /// them counted from its first; runs: for each waypoint the run that it belongs to, −1 if none.
  /// Throws std::invalid_argument if a time asks for more than 5 m/s.
  Schedule(const WaypointCurve& curve, const std::vector<double>& speeds,
           const std::vector<std::optional<double>>& times, const std::vector<int>& runs,
           const ScheduleLimits& limits);

  double duration() const { return pieces_.empty() ? 0.0 : pieces_.back().end; }
  /// Curve parameter at a time [s], clamped to [0, duration()].
  double parameterAt(double time) const;

 private:
  /// A part of the motion: either free (cells first..last with a time for each node) or timed (way over
  /// time through knots).
  struct Piece {
    double begin = 0.0, end = 0.0;         // [s]
    std::size_t first = 0, last = 0;       // nodes
    std::vector<double> node_time;         // free: of nodes first..last
    std::vector<double> time, way, slope;  // timed: knots, in the times of the piece
  };

  void sample(const WaypointCurve& curve, const std::vector<double>& speeds,
              const ScheduleLimits& limits);
  void limitSpeeds(std::size_t first, std::size_t last, double acceleration);
  double parameterAtWay(double way) const;

  // Nodes: dense samples of the curve.
  std::vector<double> u_, way_, speed_;
  std::vector<std::size_t> node_of_waypoint_;
  std::vector<Piece> pieces_;
};

}  // namespace calligraphy_brush
