#pragma once

#include <vector>

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

/// A chain of rigid links in the plane y = 0 with elastic joints, clamped at the origin towards +x.
struct PlanarChain {
  double link = 0;            ///< length of a link [m]
  std::vector<double> mass;   ///< of nodes 0 .. n − 1 [kg]
  std::vector<double> joint;  ///< stiffness K_j of joints 0 .. n − 2 [N m]: energy 2 K tan²(turn/2)
  double gravity = 0;         ///< [m/s²]
  double damping = 0;         ///< c of the force −c m v [1/s]
};

/// Where the tip is at `times` (rising) after the chain was let go at rest along +x.
///
/// Classical Runge–Kutta (order 4) of the links' angles, so links keep their length exactly; the
/// accelerations follow in O(n) from the tensions, a tridiagonal system. Shares no code and no idea
/// with the implicit solver. The step is 0.4 over the highest frequency. Empty if that would take more
/// than about half a minute.
std::vector<TipAt> solvePlanarChain(const PlanarChain& chain, const std::vector<double>& times);

}  // namespace validate
}  // namespace calligraphy_brush
