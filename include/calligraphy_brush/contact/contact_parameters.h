#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// Contact of the rods with the sheet.
struct ContactParameters {
  double paper_friction = 0.3;
  double stiffness = 5.0;
  int multiplier_updates = 10;
  double tolerance = 3e-5;
  bool paper = true;
  bool bundles = false;
  double bundle_friction = 0.1;
  double bundle_stiffness = 2.0;
  double bundle_modulus = 1000.0;
  double surface_tension = 0.042;
  double cohesion_range = 1.5;
  int coupling_rounds = 1;
  double coupling_tolerance = 1e-6;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("paper_friction", self.paper_friction, Range{0.0, 10.0}, "1",
          "Coulomb coefficient of hair on paper; 0.2 to 0.5 is usual, no measured source.");
    visit("stiffness", self.stiffness, Range{0.1, 1000.0}, "1",
          "Stiffness of the augmented Lagrangian over M/tau^2 + B/h^3 of a node; 3 to 10 works best.");
    visit("multiplier_updates", self.multiplier_updates, Range{1, 10000}, "1",
          "Most solutions of a step with better and better contact multipliers; most steps need one.");
    visit("tolerance", self.tolerance, Range{1e-15, 1e-3}, "m",
          "Residual of a contact at which its multipliers are not updated again.");
    visit("paper", self.paper, "Whether there is a sheet to touch.");
    visit("bundles", self.bundles,
          "Whether rods touch each other and cling by the ink they hold; the brush presets say so.");
    visit("bundle_friction", self.bundle_friction, Range{0.0, 10.0}, "1",
          "Coulomb coefficient of hair on hair; no measured source.");
    visit("bundle_stiffness", self.bundle_stiffness, Range{0.01, 1000.0}, "1",
          "Stiffness of the contact of two rods over M/tau^2 + B/h^3 of the softer node.");
    visit(
        "bundle_modulus", self.bundle_modulus, Range{0.0, 1e9}, "Pa",
        "Least force per length and overlap of two rods; hair packed together is stiffer by far, but so "
        "steps are soft enough to solve.");
    visit("surface_tension", self.surface_tension, Range{0.0, 1.0}, "N/m",
          "Of the ink: 0.038 to 0.045 for pen ink, 0.073 for water.");
    visit("cohesion_range", self.cohesion_range, Range{1e-4, 10.0}, "1",
          "Gap at which the ink between two rods lets go, over the sum of their radii at the root.");
    visit("coupling_rounds", self.coupling_rounds, Range{1, 1000}, "1",
          "Most solutions of a step in which rods learn what their neighbours did; one is stable, comes "
          "to rest where more do, and errs by a fifth of a millimetre in motion.");
    visit("coupling_tolerance", self.coupling_tolerance, Range{1e-12, 1e-3}, "m",
          "Error of where rods believe their neighbours to be at which a step is done.");
  }
};

}  // namespace calligraphy_brush
