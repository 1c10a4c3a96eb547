#pragma once

#include <cstddef>
#include <vector>

#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Where nodes of rods are on the places that they have in common: between place floor(x) and the next,
/// a node has the shift of both by the part that x is beyond the first.
template <class Real>
struct CommonPlaces {
  AlignedVector<Real> place;  ///< x of a node, [node][lane]
  AlignedVector<Real> joint;  ///< stiffness of the joints between places over that of the rod's, [lane]
  std::vector<int> first, last;  ///< places that the nodes of all lanes have to do with, [node]

  /// Places from a node of the rod in a lane to the next.
  Real spacing(std::size_t lane) const { return place[kLanes + lane]; }
};

/// Part of the shift of a place that a node has, in the lanes from `lane` on.
template <class V>
CALLIGRAPHY_INLINE V partOfPlace(const CommonPlaces<RealOf<V>>& places, int node, int place, int lane) {
  const V off =
      load<V>(places.place.data() + node * kLanes + lane) - broadcast<V>(static_cast<RealOf<V>>(place));
  return max(V{}, broadcast<V>(1) - max(off, -off));
}

}  // namespace calligraphy_brush
