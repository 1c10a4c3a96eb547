#pragma once

#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/ink/ink_parameters.h"
#include "calligraphy_brush/ink/tip_ink.h"

namespace calligraphy_brush {

/// Ink that moves in the tip towards balance: along each rod, and between rods that touch at rest.
///
/// A bundle is a porous body. Where the part S of its room is filled it sucks with a pressure that
/// falls about linearly to zero at S = 1, and lets through what Darcy's law says at a relative
/// permeability S³ (Corey), so the filling spreads as
///
///   ∂S/∂t = ∂/∂s (D S³ ∂S/∂s),   D = 2 γ κ/(µ r (1 − φ))
///
/// κ: permeability along the hairs, r: radius of the gaps, φ: packing. Across the hairs it is taken to
/// be half as permeable (Drummond & Tahir 1984). Weight is left out: at 45 mm it is a tenth of the
/// suction. Volumes move as fluxes out of one node into another, so nothing is made or lost, and
/// pigment goes with the liquid (upwind). Implicit, so a step of any length is stable.
class CapillaryFlow {
 public:
  CapillaryFlow(const BrushModel& brush, const InkParameters& parameters);

  /// Lets `seconds` go by along the rods.
  void flowAlong(double seconds, TipInk& ink);
  /// And across: slower, so it may be called less often, with more.
  void flowAcross(double seconds, TipInk& ink) const;

 private:
  /// Two nodes of neighbouring rods whose surfaces touch at rest.
  struct Bridge {
    std::size_t a, b;
    double conductance;  // of a saturated bridge [m³/s]
  };

  void flowInRod(int rod, double seconds, TipInk& ink);
  static void flowOver(const Bridge& bridge, double seconds, TipInk& ink);

  int node_count_;
  std::vector<double> conductance_;  // of a saturated edge [m³/s], [rod][edge]
  std::vector<Bridge> bridges_;
  // Scratch, one rod.
  std::vector<double> filling_, pull_, forward_, flux_, concentration_, below_, diagonal_, above_;
};

}  // namespace calligraphy_brush
