#include "calligraphy_brush/score/recorded_strokes.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

#include "calligraphy_brush/files/stroke_file.h"
#include "calligraphy_brush/writing/trajectory.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

/// Piecewise linear through values at t = 0, 0.333, 0.666, 1, as the arm's program has it.
double alongKnots(const std::array<double, 4>& values, double t) {
  constexpr std::array<double, 4> kKnots{0.0, 0.333, 0.666, 1.0};
  t = std::clamp(t, 0.0, 1.0);
  std::size_t k = 0;
  while (k < 2 && t > kKnots[k + 1]) ++k;
  const double part = (t - kKnots[k]) / (kKnots[k + 1] - kKnots[k]);
  return values[k] + part * (values[k + 1] - values[k]);
}

std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> parts;
  std::istringstream text(line);
  for (std::string part; std::getline(text, part, ',');) {
    while (!part.empty() && (part.back() == '\r' || part.back() == ' ')) part.pop_back();
    parts.push_back(part);
  }
  return parts;
}

double numberOf(const std::string& text, const std::string& what) {
  std::size_t used = 0;
  double value = 0.0;
  try {
    value = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used == 0 || used != text.size() || !std::isfinite(value))
    throw std::runtime_error(what + " = \"" + text + "\" is not a number");
  return value;
}

std::vector<RecordedStroke> readPaths(const std::string& file, double depth_range) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error(file + ": cannot be read");
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> header = cells(line);
  std::vector<RecordedStroke> strokes;
  for (int row = 2; std::getline(in, line); ++row) {
    if (line.empty()) continue;
    const std::string where = file + ":" + std::to_string(row) + ": ";
    const std::vector<std::string> values = cells(line);
    if (values.size() != header.size())
      throw std::runtime_error(where + "has " + std::to_string(values.size()) + " values, the header " +
                               std::to_string(header.size()));
    std::map<std::string, double> by_name;
    for (std::size_t k = 0; k < header.size(); ++k)
      by_name[header[k]] = numberOf(values[k], where + header[k]);
    const auto valueOf = [&](const std::string& name) {
      const auto found = by_name.find(name);
      if (found == by_name.end()) throw std::runtime_error(file + ": has no column " + name);
      return found->second;
    };
    RecordedStroke stroke;
    stroke.number = static_cast<int>(valueOf("stroke"));
    for (std::size_t k = 0; k < 4; ++k) {
      const std::string i = std::to_string(k);
      stroke.place[k] = {valueOf("x" + i + "_m"), valueOf("y" + i + "_m")};
      stroke.depth[k] = depth_range * valueOf("z" + i + "_norm");
      stroke.tilt[k] = valueOf("tilt" + i + "_rad");
      if (!(stroke.place[k].norm() < 1.0 && std::abs(stroke.depth[k]) < 1.0 &&
            std::abs(stroke.tilt[k]) < 1.5))
        throw std::runtime_error(where + "a control point is further than 1 m or 1.5 rad away");
    }
    strokes.push_back(stroke);
  }
  if (strokes.empty()) throw std::runtime_error(file + ": has no strokes");
  return strokes;
}

}  // namespace

Vector2d RecordedStroke::placeAt(double t) const {
  const double u = 1.0 - t;
  return u * u * u * place[0] + 3 * u * u * t * place[1] + 3 * u * t * t * place[2] +
         t * t * t * place[3];
}

Vector2d RecordedStroke::headingAt(double t) const {
  const double u = 1.0 - t;
  const Vector2d slope =
      u * u * (place[1] - place[0]) + 2 * u * t * (place[2] - place[1]) + t * t * (place[3] - place[2]);
  return slope.norm() > 1e-9 ? Vector2d(slope.normalized()) : Vector2d::UnitX();
}

double RecordedStroke::depthAt(double t) const {
  return alongKnots(depth, t);
}
double RecordedStroke::tiltAt(double t) const {
  return alongKnots(tilt, t);
}

double RecordedStroke::bend() const {
  const Vector2d chord = place[3] - place[0], middle = placeAt(0.5) - place[0];
  return chord.norm() > 0 ? (chord.x() * middle.y() - chord.y() * middle.x()) / chord.norm() : 0.0;
}

RecordedSet readRecordedSet(const std::string& folder) {
  RecordedSet set;
  const std::string meta_file = folder + "/meta.json";
  double depth_range = 0.0;
  try {
    const YAML::Node meta = YAML::LoadFile(meta_file);
    const auto number = [&](const char* name) {
      const auto value = meta[name].as<double>();
      if (!(value > 0 && value < 1e6))
        throw std::runtime_error(meta_file + ": " + name + " is outside (0, 1e6)");
      return value;
    };
    set.columns = static_cast<int>(number("cols"));
    set.tile_width_px = static_cast<int>(number("tile_w_px"));
    set.tile_height_px = static_cast<int>(number("tile_h_px"));
    set.px_per_mm = number("px_per_mm");
    set.origin_px = {meta["origin_px"][0].as<double>(), meta["origin_px"][1].as<double>()};
    depth_range = 1e-3 * number("depth_range_mm");
  } catch (const YAML::BadFile&) {
    throw std::runtime_error(meta_file + ": cannot be read");
  } catch (const YAML::Exception& error) {
    throw std::runtime_error(meta_file + ": " + error.msg);
  }
  set.strokes = readPaths(folder + "/strokes.csv", depth_range);
  set.tiles = readPng(folder + "/strokes.png");
  const int rows = (static_cast<int>(set.strokes.size()) + set.columns - 1) / set.columns;
  if (set.tiles.width_px < set.columns * set.tile_width_px ||
      set.tiles.height_px < rows * set.tile_height_px)
    throw std::runtime_error(folder + "/strokes.png: is smaller than its tiles");
  return set;
}

Mask photographOf(const RecordedSet& set, std::size_t index, double px_per_mm) {
  const auto columns = static_cast<std::size_t>(set.columns);
  const std::size_t left = index % columns * static_cast<std::size_t>(set.tile_width_px);
  const std::size_t top = index / columns * static_cast<std::size_t>(set.tile_height_px);
  GreyPicture tile{set.tile_width_px, set.tile_height_px, {}};
  for (int row = 0; row < set.tile_height_px; ++row) {
    const auto* start =
        set.tiles.mono8.data() +
        (top + static_cast<std::size_t>(row)) * static_cast<std::size_t>(set.tiles.width_px) + left;
    tile.mono8.insert(tile.mono8.end(), start, start + set.tile_width_px);
  }
  const auto width = static_cast<int>(std::ceil(1e3 * set.width() * px_per_mm - 1e-6));
  const auto height = static_cast<int>(std::ceil(1e3 * set.height() * px_per_mm - 1e-6));
  std::vector<Vector2d> path;
  constexpr int kSamples = 200;
  constexpr double kReach_mm = 3.0;
  for (int k = 0; k <= kSamples; ++k)
    path.push_back(1e3 *
                   (set.origin() + set.strokes.at(index).placeAt(static_cast<double>(k) / kSamples)));
  // As fine as the photograph is: its rims may be as thin as a pixel of the score.
  const Mask paint = withoutHoles(piecesNear(maskOf(tile, set.px_per_mm), path, kReach_mm));
  for (std::size_t k = 0; k < paint.ink.size(); ++k) tile.mono8[k] = paint.ink[k] ? 0 : 255;
  return maskOf(resampled(tile, set.px_per_mm, Vector2d::Zero(), width, height, px_per_mm), px_per_mm);
}

namespace {

/// What an arm is told and goes straight between: x, y [m], depth [m], and the lean of the shaft, its
/// tilt [rad] to the side it leans to.
using ArmPoint = Eigen::Matrix<double, 5, 1>;

ArmPoint armPointAt(const RecordedStroke& stroke, double t, double depth) {
  const Vector2d place = stroke.placeAt(t), heading = stroke.headingAt(t);
  ArmPoint point;
  point << place, depth, stroke.tiltAt(t) * Vector2d(-heading.y(), heading.x());
  return point;
}

/// Straight lines through the points, corners rounded by parabolas that begin at most `corner` before a
/// point and no further than half of the way to the next, as dense points.
std::vector<ArmPoint> withRoundCorners(const std::vector<ArmPoint>& points, double corner) {
  constexpr int kPieces = 16;
  const auto distance = [](const ArmPoint& a, const ArmPoint& b) {
    return (a - b).head<3>().norm();
  };
  std::vector<ArmPoint> way{points.front()};
  for (std::size_t k = 1; k + 1 < points.size(); ++k) {
    const ArmPoint &before = points[k - 1], &here = points[k], &after = points[k + 1];
    const double to = distance(before, here), from = distance(here, after);
    const double cut = std::min({corner, 0.5 * to, 0.5 * from});
    if (!(cut > 0.0)) {
      way.push_back(here);
      continue;
    }
    const ArmPoint a = here + cut / to * (before - here), b = here + cut / from * (after - here);
    for (int i = 0; i <= kPieces; ++i) {
      const double q = static_cast<double>(i) / kPieces, p = 1.0 - q;
      way.push_back(p * p * a + 2 * p * q * here + q * q * b);
    }
  }
  way.push_back(points.back());
  return way;
}

/// The way of an arm that is driven by waypoints, at equal steps of time.
std::vector<ArmPoint> wayByWaypoints(const RecordedStroke& stroke, const ArmMotion& motion) {
  std::vector<ArmPoint> points;
  const auto add = [&](double t, double depth) { points.push_back(armPointAt(stroke, t, depth)); };
  const auto air = [&](double t, double depth, double above) {
    add(t, depth - above);
    if (depth - above > -motion.clearance) add(t, -motion.clearance);
  };
  air(0.0, stroke.depthAt(0.0), motion.approach);
  std::reverse(points.begin(), points.end());
  for (int k = 0; k < motion.waypoints; ++k) {
    const double t = static_cast<double>(k) / (motion.waypoints - 1);
    add(t, stroke.depthAt(t));
  }
  air(1.0, stroke.depthAt(1.0), motion.departure);

  // In the air it is faster. Both ends are cut at the clearance.
  const std::vector<ArmPoint> dense = withRoundCorners(points, motion.corner);
  std::vector<double> time{0.0};
  for (std::size_t k = 1; k < dense.size(); ++k) {
    const double length = (dense[k] - dense[k - 1]).head<3>().norm();
    const bool in_air = 0.5 * (dense[k][2] + dense[k - 1][2]) < 0.0;
    time.push_back(time.back() + length / (in_air ? motion.air_speed : motion.speed));
  }
  const int steps = std::max(1, static_cast<int>(std::ceil(time.back() / motion.period)));
  std::vector<ArmPoint> way;
  std::size_t k = 1;
  for (int n = 0; n <= steps; ++n) {
    const double now = time.back() * n / steps;
    while (k + 1 < dense.size() && time[k] < now) ++k;
    const double cell = time[k] - time[k - 1];
    const double part = cell > 0 ? std::clamp((now - time[k - 1]) / cell, 0.0, 1.0) : 1.0;
    const ArmPoint point = dense[k - 1] + part * (dense[k] - dense[k - 1]);
    if (point[2] >= -1.0000001 * motion.clearance) way.push_back(point);
  }
  return way;
}

}  // namespace

std::vector<HandlePose> posesOf(const RecordedStroke& stroke, const ArmMotion& motion,
                                const Vector2d& origin, double turn, double tip_length) {
  const Eigen::Rotation2Dd rotation(turn);
  std::vector<HandlePose> poses;
  const auto addPose = [&](const ArmPoint& where) {
    StrokePoint point;
    const Vector2d place = origin + rotation * (motion.offset + where.head<2>());
    const Vector2d lean = rotation * Vector2d(where.tail<2>());
    point.x = place.x();
    point.y = place.y();
    point.depth = where[2];
    point.twist = turn;
    point.tilt = lean.norm();
    point.azimuth = std::atan2(lean.y(), lean.x());
    HandlePose pose = handlePoseAt(point, tip_length);
    pose.stamp_ns =
        kWritingEpoch_ns + static_cast<std::int64_t>(poses.size()) * std::llround(1e9 * motion.period);
    poses.push_back(pose);
  };
  if (motion.waypoints > 0) {
    if (motion.waypoints < 2) throw std::invalid_argument("an arm needs two waypoints at least");
    for (const ArmPoint& point : wayByWaypoints(stroke, motion)) addPose(point);
    return poses;
  }
  const auto add = [&](double t, double depth) { addPose(armPointAt(stroke, t, depth)); };
  // Equal steps of the way, by inverting its length over t.
  constexpr int kSamples = 400;
  std::vector<double> way{0.0};
  for (int k = 1; k <= kSamples; ++k)
    way.push_back(way.back() + (stroke.placeAt(static_cast<double>(k) / kSamples) -
                                stroke.placeAt(static_cast<double>(k - 1) / kSamples))
                                   .norm());
  const auto steps = [&](double length, double speed) {
    return std::max(1, static_cast<int>(std::ceil(length / (speed * motion.period))));
  };
  const double down = motion.clearance + std::max(0.0, stroke.depth[0]);
  for (int n = steps(down, motion.air_speed), k = 0; k < n; ++k)
    add(0.0, stroke.depth[0] - down * (1.0 - static_cast<double>(k) / n));
  std::size_t sample = 1;
  for (int n = steps(way.back(), motion.speed), k = 0; k <= n; ++k) {
    const double s = way.back() * k / n;
    while (sample < kSamples && way[sample] < s) ++sample;
    const double cell = way[sample] - way[sample - 1];
    const double part = cell > 0 ? std::clamp((s - way[sample - 1]) / cell, 0.0, 1.0) : 1.0;
    const double t = (static_cast<double>(sample - 1) + part) / kSamples;
    add(t, stroke.depthAt(t));
  }
  const double up = motion.clearance + std::max(0.0, stroke.depth[3]);
  for (int n = steps(up, motion.air_speed), k = 1; k <= n; ++k)
    add(1.0, stroke.depth[3] - up * static_cast<double>(k) / n);
  return poses;
}

}  // namespace calligraphy_brush
