#include "calligraphy_brush/writing/trajectory.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "calligraphy_brush/writing/schedule.h"
#include "calligraphy_brush/writing/waypoint_curve.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

constexpr double kPi = 3.14159265358979323846;
constexpr double kAngleArm = 0.005;       // [m]: in distances of waypoints a radian counts as this
constexpr double kMarkSpacing = 0.25e-3;  // of samples of a mark [m]
constexpr double kLeanTurn = 0.006;       // half of the length of mark over which a lean turns [m]
constexpr int kPressSamples = 8;          // of pressing and raising with the mark in place

/// A point of the handle's way with the wishes that hold there.
struct Station {
  Waypoint place;
  double speed = 0.05;         // to the next station [m/s]
  std::optional<double> time;  // [s] since the stroke's first point
};

Waypoint waypointOf(const StrokePoint& point, double depth_or_width) {
  Waypoint waypoint;
  waypoint << point.x, point.y, depth_or_width, point.tilt * std::cos(point.azimuth),
      point.tilt * std::sin(point.azimuth), point.twist;
  return waypoint;
}

Eigen::Quaterniond orientationOf(const Waypoint& place) {
  return handleOrientation(place.segment<2>(3).norm(), std::atan2(place[4], place[3]), place[5]);
}

HandlePose poseOf(const Waypoint& place, double tip_length) {
  HandlePose pose;
  pose.orientation = orientationOf(place);
  const Eigen::Vector3d shaft = pose.orientation * Eigen::Vector3d::UnitZ();
  pose.position = {place[0] + tip_length * shaft.x(), place[1] + tip_length * shaft.y(),
                   tip_length - place[2]};
  return pose;
}

/// Direction in which a way leaves its first station (or, reversed, its last), of unit length; zero if
/// it never leaves.
template <class Iterator>
Vector2d direction(Iterator from, Iterator end) {
  constexpr double kFarEnough = 0.5e-3;  // [m]: nearer stations may be a press in place
  const Vector2d start = from->place.template head<2>();
  Vector2d way = Vector2d::Zero();
  for (auto station = from; station != end && way.norm() < kFarEnough; ++station)
    way = station->place.template head<2>() - start;
  return way.norm() > 0 ? Vector2d(way.normalized()) : Vector2d::Zero();
}

/// Mean of samples over the part of a line within `reach` of each, in `way`. Near the ends the part
/// shrinks on both sides alike, so that the ends keep their values.
std::vector<double> averaged(const std::vector<double>& values, const std::vector<double>& way,
                             double reach) {
  std::vector<double> integral(values.size(), 0.0);
  for (std::size_t k = 1; k < values.size(); ++k)
    integral[k] = integral[k - 1] + 0.5 * (values[k] + values[k - 1]) * (way[k] - way[k - 1]);
  const auto integralAt = [&](double s) {
    const auto after = std::upper_bound(way.begin() + 1, way.end() - 1, s);
    const auto k = static_cast<std::size_t>(after - way.begin());
    const double cell = way[k] - way[k - 1], t = s - way[k - 1];
    if (!(cell > 0)) return integral[k];
    return integral[k - 1] + t * (values[k - 1] + 0.5 * t / cell * (values[k] - values[k - 1]));
  };
  std::vector<double> mean = values;
  for (std::size_t k = 1; k + 1 < values.size(); ++k) {
    const double half = std::min({reach, way[k] - way.front(), way.back() - way[k]});
    if (half > 1e-9) mean[k] = (integralAt(way[k] + half) - integralAt(way[k] - half)) / (2.0 * half);
  }
  return mean;
}

/// The handle's way for a stroke given by depths: the points themselves.
std::vector<Station> stationsByDepth(const Stroke& stroke) {
  std::vector<Station> stations;
  for (const StrokePoint& point : stroke.points)
    stations.push_back({waypointOf(point, point.depth.value_or(0.0)), point.speed, point.time});
  return stations;
}

/// The handle's way that leaves a mark of given widths.
std::vector<Station> stationsByWidth(const Stroke& stroke, const WritingParameters& parameters,
                                     double tip_length, const BrushCurve& curve) {
  std::vector<Waypoint> points;
  for (const StrokePoint& point : stroke.points)
    points.push_back(waypointOf(point, point.width.value_or(0.0)));
  const WaypointCurve mark(points, kAngleArm);

  // Samples of the mark; its points are among them.
  std::vector<Station> samples;
  std::vector<double> angle, way;
  const auto add = [&](double u, const StrokePoint& point, bool is_point) {
    const Waypoint place = mark.at(u);
    Vector2d tangent = mark.slopeAt(u).head<2>();
    if (tangent.norm() < 1e-9) tangent = mark.slopeAt(u + 1e-3).head<2>();
    double heading = std::atan2(tangent.y(), tangent.x());
    if (!angle.empty()) {
      if (tangent.norm() < 1e-9) heading = angle.back();
      heading = angle.back() + std::remainder(heading - angle.back(), 2.0 * kPi);
    }
    const double step =
        samples.empty() ? 0.0 : (place.head<2>() - samples.back().place.head<2>()).norm();
    way.push_back(samples.empty() ? 0.0 : way.back() + step);
    angle.push_back(heading);
    samples.push_back({place, point.speed, is_point ? point.time : std::nullopt});
  };
  for (int k = 0; k < mark.waypointCount(); ++k) {
    const StrokePoint& point = stroke.points[static_cast<std::size_t>(k)];
    add(mark.knot(k), point, true);
    if (k + 1 == mark.waypointCount()) break;
    const double length =
        (points[static_cast<std::size_t>(k) + 1] - points[static_cast<std::size_t>(k)]).head<3>().norm();
    const int cells = std::max(1, static_cast<int>(std::ceil(length / kMarkSpacing)));
    for (int c = 1; c < cells; ++c)
      add(mark.knot(k) + (mark.knot(k + 1) - mark.knot(k)) * c / cells, point, false);
  }

  const std::vector<double> raw = angle;
  if (samples.size() > 2) angle = averaged(raw, way, parameters.turn_length);
  // Leaning the way it goes, over a turn gradually.
  const std::vector<double> way_of_lean = samples.size() > 2 ? averaged(raw, way, kLeanTurn) : raw;
  const bool has_tilt = std::any_of(stroke.points.begin(), stroke.points.end(),
                                    [](const StrokePoint& p) { return p.tilt != 0.0; });
  for (std::size_t k = 0; k < samples.size() && samples.size() > 1 && !has_tilt; ++k)
    samples[k].place.segment<2>(3) =
        parameters.lean * Vector2d(std::cos(way_of_lean[k]), std::sin(way_of_lean[k]));

  const bool leads = parameters.lag_compensation && samples.size() > 1;
  const auto lead = [&](Station station, double heading, double s, double part) {
    const double tilt = station.place.segment<2>(3).norm();
    const double pressed = part * curve.depth(station.place[2]);
    const double lag = curve.lag(pressed);
    if (leads && lag > 0) {
      // At its start the whole tuft has to lie on the mark, later it turns about a place further
      // forward; and what is under the handle is inked, so the handle stops at the end of the mark.
      const double steady = parameters.lead;
      const double ahead =
          std::min(lag * (steady + (1.0 - steady) * std::exp(-s / lag)), way.back() - s);
      station.place.head<2>() += ahead * Vector2d(std::cos(heading), std::sin(heading));
    }
    station.place[2] = pressed + tip_length * (1.0 - std::cos(tilt));
    return station;
  };
  std::vector<Station> stations;
  for (int k = 0; k < kPressSamples; ++k) {
    Station press = lead(samples.front(), angle.front(), 0.0, static_cast<double>(k) / kPressSamples);
    press.time.reset();
    stations.push_back(press);
  }
  for (std::size_t k = 0; k < samples.size(); ++k)
    stations.push_back(lead(samples[k], angle[k], way[k], 1.0));
  for (int k = kPressSamples - 1; k >= 0; --k) {
    Station raise =
        lead(samples.back(), angle.back(), way.back(), static_cast<double>(k) / kPressSamples);
    raise.time.reset();
    stations.push_back(raise);
  }
  return stations;
}

}  // namespace

Eigen::Quaterniond handleOrientation(double tilt, double azimuth, double twist) {
  // Lean about the horizontal axis at right angles to the azimuth; the shaft does not turn by it.
  const Eigen::Vector3d axis(-std::sin(azimuth), std::cos(azimuth), 0.0);
  return Eigen::Quaterniond(Eigen::AngleAxisd(tilt, axis)) *
         Eigen::Quaterniond(Eigen::AngleAxisd(twist, Eigen::Vector3d::UnitZ()));
}

HandlePose handlePoseAt(const StrokePoint& point, double tip_length) {
  return poseOf(waypointOf(point, point.depth.value_or(0.0)), tip_length);
}

std::vector<HandlePose> planHandlePoses(const std::vector<Stroke>& strokes,
                                        const WritingParameters& parameters, double tip_length,
                                        const BrushCurve* curve) {
  checkParameters(parameters);
  if (strokes.empty()) throw std::invalid_argument("there are no strokes");

  std::vector<Station> all;
  std::vector<int> runs;
  for (std::size_t index = 0; index < strokes.size(); ++index) {
    const Stroke& stroke = strokes[index];
    if (stroke.points.empty()) throw std::invalid_argument(stroke.name + " has no points");
    const bool by_width = stroke.points.front().width.has_value();
    if (by_width && curve == nullptr)
      throw std::invalid_argument(stroke.name + " is given by line width and needs the brush's curve");
    std::vector<Station> stations =
        by_width ? stationsByWidth(stroke, parameters, tip_length, *curve) : stationsByDepth(stroke);

    const auto addInAir = [&](const Station& touch, const Vector2d& along) {
      Station air{touch.place, parameters.air_speed, std::nullopt};
      const double height = parameters.clearance + std::max(0.0, touch.place[2]);
      air.place.head<2>() += parameters.run * height * along;
      air.place[2] = -parameters.clearance;
      all.push_back(air);
      runs.push_back(-1);
    };
    const bool timed = std::any_of(stations.begin(), stations.end(),
                                   [](const Station& s) { return s.time.has_value(); });
    if (timed && !by_width) stations.front().time = 0.0;
    if (stations.front().place[2] >= 0)
      addInAir(stations.front(), -direction(stations.begin(), stations.end()));
    for (const Station& station : stations) {
      all.push_back(station);
      runs.push_back(timed ? static_cast<int>(index) : -1);
    }
    if (stations.back().place[2] >= 0) {
      all.back().speed = std::max(all.back().speed, 0.5 * parameters.air_speed);
      addInAir(stations.back(), -direction(stations.rbegin(), stations.rend()));
    } else {
      all.back().speed = parameters.air_speed;
    }
  }

  std::vector<Waypoint> places;
  std::vector<double> speeds;
  std::vector<std::optional<double>> times;
  for (const Station& station : all) {
    places.push_back(station.place);
    speeds.push_back(station.speed);
    times.push_back(station.time);
  }
  const WaypointCurve path(places, kAngleArm);
  const std::int64_t period_ns = std::llround(1e9 / parameters.rate);
  ScheduleLimits limits;
  limits.acceleration = parameters.acceleration;
  limits.period = static_cast<double>(period_ns) * 1e-9;
  limits.tip_length = tip_length;
  const Schedule schedule(path, speeds, times, runs, limits);
  constexpr double kLongest = 3600.0;  // [s]
  if (!(schedule.duration() <= kLongest))
    throw std::runtime_error("the strokes would take " + std::to_string(schedule.duration()) +
                             " s, more than an hour: raise their speed");

  std::vector<HandlePose> poses;
  const auto count = static_cast<std::int64_t>(std::ceil(schedule.duration() / limits.period - 1e-9));
  for (std::int64_t k = 0; k <= count; ++k) {
    HandlePose pose =
        poseOf(path.at(schedule.parameterAt(static_cast<double>(k) * limits.period)), tip_length);
    pose.stamp_ns = kWritingEpoch_ns + k * period_ns;
    poses.push_back(pose);
  }
  return poses;
}

std::vector<Stroke> strokesOfGlyph(const Glyph& glyph, double size, const Vector2d& origin,
                                   const StrokePoint& defaults) {
  constexpr double kSpacing = 8.0;  // of samples of a median [em units]: finer shows only its jitter
  const double scale = size / kGlyphEm;
  std::vector<Stroke> strokes;
  for (const GlyphStroke& outline : glyph.strokes) {
    Stroke stroke;
    stroke.name = "stroke " + std::to_string(strokes.size() + 1);
    for (const MedialPoint& medial : measureStroke(outline, kSpacing)) {
      StrokePoint point = defaults;
      point.x = origin.x() + scale * medial.position.x();
      point.y = origin.y() + scale * (medial.position.y() - kGlyphBottom);
      point.depth.reset();
      point.width = scale * 2.0 * medial.radius;
      stroke.points.push_back(point);
    }
    strokes.push_back(std::move(stroke));
  }
  return strokes;
}

}  // namespace calligraphy_brush
