#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

struct PressParameters : SceneParameters {
  double tilt_deg = 30.0;
  double mu = 0.2;
  double gamma = 0.0;
  double depth = 0.3;
  bool plane = false;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tilt_deg", self.tilt_deg, Range{0.0, 45.0}, "deg", "Tilt of the handle from the vertical.");
    visit("mu", self.mu, Range{0.0, 1.0}, "1", "Coulomb friction of rod on sheet.");
    visit("gamma", self.gamma, Range{0.0, 100.0}, "1", "Weight rho A g L^3 / B.");
    visit("depth", self.depth, Range{0.0, 0.8}, "L", "d = cos(tilt) - H/L for a handle at height H.");
    visit("plane", self.plane, "Hold the rod in the plane y = 0.");
    SceneParameters::describe(self, visit);
  }
};

struct PressResult : SceneResult {
  double normal_force = 0, tangential_force = 0, tip_offset = 0, flat_length = 0, out_of_plane = 0;
  std::string state;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("normal_force", self.normal_force, "B/L^2", "Force of the sheet on the rod, upwards.");
    visit("tangential_force", self.tangential_force, "B/L^2", "Force of the sheet on the rod along +x.");
    visit("tip_offset", self.tip_offset, "L", "Tip from the handle along +x.");
    visit("flat_length", self.flat_length, "L",
          "Rod that lies on the sheet, ending at the centre of what the sheet pushes beyond carrying "
          "weight.");
    visit("out_of_plane", self.out_of_plane, "L", "Largest distance of a node from the plane y = 0.");
    visit("state", self.state, "",
          "stick, slip (in drag: drag-x or drag+x), or free where nothing touches.");
    SceneResult::describe(self, visit);
  }
};

PressResult press(const PressParameters& parameters);

struct DragParameters : PressParameters {
  int direction = -1;
  double distance = 0.1;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("direction", self.direction, Range{-1, 1}, "1", "Sign of the handle's way along x: -1 or 1.");
    visit("distance", self.distance, Range{0.0, 1.0}, "L", "The handle's way.");
    PressParameters::describe(self, visit);
  }
};

/// Throws std::invalid_argument for a direction of 0.
PressResult drag(const DragParameters& parameters);

struct StickSlipParameters : SceneParameters {
  double mu = 0.2;
  double gamma = 0.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("mu", self.mu, Range{0.03, 1.0}, "1", "Coulomb friction of rod on sheet.");
    visit("gamma", self.gamma, Range{0.0, 20.0}, "1", "Weight rho A g L^3 / B.");
    SceneParameters::describe(self, visit);
  }
};

struct StickSlipResult : SceneResult {
  double slip_depth = kNone, normal_force_before = kNone, largest_ratio = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("slip_depth", self.slip_depth, "L", "Depth at which the foot slips; null: never.");
    visit("normal_force_before", self.normal_force_before, "B/L^2", "Normal force there.");
    visit("largest_ratio", self.largest_ratio, "1", "Largest |T|/N while the foot stuck.");
    SceneResult::describe(self, visit);
  }
};

StickSlipResult stickSlip(const StickSlipParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
