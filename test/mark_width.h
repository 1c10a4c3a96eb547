#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "calligraphy_brush/sim/simulator.h"

namespace calligraphy_brush {

/// The ink that a stroke leaves on a clean sheet, in the order in which it came there.
///
/// The mark of a moment is the ink that came onto the sheet from then on, until the handle has gone a
/// root's diameter or 50 ms have passed. Its width is that of a uniform strip with the same standard
/// deviation, √12 σ across the mark's longer axis: a line has its own width, however fast it is drawn
/// and wherever the tuft trails, and a tuft that splays on the spot that of its blot. What touches for a
/// moment and leaves nothing does not count, nor does a single hair count as a line because the others
/// are up in this report.
class StrokeMark {
 public:
  /// The sheet is clean.
  void begin(const Simulator& simulator) {
    moments_.clear();
    ink_.assign(static_cast<std::size_t>(simulator.paper().width_px()) *
                    static_cast<std::size_t>(simulator.paper().height_px()),
                0.0F);
    longest_ = simulator.parameters().brush.root_diameter;
  }

  /// What came since the last call; seconds: now, way: of the handle since begin() [m].
  void take(const Simulator& simulator, double seconds, double way) {
    moments_.push_back({seconds, way, {}});
    Box box;
    for (int rod = 0; rod < simulator.rodCount(); ++rod)
      for (int node = 0; node < simulator.nodeCount(); ++node)
        if (simulator.nodeTouches(rod, node)) {
          const Eigen::Vector2d place = simulator.nodePosition(rod, node).head<2>();
          box.low = box.low.cwiseMin(place);
          box.high = box.high.cwiseMax(place);
        }
    const Eigen::Vector2d low = box.low.cwiseMin(last_.low), high = box.high.cwiseMax(last_.high);
    last_ = box;
    if (low.x() > high.x()) return;
    const Paper& paper = simulator.paper();
    constexpr double kMargin = 0.006;  // [m]: what a bundle wets beside itself and between two reports
    const auto pixel = [&paper](double place, int count) {
      return static_cast<int>(std::clamp(place / paper.pixelSize(), 0.0, count - 1.0));
    };
    const int left = pixel(low.x() - kMargin, paper.width_px());
    const int right = pixel(high.x() + kMargin, paper.width_px());
    const int bottom = pixel(low.y() - kMargin, paper.height_px());
    const int top = pixel(high.y() + kMargin, paper.height_px());
    for (int row = bottom; row <= top; ++row)
      for (int column = left; column <= right; ++column) {
        float& before = ink_[static_cast<std::size_t>(row) * static_cast<std::size_t>(paper.width_px()) +
                             static_cast<std::size_t>(column)];
        const float now = paper.ink(column, row);
        if (!(now > before + kLeast)) continue;
        moments_.back().gains.push_back(
            {paper.pixelSize() * Eigen::Vector2d(column + 0.5, row + 0.5), double(now - before)});
        before = now;
      }
  }

  struct Width {
    double seconds, way;  ///< since the first ink [s], [m]
    double width;         ///< [m]
  };
  /// Of the marks of all moments that left ink.
  std::vector<Width> widths() const {
    std::vector<Width> found;
    std::size_t first = moments_.size();
    for (std::size_t k = 0; k < moments_.size(); ++k) {
      if (moments_[k].gains.empty()) continue;
      first = std::min(first, k);
      found.push_back({moments_[k].seconds - moments_[first].seconds,
                       moments_[k].way - moments_[first].way, widthOf(k, endOfMark(k))});
    }
    return found;
  }

 private:
  struct Gain {
    Eigen::Vector2d place;  // [m]
    double ink;             // per area [m]
  };
  struct Moment {
    double seconds, way;
    std::vector<Gain> gains;
  };
  struct Box {
    Eigen::Vector2d low = Eigen::Vector2d::Constant(1e9), high = Eigen::Vector2d::Constant(-1e9);
  };
  static constexpr double kDuration = 0.05;  // [s]
  static constexpr float kLeast = 1e-9F;     // [m]: a thousandth of what looks dark

  std::size_t endOfMark(std::size_t begin) const {
    std::size_t end = begin;
    while (end < moments_.size() && moments_[end].seconds - moments_[begin].seconds <= kDuration &&
           moments_[end].way - moments_[begin].way <= longest_)
      ++end;
    return end;
  }

  double widthOf(std::size_t begin, std::size_t end) const {
    double sum = 0.0;
    Eigen::Vector2d first = Eigen::Vector2d::Zero();
    Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
    const Eigen::Vector2d origin = moments_[begin].gains.front().place;
    for (std::size_t k = begin; k < end; ++k)
      for (const Gain& gain : moments_[k].gains) {
        const Eigen::Vector2d place = gain.place - origin;
        sum += gain.ink;
        first += gain.ink * place;
        second += gain.ink * place * place.transpose();
      }
    const Eigen::Vector2d mean = first / sum;
    const Eigen::Matrix2d spread = second / sum - mean * mean.transpose();
    const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvalues()[0];
    return std::sqrt(12.0 * std::max(0.0, least));
  }

  std::vector<Moment> moments_;
  std::vector<float> ink_;  // of each pixel, when it was last looked at [m]
  Box last_;                // where the tuft lay then
  double longest_ = 0.0;    // [m]
};

}  // namespace calligraphy_brush
