#include "calligraphy_brush/files/stroke_file.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <sstream>

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {
namespace {

/// Reads strokes and collects what is wrong with them.
class StrokeReader {
 public:
  explicit StrokeReader(const std::string& file) : file_(file) {}

  std::vector<Stroke> read(const YAML::Node& root) {
    StrokePoint defaults;
    if (root.IsMap()) readMap(root, "", defaults, {"strokes"});
    const bool has_list = root.IsSequence() || root["strokes"];
    std::vector<Stroke> strokes;
    if (!has_list) {
      report(root, "there is no list \"strokes\"");
    } else if (const YAML::Node list = root.IsSequence() ? root : root["strokes"]; !list.IsSequence()) {
      report(list, "strokes must be a list");
    } else {
      if (list.size() == 0) report(list, "there are no strokes");
      for (const YAML::Node& node : list)
        strokes.push_back(readStroke(node, defaults, strokes.size() + 1));
    }
    if (!problems_.empty()) throw ParameterError(problems_);
    return strokes;
  }

 private:
  using Names = std::vector<std::string>;

  Stroke readStroke(const YAML::Node& node, StrokePoint defaults, std::size_t number) {
    Stroke stroke;
    stroke.name = "stroke " + std::to_string(number);
    if (node.IsMap()) {
      readMap(node, stroke.name + ": ", defaults, {"name", "points"});
      if (node["name"] && node["name"].IsScalar()) stroke.name += " (" + node["name"].Scalar() + ")";
    }
    const bool has_points = node.IsSequence() || (node.IsMap() && node["points"]);
    if (!has_points) {
      report(node, stroke.name + " has no list of points");
      return stroke;
    }
    const YAML::Node points = node.IsMap() ? node["points"] : node;
    if (!points.IsSequence() || points.size() == 0) {
      report(node, stroke.name + " has no list of points");
      return stroke;
    }
    for (const YAML::Node& point : points) {
      const std::string where = stroke.name + ", point " + std::to_string(stroke.points.size() + 1);
      stroke.points.push_back(readPoint(point, defaults, where));
    }
    checkTogether(stroke, points);
    return stroke;
  }

  StrokePoint readPoint(const YAML::Node& node, StrokePoint point, const std::string& where) {
    if (node.IsSequence()) {
      if (node.size() != 3) {
        report(node, where + " must be [x, y, depth]");
        return point;
      }
      double depth = 0.0;
      readNumber(node[0], where + ": x", -10.0, 10.0, "m", point.x);
      readNumber(node[1], where + ": y", -10.0, 10.0, "m", point.y);
      readNumber(node[2], where + ": depth", -1.0, 1.0, "m", depth);
      point.depth = depth;
    } else if (node.IsMap()) {
      readMap(node, where + ": ", point, {"x", "y", "depth", "width", "time"});
      const auto number = [&](const char* key, double low, double high, const char* unit) {
        std::optional<double> value;
        if (double read = 0.0;
            node[key] && readNumber(node[key], where + ": " + key, low, high, unit, read))
          value = read;
        return value;
      };
      if (!node["x"] || !node["y"]) report(node, where + " needs x and y");
      if (static_cast<bool>(node["depth"]) == static_cast<bool>(node["width"]))
        report(node, where + " needs one of depth and width");
      point.x = number("x", -10.0, 10.0, "m").value_or(0.0);
      point.y = number("y", -10.0, 10.0, "m").value_or(0.0);
      point.depth = number("depth", -1.0, 1.0, "m");
      point.width = number("width", 1e-6, 1.0, "m");
      point.time = number("time", 0.0, 3600.0, "s");
    } else {
      report(node, where + " must be [x, y, depth] or a map");
    }
    return point;
  }

  void checkTogether(const Stroke& stroke, const YAML::Node& points) {
    double latest = -1.0;
    for (std::size_t k = 0; k < stroke.points.size(); ++k) {
      const StrokePoint& point = stroke.points[k];
      const std::string where = stroke.name + ", point " + std::to_string(k + 1);
      if (point.width && stroke.points.front().depth)
        report(points[k], where + " has a width, but the stroke's first point a depth");
      if (point.depth && stroke.points.front().width)
        report(points[k], where + " has a depth, but the stroke's first point a width");
      if (!point.time) continue;
      if (k == 0 && *point.time != 0.0)
        report(points[k], where + ": times count from the first point, which must have time 0");
      if (*point.time <= latest)
        report(points[k],
               where + ": time = " + text(*point.time) + " s is not after " + text(latest) + " s");
      latest = *point.time;
    }
  }

  /// Reads the keys that may be defaults into `point` and reports keys that are neither those nor
  /// `others`.
  void readMap(const YAML::Node& map, const std::string& where, StrokePoint& point,
               const Names& others) {
    for (const auto& pair : map) {
      const std::string key = pair.first.IsScalar() ? pair.first.Scalar() : "?";
      if (key == "speed")
        readNumber(pair.second, where + key, 1e-4, 5.0, "m/s", point.speed);
      else if (key == "tilt")
        readNumber(pair.second, where + key, 0.0, 1.5, "rad", point.tilt);
      else if (key == "azimuth")
        readNumber(pair.second, where + key, -7.0, 7.0, "rad", point.azimuth);
      else if (key == "twist")
        readNumber(pair.second, where + key, -7.0, 7.0, "rad", point.twist);
      else if (std::find(others.begin(), others.end(), key) == others.end())
        report(pair.first, where + "unknown key \"" + key + "\"");
    }
  }

  bool readNumber(const YAML::Node& node, const std::string& what, double low, double high,
                  const char* unit, double& value) {
    double read = 0.0;
    const std::string range = "[" + text(low) + ", " + text(high) + "] " + unit;
    if (!node.IsScalar() || !YAML::convert<double>::decode(node, read)) {
      report(node, what + " must be a number in " + range);
    } else if (!(read >= low && read <= high)) {  // NaN fails
      report(node, what + " = " + node.Scalar() + " is outside " + range);
    } else {
      value = read;
      return true;
    }
    return false;
  }

  void report(const YAML::Node& at, const std::string& problem) {
    problems_.push_back(file_ + ":" + std::to_string(at.Mark().line + 1) + ": " + problem);
  }

  static std::string text(double value) {
    std::ostringstream stream;
    stream << value;
    return stream.str();
  }

  std::string file_;
  std::vector<std::string> problems_;
};

}  // namespace

std::vector<Stroke> readStrokeFile(const std::string& file) {
  YAML::Node root;
  try {
    root = YAML::LoadFile(file);
  } catch (const YAML::BadFile&) {
    throw ParameterError({file + ": cannot be read"});
  } catch (const YAML::Exception& error) {
    throw ParameterError({file + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg});
  }
  if (!root.IsMap() && !root.IsSequence()) throw ParameterError({file + ":1: has no strokes"});
  return StrokeReader(file).read(root);
}

}  // namespace calligraphy_brush
