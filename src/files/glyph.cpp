#include "calligraphy_brush/files/glyph.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;
using Points = std::vector<Vector2d>;

constexpr double kLargestCoordinate = 1e6;

/// Commands and numbers of an SVG path, one after another.
class PathScanner {
 public:
  explicit PathScanner(const std::string& path) : at_(path.c_str()) {}

  bool atEnd() {
    skipSeparators();
    return *at_ == '\0';
  }
  bool atNumber() {
    skipSeparators();
    return *at_ == '-' || *at_ == '+' || *at_ == '.' || (*at_ >= '0' && *at_ <= '9');
  }
  char takeCommand() {
    skipSeparators();
    return *at_++;
  }
  Vector2d takePoint() {
    const double x = takeNumber();
    return {x, takeNumber()};
  }

 private:
  void skipSeparators() {
    while (*at_ == ' ' || *at_ == ',' || *at_ == '\t' || *at_ == '\n' || *at_ == '\r') ++at_;
  }
  double takeNumber() {
    char* end = nullptr;
    const double number = atNumber() ? std::strtod(at_, &end) : 0.0;
    if (end == nullptr || end == at_) throw std::runtime_error("a number is missing in an SVG path");
    if (!(std::abs(number) <= kLargestCoordinate))
      throw std::runtime_error("a number in an SVG path is too large");
    at_ = end;
    return number;
  }

  const char* at_;
};

/// Parts into which a polynomial curve is cut so that chords stay within `tolerance`: the error of a
/// chord over a part of length 1/n is at most |second derivative| / (8 n²).
int chordCount(double second_derivative, double tolerance) {
  return std::clamp(static_cast<int>(std::ceil(std::sqrt(second_derivative / (8.0 * tolerance)))), 1,
                    1000);
}

void appendQuadratic(Points& points, const Vector2d& b, const Vector2d& c, double tolerance) {
  const Vector2d a = points.back();
  const int n = chordCount(2.0 * (a - 2.0 * b + c).norm(), tolerance);
  for (int k = 1; k <= n; ++k) {
    const double t = static_cast<double>(k) / n, u = 1.0 - t;
    points.push_back(u * u * a + 2.0 * u * t * b + t * t * c);
  }
}

void appendCubic(Points& points, const Vector2d& b, const Vector2d& c, const Vector2d& d,
                 double tolerance) {
  const Vector2d a = points.back();
  const int n =
      chordCount(6.0 * std::max((a - 2.0 * b + c).norm(), (b - 2.0 * c + d).norm()), tolerance);
  for (int k = 1; k <= n; ++k) {
    const double t = static_cast<double>(k) / n, u = 1.0 - t;
    points.push_back(u * u * u * a + 3.0 * u * u * t * b + 3.0 * u * t * t * c + t * t * t * d);
  }
}

double distanceToSegment(const Vector2d& point, const Vector2d& a, const Vector2d& b) {
  const Vector2d along = b - a;
  const double length_squared = along.squaredNorm();
  const double t =
      length_squared > 0 ? std::clamp((point - a).dot(along) / length_squared, 0.0, 1.0) : 0.0;
  return (point - a - t * along).norm();
}

/// Points at equal distances along a polyline, the first and the last among them.
Points resample(const Points& line, double spacing) {
  std::vector<double> length(line.size(), 0.0);
  for (std::size_t k = 1; k < line.size(); ++k)
    length[k] = length[k - 1] + (line[k] - line[k - 1]).norm();
  const int parts = std::max(1, static_cast<int>(std::lround(length.back() / spacing)));
  if (length.back() <= 0) return {line.front()};
  Points even;
  std::size_t segment = 1;
  for (int k = 0; k <= parts; ++k) {
    const double s = length.back() * k / parts;
    while (segment + 1 < line.size() && length[segment] < s) ++segment;
    const double part = length[segment] - length[segment - 1];
    const double t = part > 0 ? std::clamp((s - length[segment - 1]) / part, 0.0, 1.0) : 0.0;
    even.push_back(line[segment - 1] + t * (line[segment] - line[segment - 1]));
  }
  return even;
}

/// One pass of the binomial filter (1, 2, 1)/4; the ends stay.
template <class Value>
void smooth(std::vector<Value>& values) {
  const std::vector<Value> before = values;
  for (std::size_t k = 1; k + 1 < values.size(); ++k)
    values[k] = 0.25 * before[k - 1] + 0.5 * before[k] + 0.25 * before[k + 1];
}

Vector2d tangentAt(const Points& line, std::size_t k) {
  // Over two samples to each side: one would follow the jitter that it is used to remove.
  const std::size_t before = k >= 2 ? k - 2 : 0, after = std::min(k + 2, line.size() - 1);
  return (line[after] - line[before]).normalized();
}

/// Moves a point along `normal`, at most `reach`, to where the inscribed disc is largest. The
/// distance to the outline is concave between two opposite sides: golden-section search.
Vector2d centre(const Outline& outline, const Vector2d& point, const Vector2d& normal, double reach) {
  constexpr double kGolden = 0.6180339887498949;
  double low = -reach, high = reach;
  while (high - low > 0.05 * reach) {
    const double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
    if (insideDistance(outline, point + a * normal) > insideDistance(outline, point + b * normal))
      high = b;
    else
      low = a;
  }
  const Vector2d moved = point + 0.5 * (low + high) * normal;
  return insideDistance(outline, moved) > insideDistance(outline, point) ? moved : point;
}

/// Samples from the end of a line straight on, up to the outline.
Points runToOutline(const Outline& outline, Vector2d point, const Vector2d& direction, double spacing) {
  Points run;
  // At most an em, should the outline be open to that side.
  for (double length = 0.0; length < kGlyphEm; length += spacing) {
    const Vector2d next = point + spacing * direction;
    if (insideDistance(outline, next) <= 0) {
      double inside = 0.0, outside = spacing;
      for (int halving = 0; halving < 20; ++halving) {
        const double middle = 0.5 * (inside + outside);
        (insideDistance(outline, point + middle * direction) > 0 ? inside : outside) = middle;
      }
      if (inside > 0.1 * spacing) run.push_back(point + inside * direction);
      return run;
    }
    run.push_back(next);
    point = next;
  }
  return run;
}

Points readMedian(const YAML::Node& node) {
  Points median;
  if (!node.IsSequence() || node.size() == 0)
    throw std::runtime_error("a median is not a list of points");
  for (const YAML::Node& point : node) {
    double x = 0.0, y = 0.0;
    if (!point.IsSequence() || point.size() != 2 || !YAML::convert<double>::decode(point[0], x) ||
        !YAML::convert<double>::decode(point[1], y) || !(std::abs(x) <= kLargestCoordinate) ||
        !(std::abs(y) <= kLargestCoordinate))
      throw std::runtime_error("a point of a median is not [x, y]");
    median.emplace_back(x, y);
  }
  return median;
}

Glyph parseGlyph(const YAML::Node& root) {
  if (!root.IsMap()) throw std::runtime_error("not the JSON of a character");
  for (const char* key : {"strokes", "medians"})
    if (!root[key] || !root[key].IsSequence())
      throw std::runtime_error("has no list \"" + std::string(key) + "\"");
  const YAML::Node strokes = root["strokes"], medians = root["medians"];
  if (strokes.size() == 0) throw std::runtime_error("has no strokes");
  if (strokes.size() != medians.size())
    throw std::runtime_error("has " + std::to_string(strokes.size()) + " strokes but " +
                             std::to_string(medians.size()) + " medians");
  Glyph glyph;
  for (std::size_t k = 0; k < strokes.size(); ++k) {
    try {
      if (!strokes[k].IsScalar()) throw std::runtime_error("the outline is not a text");
      glyph.strokes.push_back({parseSvgPath(strokes[k].Scalar()), readMedian(medians[k])});
    } catch (const std::runtime_error& error) {
      throw std::runtime_error("stroke " + std::to_string(k + 1) + ": " + error.what());
    }
  }
  return glyph;
}

}  // namespace

Outline parseSvgPath(const std::string& path, double tolerance) {
  Outline outline;
  PathScanner scan(path);
  char command = '\0';
  while (!scan.atEnd()) {
    // A number in the place of a command repeats the last one; after M it means L.
    if (!scan.atNumber())
      command = scan.takeCommand();
    else if (command == 'M')
      command = 'L';
    else if (command == '\0' || command == 'Z')
      throw std::runtime_error("a number stands before any command of an SVG path");

    if (command != 'M' && outline.empty()) throw std::runtime_error("an SVG path does not begin with M");
    switch (command) {
      case 'M': outline.push_back({scan.takePoint()}); break;
      case 'L': outline.back().push_back(scan.takePoint()); break;
      case 'Q': {
        const Vector2d b = scan.takePoint();
        appendQuadratic(outline.back(), b, scan.takePoint(), tolerance);
        break;
      }
      case 'C': {
        const Vector2d b = scan.takePoint(), c = scan.takePoint();
        appendCubic(outline.back(), b, c, scan.takePoint(), tolerance);
        break;
      }
      case 'Z': break;  // every outline is closed by its meaning
      default:
        throw std::runtime_error(std::string("SVG path command '") + command +
                                 "' is not one of M L Q C Z");
    }
  }
  for (const Points& polygon : outline)
    if (polygon.size() < 3) throw std::runtime_error("an outline has fewer than three points");
  if (outline.empty()) throw std::runtime_error("an outline is empty");
  return outline;
}

double insideDistance(const Outline& outline, const Vector2d& point) {
  double distance = std::numeric_limits<double>::infinity();
  int winding = 0;
  for (const Points& polygon : outline) {
    for (std::size_t k = 0; k < polygon.size(); ++k) {
      const Vector2d& a = polygon[k];
      const Vector2d& b = polygon[k + 1 < polygon.size() ? k + 1 : 0];
      distance = std::min(distance, distanceToSegment(point, a, b));
      const double side = (b.x() - a.x()) * (point.y() - a.y()) - (point.x() - a.x()) * (b.y() - a.y());
      if (a.y() <= point.y() && b.y() > point.y() && side > 0) ++winding;
      if (a.y() > point.y() && b.y() <= point.y() && side < 0) --winding;
    }
  }
  return winding != 0 ? distance : -distance;
}

std::vector<MedialPoint> measureStroke(const GlyphStroke& stroke, double spacing) {
  Points line = resample(stroke.median, spacing);
  constexpr int kRounds = 4;
  for (int round = 0; round < kRounds && line.size() > 1; ++round) {
    const Points before = line;
    for (std::size_t k = 0; k < line.size(); ++k) {
      const Vector2d tangent = tangentAt(before, k);
      line[k] = centre(stroke.outline, before[k], {-tangent.y(), tangent.x()}, spacing);
    }
    smooth(line);
    line = resample(line, spacing);
  }
  if (line.size() > 1) {
    // The ends of a rough median often sit aside or bend off: what runs on is the line before them.
    const Points head = runToOutline(stroke.outline, line.front(), -tangentAt(line, 0), spacing);
    const Points tail =
        runToOutline(stroke.outline, line.back(), tangentAt(line, line.size() - 1), spacing);
    line.insert(line.begin(), head.rbegin(), head.rend());
    line.insert(line.end(), tail.begin(), tail.end());
  }

  std::vector<double> radius;
  for (const Vector2d& point : line)
    radius.push_back(std::max(0.0, insideDistance(stroke.outline, point)));
  // At a blunt end the disc shrinks as fast as its centre nears the outline: the line ends before, where
  // the last whole disc touches it. At a pointed end it shrinks slowly, and the line goes on to the
  // point.
  constexpr double kBlunt = 0.4;
  std::size_t first = 0, last = line.size() - 1;
  const auto shrinks = [&](std::size_t from, std::size_t to) {
    return radius[from] - radius[to] > kBlunt * (line[from] - line[to]).norm();
  };
  while (first + 2 < last && shrinks(first + 1, first)) ++first;
  while (first + 2 < last && shrinks(last - 1, last)) --last;
  smooth(radius);
  std::vector<MedialPoint> measured;
  for (std::size_t k = first; k <= last; ++k) measured.push_back({line[k], radius[k]});
  return measured;
}

Glyph readGlyph(const std::string& file) {
  try {
    return parseGlyph(YAML::LoadFile(file));
  } catch (const YAML::BadFile&) {
    throw std::runtime_error(file + ": cannot be read");
  } catch (const YAML::Exception& error) {
    throw std::runtime_error(file + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(file + ": " + error.what());
  }
}

GreyPicture drawOutlines(const std::vector<Outline>& outlines, int width_px, int height_px,
                         double px_per_unit) {
  constexpr int kSamples = 4;
  GreyPicture picture{width_px, height_px, {}};
  const auto columns = static_cast<std::size_t>(width_px) * kSamples;
  picture.mono8.assign(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px), 255);
  struct Crossing {
    double x;
    int turn;
  };
  std::vector<Crossing> crossings;
  std::vector<std::uint8_t> inside(columns);
  std::vector<int> covered(static_cast<std::size_t>(width_px));
  for (int row = 0; row < height_px; ++row) {
    std::fill(covered.begin(), covered.end(), 0);
    for (int sample = 0; sample < kSamples; ++sample) {
      const double y = (height_px - row - (sample + 0.5) / kSamples) / px_per_unit;
      std::fill(inside.begin(), inside.end(), std::uint8_t{0});
      for (const Outline& outline : outlines) {
        crossings.clear();
        for (const auto& polygon : outline)
          for (std::size_t k = 0; k < polygon.size(); ++k) {
            const Eigen::Vector2d &a = polygon[k], &b = polygon[k + 1 < polygon.size() ? k + 1 : 0];
            if ((a.y() <= y) == (b.y() <= y)) continue;
            const double t = (y - a.y()) / (b.y() - a.y());
            crossings.push_back({a.x() + t * (b.x() - a.x()), a.y() <= y ? 1 : -1});
          }
        std::sort(crossings.begin(), crossings.end(),
                  [](const Crossing& a, const Crossing& b) { return a.x < b.x; });
        int winding = 0;
        for (std::size_t k = 0; k + 1 < crossings.size(); ++k) {
          winding += crossings[k].turn;
          if (winding == 0) continue;
          const auto columnOf = [&](double x) {
            return static_cast<std::size_t>(std::clamp(std::ceil(x * px_per_unit * kSamples - 0.5), 0.0,
                                                       static_cast<double>(columns)));
          };
          for (std::size_t c = columnOf(crossings[k].x); c < columnOf(crossings[k + 1].x); ++c)
            inside[c] = 1;
        }
      }
      for (std::size_t c = 0; c < columns; ++c) covered[c / kSamples] += inside[c];
    }
    for (std::size_t c = 0; c < covered.size(); ++c)
      picture.mono8[static_cast<std::size_t>(row) * covered.size() + c] = static_cast<std::uint8_t>(
          255 - std::lround(255.0 * covered[c] / static_cast<double>(kSamples * kSamples)));
  }
  return picture;
}

}  // namespace calligraphy_brush
