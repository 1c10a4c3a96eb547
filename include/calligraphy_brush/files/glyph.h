#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "calligraphy_brush/files/png.h"

namespace calligraphy_brush {

/// Closed outlines; a point is inside where the winding number is not zero.
using Outline = std::vector<std::vector<Eigen::Vector2d>>;

/// One stroke of a character: its outline and a rough line along its middle.
struct GlyphStroke {
  Outline outline;
  std::vector<Eigen::Vector2d> median;  ///< in the direction of writing
};

/// A character in the units of its em square, y up.
struct Glyph {
  std::vector<GlyphStroke> strokes;
};

/// Em square of hanzi-writer-data: x in [0, 1024], y in [−124, 900], y up.
constexpr double kGlyphEm = 1024.0;
constexpr double kGlyphBottom = -124.0;

/// Reads a character of hanzi-writer-data: JSON with "strokes" (SVG paths) and "medians" (lists of
/// [x, y]), as many of one as of the other. Throws std::runtime_error of one line with file and reason.
Glyph readGlyph(const std::string& file);

/// Flattens an SVG path to polygons that are nowhere further from the curve than `tolerance` (units
/// of the path). Understands the absolute commands M, L, Q, C and Z; throws std::runtime_error
/// naming anything else.
Outline parseSvgPath(const std::string& path, double tolerance = 0.25);

/// Distance from a point to the nearest outline, > 0 inside and < 0 outside.
double insideDistance(const Outline& outline, const Eigen::Vector2d& point);

/// The inside of outlines as a grey picture: 255 · (1 − covered part), from 4 × 4 samples a pixel. The
/// picture's lower left corner is at (0, 0), and a unit of the outlines is px_per_unit pixels.
GreyPicture drawOutlines(const std::vector<Outline>& outlines, int width_px, int height_px,
                         double px_per_unit);

/// A place on the middle line of a stroke and the radius of the line there.
struct MedialPoint {
  Eigen::Vector2d position;
  double radius;
};

/// Measures a stroke along its median.
///
/// The median is resampled at `spacing`, pulled to where the largest disc fits across it (a step
/// along its normal, at most `spacing` a round, so that it cannot leave for a side branch), and
/// lengthened at both ends until the outline. The radius is the distance to the outline. Both are
/// smoothed over a few samples; units are those of the outline. `spacing` > 0.
/// A median of a single place or outside its outline gives a radius of 0 there.
std::vector<MedialPoint> measureStroke(const GlyphStroke& stroke, double spacing);

}  // namespace calligraphy_brush
