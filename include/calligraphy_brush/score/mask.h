#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "calligraphy_brush/files/png.h"

namespace calligraphy_brush {

/// Which pixels of a picture are ink: 1 or 0, top row first.
///
/// A place (x, y) [mm], y up, from the picture's lower left corner, is in the pixel of column
/// floor(x · px_per_mm) and row height_px − 1 − floor(y · px_per_mm).
struct Mask {
  int width_px = 0;
  int height_px = 0;
  double px_per_mm = 1.0;
  std::vector<std::uint8_t> ink;  ///< width_px × height_px values

  Mask() = default;
  Mask(int width, int height, double resolution);

  bool at(int column, int row) const { return ink[index(column, row)] != 0; }
  void set(int column, int row) { ink[index(column, row)] = 1; }
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_px) +
           static_cast<std::size_t>(column);
  }
  bool contains(int column, int row) const {
    return column >= 0 && column < width_px && row >= 0 && row < height_px;
  }
  /// Pixels of ink.
  std::int64_t area_px() const;
};

/// Ink where the picture is darker than `level`: 128 is half of the way from white to black.
Mask maskOf(const GreyPicture& picture, double px_per_mm, int level = 128);

/// A picture at another resolution: each pixel is the mean of the old picture over it, 255 beyond its
/// edge. The new one's lower left corner is at `corner_mm` in the old one, counted as in Mask.
GreyPicture resampled(const GreyPicture& picture, double px_per_mm, const Eigen::Vector2d& corner_mm,
                      int width_px, int height_px, double new_px_per_mm);

/// Exact Euclidean distance of each pixel's centre to the nearest centre of a pixel that is ink (0
/// there), in pixels; +∞ everywhere if there is no ink. Lower envelope of parabolas: Felzenszwalb &
/// Huttenlocher 2012, Distance Transforms of Sampled Functions, algorithm 1.
std::vector<double> distanceToInk(const Mask& mask);

/// Ink that is joined by an edge or a corner to ink within `reach_mm` of one of the places [mm]; the
/// largest piece if there is none such.
Mask piecesNear(const Mask& mask, const std::vector<Eigen::Vector2d>& places_mm, double reach_mm);

/// The mask with its holes filled: paper from which no way over edges of paper leads to the picture's
/// rim.
Mask withoutHoles(Mask mask);

}  // namespace calligraphy_brush
