#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "calligraphy_brush/paper/paper.h"
#include "paper_tile.h"

namespace calligraphy_brush {

namespace {

/// Reflectance of ink on the sheet by Kubelka and Munk, thick enough for the backing not to show.
class InkOptics {
 public:
  InkOptics(const PaperParameters& p, double bare, double wavelength)
      : bare_(static_cast<float>(bare)),
        base_(static_cast<float>(1.0 + (1.0 - bare) * (1.0 - bare) / (2.0 * bare))),
        absorption_(static_cast<float>(std::pow(550e-9 / wavelength, p.absorption_exponent) /
                                       (p.dark_thickness * p.scattering))) {}
  /// Of `ink` [m] of undiluted ink.
  float reflectance(float ink) const {
    const float a = base_ + absorption_ * ink;
    return 1.0F / (a + std::sqrt(a * a - 1.0F));
  }
  /// Over that of the bare sheet.
  float relative(float ink) const { return std::min(1.0F, reflectance(ink) / bare_); }

 private:
  float bare_, base_, absorption_;
};

std::array<InkOptics, 3> colours(const PaperParameters& p) {
  return {InkOptics(p, p.red, 610e-9), InkOptics(p, p.green, 550e-9), InkOptics(p, p.blue, 465e-9)};
}
InkOptics grey(const PaperParameters& p) {
  return {p, p.green, 550e-9};
}

/// Linear light to the value that a screen wants, 0..1.
float encodeSrgb(float linear) {
  return linear <= 0.0031308F ? 12.92F * linear : 1.055F * std::pow(linear, 1.0F / 2.4F) - 0.055F;
}

template <class Value>
Value toValue(float part) {
  constexpr auto kMost = static_cast<float>(std::numeric_limits<Value>::max());
  return static_cast<Value>(std::lround(kMost * std::clamp(part, 0.0F, 1.0F)));
}

}  // namespace

/// Calls function(index of the pixel in a picture, ink) where there may be ink.
template <class Function>
void Paper::forEachPixel(Function&& function) const {
  for (const auto& tile : tiles_)
    for (int row = 0; row < tile->rows; ++row) {
      const std::size_t first = static_cast<std::size_t>(height_px_ - 1 - tile->row * kTile - row) *
                                    static_cast<std::size_t>(width_px_) +
                                static_cast<std::size_t>(tile->column * kTile);
      for (int column = 0; column < tile->columns; ++column) {
        const auto at = static_cast<std::size_t>(row * kTile + column);
        const double ink = tile->pigment[at] + tile->settled[at];
        if (ink > 0.0) function(first + static_cast<std::size_t>(column), static_cast<float>(ink));
      }
    }
}

void Paper::render(std::vector<std::uint8_t>& mono8) const {
  mono8.assign(pixelCount(), 255);
  const InkOptics optics = grey(parameters_);
  forEachPixel(
      [&](std::size_t pixel, float ink) { mono8[pixel] = toValue<std::uint8_t>(optics.relative(ink)); });
}

void Paper::render(std::vector<std::uint16_t>& mono16) const {
  mono16.assign(pixelCount(), 65535);
  const InkOptics optics = grey(parameters_);
  forEachPixel([&](std::size_t pixel, float ink) {
    mono16[pixel] = toValue<std::uint16_t>(optics.relative(ink));
  });
}

void Paper::renderColour(std::vector<std::uint8_t>& rgb8) const {
  rgb8.resize(3 * pixelCount());
  const auto optics = colours(parameters_);
  std::uint8_t bare[3];
  for (std::size_t i = 0; i < 3; ++i)
    bare[i] = toValue<std::uint8_t>(encodeSrgb(optics[i].reflectance(0.0F)));
  for (std::size_t pixel = 0; pixel < pixelCount(); ++pixel) std::copy(bare, bare + 3, &rgb8[3 * pixel]);
  forEachPixel([&](std::size_t pixel, float ink) {
    for (std::size_t i = 0; i < 3; ++i)
      rgb8[3 * pixel + i] = toValue<std::uint8_t>(encodeSrgb(optics[i].reflectance(ink)));
  });
}

void Paper::renderTransparent(std::vector<std::uint8_t>& rgba8) const {
  rgba8.assign(4 * pixelCount(), 0);
  const auto optics = colours(parameters_);
  forEachPixel([&](std::size_t pixel, float ink) {
    float seen[3];
    for (std::size_t i = 0; i < 3; ++i) seen[i] = encodeSrgb(optics[i].relative(ink));
    // As opaque as the darkest channel asks for, the others shining through by their own colour.
    const float clear = std::min({seen[0], seen[1], seen[2]});
    const float opacity = 1.0F - clear;
    for (std::size_t i = 0; i < 3; ++i)
      rgba8[4 * pixel + i] =
          opacity > 0.0F ? toValue<std::uint8_t>((seen[i] - clear) / opacity) : std::uint8_t{0};
    rgba8[4 * pixel + 3] = toValue<std::uint8_t>(opacity);
  });
}

void Paper::renderAdded(const Paper& before, std::vector<std::uint8_t>& mono8) const {
  if (before.width_px_ != width_px_ || before.height_px_ != height_px_)
    throw std::invalid_argument("sheets of different sizes cannot be compared");
  std::vector<float> old(pixelCount(), 0.0F);
  before.forEachPixel([&](std::size_t pixel, float ink) { old[pixel] = ink; });
  mono8.assign(pixelCount(), 255);
  const InkOptics optics = grey(parameters_);
  forEachPixel([&](std::size_t pixel, float ink) {
    mono8[pixel] = toValue<std::uint8_t>(optics.relative(std::max(0.0F, ink - old[pixel])));
  });
}

}  // namespace calligraphy_brush
