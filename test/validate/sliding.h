#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

struct SlideParameters : DynamicParameters {
  static constexpr double kLeastStep = 1e-5;
  double speed = 0.5;
  double mu = 0.3;
  SlideParameters() { nodes = 4; }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("speed", self.speed, Range{0.001, 10.0}, "m/s", "Speed of the block at time 0.");
    visit("mu", self.mu, Range{0.01, 5.0}, "1", "Coulomb friction of block on sheet.");
    DynamicParameters::describe(self, visit);
  }
};

struct SlideResult : SceneResult {
  double distance = 0, time = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("distance", self.distance, "m", "Way of the block until it stood.");
    visit("time", self.time, "s", "When it stood.");
    SceneResult::describe(self, visit);
  }
};

SlideResult slide(const SlideParameters& parameters);

struct InclineParameters : DynamicParameters {
  static constexpr double kLeastStep = 1e-4;
  double mu = 0.3;
  double angle_deg = 20.0;
  InclineParameters() { nodes = 4; }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("mu", self.mu, Range{0.0, 5.0}, "1", "Coulomb friction of block on sheet.");
    visit("angle_deg", self.angle_deg, Range{0.0, 85.0}, "deg", "Slope of the sheet.");
    DynamicParameters::describe(self, visit);
  }
};

struct InclineResult : SceneResult {
  bool slides = false;
  double distance = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("slides", self.slides, "", "Whether the block still moved in the second half of the second.");
    visit("distance", self.distance, "m", "Its way in one second.");
    SceneResult::describe(self, visit);
  }
};

InclineResult incline(const InclineParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
