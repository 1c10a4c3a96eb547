#include "calligraphy_brush/paper/paper.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace calligraphy_brush {

Paper::Paper(const PaperParameters& parameters) : parameters_(parameters) {
  checkParameters(parameters);
  pixel_size_ = 1e-3 / parameters.px_per_mm;
  width_px_ = std::max(1, static_cast<int>(std::lround(parameters.width / pixel_size_)));
  height_px_ = std::max(1, static_cast<int>(std::lround(parameters.height / pixel_size_)));
  constexpr double kMostPixels = 4e8;  // 1.6 GB
  if (static_cast<double>(width_px_) * static_cast<double>(height_px_) > kMostPixels)
    throw ParameterError(
        {"paper/width x paper/height x (paper/px_per_mm)^2 = " + std::to_string(width_px_) + " x " +
         std::to_string(height_px_) + " pixels is more than 4e8: make the sheet smaller or coarser"});
  ink_.assign(static_cast<std::size_t>(width_px_) * static_cast<std::size_t>(height_px_), 0.0F);
}

double Paper::deposit(const TaperedCapsule& capsule, double thickness) {
  if (!(thickness > 0.0)) return 0.0;
  // In pixels from here on; pixel (i, j) has its middle at (i + ½, j + ½).
  const double scale = 1.0 / pixel_size_;
  double x0 = capsule.x0 * scale - 0.5, y0 = capsule.y0 * scale - 0.5;
  double dx = (capsule.x1 - capsule.x0) * scale, dy = (capsule.y1 - capsule.y0) * scale;
  double r0 = capsule.radius0 * scale, dr = (capsule.radius1 - capsule.radius0) * scale;
  if (dx * dx + dy * dy <= dr * dr) {  // one of the two discs holds the other
    if (dr > 0) {
      x0 += dx;
      y0 += dy;
      r0 += dr;
    }
    dx = dy = dr = 0.0;
  }
  const double reach = std::max(r0, r0 + dr) + 0.5;
  if (!(std::isfinite(x0 + y0 + dx + dy) && reach < 1e6)) return 0.0;

  const auto clampTo = [](double value, int size) {
    return static_cast<int>(std::clamp(value, -1.0, static_cast<double>(size)));
  };
  const int first_column = std::max(0, clampTo(std::ceil(x0 + std::min(0.0, dx) - reach), width_px_));
  const int last_column =
      std::min(width_px_ - 1, clampTo(std::floor(x0 + std::max(0.0, dx) + reach), width_px_));
  const int first_row = std::max(0, clampTo(std::ceil(y0 + std::min(0.0, dy) - reach), height_px_));
  const int last_row =
      std::min(height_px_ - 1, clampTo(std::floor(y0 + std::max(0.0, dy) + reach), height_px_));

  const double length_squared = dx * dx + dy * dy;
  const double inverse = length_squared > 0 ? 1.0 / length_squared : 0.0;
  const auto most = static_cast<float>(thickness);
  double added = 0.0;
  for (int row = first_row; row <= last_row; ++row) {
    const double py = row - y0;
    for (int column = first_column; column <= last_column; ++column) {
      float& ink = ink_[index(column, row)];
      if (ink >= most) continue;
      const double px = column - x0;
      const double along = std::clamp((px * dx + py * dy) * inverse, 0.0, 1.0);
      const double ox = px - along * dx, oy = py - along * dy;
      const double distance = std::sqrt(ox * ox + oy * oy);
      const double radius = r0 + along * dr;
      if (distance > radius + 0.5) continue;
      // Part of a pixel's breadth that lies between −radius and radius of the middle line.
      const double covered =
          std::min(1.0, 0.5 + radius - distance) - std::max(0.0, 0.5 - radius - distance);
      const auto wanted = static_cast<float>(thickness * std::max(0.0, covered));
      if (wanted > ink) {
        added += static_cast<double>(wanted) - static_cast<double>(ink);
        ink = wanted;
      }
    }
  }
  if (added > 0.0) ++revision_;
  return added * pixel_size_ * pixel_size_;
}

void Paper::clear() {
  std::fill(ink_.begin(), ink_.end(), 0.0F);
  ++revision_;
}

double Paper::inkVolume() const {
  double sum = 0.0;
  for (const float ink : ink_) sum += static_cast<double>(ink);
  return sum * pixel_size_ * pixel_size_;
}

void Paper::render(std::vector<std::uint8_t>& mono8) const {
  mono8.resize(ink_.size());
  // exp() of a million pixels takes longer than all rods; greys are 8 bits, so a table is exact.
  constexpr int kSteps = 4096;
  constexpr double kThickest = 6.0;  // exp(−6) · 255 rounds to 1
  static const std::vector<std::uint8_t> greys = [] {
    std::vector<std::uint8_t> table(kSteps + 1);
    for (int step = 0; step <= kSteps; ++step)
      table[static_cast<std::size_t>(step)] =
          static_cast<std::uint8_t>(std::lround(255.0 * std::exp(-kThickest * step / kSteps)));
    return table;
  }();
  const auto scale = static_cast<float>(kSteps / (kThickest * parameters_.dark_thickness));
  for (int row = 0; row < height_px_; ++row) {
    const float* from = &ink_[index(0, row)];
    std::uint8_t* to = &mono8[index(0, height_px_ - 1 - row)];
    for (int column = 0; column < width_px_; ++column) {
      const float step = std::min(static_cast<float>(kSteps), from[column] * scale + 0.5F);
      to[column] = greys[static_cast<std::size_t>(step)];
    }
  }
}

}  // namespace calligraphy_brush
