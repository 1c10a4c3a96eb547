#pragma once

#include <cstdint>
#include <vector>

#include "calligraphy_brush/paper/paper_parameters.h"

namespace calligraphy_brush {

/// A disc that moves from one place to another while its radius changes: the piece of a bundle
/// that lies on the sheet. Places in the paper frame [m].
struct TaperedCapsule {
  double x0, y0, radius0;
  double x1, y1, radius1;
};

/// The sheet: ink by volume per area [m] on a grid of square pixels, and its picture.
///
/// Row 0 of the grid is the lowest (y = 0); row 0 of the picture is the highest, as in any image.
/// Constant memory after construction; not thread-safe.
class Paper {
 public:
  /// Throws ParameterError.
  explicit Paper(const PaperParameters& parameters);

  int width_px() const { return width_px_; }
  int height_px() const { return height_px_; }
  double pixelSize() const { return pixel_size_; }  ///< [m]

  /// Raises the ink under a capsule to `thickness` [m] (less at the rim of it, by the covered part
  /// of each pixel). Ink that is there already is not lowered. Off the sheet nothing happens.
  /// Returns the ink volume added [m³].
  double deposit(const TaperedCapsule& capsule, double thickness);

  /// Removes all ink.
  void clear();

  /// Ink at a pixel, rows from below [m].
  float ink(int column, int row) const { return ink_[index(column, row)]; }

  /// All of a row from below, width_px() values [m].
  const float* row(int row) const { return &ink_[index(0, row)]; }

  /// Ink on the whole sheet [m³].
  double inkVolume() const;

  /// Grows with every change of the ink.
  std::uint64_t revision() const { return revision_; }

  /// The picture: 255 is paper, 0 is black ink, one byte a pixel, top row first.
  /// Grey is 255 · exp(−ink / dark_thickness), the Beer–Lambert law.
  void render(std::vector<std::uint8_t>& mono8) const;

 private:
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_px_) +
           static_cast<std::size_t>(column);
  }

  PaperParameters parameters_;
  int width_px_;
  int height_px_;
  double pixel_size_;
  std::vector<float> ink_;
  std::uint64_t revision_ = 0;
};

}  // namespace calligraphy_brush
