#pragma once

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/sim/tuft.h"

namespace calligraphy_brush {

/// How a tip holds together.
struct TipShape {
  int groups = 0;  ///< of rods that hang together in the last 30 % of their lengths, see Tuft::groups
  double width = 0.0;  ///< see endWidth() [m]
};

/// Width of the end of the tip: of what lies, measured along the rods, in the last tenth of the length
/// of the longest one, its widest extent across the mean direction of the rods there, with their radii
/// [m]. A closed tip ends in a point, one that is pressed dry spreads. Known to a thousandth.
double endWidth(const BrushModel& brush, const Tuft& tuft);

TipShape findTipShape(const BrushModel& brush, const Tuft& tuft);

}  // namespace calligraphy_brush
