#pragma once

#include "calligraphy_brush/rods/newton_step.h"

namespace calligraphy_brush {

/// Potential of the nodes of a rod whose neighbours are held where they are believed to be: for node i
///
///   gᵢ·(d − Dᵢ) + ½ kᵢ |d − Dᵢ|²       d, D: way of the node in the step, and what is believed of it
///
/// on top of the potential Base (a sheet, or none). What couples rods with one another reaches the
/// kernel only in this form, so its Newton system keeps its structure, and the cost of a rod stays
/// linear in its nodes. k ≥ 0.
template <class V, class Base>
class NodeSprings {
 public:
  static constexpr bool kPresent = true;
  static constexpr bool kHasFloor = Base::kHasFloor;
  static constexpr bool kTied = true;
  using Real = RealOf<V>;
  using Mask = MaskOf<V>;

  /// Numbers of a node: g as x, y, z [N], k [N/m].
  static constexpr int kRows = 4;

  /// springs: [node][kRows][lane], and way: D [m], [node][3][lane], from the lane that `base` begins
  /// with.
  NodeSprings(Base& base, const Real* springs, const Real* way)
      : floor(floorOf(base)), below(belowOf(base)), base_(base), springs_(springs), way_(way) {}

  CALLIGRAPHY_INLINE void beginPass() {
    if constexpr (Base::kPresent) base_.beginPass();
  }

  CALLIGRAPHY_INLINE V add(int node, const Vec3<V>& way, Vec3<V>& gradient) {
    const Vec3<V> constant = Vec3<V>::loadFrom(springs_ + node * kRows * kLanes);
    const Vec3<V> off = way - Vec3<V>::loadFrom(way_ + node * 3 * kLanes);
    const Vec3<V> bent = stiffness(node) * off;
    gradient = gradient + constant + bent;
    V energy = dot(constant + broadcast<V>(Real(0.5)) * bent, off);
    if constexpr (Base::kPresent) energy = energy + base_.add(node, way, gradient);
    return energy;
  }

  /// What the potential pulls the root with, which the clamp has to hold.
  CALLIGRAPHY_INLINE void addToRoot(const Vec3<V>& way, Vec3<V>& gradient) const {
    gradient = gradient + Vec3<V>::loadFrom(springs_) + stiffness(0) * (way - Vec3<V>::loadFrom(way_));
  }

  CALLIGRAPHY_INLINE void addHessian(int node, Symmetric3<V>& sum) const {
    const V own = stiffness(node);
    sum.xx = sum.xx + own;
    sum.yy = sum.yy + own;
    sum.zz = sum.zz + own;
    if constexpr (Base::kPresent) base_.addHessian(node, sum);
  }

  /// Without the springs.
  CALLIGRAPHY_INLINE void addBaseHessian(int node, Symmetric3<V>& sum) const {
    if constexpr (Base::kPresent) base_.addHessian(node, sum);
  }

  // The springs themselves are smooth: all of this is asked for the sake of the base.
  CALLIGRAPHY_INLINE Mask pieceChanged() const {
    if constexpr (Base::kPresent) return base_.pieceChanged();
    return nobody();
  }
  CALLIGRAPHY_INLINE Mask absent() const {
    if constexpr (Base::kPresent) return base_.absent();
    return !nobody();
  }
  void begin() {
    if constexpr (Base::kPresent) base_.begin();
  }
  Mask admit(V lowest) {
    if constexpr (Base::kPresent) return base_.admit(lowest);
    return nobody();
  }
  Mask update(double tolerance, Mask lanes) {
    if constexpr (Base::kPresent) return base_.update(tolerance, lanes);
    return nobody();
  }
  void adopt(Mask lanes) {
    if constexpr (Base::kPresent) base_.adopt(lanes);
  }
  void finish() {
    if constexpr (Base::kPresent) base_.finish();
  }

  const double floor;
  Real* const below;

 private:
  static double floorOf(const Base& base) {
    if constexpr (Base::kHasFloor) return base.floor;
    return 0.0;
  }
  static Real* belowOf(const Base& base) {
    if constexpr (Base::kHasFloor) return base.below;
    return nullptr;
  }
  static CALLIGRAPHY_INLINE Mask nobody() { return V{} > broadcast<V>(1); }
  CALLIGRAPHY_INLINE V stiffness(int node) const {
    return load<V>(springs_ + (node * kRows + 3) * kLanes);
  }

  Base& base_;
  const Real *springs_, *way_;
};

}  // namespace calligraphy_brush
