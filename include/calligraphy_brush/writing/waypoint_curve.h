#pragma once

#include <Eigen/Core>
#include <vector>

namespace calligraphy_brush {

/// What a stroke prescribes at one instant: x, y of the undeformed brush's point [m], depth [m] (or line
/// width [m]), lean x, y = tilt · (cos azimuth, sin azimuth) [rad], twist [rad].
using Waypoint = Eigen::Matrix<double, 6, 1>;

/// C1 cubic curve through waypoints over a parameter u that is 0 at the first and grows by the square
/// root of the distance between neighbours (centripetal: Yuksel, Schaefer & Keyser 2011,
/// Parameterization and Applications of Catmull–Rom Curves).
///
/// Tangents are those of the parabola through three neighbours, limited: (x, y) to three times the
/// shorter of the neighbouring chords' slopes, each other component to the monotone cubic of Fritsch &
/// Carlson 1980, so that nothing overshoots and waypoints at one place are a stop there. The distance of
/// two waypoints is the Euclidean one, an angle counting as angle · `arm` [m].
class WaypointCurve {
 public:
  /// Throws std::invalid_argument without waypoints. Equal neighbours are 1e-6 m apart in u.
  WaypointCurve(std::vector<Waypoint> waypoints, double arm);

  int waypointCount() const { return static_cast<int>(waypoints_.size()); }
  /// Parameter of a waypoint.
  double knot(int waypoint) const { return knots_[static_cast<std::size_t>(waypoint)]; }
  double end() const { return knots_.back(); }
  /// Place at u, clamped to [0, end()].
  Waypoint at(double u) const;
  /// d at / du; at a knot that of the segment after it.
  Waypoint slopeAt(double u) const;

 private:
  std::size_t segmentOf(double u) const;

  std::vector<Waypoint> waypoints_;
  std::vector<Waypoint> tangents_;
  std::vector<double> knots_;
};

/// Tangents of the monotone cubic through (x, y), x rising (Fritsch & Carlson 1980, with the limit 3).
std::vector<double> monotoneTangents(const std::vector<double>& x, const std::vector<double>& y);

/// Cubic over [0, h] with values y0, y1 and slopes m0, m1 at its ends, at t.
template <class Value>
Value hermite(double t, double h, const Value& y0, const Value& m0, const Value& y1, const Value& m1) {
  const double s = t / h, r = 1.0 - s;
  return (1.0 + 2.0 * s) * r * r * y0 + s * r * r * h * m0 + s * s * (3.0 - 2.0 * s) * y1 -
         s * s * r * h * m1;
}

/// Derivative of hermite with respect to t.
template <class Value>
Value hermiteSlope(double t, double h, const Value& y0, const Value& m0, const Value& y1,
                   const Value& m1) {
  const double s = t / h;
  return 6.0 * s * (1.0 - s) / h * (y1 - y0) + (1.0 - s) * (1.0 - 3.0 * s) * m0 +
         s * (3.0 * s - 2.0) * m1;
}

}  // namespace calligraphy_brush
