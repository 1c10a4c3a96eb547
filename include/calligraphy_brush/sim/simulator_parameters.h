#pragma once

#include "calligraphy_brush/brush/brush_parameters.h"
#include "calligraphy_brush/contact/contact_parameters.h"
#include "calligraphy_brush/ink/ink_parameters.h"
#include "calligraphy_brush/motion/motion_parameters.h"
#include "calligraphy_brush/paper/paper_parameters.h"
#include "calligraphy_brush/rods/rod_parameters.h"

namespace calligraphy_brush {

/// Everything that decides what a stroke looks like, grouped by room.
struct SimulatorParameters {
  BrushParameters brush;
  RodParameters rods;
  ContactParameters contact;
  InkParameters ink;
  PaperParameters paper;
  MotionParameters motion;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit.group("brush", self.brush);
    visit.group("rods", self.rods);
    visit.group("contact", self.contact);
    visit.group("ink", self.ink);
    visit.group("paper", self.paper);
    visit.group("motion", self.motion);
  }
};

}  // namespace calligraphy_brush
