#pragma once

#include <vector>

#include "calligraphy_brush/common/aligned.h"

namespace calligraphy_brush {

/// Where nodes of rods are on the places that they have in common: between place floor(x) and the next,
/// a node has the shift of both by the part that x is beyond the first.
template <class Real>
struct CommonPlaces {
  AlignedVector<Real> place;  ///< x of a node, [node][lane]
  AlignedVector<Real> joint;  ///< stiffness of the joints between places over that of the rod's, [lane]
  std::vector<int> first, last;  ///< places that the nodes of all lanes have to do with, [node]
};

}  // namespace calligraphy_brush
