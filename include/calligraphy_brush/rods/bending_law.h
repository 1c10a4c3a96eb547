#pragma once

#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Discrete bending energy of two edges that meet at an angle φ, as a function of
/// s = |t₁ − t₀|² = 4 sin²(φ/2), the squared difference of their unit tangents: s in [0, 4].
///
/// A joint of stiffness k = EI/l̄ [N m] (l̄: its Voronoi length) holds the energy k · value(s) [J].
/// Each law is k κ²/2 for small angles.
template <class V>
struct BendingTerms {
  V value;   ///< f(s)
  V first;   ///< f'(s), > 0
  V second;  ///< f''(s), ≥ 0
};

/// κ = 2 tan(φ/2): f = 2 s/(4 − s). Has its pole where an edge folds back on the one before it
/// (s = 4); beyond s = 3.99, a turn by 174°, f goes on along its tangent, so that a clamp that spins
/// round in one step still finds a finite energy that falls on the way back.
/// Source: Bergou et al. 2008, Discrete Elastic Rods, equation 1 and section 4.2.
struct TangentLaw {
  template <class V>
  static CALLIGRAPHY_INLINE BendingTerms<V> evaluate(V s) {
    const V regular = min(s, broadcast<V>(RealOf<V>(3.99)));
    const V r = broadcast<V>(1) / (broadcast<V>(4) - regular);
    const V first = broadcast<V>(8) * r * r;
    return {broadcast<V>(2) * regular * r + first * (s - regular), first,
            select(s > regular, V{}, broadcast<V>(2) * first * r)};
  }
};

/// κ = 2 sin(φ/2): f = s/2. Softer than a continuous rod in a sharp bend and finite when folded.
struct SineLaw {
  template <class V>
  static CALLIGRAPHY_INLINE BendingTerms<V> evaluate(V s) {
    return {broadcast<V>(RealOf<V>(0.5)) * s, broadcast<V>(RealOf<V>(0.5)), V{}};
  }
};

}  // namespace calligraphy_brush
