#include "calligraphy_brush/score/mask.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Squared distance transform of n values that lie `stride` apart, in place.
void transformLine(double* values, std::size_t n, std::size_t stride, std::vector<double>& line,
                   std::vector<std::size_t>& vertex, std::vector<double>& border) {
  line.resize(n);
  vertex.resize(n);
  border.resize(n + 1);
  for (std::size_t k = 0; k < n; ++k) line[k] = values[k * stride];
  std::size_t count = 0;
  for (std::size_t q = 0; q < n; ++q) {
    if (line[q] == kInfinity) continue;
    double from = -kInfinity;
    while (count > 0) {
      const std::size_t p = vertex[count - 1];
      const double dp = static_cast<double>(p), dq = static_cast<double>(q);
      from = ((line[q] + dq * dq) - (line[p] + dp * dp)) / (2.0 * (dq - dp));
      if (from > border[count - 1]) break;
      --count;
      from = -kInfinity;
    }
    vertex[count] = q;
    border[count] = from;
    ++count;
    border[count] = kInfinity;
  }
  if (count == 0) return;
  std::size_t k = 0;
  for (std::size_t q = 0; q < n; ++q) {
    while (border[k + 1] < static_cast<double>(q)) ++k;
    const double away = static_cast<double>(q) - static_cast<double>(vertex[k]);
    values[q * stride] = away * away + line[vertex[k]];
  }
}

}  // namespace

Mask::Mask(int width, int height, double resolution)
    : width_px(width), height_px(height), px_per_mm(resolution) {
  if (width < 1 || height < 1 || !(resolution > 0 && std::isfinite(resolution)))
    throw std::invalid_argument("a mask needs a pixel and a resolution > 0");
  ink.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0);
}

std::int64_t Mask::area_px() const {
  return std::count_if(ink.begin(), ink.end(), [](std::uint8_t pixel) { return pixel != 0; });
}

Mask maskOf(const GreyPicture& picture, double px_per_mm, int level) {
  Mask mask(picture.width_px, picture.height_px, px_per_mm);
  if (picture.mono8.size() != mask.ink.size())
    throw std::invalid_argument("a picture has not as many pixels as its sides say");
  for (std::size_t k = 0; k < mask.ink.size(); ++k) mask.ink[k] = picture.mono8[k] < level;
  return mask;
}

GreyPicture resampled(const GreyPicture& picture, double px_per_mm, const Eigen::Vector2d& corner_mm,
                      int width_px, int height_px, double new_px_per_mm) {
  const double ratio = px_per_mm / new_px_per_mm;  // old pixels a new one
  const double old_left = corner_mm.x() * px_per_mm;
  const double old_top = picture.height_px - corner_mm.y() * px_per_mm - height_px * ratio;
  GreyPicture result{width_px, height_px, {}};
  result.mono8.resize(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  // Covered part of each old pixel along one axis; the area is the product.
  const auto cover = [](double from, double to, int pixel) {
    return std::min(to, pixel + 1.0) - std::max(from, static_cast<double>(pixel));
  };
  std::size_t out = 0;
  for (int row = 0; row < height_px; ++row) {
    const double top = old_top + row * ratio, bottom = top + ratio;
    for (int column = 0; column < width_px; ++column, ++out) {
      const double left = old_left + column * ratio, right = left + ratio;
      double sum = 0.0;
      for (int y = static_cast<int>(std::floor(top)); y < bottom; ++y)
        for (int x = static_cast<int>(std::floor(left)); x < right; ++x) {
          const bool inside = x >= 0 && y >= 0 && x < picture.width_px && y < picture.height_px;
          const double grey =
              inside
                  ? picture
                        .mono8[static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width_px) +
                               static_cast<std::size_t>(x)]
                  : 255.0;
          sum += grey * cover(left, right, x) * cover(top, bottom, y);
        }
      result.mono8[out] =
          static_cast<std::uint8_t>(std::clamp(std::lround(sum / (ratio * ratio)), 0L, 255L));
    }
  }
  return result;
}

std::vector<double> distanceToInk(const Mask& mask) {
  std::vector<double> distance(mask.ink.size());
  for (std::size_t k = 0; k < distance.size(); ++k) distance[k] = mask.ink[k] ? 0.0 : kInfinity;
  std::vector<double> line, border;
  std::vector<std::size_t> vertex;
  const auto width = static_cast<std::size_t>(mask.width_px);
  const auto height = static_cast<std::size_t>(mask.height_px);
  for (std::size_t column = 0; column < width; ++column)
    transformLine(&distance[column], height, width, line, vertex, border);
  for (std::size_t row = 0; row < height; ++row)
    transformLine(&distance[row * width], width, 1, line, vertex, border);
  for (double& value : distance) value = std::sqrt(value);
  return distance;
}

Mask piecesNear(const Mask& mask, const std::vector<Eigen::Vector2d>& places_mm, double reach_mm) {
  Mask places(mask.width_px, mask.height_px, mask.px_per_mm);
  for (const Eigen::Vector2d& place : places_mm) {
    const auto column = static_cast<int>(std::floor(place.x() * mask.px_per_mm));
    const int row = mask.height_px - 1 - static_cast<int>(std::floor(place.y() * mask.px_per_mm));
    if (places.contains(column, row)) places.set(column, row);
  }
  const std::vector<double> away = distanceToInk(places);

  std::vector<int> piece(mask.ink.size(), -1);
  std::vector<std::int64_t> area;
  std::vector<bool> near;
  std::vector<std::size_t> open;
  for (std::size_t start = 0; start < piece.size(); ++start) {
    if (!mask.ink[start] || piece[start] >= 0) continue;
    const int label = static_cast<int>(area.size());
    area.push_back(0);
    near.push_back(false);
    piece[start] = label;
    open.assign(1, start);
    while (!open.empty()) {
      const std::size_t pixel = open.back();
      open.pop_back();
      ++area.back();
      if (away[pixel] <= reach_mm * mask.px_per_mm) near.back() = true;
      const int column = static_cast<int>(pixel % static_cast<std::size_t>(mask.width_px));
      const int row = static_cast<int>(pixel / static_cast<std::size_t>(mask.width_px));
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          if (!mask.contains(column + dx, row + dy)) continue;
          const std::size_t other = mask.index(column + dx, row + dy);
          if (!mask.ink[other] || piece[other] >= 0) continue;
          piece[other] = label;
          open.push_back(other);
        }
    }
  }
  if (area.empty()) return mask;
  if (std::none_of(near.begin(), near.end(), [](bool is_near) { return is_near; }))
    near[static_cast<std::size_t>(std::max_element(area.begin(), area.end()) - area.begin())] = true;
  Mask kept = mask;
  for (std::size_t k = 0; k < piece.size(); ++k)
    if (piece[k] >= 0 && !near[static_cast<std::size_t>(piece[k])]) kept.ink[k] = 0;
  return kept;
}

Mask withoutHoles(Mask mask) {
  std::vector<std::uint8_t> outside(mask.ink.size(), 0);
  std::vector<std::size_t> open;
  const auto reach = [&](int column, int row) {
    if (!mask.contains(column, row) || mask.at(column, row)) return;
    const std::size_t pixel = mask.index(column, row);
    if (outside[pixel]) return;
    outside[pixel] = 1;
    open.push_back(pixel);
  };
  for (int column = 0; column < mask.width_px; ++column)
    for (const int row : {0, mask.height_px - 1}) reach(column, row);
  for (int row = 0; row < mask.height_px; ++row)
    for (const int column : {0, mask.width_px - 1}) reach(column, row);
  while (!open.empty()) {
    const std::size_t pixel = open.back();
    open.pop_back();
    const int column = static_cast<int>(pixel % static_cast<std::size_t>(mask.width_px));
    const int row = static_cast<int>(pixel / static_cast<std::size_t>(mask.width_px));
    reach(column - 1, row);
    reach(column + 1, row);
    reach(column, row - 1);
    reach(column, row + 1);
  }
  for (std::size_t k = 0; k < outside.size(); ++k) mask.ink[k] = !outside[k];
  return mask;
}

}  // namespace calligraphy_brush
