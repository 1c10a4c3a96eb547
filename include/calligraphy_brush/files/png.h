#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace calligraphy_brush {

/// A grey picture: one byte a pixel, 0 black, 255 white, top row first.
struct GreyPicture {
  int width_px = 0;
  int height_px = 0;
  std::vector<std::uint8_t> mono8;  ///< width_px × height_px values
};

/// Writes an 8 bit grey PNG, whole or not at all.
///
/// px_per_mm > 0 is stored as the print size of a pixel (chunk pHYs), in whole pixels per metre.
/// Throws std::invalid_argument if mono8 has not width_px × height_px values or a side is < 1, and
/// std::runtime_error with path and reason if the file cannot be written; then nothing is left behind.
void writePng(const std::string& path, int width_px, int height_px,
              const std::vector<std::uint8_t>& mono8, double px_per_mm = 0.0);

/// The same in 16 bits.
void writePng16(const std::string& path, int width_px, int height_px,
                const std::vector<std::uint16_t>& mono16, double px_per_mm = 0.0);

/// What the values of a picture in colour are, in their order.
enum class Colours { kRgb, kRgba };

/// An 8 bit PNG in colour, of 3 or 4 values a pixel; otherwise as writePng.
void writeColourPng(const std::string& path, int width_px, int height_px, Colours colours,
                    const std::vector<std::uint8_t>& values, double px_per_mm = 0.0);

/// Reads any PNG as 8 bit grey. Throws std::runtime_error with path and reason.
GreyPicture readPng(const std::string& path);

}  // namespace calligraphy_brush
