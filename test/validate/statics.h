#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

struct HeavyCantileverParameters : SceneParameters {
  double gamma = 1.0;
  double clamp_angle_deg = 90.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("gamma", self.gamma, Range{0.1, 1000.0}, "1", "Weight rho A g L^3 / B.");
    visit("clamp_angle_deg", self.clamp_angle_deg, Range{0.0, 180.0}, "deg",
          "Direction of the clamp from straight down; 90 is horizontal.");
    SceneParameters::describe(self, visit);
  }
};

struct HeavyCantileverResult : SceneResult {
  double tip_x = 0, tip_z = 0, height_over_width = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tip_x", self.tip_x, "L", "Tip from the clamp, horizontally.");
    visit("tip_z", self.tip_z, "L", "Tip from the clamp, upwards.");
    visit("height_over_width", self.height_over_width, "1", "|tip_z| / tip_x; null where tip_x is 0.");
    SceneResult::describe(self, visit);
  }
};

HeavyCantileverResult heavyCantilever(const HeavyCantileverParameters& parameters);

struct TipLoadParameters : SceneParameters {
  double beta = 1.0;
  bool follower = false;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("beta", self.beta, Range{0.1, 20.0}, "1", "Load P L^2 / B.");
    visit("follower", self.follower, "The load stays normal to the tip instead of pointing down.");
    SceneParameters::describe(self, visit);
  }
};

struct TipLoadResult : SceneResult {
  double tip_x = 0, drop = 0, tip_angle_deg = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tip_x", self.tip_x, "L", "Tip from the clamp, horizontally.");
    visit("drop", self.drop, "L", "Tip below the clamp.");
    visit("tip_angle_deg", self.tip_angle_deg, "deg",
          "How far the last edge has turned from the clamp direction.");
    SceneResult::describe(self, visit);
  }
};

TipLoadResult tipLoad(const TipLoadParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
