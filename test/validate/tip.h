#pragma once

#include "calligraphy_brush/contact/contact_parameters.h"
#include "scene.h"

namespace calligraphy_brush {
namespace validate {

/// A tuft with ink, in the air or on the sheet.
struct TipShapeParameters : DynamicParameters {
  static Choices schemes() { return {"backward_euler", "bdf2", "sdirk2"}; }
  TipShapeParameters() {
    nodes = 16;
    precision = "float";
    dt = 0.002;
    scheme = "backward_euler";
  }
  double ink = 1.0;
  double depth = 0.0;
  std::string brush = "pointed";
  std::string picture;
  int rods = 0;
  double duration = 0.6;
  double drag = 0.01;
  int rounds = 8;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("ink", self.ink, Range{0.0, 1.0}, "1",
          "In the tip, as a part of the room between its hairs, everywhere the same.");
    visit("depth", self.depth, Range{0.0, 0.2}, "m",
          "How far the handle is below where the upright brush at rest touches; 0: in the air.");
    visit("brush", self.brush, Choices{}, "1", "Preset in config/brushes, or a YAML file.");
    visit("picture", self.picture, Choices{}, "1",
          "SVG file to draw the tip into, seen along the way that it is dragged; none: nothing.");
    visit("rods", self.rods, Range{0, 4096}, "1", "Bundles of the tuft; 0: as the brush says.");
    visit("duration", self.duration, Range{1e-2, 100.0}, "s",
          "Of each part: closing in the air, pressing, dragging, settling.");
    visit("drag", self.drag, Range{0.0, 1.0}, "m", "Way that the pressed brush is dragged.");
    visit("rounds", self.rounds, Range{1, 1000}, "1", "contact/coupling_rounds.");
    DynamicParameters::describe(self, visit);
  }
};

struct TipShapeResult : SceneResult {
  double end_diameter = 0, rest_diameter = 0;
  int groups = 0;
  std::vector<int> group_sizes;
  double ends_diameter = 0, rest_ends_diameter = 0, coupling_error = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("end_diameter", self.end_diameter, "m",
          "Of the disc with the second moment of the rods in the last 10 % of the tuft's length.");
    visit("rest_diameter", self.rest_diameter, "m", "The same of the straight rods.");
    visit("groups", self.groups, "1", "Of rods that hang together in the last quarter of their length.");
    visit("group_sizes", self.group_sizes, "1", "Rods in them, largest first.");
    visit("ends_diameter", self.ends_diameter, "m", "As end_diameter, of the last 10 % of every rod.");
    visit("rest_ends_diameter", self.rest_ends_diameter, "m", "The same of the straight rods.");
    visit("coupling_error", self.coupling_error, "m", "Of the last step.");
    SceneResult::describe(self, visit);
  }
};

TipShapeResult tipShape(const TipShapeParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
