#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "calligraphy_brush/files/glyph.h"
#include "calligraphy_brush/files/stroke_file.h"
#include "calligraphy_brush/sim/simulator_parameters.h"
#include "calligraphy_brush/writing/brush_curve.h"
#include "calligraphy_brush/writing/writing_parameters.h"

namespace calligraphy_brush {

/// How strokes are practised.
struct CorrectionOptions {
  int passes = 6;     ///< times that each stroke is written
  double gain = 1.0;  ///< part of an error that the next pass takes back, in (0, 1]
};

/// A stroke after practice.
struct CorrectedStroke {
  Stroke stroke;            ///< what has to be asked for
  std::vector<double> iou;  ///< of each pass with the outline
};

/// Finds the strokes to ask for, so that planHandlePoses writes the outlines that are wanted.
///
/// Iterative learning control (Arimoto, Kawamura & Miyazaki 1984): each stroke is simulated alone with a
/// full brush, on paper like the sheet and at its resolution. All of the sheet is shared out among the
/// points of the wanted mark, to the nearest, so that ends and corners count whole; in each share the
/// amount of ink and its middle are compared with those of the outline. What is missing widens the line
/// that is asked for there, and what is aside, or beyond an end, moves it.
/// Errors are smoothed along the stroke, which keeps the iteration stable; where a pass was worse than
/// the best so far, the next starts from that one and goes half as far. The pass that is most like its
/// outline (intersection over union) is the result, so it is never worse than the first. Equal calls
/// give equal results.
///
/// strokes: by width, in the paper frame; outlines: of each, in the paper frame [m]. Strokes by depth,
/// or of fewer than two points, stay as they are. Throws ParameterError, and std::invalid_argument if
/// there are not as many outlines as strokes or an option is out of its range.
std::vector<CorrectedStroke> correctStrokes(const std::vector<Stroke>& strokes,
                                            const std::vector<Outline>& outlines,
                                            const SimulatorParameters& parameters,
                                            const WritingParameters& writing, const BrushCurve& curve,
                                            const CorrectionOptions& options);

/// Outlines of a character's strokes where strokesOfGlyph puts it [m].
std::vector<Outline> outlinesOfGlyph(const Glyph& glyph, double size, const Eigen::Vector2d& origin);

}  // namespace calligraphy_brush
