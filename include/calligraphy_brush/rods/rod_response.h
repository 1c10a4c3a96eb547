#pragma once

#include "calligraphy_brush/rods/rod_batch.h"

namespace calligraphy_brush {

/// How rods answer to small forces, by the factors that their last Newton step has left behind.
///
/// A turn is two numbers u an edge, along the basis P of its tangent plane [m]; a load is what does
/// work on it [N]: both [edge][2][lane], from the lane that V begins with. Factors are those of its lanes,
/// [edge][kRodFactorRows][lane of V].
template <class V>
struct RodResponse {
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  static constexpr int kTurn = 2 * kLanes, kRow = widthOf<V>, kFactor = kRodFactorRows * kRow;

  /// The turn H⁻¹ · load, where H is the matrix of the last sweep: the same recursion with another
  /// right side. Costs a fifth of a sweep. `turn` may be `load`.
  static CALLIGRAPHY_INLINE void solve(int edges, const Real* factor, const Real* load, Real* turn) {
    Vector p{};
    V q0{}, q1{};
    for (int i = edges - 1; i >= 0; --i) {
      const Real* row = factor + i * kFactor;
      const V g0 = q0 + at(load, i, 0) + dot(basis(row, 0), p);
      const V g1 = q1 + at(load, i, 1) + dot(basis(row, 1), p);
      const V I01 = in(row, kRodFactorPivot + 1);
      store<V>(turn + i * kTurn, in(row, kRodFactorPivot) * g0 + I01 * g1);
      store<V>(turn + i * kTurn + kLanes, I01 * g0 + in(row, kRodFactorPivot + 2) * g1);
      p = p - g0 * gain(row, 0) - g1 * gain(row, 1);
      q0 = -(in(row, kRodFactorCoupling) * g0 + in(row, kRodFactorCoupling + 2) * g1);
      q1 = -(in(row, kRodFactorCoupling + 1) * g0 + in(row, kRodFactorCoupling + 3) * g1);
    }
    Vector shift{};
    V u0{}, u1{};
    for (int i = 0; i < edges; ++i) {
      const Real* row = factor + i * kFactor;
      V v0 = at(turn, i, 0) - dot(gain(row, 0), shift);
      V v1 = at(turn, i, 1) - dot(gain(row, 1), shift);
      if (i > 0) {
        v0 = v0 - in(row, kRodFactorCoupling) * u0 - in(row, kRodFactorCoupling + 1) * u1;
        v1 = v1 - in(row, kRodFactorCoupling + 2) * u0 - in(row, kRodFactorCoupling + 3) * u1;
      }
      u0 = v0;
      u1 = v1;
      store<V>(turn + i * kTurn, u0);
      store<V>(turn + i * kTurn + kLanes, u1);
      shift = shift + (u0 * basis(row, 0) + u1 * basis(row, 1));
    }
  }

  /// Calls visit(node, way) for the nodes 1, 2, ... of rods whose edges turn.
  template <class Visit>
  static CALLIGRAPHY_INLINE void walk(int edges, const Real* factor, const Real* turn, Visit&& visit) {
    Vector way{};
    for (int i = 0; i < edges; ++i) {
      const Real* row = factor + i * kFactor;
      way = way + (at(turn, i, 0) * basis(row, 0) + at(turn, i, 1) * basis(row, 1));
      visit(i + 1, way);
    }
  }

  /// The load of forces on nodes: give(edge, load0, load1), from the tip, of force(node).
  template <class Force, class Give>
  static CALLIGRAPHY_INLINE void gather(int edges, const Real* factor, Force&& force, Give&& give) {
    Vector sum{};
    for (int i = edges - 1; i >= 0; --i) {
      const Real* row = factor + i * kFactor;
      sum = sum + force(i + 1);
      give(i, dot(basis(row, 0), sum), dot(basis(row, 1), sum));
    }
  }

 private:
  static CALLIGRAPHY_INLINE V in(const Real* row, int index) {
    return calligraphy_brush::load<V>(row + index * kRow);
  }
  static CALLIGRAPHY_INLINE Vector vectorIn(const Real* row, int index) {
    return {in(row, index), in(row, index + 1), in(row, index + 2)};
  }
  static CALLIGRAPHY_INLINE V at(const Real* turn, int edge, int component) {
    return calligraphy_brush::load<V>(turn + edge * kTurn + component * kLanes);
  }
  static CALLIGRAPHY_INLINE Vector basis(const Real* row, int index) {
    return vectorIn(row, kRodFactorBasis + 3 * index);
  }
  static CALLIGRAPHY_INLINE Vector gain(const Real* row, int index) {
    return vectorIn(row, kRodFactorGain + 3 * index);
  }
};

}  // namespace calligraphy_brush
