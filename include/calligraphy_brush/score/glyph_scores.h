#pragma once

#include <string>
#include <vector>

#include "calligraphy_brush/files/glyph.h"
#include "calligraphy_brush/score/stroke_scores.h"
#include "calligraphy_brush/writing/brush_curve.h"
#include "calligraphy_brush/writing/correction.h"
#include "calligraphy_brush/writing/writing_parameters.h"

namespace calligraphy_brush {

/// A character beside the one that was written.
struct GlyphScore {
  std::string name;
  double size = 0.0;   ///< side of its em square [m]
  double width = 0.0;  ///< of its lines, mean over their length [m]
  Likeness likeness;
  double disc_iou = 0.0;  ///< what a disc of the exact medial radius reaches
  GreyPicture wanted, written;
};

/// How characters are written for a score.
struct GlyphOptions {
  double size = 0.06;      ///< side of the em square [m]
  double speed = 0.04;     ///< of the handle [m/s]
  double px_per_mm = 6.0;  ///< of the pictures that are compared
  CorrectionOptions correction;
};

/// Plans, corrects (correction.passes > 1) and writes a character with one full brush, all strokes in
/// one run, and compares it with its outlines.
GlyphScore scoreGlyph(const Glyph& glyph, const std::string& name, SimulatorParameters parameters,
                      const WritingParameters& writing, const BrushCurve& curve,
                      const GlyphOptions& options);

}  // namespace calligraphy_brush
