#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

/// What both scenes of flow in a sheet take. D = k p_c / (µ φ).
struct PorousParameters : SceneParameters {
  PorousParameters() { nodes = 100; }
  double permeability = 1e-13;
  double porosity = 0.6;
  double capillary_pressure = 5000.0;
  double viscosity = 2e-3;
  int exponent = 6;
  double duration = 10.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("permeability", self.permeability, Range{1e-18, 1e-6}, "m^2", "k of Darcy's law.");
    visit("porosity", self.porosity, Range{0.01, 1.0}, "1", "Part of the sheet that is room.");
    visit("capillary_pressure", self.capillary_pressure, Range{1e-3, 1e9}, "Pa", "At the front.");
    visit("viscosity", self.viscosity, Range{1e-6, 1e4}, "Pa s", "Of the liquid.");
    visit("exponent", self.exponent, Range{1, 8}, "1", "q of the diffusivity D_0 theta^q.");
    visit("duration", self.duration, Range{1e-9, 1e9}, "s", "Time of the last front.");
    SceneParameters::describe(self, visit);
  }
};

struct StripParameters : PorousParameters {
  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    PorousParameters::describe(self, visit);
  }
};

struct BlotParameters : PorousParameters {
  std::string supply = "rate";
  double radius = 1e-3;
  double filling = 0.5;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("supply", self.supply, Choices{"rate", "saturated", "drop"}, "1", "What feeds the blot.");
    visit("radius", self.radius, Range{1e-9, 1e3}, "m", "Of the saturated disc; of the drop at first.");
    visit("filling", self.filling, Range{0.01, 1.0}, "1",
          "Filling of the drop at first; of the sheet in the middle of the supply.");
    PorousParameters::describe(self, visit);
  }
};

struct PorousResult : SceneResult {
  std::vector<double> times, front, filling;
  double exponent = 0, reference = 0, mass_error = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("times", self.times, "s", "Ten times up to the duration, evenly spaced in their logarithm.");
    visit("front", self.front, "m", "Of the wet part, at these times.");
    visit("exponent", self.exponent, "1", "Slope of the logarithm of the front over that of the time.");
    visit("reference", self.reference, "m",
          "Front at the end by Washburn's law (strip, saturated) or Barenblatt's solution (drop); null "
          "for "
          "a rate.");
    visit("filling", self.filling, "1", "At the end, pixel by pixel from the middle outwards.");
    visit("mass_error", self.mass_error, "1", "Of the liquid at the end, over what was put in.");
    SceneResult::describe(self, visit);
  }
};

PorousResult strip(const StripParameters& parameters);
PorousResult blot(const BlotParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
