#include "calligraphy_brush/paper/relief.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
// Fibres that lie over each other at a place of the surface. More would look like clouds, not fibres.
constexpr double kLayers = 1.0;
// Part of the variance of the height that is fibres; the rest is formation.
constexpr double kFibreVariance = 0.4;
// Formation: each octave half the length and, per octave, as strong as the last.
constexpr double kLongestCloud = 0.8e-3;       // [m]
constexpr double kLongestPermeability = 2e-3;  // [m]
constexpr double kMostDeviations = 2.0;        // of the logarithm of the permeability

/// SplitMix64 (Steele et al. 2014): a good mix of one word.
std::uint64_t mix(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}
std::uint64_t mix(std::uint64_t seed, int i, int j) {
  return mix(mix(seed ^ static_cast<std::uint32_t>(i)) ^
             (static_cast<std::uint64_t>(static_cast<std::uint32_t>(j)) << 32));
}
/// In [0, 1).
double uniform(std::uint64_t& state) {
  state = mix(state);
  return static_cast<double>(state >> 11) * (1.0 / 9007199254740992.0);
}

/// Smooth noise of mean 0 and standard deviation 1, its knots uniform on a square lattice.
double latticeNoise(std::uint64_t seed, double x, double y) {
  const double column = std::floor(x), row = std::floor(y);
  const int i = static_cast<int>(column), j = static_cast<int>(row);
  const auto knot = [&](int a, int b) {
    return static_cast<double>(mix(seed, a, b) >> 11) * (2.0 / 9007199254740992.0) - 1.0;
  };
  const auto smooth = [](double s) { return s * s * (3.0 - 2.0 * s); };
  const double u = smooth(x - column), v = smooth(y - row);
  const double value = (1 - v) * ((1 - u) * knot(i, j) + u * knot(i + 1, j)) +
                       v * ((1 - u) * knot(i, j + 1) + u * knot(i + 1, j + 1));
  // Knots have variance 1/3; the mean over a cell of (1 − u)² + u² is 26/35 in each direction.
  return value * (std::sqrt(3.0) * 35.0 / 26.0);
}

/// Part of an octave's amplitude that is left after averaging over a pixel.
double passed(double wavelength, double pixel) {
  const double phase = kPi * pixel / (2.0 * wavelength);
  return std::max(0.0, std::sin(std::min(phase, kPi)) / std::max(phase, 1e-9));
}

// Height of a fibre at the distance d from its middle line: (1 − (d/w)²)² up to d = w. Integrals of it
// and of its square over d / w, and over its two round ends in units of w².
constexpr double kProfile = 16.0 / 15.0, kProfileSquared = 256.0 / 315.0;
constexpr double kEnd = kPi / 3.0, kEndSquared = kPi / 5.0;

}  // namespace

Relief::Relief(const PaperParameters& parameters, double pixel_size)
    : parameters_(parameters), pixel_size_(pixel_size) {
  const double variance = parameters.roughness * parameters.roughness;
  const auto seed = static_cast<std::uint64_t>(parameters.seed);

  // Campbell: n fibres an area have the variance n ∫ profile². Averaged over a pixel they are as many,
  // wider and lower.
  const double length = parameters.fibre_length, width = parameters.fibre_width;
  const double density = kLayers / (length * width);
  const auto integral = [length](double w) { return w * length * kProfile + w * w * kEnd; };
  const auto squareIntegral = [length](double w) {
    return w * length * kProfileSquared + w * w * kEndSquared;
  };
  const double amplitude = std::sqrt(kFibreVariance * variance / (density * squareIntegral(width)));
  fibre_reach_ = std::sqrt(width * width + pixel_size * pixel_size);
  fibre_amplitude_ = amplitude * integral(width) / integral(fibre_reach_);
  fibre_mean_ = density * amplitude * integral(width);
  fibres_per_cell_ = density * length * length;
  double resolved = density * fibre_amplitude_ * fibre_amplitude_ * squareIntegral(fibre_reach_);

  double wavelength = kLongestCloud;
  for (Octave& octave : formation_) {
    const double whole = std::sqrt((1.0 - kFibreVariance) * variance / 4.0);
    octave = {wavelength, whole * passed(wavelength, pixel_size),
              mix(seed, 1, int(&octave - formation_))};
    resolved += octave.amplitude * octave.amplitude;
    wavelength *= 0.5;
  }
  spread_in_pixel_ = std::sqrt(std::max(0.0, variance - resolved));

  wavelength = kLongestPermeability;
  for (Octave& octave : permeability_) {
    octave = {wavelength, parameters.unevenness / std::sqrt(3.0) * passed(wavelength, pixel_size),
              mix(seed, 2, int(&octave - permeability_))};
    wavelength *= 0.5;
  }
}

void Relief::sampleHeight(int first_column, int first_row, int size, float* height) const {
  for (int row = 0; row < size; ++row)
    for (int column = 0; column < size; ++column) {
      const double x = (first_column + column + 0.5) * pixel_size_;
      const double y = (first_row + row + 0.5) * pixel_size_;
      double sum = -fibre_mean_;
      for (const Octave& octave : formation_)
        if (octave.amplitude > 0.0)
          sum +=
              octave.amplitude * latticeNoise(octave.seed, x / octave.wavelength, y / octave.wavelength);
      height[row * size + column] = static_cast<float>(sum);
    }
  if (!(fibre_amplitude_ > 0.0)) return;

  // Fibres are thrown cell by cell; one reaches into the next cells but no further.
  const double cell = parameters_.fibre_length, half = 0.5 * parameters_.fibre_length;
  const double margin = half + fibre_reach_;
  const double left = first_column * pixel_size_, low = first_row * pixel_size_;
  const double side = size * pixel_size_;
  const auto cellOf = [&](double place) { return static_cast<int>(std::floor(place / cell)); };
  const double inverse = 1.0 / (fibre_reach_ * fibre_reach_);
  for (int j = cellOf(low - margin); j <= cellOf(low + side + margin); ++j)
    for (int i = cellOf(left - margin); i <= cellOf(left + side + margin); ++i) {
      std::uint64_t random = mix(static_cast<std::uint64_t>(parameters_.seed), i, j);
      const int count = static_cast<int>(fibres_per_cell_ + uniform(random));
      for (int fibre = 0; fibre < count; ++fibre) {
        // In pixels of the square, pixel (0, 0) having its middle at 0.
        const double x = ((i + uniform(random)) * cell - left) / pixel_size_ - 0.5;
        const double y = ((j + uniform(random)) * cell - low) / pixel_size_ - 0.5;
        const double angle = kPi * uniform(random);
        const double ex = std::cos(angle), ey = std::sin(angle);
        const double long_px = half / pixel_size_, wide_px = fibre_reach_ / pixel_size_;
        const double bx = long_px * std::abs(ex) + wide_px, by = long_px * std::abs(ey) + wide_px;
        const int row_end = std::min(size - 1, static_cast<int>(std::floor(y + by)));
        for (int row = std::max(0, static_cast<int>(std::ceil(y - by))); row <= row_end; ++row) {
          const double dy = row - y;
          // Columns that are close enough to the line of the fibre.
          double from = x - bx, to = x + bx;
          if (std::abs(ey) > 1e-3) {
            const double middle = x + dy * ex / ey, reach = wide_px / std::abs(ey);
            from = std::max(from, middle - reach);
            to = std::min(to, middle + reach);
          }
          const int column_end = std::min(size - 1, static_cast<int>(std::floor(to)));
          for (int column = std::max(0, static_cast<int>(std::ceil(from))); column <= column_end;
               ++column) {
            const double dx = column - x;
            const double beyond = std::max(0.0, std::abs(dx * ex + dy * ey) - long_px);
            const double across = dx * ey - dy * ex;
            const double s =
                1.0 - (across * across + beyond * beyond) * pixel_size_ * pixel_size_ * inverse;
            if (s > 0.0) height[row * size + column] += static_cast<float>(fibre_amplitude_ * s * s);
          }
        }
      }
    }
}

double Relief::mostPermeability() const {
  return std::exp(kMostDeviations * parameters_.unevenness);
}

void Relief::samplePermeability(int first_column, int first_row, int size, float* factor) const {
  const double most = kMostDeviations * parameters_.unevenness;
  for (int row = 0; row < size; ++row)
    for (int column = 0; column < size; ++column) {
      const double x = (first_column + column + 0.5) * pixel_size_;
      const double y = (first_row + row + 0.5) * pixel_size_;
      double sum = 0.0;
      for (const Octave& octave : permeability_)
        if (octave.amplitude > 0.0)
          sum +=
              octave.amplitude * latticeNoise(octave.seed, x / octave.wavelength, y / octave.wavelength);
      factor[row * size + column] = static_cast<float>(std::exp(std::clamp(sum, -most, most)));
    }
}

}  // namespace calligraphy_brush
