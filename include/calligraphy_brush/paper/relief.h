#pragma once

#include <cstdint>

#include "calligraphy_brush/paper/paper_parameters.h"

namespace calligraphy_brush {

/// The surface of a sheet as a function of the place in metres: fibres thrown at random (a shot noise,
/// whose moments are Campbell's) on the clouds of an uneven formation.
///
/// What is finer than a pixel is averaged over it and kept as a standard deviation, so a sheet is the
/// same at every resolution. A function of seed and place alone.
class Relief {
 public:
  Relief(const PaperParameters& parameters, double pixel_size);

  /// Mean height over its mean plane [m] of each pixel of a square of `size` × `size`, row by row, the
  /// first at column `column`, row `row` of the sheet.
  void sampleHeight(int column, int row, int size, float* height) const;
  /// Permeability over its median, likewise.
  void samplePermeability(int column, int row, int size, float* factor) const;
  /// It is nowhere more.
  double mostPermeability() const;

  /// Standard deviation of the height inside a pixel [m].
  double spreadInPixel() const { return spread_in_pixel_; }

 private:
  struct Octave {
    double wavelength, amplitude;
    std::uint64_t seed;
  };

  PaperParameters parameters_;
  double pixel_size_;
  double fibre_amplitude_ = 0.0, fibre_reach_ = 0.0, fibre_mean_ = 0.0, fibres_per_cell_ = 0.0;
  double spread_in_pixel_ = 0.0;
  Octave formation_[4];
  Octave permeability_[3];
};

}  // namespace calligraphy_brush
