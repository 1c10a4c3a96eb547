#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// Ink in the tip and how it leaves.
struct InkParameters {
  double load = 1.0;
  double concentration = 1.0;
  double film_thickness = 12e-6;
  double suction_ratio = 4.0;
  double spreading = 8e-5;
  double coat = 100e-6;
  double hair_unevenness = 30e-6;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("load", self.load, Range{0.0, 1.0}, "1",
          "Ink in the brush after a dip and at the start, as a part of the room between its hairs.");
    visit("concentration", self.concentration, Range{0.0, 1.0}, "1",
          "Pigment in the ink that the brush is dipped into, over that of undiluted ink.");
    visit("film_thickness", self.film_thickness, Range{0.0, 1e-3}, "m",
          "Ink that a full brush leaves at first touch, as volume per area; more soaks in with time.");
    visit("suction_ratio", self.suction_ratio, Range{0.1, 100.0}, "1",
          "Filling of the sheet's pores over that of the tip when they are in balance: how much finer "
          "they "
          "are, 18 um between hairs packed to 45 % and 5 um between fibres.");
    visit("spreading", self.spreading, Range{0.0, 1.0}, "m^2/s",
          "How fast filling spreads along a wet bundle; from 42 mN/m, hairs of 30 um packed to 45 % and "
          "5 mPa s.");
    visit("coat", self.coat, Range{0.0, 1e-3}, "m",
          "Thickness of the liquid around a full bundle: a meniscus wets the sheet where it is closer.");
    visit("hair_unevenness", self.hair_unevenness, Range{0.0, 1e-3}, "m",
          "Standard deviation of the heights at which the hairs on the outside of a bundle lie.");
  }
};

}  // namespace calligraphy_brush
