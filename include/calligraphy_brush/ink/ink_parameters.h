#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// Ink in the tip and how it leaves.
struct InkParameters {
  double load = 1.0;
  double film_thickness = 20e-6;
  double coat = 100e-6;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("load", self.load, Range{0.0, 1.0}, "1",
          "Ink in the brush after a dip and at the start, as a part of the room between its hairs.");
    visit("film_thickness", self.film_thickness, Range{1e-7, 1e-3}, "m",
          "Ink that a full brush leaves on the sheet, as volume per area.");
    visit("coat", self.coat, Range{0.0, 1e-3}, "m",
          "Thickness of the liquid around a full bundle: a meniscus wets the sheet where it is closer.");
  }
};

}  // namespace calligraphy_brush
