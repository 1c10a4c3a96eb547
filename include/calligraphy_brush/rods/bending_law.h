#pragma once

#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Discrete bending energy of two edges that meet at an angle φ, as a function of
/// s = |t₁ − t₀|² = 4 sin²(φ/2), the squared difference of their unit tangents: s in [0, 4].
///
///   f(s) = ½ κ² = ½ s/(1 − p s)
///
/// A joint of stiffness k = EI/l̄ [N m] (l̄: the length that it stands for) holds the energy k f [J].
/// All laws of the family agree for small angles; p, where 1/p is the pole, tells how they stiffen:
///
///   kTangentLaw  1/4    κ = 2 tan(φ/2): infinite where an edge folds back on the one before it.
///                       Bergou et al. 2008, Discrete Elastic Rods, equation 1
///   kArcLaw      1/16   close to κ = φ (which is p = 1/12 to fourth order in φ). A polygon of edges of
///                       fixed length is a little longer than the arc through its corners; this p makes
///                       up for it, and leaves the least error of a bent rod
///   kSineLaw     0      κ = 2 sin(φ/2)
constexpr double kTangentLaw = 1.0 / 4.0;
constexpr double kArcLaw = 1.0 / 16.0;
constexpr double kSineLaw = 0.0;

template <class V>
struct BendingTerms {
  V value;   ///< f(s)
  V first;   ///< f'(s), > 0
  V second;  ///< f''(s), ≥ 0
};

/// Beyond s = 3.99, a turn by 174°, f goes on along its tangent, so that a clamp that spins round in
/// one step still finds a finite energy that falls on the way back.
template <class V>
CALLIGRAPHY_INLINE BendingTerms<V> bendingTerms(V s, V p) {
  const V half = broadcast<V>(RealOf<V>(0.5)), two = broadcast<V>(2);
  const V regular = min(s, broadcast<V>(RealOf<V>(3.99)));
  const V r = broadcast<V>(1) / (broadcast<V>(1) - p * regular);
  const V first = half * r * r;
  return {half * regular * r + first * (s - regular), first,
          select(s > regular, V{}, two * p * first * r)};
}

}  // namespace calligraphy_brush
