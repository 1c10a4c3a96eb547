#include "calligraphy_brush/writing/correction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/writing/trajectory.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

constexpr double kMargin = 0.02;        // of sheet around a stroke [m]
constexpr int kSmoothing = 6;           // passes of a binomial filter over errors
constexpr double kLeastWidth = 0.2e-3;  // that is asked for [m]

/// A grey picture in the paper frame: whether there is ink at any place, 0..1, linear between pixels'
/// centres. Half as dark as can be is half, and an eighth to both sides of it no and yes: how black ink
/// is does not make a line wider, and what a score counts as ink, darker than half, counts here.
class InkPicture {
 public:
  InkPicture(GreyPicture picture, double px_per_m) : picture_(std::move(picture)), px_per_m_(px_per_m) {}

  double at(const Vector2d& place) const {
    const double x = place.x() * px_per_m_ - 0.5, y = picture_.height_px - place.y() * px_per_m_ - 0.5;
    const double column = std::floor(x), row = std::floor(y);
    const double u = x - column, v = y - row;
    const int c = static_cast<int>(column), r = static_cast<int>(row);
    return (1 - v) * ((1 - u) * pixel(c, r) + u * pixel(c + 1, r)) +
           v * ((1 - u) * pixel(c, r + 1) + u * pixel(c + 1, r + 1));
  }
  const GreyPicture& picture() const { return picture_; }
  double pixelSize() const { return 1.0 / px_per_m_; }

 private:
  double pixel(int column, int row) const {
    if (column < 0 || row < 0 || column >= picture_.width_px || row >= picture_.height_px) return 0.0;
    const double dark =
        1.0 -
        picture_.mono8[static_cast<std::size_t>(row) * static_cast<std::size_t>(picture_.width_px) +
                       static_cast<std::size_t>(column)] /
            255.0;
    constexpr double kSteepness = 4.0;
    return std::clamp(0.5 + kSteepness * (dark - 0.5), 0.0, 1.0);
  }

  GreyPicture picture_;
  double px_per_m_;
};

double likeness(const GreyPicture& a, const GreyPicture& b) {
  long both = 0, either = 0;
  for (std::size_t k = 0; k < a.mono8.size(); ++k) {
    both += a.mono8[k] < 128 && b.mono8[k] < 128;
    either += a.mono8[k] < 128 || b.mono8[k] < 128;
  }
  return either > 0 ? static_cast<double>(both) / static_cast<double>(either) : 1.0;
}

/// Ink on a line across a mark.
struct Section {
  double length = 0.0;  ///< of the line that is ink [m]
  double middle = 0.0;  ///< mean place of it, along the direction [m]; 0 without ink
};

/// Of the line from place − reach · direction to place + reach · direction: integrals of the ink, so
/// that gaps between hairs and hairs astray count for what they are.
Section sectionOf(const InkPicture& ink, const Vector2d& place, const Vector2d& direction,
                  double reach) {
  const int count = std::max(1, static_cast<int>(std::ceil(reach / (0.5 * ink.pixelSize()))));
  const double step = reach / count;
  double sum = 0.0, moment = 0.0;
  for (int k = -count; k < count; ++k) {
    const double s = (k + 0.5) * step, part = ink.at(place + s * direction);
    sum += part;
    moment += part * s;
  }
  return {sum * step, sum * step > 0.5 * ink.pixelSize() ? moment / sum : 0.0};
}

/// What the next pass changes at a point of the mark.
struct Change {
  Vector2d shift = Vector2d::Zero();  // [m]
  double width = 0.0;                 // [m]
};

void smooth(std::vector<Change>& changes, int passes) {
  for (int pass = 0; pass < passes; ++pass) {
    const std::vector<Change> before = changes;
    for (std::size_t k = 0; k < changes.size(); ++k) {
      const Change &a = before[k > 0 ? k - 1 : k], &b = before[k + 1 < changes.size() ? k + 1 : k];
      changes[k].shift = 0.25 * a.shift + 0.5 * before[k].shift + 0.25 * b.shift;
      changes[k].width = 0.25 * a.width + 0.5 * before[k].width + 0.25 * b.width;
    }
  }
}

Vector2d placeOf(const StrokePoint& point) {
  return {point.x, point.y};
}

/// Unit direction of a mark at a point, over two neighbours to each side.
Vector2d tangentAt(const std::vector<StrokePoint>& points, std::size_t k) {
  const std::size_t before = k >= 2 ? k - 2 : 0, after = std::min(k + 2, points.size() - 1);
  const Vector2d way = placeOf(points[after]) - placeOf(points[before]);
  return way.norm() > 1e-9 ? Vector2d(way.normalized()) : Vector2d::UnitX();
}

/// Practice of one stroke on a small sheet of its own.
class Practice {
 public:
  Practice(const Stroke& stroke, const Outline& outline, const SimulatorParameters& parameters,
           const WritingParameters& writing, const BrushCurve& curve, const CorrectionOptions& options)
      : parameters_(parameters), writing_(writing), curve_(curve), options_(options), wanted_(stroke) {
    Vector2d low = Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const auto& polygon : outline)
      for (const Vector2d& point : polygon) {
        low = low.cwiseMin(point);
        high = high.cwiseMax(point);
      }
    for (const StrokePoint& point : stroke.points) {
      low = low.cwiseMin(placeOf(point));
      high = high.cwiseMax(placeOf(point));
    }
    corner_ = low - Vector2d::Constant(kMargin);
    const Vector2d size = high - low + Vector2d::Constant(2.0 * kMargin);
    parameters_.paper.width = size.x();
    parameters_.paper.height = size.y();
    move(wanted_, -corner_);
    outline_ = outline;
    for (auto& polygon : outline_)
      for (Vector2d& point : polygon) point -= corner_;
    tip_length_ = makeBrush(parameters_.brush).tip_length;
  }

  CorrectedStroke run() {
    CorrectedStroke best;
    double best_iou = -1.0;
    const std::size_t count = wanted_.points.size();
    std::vector<Change> asked(count), good(count), error(count);
    std::vector<double> least(count, std::numeric_limits<double>::infinity()),
        gain(count, options_.gain);
    for (int pass = 0; pass < options_.passes; ++pass) {
      const Stroke stroke = changed(asked);
      const InkPicture ink = write(stroke);
      if (pass == 0) {
        const GreyPicture& picture = ink.picture();
        target_.emplace(
            drawOutlines({outline_}, picture.width_px, picture.height_px, 1.0 / ink.pixelSize()),
            1.0 / ink.pixelSize());
      }
      const double iou = likeness(target_->picture(), ink.picture());
      best.iou.push_back(iou);
      if (iou > best_iou) {
        best_iou = iou;
        best.stroke = stroke;
      }
      // Each part of the stroke goes on from its own best pass, less far after one that was worse.
      const std::vector<double> unlikeness = unlikenessOf(ink);
      const std::vector<Change> now = errorsOf(ink);
      for (std::size_t k = 0; k < count; ++k) {
        if (unlikeness[k] < least[k]) {
          least[k] = unlikeness[k];
          good[k] = asked[k];
          error[k] = now[k];
        } else {
          gain[k] *= 0.5;
        }
        asked[k].shift = good[k].shift + gain[k] * error[k].shift;
        asked[k].width = good[k].width + gain[k] * error[k].width;
      }
      smooth(asked, 2);
    }
    move(best.stroke, corner_);
    return best;
  }

 private:
  static void move(Stroke& stroke, const Vector2d& by) {
    for (StrokePoint& point : stroke.points) {
      point.x += by.x();
      point.y += by.y();
    }
  }

  InkPicture write(const Stroke& stroke) const {
    Simulator simulator(parameters_);
    for (const HandlePose& pose : planHandlePoses({stroke}, writing_, tip_length_, &curve_)) {
      simulator.addPose(pose);
      simulator.advance();
    }
    GreyPicture picture{simulator.paper().width_px(), simulator.paper().height_px(), {}};
    simulator.paper().render(picture.mono8);
    return {std::move(picture), 1.0 / simulator.paper().pixelSize()};
  }

  /// By how much the ink is aside and too narrow at each point of the mark.
  std::vector<Change> errorsOf(const InkPicture& ink) const {
    const std::vector<StrokePoint>& mark = wanted_.points;
    std::vector<Change> errors(mark.size());
    for (std::size_t k = 0; k < mark.size(); ++k) {
      const Vector2d place = placeOf(mark[k]), along = tangentAt(mark, k), left(-along.y(), along.x());
      const double reach = 0.8 * *mark[k].width + 1e-3;
      const Section want = sectionOf(*target_, place, left, reach),
                    have = sectionOf(ink, place, left, reach);
      errors[k].width = want.length - have.length;
      if (have.length > 0) errors[k].shift = (want.middle - have.middle) * left;
    }
    smooth(errors, kSmoothing);
    for (const bool at_end : {false, true}) stretch(errors, ink, at_end);
    return errors;
  }

  /// Moves an end of the line by how much too short the ink is there; less and less up to a width and a
  /// half away from it.
  void stretch(std::vector<Change>& errors, const InkPicture& ink, bool at_end) const {
    const std::vector<StrokePoint>& mark = wanted_.points;
    const std::size_t end = at_end ? mark.size() - 1 : 0;
    const Vector2d along = tangentAt(mark, end), left(-along.y(), along.x());
    const double width = *mark[end].width, reach = 0.5 * width + 1e-3;
    // Mean over lines side by side, of the length of ink beyond the mark's end.
    double missing = 0.0;
    constexpr int kLines = 5;
    for (int line = 0; line < kLines; ++line) {
      const double aside = (line - 0.5 * (kLines - 1)) / kLines * width;
      const Vector2d middle = placeOf(mark[end]) + aside * left + (at_end ? 0.5 : -0.5) * reach * along;
      missing += (sectionOf(*target_, middle, along, 0.5 * reach).length -
                  sectionOf(ink, middle, along, 0.5 * reach).length) /
                 kLines;
    }
    const double length = 1.5 * width + 1e-3;
    for (std::size_t k = 0; k < mark.size(); ++k) {
      const double away = (placeOf(mark[k]) - placeOf(mark[end])).norm() / length;
      if (away < 1.0) errors[k].shift += (at_end ? 1.0 : -1.0) * (1.0 - away) * missing * along;
    }
  }

  /// How much of the line across the mark is ink that should not be, or is not that should be, at each
  /// point [m].
  std::vector<double> unlikenessOf(const InkPicture& ink) const {
    const std::vector<StrokePoint>& mark = wanted_.points;
    std::vector<Change> wrong(mark.size());
    for (std::size_t k = 0; k < mark.size(); ++k) {
      const Vector2d place = placeOf(mark[k]), along = tangentAt(mark, k), left(-along.y(), along.x());
      const double reach = 0.8 * *mark[k].width + 1e-3, step = 0.5 * ink.pixelSize();
      for (double s = -reach; s < reach; s += step)
        wrong[k].width += step * std::abs(target_->at(place + s * left) - ink.at(place + s * left));
    }
    smooth(wrong, kSmoothing);
    std::vector<double> unlikeness;
    for (const Change& change : wrong) unlikeness.push_back(change.width);
    return unlikeness;
  }

  /// The stroke to ask for, within bounds of the wanted one; brings the changes within them.
  Stroke changed(std::vector<Change>& changes) const {
    Stroke next = wanted_;
    for (std::size_t k = 0; k < next.points.size(); ++k) {
      StrokePoint& point = next.points[k];
      const double width = *point.width;
      const double widest = std::max(kLeastWidth, std::min(curve_.maxWidth(), 2.5 * width + 1e-3));
      point.width = std::clamp(width + changes[k].width, kLeastWidth, widest);
      changes[k].width = *point.width - width;
      const double furthest = width + 1e-3, length = changes[k].shift.norm();
      if (length > furthest) changes[k].shift *= furthest / length;
      point.x += changes[k].shift.x();
      point.y += changes[k].shift.y();
    }
    return next;
  }

  SimulatorParameters parameters_;
  const WritingParameters& writing_;
  const BrushCurve& curve_;
  const CorrectionOptions& options_;
  Stroke wanted_;
  Outline outline_;
  Vector2d corner_;
  double tip_length_ = 0.0;
  std::optional<InkPicture> target_;
};

}  // namespace

std::vector<CorrectedStroke> correctStrokes(const std::vector<Stroke>& strokes,
                                            const std::vector<Outline>& outlines,
                                            const SimulatorParameters& parameters,
                                            const WritingParameters& writing, const BrushCurve& curve,
                                            const CorrectionOptions& options) {
  if (strokes.size() != outlines.size())
    throw std::invalid_argument("strokes are corrected without an outline for each");
  if (options.passes < 1 || !(options.gain > 0 && options.gain <= 1))
    throw std::invalid_argument("a correction needs a pass and a gain in (0, 1]");
  checkParameters(parameters);
  std::vector<CorrectedStroke> corrected;
  for (std::size_t k = 0; k < strokes.size(); ++k) {
    const auto& points = strokes[k].points;
    if (points.size() < 2 || !points.front().width)
      corrected.push_back({strokes[k], {}});
    else
      corrected.push_back(Practice(strokes[k], outlines[k], parameters, writing, curve, options).run());
  }
  return corrected;
}

std::vector<Outline> outlinesOfGlyph(const Glyph& glyph, double size, const Vector2d& origin) {
  const double scale = size / kGlyphEm;
  std::vector<Outline> outlines;
  for (const GlyphStroke& stroke : glyph.strokes) {
    outlines.push_back(stroke.outline);
    for (auto& polygon : outlines.back())
      for (Vector2d& point : polygon) point = origin + scale * (point - Vector2d(0.0, kGlyphBottom));
  }
  return outlines;
}

}  // namespace calligraphy_brush
