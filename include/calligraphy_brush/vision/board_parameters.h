#pragma once

#include <string>

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// Fiducial markers around the shaft of the brush: one or more flat grids of ArUco markers.
///
/// Face k of n is turned by 2π k / n about the shaft and has columns × rows markers with identities that
/// go on from the face before, row by row from the top. Its middle is `height` up the shaft from the
/// ferrule and `radius` out from the axis; it looks outwards, and up by `elevation`.
struct BoardParameters {
  std::string dictionary = "4x4_50";
  int first_id = 0;
  int faces = 4;
  int columns = 1;
  int rows = 3;
  double marker_length = 0.03;
  double separation = 0.006;
  double radius = 0.02;
  double height = 0.12;
  double elevation = 0.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("dictionary", self.dictionary, Choices{"4x4_50", "5x5_100", "6x6_250", "apriltag_36h11"}, "1",
          "Predefined dictionary of the markers.");
    visit("first_id", self.first_id, Range{0, 1000}, "1", "Identity of the first marker.");
    visit("faces", self.faces, Range{1, 12}, "1", "Flat grids around the shaft.");
    visit("columns", self.columns, Range{1, 20}, "1", "Markers of a grid side by side.");
    visit("rows", self.rows, Range{1, 20}, "1", "Markers of a grid one above another.");
    visit("marker_length", self.marker_length, Range{0.002, 1.0}, "m",
          "Side of a marker's black square.");
    visit("separation", self.separation, Range{0.0005, 1.0}, "m", "White between markers.");
    visit("radius", self.radius, Range{-1.0, 1.0}, "m",
          "From the shaft's axis to the middle of a face, level.");
    visit("height", self.height, Range{-1.0, 2.0}, "m",
          "From the ferrule to the middle of a face, along the shaft.");
    visit("elevation", self.elevation, Range{-1.5708, 1.5708}, "rad",
          "How far a face looks up the shaft; 0: straight outwards.");
  }
};

/// How the pose is found in a picture, and when it is not believed.
struct TrackerParameters {
  BoardParameters board;
  int min_markers = 2;
  double max_residual_px = 1.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit.group("board", self.board);
    visit("tracker/min_markers", self.min_markers, Range{1, 100}, "1",
          "With fewer markers in the picture there is no pose.");
    visit(
        "tracker/max_residual_px", self.max_residual_px, Range{0.05, 100.0}, "px",
        "With a larger root mean square distance between seen and projected corners there is no pose.");
  }
};

}  // namespace calligraphy_brush
