#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// How strokes become a motion of the handle.
struct WritingParameters {
  double rate = 125.0;
  double acceleration = 0.6;
  double air_speed = 0.15;
  double clearance = 0.012;
  double run = 0.25;
  bool lag_compensation = true;
  double lead = 0.5;
  double lean = 0.2;
  double turn_length = 0.0015;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("rate", self.rate, Range{10.0, 2000.0}, "Hz", "Poses per second.");
    visit("acceleration", self.acceleration, Range{0.01, 100.0}, "m/s^2",
          "Largest acceleration along the path and across it: the handle slows down in sharp turns.");
    visit("air_speed", self.air_speed, Range{0.001, 2.0}, "m/s", "Speed between strokes.");
    visit("clearance", self.clearance, Range{0.001, 0.3}, "m",
          "Height of the tip over the sheet between strokes.");
    visit("run", self.run, Range{0.0, 2.0}, "1",
          "Way along the stroke, over the way down or up, of an approach or a lift-off that is added.");
    visit("lag_compensation", self.lag_compensation,
          "Whether strokes given by line width lead the handle ahead of the mark, for the tip trails.");
    visit("lead", self.lead, Range{0.0, 2.0}, "1",
          "Lead of the handle over the lag of the footprint's middle, in the course of a stroke; 0.3 to "
          "0.7 "
          "gave the best likeness over six characters of different shape.");
    visit("lean", self.lean, Range{0.0, 1.0}, "rad",
          "Tilt the way the stroke goes, of strokes given by line width in which no point has a tilt.");
    visit("turn_length", self.turn_length, Range{0.0, 0.1}, "m",
          "Half of the length of mark over which the lead ahead of it is averaged in a turn.");
  }
};

}  // namespace calligraphy_brush
