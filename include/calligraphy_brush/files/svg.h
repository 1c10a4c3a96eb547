#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace calligraphy_brush {

/// A corner of an outline [px]: x to the right, y down, (0, 0) the upper left corner of the picture.
struct OutlinePoint {
  double x, y;
};

/// A closed line; its last point is joined to the first. Ink is on its right hand, seen along it.
using Outline = std::vector<OutlinePoint>;

/// Outlines of what is darker than `threshold` in a grey picture (0 black), between the middles of
/// pixels by linear interpolation: marching squares (Lorensen and Cline 1987, in the plane). Where four
/// pixels differ crosswise the dark ones are apart. Beyond the picture all is white, so every line
/// closes. Throws std::invalid_argument if mono8 has not width_px × height_px values.
std::vector<Outline> traceOutlines(int width_px, int height_px, const std::vector<std::uint8_t>& mono8,
                                   double threshold = 127.5);

/// Writes shapes, each a name and its outlines, filled, in millimetres on a page of the picture's size,
/// whole or not at all; each shape is a path with its name as id. Throws std::runtime_error with path
/// and reason.
void writeSvg(const std::string& path, int width_px, int height_px, double px_per_mm,
              const std::vector<std::pair<std::string, std::vector<Outline>>>& shapes);

}  // namespace calligraphy_brush
