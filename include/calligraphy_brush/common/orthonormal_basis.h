#pragma once

#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Unit vectors that span the plane perpendicular to unit t.
/// Source: Duff et al. 2017, Building an Orthonormal Basis, Revisited, listing 3.
template <class V>
CALLIGRAPHY_INLINE void orthonormalBasis(const Vec3<V>& t, Vec3<V>& p0, Vec3<V>& p1) {
  const V one = broadcast<V>(1);
  const V sign = select(t.z < V{}, -one, one);
  const V a = -one / (sign + t.z);
  const V xa = t.x * a;
  const V b = xa * t.y;
  p0 = {one + sign * t.x * xa, sign * b, -sign * t.x};
  p1 = {b, sign + t.y * t.y * a, -t.y};
}

}  // namespace calligraphy_brush
