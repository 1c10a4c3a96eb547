#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// What the pose track accepts as the motion of a hand or a robot.
struct MotionParameters {
  double max_speed = 10.0;
  double max_angular_speed = 200.0;
  double max_distance = 10.0;
  double max_gap = 10.0;
  double hold_after = 0.25;
  double hold_distance = 0.003;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("max_speed", self.max_speed, Range{1e-3, 1e6}, "m/s",
          "A pose that asks the handle to move faster than this is refused; a fast hand reaches 3.");
    visit("max_angular_speed", self.max_angular_speed, Range{1e-3, 1e6}, "rad/s",
          "A pose that asks the handle to turn faster than this is refused; a fast hand reaches 30.");
    visit("max_distance", self.max_distance, Range{0.1, 1000.0}, "m",
          "A pose further from the corner of the sheet than this is refused.");
    visit("max_gap", self.max_gap, Range{1e-3, 1e6}, "s",
          "After a longer time without poses the brush is taken off and put down anew at the next one.");
    visit("hold_after", self.hold_after, Range{1e-3, 1e6}, "s",
          "After a longer time without poses the tip holds; the brush is put down anew, and draws no "
          "line, if the next one is further away than hold_distance.");
    visit("hold_distance", self.hold_distance, Range{0.0, 10.0}, "m",
          "How far the handle's origin or the point of the undeformed tip may move during a hold.");
  }
};

}  // namespace calligraphy_brush
