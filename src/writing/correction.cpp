#include "calligraphy_brush/writing/correction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/writing/trajectory.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

constexpr double kMargin = 0.02;        // of sheet around a stroke [m]
constexpr int kSmoothing = 6;           // passes of a binomial filter over errors
constexpr double kLeastWidth = 0.2e-3;  // that is asked for [m]

/// Whether there is ink at a pixel, 0..1. Half as dark as can be is half, an eighth to both sides of it
/// no and yes: how black ink is does not make a line wider, and what a score counts as ink, darker than
/// half, counts here.
double inkAt(const GreyPicture& picture, std::size_t pixel) {
  constexpr double kSteepness = 4.0;
  return std::clamp(0.5 + kSteepness * (0.5 - picture.mono8[pixel] / 255.0), 0.0, 1.0);
}

double likeness(const GreyPicture& a, const GreyPicture& b) {
  long both = 0, either = 0;
  for (std::size_t k = 0; k < a.mono8.size(); ++k) {
    both += a.mono8[k] < 128 && b.mono8[k] < 128;
    either += a.mono8[k] < 128 || b.mono8[k] < 128;
  }
  return either > 0 ? static_cast<double>(both) / static_cast<double>(either) : 1.0;
}

/// What the next pass changes at a point of the mark: shift x, y and width [m].
using Change = Eigen::Vector3d;

/// The ink that is nearer to a point of the mark than to others: its moment about the point, x and y,
/// and its amount, in pixels.
using Share = Eigen::Vector3d;

/// Passes of the binomial filter (1, 2, 1)/4.
template <class Value>
void smooth(std::vector<Value>& values, int passes) {
  for (int pass = 0; pass < passes; ++pass) {
    const std::vector<Value> before = values;
    for (std::size_t k = 0; k < values.size(); ++k)
      values[k] = 0.25 * before[k > 0 ? k - 1 : k] + 0.5 * before[k] +
                  0.25 * before[k + 1 < values.size() ? k + 1 : k];
  }
}

Vector2d placeOf(const StrokePoint& point) {
  return {point.x, point.y};
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
    std::vector<Change> asked(count, Change::Zero()), good = asked, error = asked;
    std::vector<double> least(count, std::numeric_limits<double>::infinity()),
        gain(count, options_.gain);
    for (int pass = 0; pass < options_.passes; ++pass) {
      const Stroke stroke = changed(asked);
      const GreyPicture written = write(stroke);
      if (pass == 0) {
        target_ = drawOutlines({outline_}, written.width_px, written.height_px,
                               1e3 * parameters_.paper.px_per_mm);
        shareOut();
      }
      const double iou = likeness(target_, written);
      best.iou.push_back(iou);
      if (iou > best_iou) {
        best_iou = iou;
        best.stroke = stroke;
      }
      // Each part of the stroke goes on from its own best pass, less far after one that was worse.
      const std::vector<double> unlikeness = unlikenessOf(written);
      const std::vector<Change> now = errorsOf(written);
      for (std::size_t k = 0; k < count; ++k) {
        if (unlikeness[k] < least[k]) {
          least[k] = unlikeness[k];
          good[k] = asked[k];
          error[k] = now[k];
        } else {
          gain[k] *= 0.5;
        }
        asked[k] = good[k] + gain[k] * error[k];
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

  GreyPicture write(const Stroke& stroke) const {
    Simulator simulator(parameters_);
    for (const HandlePose& pose : planHandlePoses({stroke}, writing_, tip_length_, &curve_)) {
      simulator.addPose(pose);
      simulator.advance();
    }
    GreyPicture picture{simulator.paper().width_px(), simulator.paper().height_px(), {}};
    simulator.paper().render(picture.mono8);
    return picture;
  }

  /// Each point's share of the ink, taken together with those of its neighbours.
  std::vector<Share> sharesOf(const GreyPicture& picture) const {
    std::vector<Share> shares(wanted_.points.size(), Share::Zero());
    for (std::size_t pixel = 0; pixel < nearest_.size(); ++pixel) {
      const double part = inkAt(picture, pixel);
      if (part > 0) shares[nearest_[pixel]] += part * Share(offset_[pixel].x(), offset_[pixel].y(), 1.0);
    }
    smooth(shares, kSmoothing);
    return shares;
  }

  /// By how much the ink is aside and too narrow at each point of the mark: by the middles and the
  /// amounts of what is nearest to it. So corners and ends count whole.
  std::vector<Change> errorsOf(const GreyPicture& written) const {
    const std::vector<Share> want = sharesOf(target_), have = sharesOf(written);
    std::vector<double> width;
    for (const StrokePoint& point : wanted_.points) width.push_back(*point.width);
    smooth(width, kSmoothing);
    std::vector<Change> errors(want.size(), Change::Zero());
    for (std::size_t k = 0; k < errors.size(); ++k) {
      constexpr double kLeast = 1.0;  // pixel that has a middle
      if (want[k].z() < kLeast) continue;
      errors[k].z() = width[k] * std::max(-1.0, 1.0 - have[k].z() / want[k].z());
      if (have[k].z() >= kLeast)
        errors[k].head<2>() = want[k].head<2>() / want[k].z() - have[k].head<2>() / have[k].z();
    }
    return errors;
  }

  /// Finds for each pixel the point of the mark that is nearest, and the way from it to the pixel.
  void shareOut() {
    const std::vector<StrokePoint>& mark = wanted_.points;
    const double pixel_size = 1e-3 / parameters_.paper.px_per_mm;
    for (int row = 0; row < target_.height_px; ++row)
      for (int column = 0; column < target_.width_px; ++column) {
        const Vector2d place = pixel_size * Vector2d(column + 0.5, target_.height_px - row - 0.5);
        std::size_t best = 0;
        for (std::size_t k = 1; k < mark.size(); ++k)
          if ((placeOf(mark[k]) - place).squaredNorm() < (placeOf(mark[best]) - place).squaredNorm())
            best = k;
        nearest_.push_back(best);
        offset_.push_back(place - placeOf(mark[best]));
      }
  }

  /// How much ink is where it should not be or missing where it should be, of what is nearest to each
  /// point of the mark and its neighbours [pixels].
  std::vector<double> unlikenessOf(const GreyPicture& written) const {
    std::vector<double> wrong(wanted_.points.size(), 0.0);
    for (std::size_t pixel = 0; pixel < nearest_.size(); ++pixel)
      wrong[nearest_[pixel]] += std::abs(inkAt(target_, pixel) - inkAt(written, pixel));
    smooth(wrong, kSmoothing);
    return wrong;
  }

  /// The stroke to ask for, within bounds of the wanted one; brings the changes within them.
  Stroke changed(std::vector<Change>& changes) const {
    Stroke next = wanted_;
    for (std::size_t k = 0; k < next.points.size(); ++k) {
      StrokePoint& point = next.points[k];
      const double width = *point.width;
      const double widest = std::max(kLeastWidth, std::min(curve_.maxWidth(), 2.5 * width + 1e-3));
      point.width = std::clamp(width + changes[k].z(), kLeastWidth, widest);
      changes[k].z() = *point.width - width;
      const double furthest = width + 1e-3, length = changes[k].head<2>().norm();
      if (length > furthest) changes[k].head<2>() *= furthest / length;
      point.x += changes[k].x();
      point.y += changes[k].y();
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
  GreyPicture target_;
  std::vector<std::size_t> nearest_;  // point of the mark, for each pixel
  std::vector<Vector2d> offset_;      // of the pixel from it [m]
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
