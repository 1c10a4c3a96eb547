#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// The sheet and its picture.
struct PaperParameters {
  double width = 0.3;
  double height = 0.3;
  double px_per_mm = 4.0;
  double dark_thickness = 6e-6;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("width", self.width, Range{0.005, 2.0}, "m", "Extent of the sheet along x.");
    visit("height", self.height, Range{0.005, 2.0}, "m", "Extent of the sheet along y.");
    visit("px_per_mm", self.px_per_mm, Range{0.5, 40.0}, "px/mm",
          "Resolution of the sheet and of its picture.");
    visit("dark_thickness", self.dark_thickness, Range{1e-8, 1e-3}, "m",
          "Ink volume per area that absorbs all but 1/e of the light.");
  }
};

}  // namespace calligraphy_brush
