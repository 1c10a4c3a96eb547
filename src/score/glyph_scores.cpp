#include "calligraphy_brush/score/glyph_scores.h"

#include <algorithm>
#include <cmath>

#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/writing/trajectory.h"

namespace calligraphy_brush {
namespace {

/// Discs of the wanted widths along the lines, and tapered between.
GreyPicture drawDiscs(const std::vector<Stroke>& strokes, const GreyPicture& like, double px_per_m) {
  GreyPicture picture = like;
  std::fill(picture.mono8.begin(), picture.mono8.end(), std::uint8_t{255});
  const auto disc = [&](double x, double y, double radius) {
    x *= px_per_m;
    y = picture.height_px - y * px_per_m;
    radius *= px_per_m;
    const int top = std::max(0, static_cast<int>(y - radius - 1)),
              left = std::max(0, static_cast<int>(x - radius - 1));
    for (int row = top; row < std::min(picture.height_px, static_cast<int>(y + radius + 2)); ++row)
      for (int column = left; column < std::min(picture.width_px, static_cast<int>(x + radius + 2));
           ++column)
        if (std::hypot(column + 0.5 - x, row + 0.5 - y) <= radius)
          picture.mono8[static_cast<std::size_t>(row) * static_cast<std::size_t>(picture.width_px) +
                        static_cast<std::size_t>(column)] = 0;
  };
  for (const Stroke& stroke : strokes)
    for (std::size_t k = 0; k < stroke.points.size(); ++k) {
      const StrokePoint& a = stroke.points[k];
      const StrokePoint& b = stroke.points[std::min(k + 1, stroke.points.size() - 1)];
      constexpr int kParts = 4;
      for (int part = 0; part < kParts; ++part) {
        const double t = static_cast<double>(part) / kParts;
        disc(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), 0.5 * (*a.width + t * (*b.width - *a.width)));
      }
    }
  return picture;
}

}  // namespace

GlyphScore scoreGlyph(const Glyph& glyph, const std::string& name, SimulatorParameters parameters,
                      const WritingParameters& writing, const BrushCurve& curve,
                      const GlyphOptions& options) {
  constexpr double kReach_mm = 1.0;
  const double margin = 0.1 * options.size;
  const Eigen::Vector2d origin(margin, margin);
  parameters.paper.width = parameters.paper.height = options.size + 2.0 * margin;
  parameters.paper.px_per_mm = options.px_per_mm;

  StrokePoint defaults;
  defaults.speed = options.speed;
  const std::vector<Stroke> wanted = strokesOfGlyph(glyph, options.size, origin, defaults);
  const std::vector<Outline> outlines = outlinesOfGlyph(glyph, options.size, origin);
  std::vector<Stroke> strokes = wanted;
  if (options.correction.passes > 1) {
    const auto corrected =
        correctStrokes(wanted, outlines, parameters, writing, curve, options.correction);
    for (std::size_t k = 0; k < strokes.size(); ++k) strokes[k] = corrected[k].stroke;
  }

  GlyphScore score;
  score.name = name;
  score.size = options.size;
  const double tip_length = makeBrush(parameters.brush).tip_length;
  score.written = simulatePicture(parameters, planHandlePoses(strokes, writing, tip_length, &curve));
  const double px_per_m = 1e3 * options.px_per_mm;
  score.wanted = drawOutlines(outlines, score.written.width_px, score.written.height_px, px_per_m);
  score.likeness = compare(score.wanted, score.written, options.px_per_mm, kReach_mm);
  score.disc_iou =
      intersectionOverUnion(maskOf(score.wanted, options.px_per_mm),
                            maskOf(drawDiscs(wanted, score.wanted, px_per_m), options.px_per_mm));
  std::vector<double> widths;
  for (const Stroke& stroke : wanted)
    for (const StrokePoint& point : stroke.points) widths.push_back(*point.width);
  score.width = mean(widths);
  return score;
}

}  // namespace calligraphy_brush
