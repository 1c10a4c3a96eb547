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
  }
};

}  // namespace calligraphy_brush
