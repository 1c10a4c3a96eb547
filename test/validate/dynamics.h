#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

/// The rod of the tables, or another.
struct RodProperties {
  double length = 0.045;
  double bending = 1.8095573685e-7;
  double line_density = 1.960353816e-4;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("length", self.length, Range{1e-3, 10.0}, "m", "Length of the rod.");
    visit("bending", self.bending, Range{1e-12, 1e3}, "N m^2", "Its bending stiffness B = EI.");
    visit("line_density", self.line_density, Range{1e-8, 1e3}, "kg/m", "Its mass by length.");
  }
};

struct ModesParameters : SceneParameters, RodProperties {
  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    RodProperties::describe(self, visit);
    SceneParameters::describe(self, visit);
  }
};

struct ModesResult : SceneResult {
  std::vector<double> frequencies_hz;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("frequencies_hz", self.frequencies_hz, "Hz", "The four lowest, or as many as there are.");
    SceneResult::describe(self, visit);
  }
};

ModesResult modes(const ModesParameters& parameters);

struct ReleaseParameters : DynamicParameters, RodProperties {
  static Choices schemes() { return {"backward_euler", "bdf2", "sdirk2", "projection"}; }
  double damping = 0.0;
  double duration = 1.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("damping", self.damping, Range{0.0, 1000.0}, "1/s",
          "Damping c of the force -c m v on a node.");
    visit("duration", self.duration, Range{1e-3, 10.0}, "s", "How long it moves.");
    RodProperties::describe(self, visit);
    DynamicParameters::describe(self, visit);
  }
};

struct ReleaseResult : SceneResult {
  std::vector<TipAt> tip;
  double max_error = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tip", self.tip, "s, m",
          "Tip at 5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 500 ms, 1 s and the end.");
    visit("max_error", self.max_error, "m",
          "Largest distance of these from the discrete rod's exact motion; null where that takes too "
          "long.");
    SceneResult::describe(self, visit);
  }
};

ReleaseResult release(const ReleaseParameters& parameters);

struct ChainParameters : DynamicParameters {
  // Projection holds the first link.
  static Choices schemes() { return {"backward_euler", "bdf2"}; }
  ChainParameters() { nodes = 11; }
};

struct ChainResult : SceneResult {
  std::vector<TipAt> tip;
  double energy_drift = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tip", self.tip, "s, m", "Tip at 0.1, 0.5 and 1 s.");
    visit("energy_drift", self.energy_drift, "1",
          "Energy at 1 s less that at 0, over weight times length.");
    SceneResult::describe(self, visit);
  }
};

ChainResult chain(const ChainParameters& parameters);

struct SlamParameters : DynamicParameters {
  static Choices schemes() { return {"backward_euler", "bdf2", "sdirk2", "projection"}; }
  double stiffness_scale = 1.0;
  bool bundles = false;
  double ink = 0.0;
  SlamParameters() {
    nodes = 16;
    precision = "float";
  }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("stiffness_scale", self.stiffness_scale, Range{1e-3, 1e3}, "1",
          "Factor on the rods' bending stiffness.");
    visit("bundles", self.bundles,
          "A tuft of 30 rods that touch, of the default brush, instead of the rod of the tables.");
    visit("ink", self.ink, Range{0.0, 1.0}, "1",
          "Ink in the tuft as a part of what there is room for, by which it clings.");
    DynamicParameters::describe(self, visit);
  }
};

struct SlamResult : SceneResult {
  bool finite = true;
  double max_speed = 0, max_penetration = 0, max_stretch = 0, max_bend_deg = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("finite", self.finite, "", "Whether every node always had a position.");
    visit("max_speed", self.max_speed, "m/s", "Largest way of a node in a step, over dt.");
    visit("max_penetration", self.max_penetration, "m", "Deepest node below the sheet.");
    visit("max_stretch", self.max_stretch, "1", "Largest change of an edge's length over its length.");
    visit("max_bend_deg", self.max_bend_deg, "deg",
          "Largest angle between the tip's edge and the clamp.");
    SceneResult::describe(self, visit);
  }
};

SlamResult slam(const SlamParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
