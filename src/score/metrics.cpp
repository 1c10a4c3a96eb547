#include "calligraphy_brush/score/metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

void checkAlike(const Mask& a, const Mask& b) {
  if (a.width_px != b.width_px || a.height_px != b.height_px || a.px_per_mm != b.px_per_mm)
    throw std::invalid_argument("masks of different sizes or resolutions are compared");
}

Mask edgeOf(const Mask& mask) {
  Mask edge(mask.width_px, mask.height_px, mask.px_per_mm);
  const auto isInk = [&](int column, int row) {
    return mask.contains(column, row) && mask.at(column, row);
  };
  for (int row = 0; row < mask.height_px; ++row)
    for (int column = 0; column < mask.width_px; ++column)
      if (mask.at(column, row) && !(isInk(column - 1, row) && isInk(column + 1, row) &&
                                    isInk(column, row - 1) && isInk(column, row + 1)))
        edge.set(column, row);
  return edge;
}

double meanDistance_px(const Mask& from, const Mask& to) {
  const std::vector<double> distance = distanceToInk(to);
  double sum = 0.0;
  std::int64_t count = 0;
  for (std::size_t k = 0; k < distance.size(); ++k)
    if (from.ink[k]) {
      sum += distance[k];
      ++count;
    }
  return sum / static_cast<double>(count);
}

}  // namespace

double intersectionOverUnion(const Mask& a, const Mask& b) {
  checkAlike(a, b);
  std::int64_t both = 0, either = 0;
  for (std::size_t k = 0; k < a.ink.size(); ++k) {
    both += a.ink[k] && b.ink[k];
    either += a.ink[k] || b.ink[k];
  }
  return either > 0 ? static_cast<double>(both) / static_cast<double>(either) : 1.0;
}

Registration registered(const Mask& a, const Mask& b, double reach_mm) {
  checkAlike(a, b);
  const std::int64_t area_a = a.area_px(), area_b = b.area_px();
  if (area_a + area_b == 0) return {1.0, 0.0, 0.0};
  // Runs of ink of b, so that a shift costs a prefix sum a run.
  struct Run {
    int row, first, end;
  };
  std::vector<Run> runs;
  for (int row = 0; row < b.height_px; ++row)
    for (int column = 0; column < b.width_px; ++column) {
      if (!b.at(column, row)) continue;
      const int first = column;
      while (column < b.width_px && b.at(column, row)) ++column;
      runs.push_back({row, first, column});
    }
  const auto stride = static_cast<std::size_t>(a.width_px) + 1;
  std::vector<int> inked(stride * static_cast<std::size_t>(a.height_px), 0);
  for (int row = 0; row < a.height_px; ++row)
    for (int column = 0; column < a.width_px; ++column) {
      const std::size_t k = static_cast<std::size_t>(row) * stride + static_cast<std::size_t>(column);
      inked[k + 1] = inked[k] + (a.at(column, row) ? 1 : 0);
    }

  const auto reach = static_cast<int>(std::floor(reach_mm * a.px_per_mm + 1e-9));
  Registration best{-1.0, 0.0, 0.0};
  int best_length = 0;
  for (int dy = -reach; dy <= reach; ++dy)
    for (int dx = -reach; dx <= reach; ++dx) {
      std::int64_t both = 0;
      for (const Run& run : runs) {
        const int row = run.row + dy;
        if (row < 0 || row >= a.height_px) continue;
        const int first = std::clamp(run.first + dx, 0, a.width_px);
        const int end = std::clamp(run.end + dx, 0, a.width_px);
        const std::size_t start = static_cast<std::size_t>(row) * stride;
        both += inked[start + static_cast<std::size_t>(end)] -
                inked[start + static_cast<std::size_t>(first)];
      }
      const double iou = static_cast<double>(both) / static_cast<double>(area_a + area_b - both);
      const int length = dx * dx + dy * dy;
      if (iou > best.iou || (iou == best.iou && length < best_length)) {
        best = {iou, dx / a.px_per_mm, -dy / a.px_per_mm};
        best_length = length;
      }
    }
  return best;
}

double cosineLikeness(const GreyPicture& a, const GreyPicture& b) {
  if (a.width_px != b.width_px || a.height_px != b.height_px || a.mono8.size() != b.mono8.size())
    throw std::invalid_argument("pictures of different sizes are compared");
  double ab = 0.0, aa = 0.0, bb = 0.0;
  for (std::size_t k = 0; k < a.mono8.size(); ++k) {
    const double dark_a = 255.0 - a.mono8[k], dark_b = 255.0 - b.mono8[k];
    ab += dark_a * dark_b;
    aa += dark_a * dark_a;
    bb += dark_b * dark_b;
  }
  if (aa == 0.0 && bb == 0.0) return 1.0;
  return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : 0.0;
}

double chamferDistance_mm(const Mask& a, const Mask& b) {
  checkAlike(a, b);
  const bool has_a = a.area_px() > 0, has_b = b.area_px() > 0;
  if (!has_a && !has_b) return 0.0;
  if (!has_a || !has_b) return std::numeric_limits<double>::infinity();
  const Mask edge_a = edgeOf(a), edge_b = edgeOf(b);
  return 0.5 * (meanDistance_px(edge_a, edge_b) + meanDistance_px(edge_b, edge_a)) / a.px_per_mm;
}

double widestLine_mm(const Mask& mask) {
  // A rim of paper around the picture: ink at its edge ends there.
  Mask paper(mask.width_px + 2, mask.height_px + 2, mask.px_per_mm);
  std::fill(paper.ink.begin(), paper.ink.end(), std::uint8_t{1});
  bool inked = false;
  for (int row = 0; row < mask.height_px; ++row)
    for (int column = 0; column < mask.width_px; ++column)
      if (mask.at(column, row)) {
        paper.ink[paper.index(column + 1, row + 1)] = 0;
        inked = true;
      }
  if (!inked) return 0.0;
  const std::vector<double> radius = distanceToInk(paper);
  return 2.0 * *std::max_element(radius.begin(), radius.end()) / mask.px_per_mm;
}

ColumnExtent columnExtent(const Mask& mask, double x_mm) {
  ColumnExtent extent;
  const auto column = static_cast<int>(std::floor(x_mm * mask.px_per_mm));
  if (column < 0 || column >= mask.width_px) return extent;
  for (int row = 0; row < mask.height_px; ++row) {
    if (!mask.at(column, row)) continue;
    if (!extent.inked) extent.high_mm = (mask.height_px - row) / mask.px_per_mm;
    extent.inked = true;
    extent.low_mm = (mask.height_px - row - 1) / mask.px_per_mm;
  }
  return extent;
}

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) throw std::invalid_argument("lists of different lengths are correlated");
  if (a.size() < 2) return 0.0;
  const double mean_a = mean(a), mean_b = mean(b);
  double ab = 0.0, aa = 0.0, bb = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    ab += (a[k] - mean_a) * (b[k] - mean_b);
    aa += (a[k] - mean_a) * (a[k] - mean_a);
    bb += (b[k] - mean_b) * (b[k] - mean_b);
  }
  return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : 0.0;
}

double quantile(std::vector<double> values, double p) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  const double place = std::clamp(p, 0.0, 1.0) * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  if (below + 1 >= values.size()) return values.back();
  return values[below] + (place - static_cast<double>(below)) * (values[below + 1] - values[below]);
}

double mean(const std::vector<double>& values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

Line fitLine(const std::vector<double>& x, const std::vector<double>& y) {
  if (x.size() != y.size()) throw std::invalid_argument("a line through lists of different lengths");
  const double mean_x = mean(x), mean_y = mean(y);
  double xy = 0.0, xx = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    xy += (x[k] - mean_x) * (y[k] - mean_y);
    xx += (x[k] - mean_x) * (x[k] - mean_x);
  }
  if (!(xx > 0.0)) throw std::invalid_argument("a line needs two different x");
  return {xy / xx, mean_y - xy / xx * mean_x};
}

}  // namespace calligraphy_brush
