#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "calligraphy_brush/sim/simulator.h"

namespace calligraphy_brush {

/// Width of the tuft where it lies on the sheet [m]; 0 if it does not.
///
/// Four standard deviations of the touching nodes across the longer axis of their spread (all of a
/// uniform strip is 3.5), and the diameter of a bundle. A tuft that is dragged lies along its way, so
/// this is the width of the line; one that is pressed on the spot and splays is as wide as the blot that
/// it makes.
inline double widthOnSheet(const Simulator& simulator) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  std::vector<Eigen::Vector2d> places;
  for (int rod = 0; rod < simulator.rodCount(); ++rod)
    for (int node = 0; node < simulator.nodeCount(); ++node)
      if (simulator.nodeTouches(rod, node)) {
        places.push_back(simulator.nodePosition(rod, node).head<2>());
        sum += places.back();
      }
  if (places.empty()) return 0.0;
  const double count = static_cast<double>(places.size());
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& place : places)
    spread += (place - sum / count) * (place - sum / count).transpose() / count;
  const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvalues()[0];
  const auto& brush = simulator.parameters().brush;
  const double bundle = brush.root_diameter / std::sqrt(brush.rod_count);
  return bundle + 4.0 * std::sqrt(std::max(0.0, least));
}

}  // namespace calligraphy_brush
