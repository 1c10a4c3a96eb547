#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// The tuft as a brush maker would describe it, and into how many rods it is divided.
struct BrushParameters {
  double tip_length = 0.045;
  double root_diameter = 0.008;
  int hair_count = 8000;
  double hair_radius = 30e-6;
  double youngs_modulus = 3.89e9;
  double density = 1300.0;
  double hair_taper = 0.4;
  double cone = 0.25;
  double point = 0.35;
  double point_hairs = 0.1;
  double convergence = 0.2;
  double length_scatter = 0.01;
  double packing = 0.45;
  int rod_count = 128;
  int node_count = 16;
  int seed = 1;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tip_length", self.tip_length, Range{0.005, 0.3}, "m",
          "Length of the longest hair from the ferrule to the point.");
    visit("root_diameter", self.root_diameter, Range{0.0005, 0.1}, "m",
          "Diameter of the tuft where it leaves the ferrule.");
    visit("hair_count", self.hair_count, Range{1, 10000000}, "1", "Hairs in the tuft.");
    visit("hair_radius", self.hair_radius, Range{1e-6, 1e-3}, "m",
          "Radius of one hair at the root; half of goat beard's 60 um.");
    visit("youngs_modulus", self.youngs_modulus, Range{1e5, 1e13}, "Pa",
          "Young's modulus of hair; human hair 3.89e9 (Robbins), 1.6e9 is usual in simulation.");
    visit("density", self.density, Range{100.0, 20000.0}, "kg/m^3",
          "Density of hair; 1300 for keratin.");
    visit("hair_taper", self.hair_taper, Range{0.05, 1.0}, "1",
          "Radius of a hair at its end over that at its root; linear between.");
    visit("cone", self.cone, Range{0.0, 0.9}, "1",
          "How much shorter than the core the hairs at the rim are, as a part of tip_length.");
    visit("point", self.point, Range{0.0, 1.0}, "1",
          "Last part of each bundle's length over which its hairs end one after another.");
    visit("point_hairs", self.point_hairs, Range{0.001, 1.0}, "1",
          "Part of a bundle's hairs that reach its very end.");
    visit("convergence", self.convergence, Range{0.0, 1.0}, "1",
          "How far bundles lean to the axis at rest: 0 parallel, 1 all ends on the axis.");
    visit("length_scatter", self.length_scatter, Range{0.0, 0.2}, "1",
          "Standard deviation of the bundles' lengths over their mean.");
    visit("packing", self.packing, Range{0.1, 0.9069}, "1",
          "Part of a bundle's cross-section that is hair; 0.9069 is the densest.");
    visit("rod_count", self.rod_count, Range{1, 4096}, "1",
          "Bundles that the tuft is divided into, one elastic rod each.");
    visit("node_count", self.node_count, Range{3, 200}, "1", "Nodes of a rod, root and end included.");
    visit("seed", self.seed, Range{0, 2147483647}, "1", "Seed of the scatter of roots and lengths.");
  }
};

}  // namespace calligraphy_brush
