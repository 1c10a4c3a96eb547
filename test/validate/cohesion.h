#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

/// Two or more parallel rods that cling. Defaults: hairs of radius 40 µm and 3 GPa, 1 mm apart, full of
/// ink of 0.05 N/m.
struct CohesionParameters : SceneParameters {
  CohesionParameters() { nodes = 60; }
  double spacing = 1e-3;
  double energy = 4.56637061436e-6;
  double bending = 6.03185789489e-9;
  double length = 0.02;
  double range = 0.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("spacing", self.spacing, Range{1e-9, 1e6}, "m", "Between the surfaces of two rods, d.");
    visit("energy", self.energy, Range{1e-15, 1e9}, "J/m",
          "That two rods gain by the length on which they touch, w.");
    visit("bending", self.bending, Range{1e-15, 1e9}, "N m^2", "Bending stiffness B of a rod.");
    visit("length", self.length, Range{1e-6, 1e6}, "m", "Length of the rods.");
    visit("range", self.range, Range{0.0, 1.0}, "1",
          "Gap at which the liquid lets go, over the spacing; 0: the least that the nodes resolve.");
    SceneParameters::describe(self, visit);
  }
};

struct CohesionPairParameters : CohesionParameters {
  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    CohesionParameters::describe(self, visit);
  }
};

struct CohesionPairResult : SceneResult {
  double dry_length = kNone;
  bool stuck = false, holds = false;
  double first_contact = kNone, pulled_from = kNone, root_moment = kNone, energy = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("dry_length", self.dry_length, "m",
          "Length of a rod up to where the free part, continued, would lie along the other rod; null "
          "where they part.");
    visit("stuck", self.stuck, "", "Whether they hold together with less energy than apart.");
    visit("holds", self.holds, "",
          "Whether they hold together once they have been brought together, be it with more energy.");
    visit("first_contact", self.first_contact, "m",
          "Length up to the first place where the surfaces touch.");
    visit("pulled_from", self.pulled_from, "m",
          "Length up to the first place where the liquid between them pulls.");
    visit("root_moment", self.root_moment, "N m",
          "Bending moment at the clamp; sqrt(w B) for any law of cohesion.");
    visit("energy", self.energy, "J",
          "Of both over that of straight ones, of the free part continued and a liquid without range.");
    SceneResult::describe(self, visit);
  }
};

CohesionPairResult cohesionPair(const CohesionPairParameters& parameters);

struct CohesionRowParameters : CohesionParameters {
  CohesionRowParameters() {
    nodes = 40;
    spacing = 2e-4;
    range = 0.5;
  }
  int count = 64;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("count", self.count, Range{2, 256}, "1", "Rods in the row.");
    CohesionParameters::describe(self, visit);
  }
};

struct CohesionRowResult : SceneResult {
  std::vector<int> group_sizes;
  int largest = 1;
  double predicted = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("group_sizes", self.group_sizes, "1",
          "Rods in each group along the row, as equal as may be: of so many groups that those at rest "
          "cling up "
          "to the ends of their rods.");
    visit("largest", self.largest, "1", "The largest of them.");
    visit(
        "predicted", self.predicted, "1",
        "2 (L/L_dry)^(4/3), with L_dry of two rods: so large that two halves cling at their very ends.");
    SceneResult::describe(self, visit);
  }
};

CohesionRowResult cohesionRow(const CohesionRowParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
