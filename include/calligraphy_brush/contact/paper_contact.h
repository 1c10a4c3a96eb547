#pragma once

#include <vector>

#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Contact of the nodes of one batch of rods with the sheet z = 0; arrays as in the batch.
template <class Real>
struct PaperContactState {
  Real friction = 0;               ///< Coulomb coefficient µ
  AlignedVector<Real> stiffness;   ///< k of the augmented Lagrangian [N/m], [node][lane]
  AlignedVector<Real> multiplier;  ///< −x, −y: friction; z: normal force [N], [node][3][lane]
  AlignedVector<Real> offset;      ///< way of a sticking node from where it stuck [m], [node][2][lane]
  AlignedVector<Real> force;       ///< of the sheet on the node in the last step [N], [node][3][lane]

  /// Whether the lanes from this one on, as far as a kernel takes them together, touch: [lane]. Where
  /// they do not, all of the above is zero.
  std::vector<char> engaged;

  // Scratch of a step.
  AlignedVector<Real> slip;     ///< offset at the end of the step [m], [node][2][lane]
  AlignedVector<Real> hessian;  ///< xx, xy, yy, zz [N/m], [node][4][lane]
  AlignedVector<Real> piece;    ///< which piece of the potential each node is on, [node][lane]
  std::vector<char> near;       ///< nodes that had a contact term in the last pass, [node]
};

/// Sizes every array, with zeros.
template <class Real>
PaperContactState<Real> makePaperContactState(int node_count) {
  PaperContactState<Real> state;
  const auto rows = [node_count](int count) {
    return static_cast<std::size_t>(node_count * count * kLanes);
  };
  state.stiffness.resize(rows(1));
  state.engaged.resize(kLanes);
  state.multiplier.resize(rows(3));
  state.offset.resize(rows(2));
  state.force.resize(rows(3));
  state.slip.resize(rows(2));
  state.hessian.resize(rows(4));
  state.piece.resize(rows(1));
  state.near.resize(static_cast<std::size_t>(node_count));
  return state;
}

/// Unilateral contact with Coulomb friction by the augmented Lagrangian, as a potential of nodes.
///
/// With the multipliers λ (normal, ≥ 0) and τ (friction) of the step before,
///
///   N = max(0, λ − k z)                                        pushes, never pulls
///   T = τ + k s, s = way from where the node stuck; cut off at |T| = µ λ
///   Φ = N²/(2k) + (|T|² / (2k)   or, where it slides,   (µλ|T| − (µλ)²/2) / k)
///
/// In the first pass of a step, over a shape that is a guess, the sheet can also pull the nodes that
/// touched in the step before. Guesses often take them off it by a little; Newton's method would then
/// see nothing below them and overshoot by far. The energy is only larger for it, so the line search
/// holds as before.
///
/// The cone has its radius from the multiplier, so Φ is convex and has a gradient, −N in z and T in
/// the plane. After the step λ ← N and τ ← T cut off at µN. A node that sticks keeps the place it
/// stuck at and τ goes on until s = 0: at rest nothing creeps and nothing is below the sheet.
/// Source: Alart & Curnier 1991 (A mixed formulation for frictional contact problems prone to
/// Newton like solution methods); Simo & Laursen 1992 for the frozen cone.
template <class V>
class PaperContact {
 public:
  static constexpr bool kPresent = true;
  using Real = RealOf<V>;
  using Mask = MaskOf<V>;

  /// position: of the nodes when the step begins [m], [node][3][lane].
  PaperContact(int node_count, int lane, const Real* position, PaperContactState<Real>& state)
      : node_count_(node_count),
        friction_(broadcast<V>(state.friction)),
        position_(position + lane),
        stiffness_(state.stiffness.data() + lane),
        multiplier_(state.multiplier.data() + lane),
        offset_(state.offset.data() + lane),
        force_(state.force.data() + lane),
        slip_(state.slip.data() + lane),
        hessian_(state.hessian.data() + lane),
        piece_(state.piece.data() + lane),
        near_(state.near.data()),
        engaged_(state.engaged.data() + lane) {
    for (int node = 0; node < node_count_; ++node) near_[node] = 0;
  }

  CALLIGRAPHY_INLINE void beginPass() {
    piece_changed_ = V{} > broadcast<V>(1);
    holds_ = passes_++ == 0;
  }

  CALLIGRAPHY_INLINE V add(int node, const Vec3<V>& way, Vec3<V>& gradient) {
    const V zero{}, one = broadcast<V>(1), half = broadcast<V>(Real(0.5));
    const V k = load<V>(stiffness_ + node * kLanes);
    const Vec3<V> multiplier = Vec3<V>::loadFrom(multiplier_ + node * 3 * kLanes);
    V normal = multiplier.z - k * (load<V>(position_ + (node * 3 + 2) * kLanes) + way.z);
    Mask touches = normal > zero;
    if (holds_) touches = touches | (multiplier.z > zero);
    normal = select(touches, normal, zero);
    Real* piece_address = piece_ + node * kLanes;
    if (!any(touches | (multiplier.z > zero))) {
      if (near_[node]) {
        piece_changed_ = piece_changed_ | (load<V>(piece_address) != zero);
        near_[node] = 0;
      }
      return zero;
    }
    const V before = near_[node] ? load<V>(piece_address) : zero;
    near_[node] = 1;

    const V sx = load<V>(offset_ + node * 2 * kLanes) + way.x;
    const V sy = load<V>(offset_ + (node * 2 + 1) * kLanes) + way.y;
    const V tx = multiplier.x + k * sx, ty = multiplier.y + k * sy;
    const V cone = friction_ * multiplier.z;
    const V size = sqrt(tx * tx + ty * ty);
    const Mask slides = size > cone;
    const V inverse_size = select(slides, one / max(size, broadcast<V>(Real(1e-30))), zero);
    const V cut = select(slides, cone * inverse_size, one);
    const V fx = cut * tx, fy = cut * ty;
    const V dx = tx * inverse_size, dy = ty * inverse_size;  // zero where it sticks
    const V kt = k * cut;

    gradient.x = gradient.x + fx;
    gradient.y = gradient.y + fy;
    gradient.z = gradient.z - normal;
    store<V>(slip_ + node * 2 * kLanes, sx);
    store<V>(slip_ + (node * 2 + 1) * kLanes, sy);
    Vec3<V>{-fx, -fy, normal}.storeTo(force_ + node * 3 * kLanes);
    Real* hessian = hessian_ + node * 4 * kLanes;
    store<V>(hessian, kt - kt * dx * dx);
    store<V>(hessian + kLanes, -kt * dx * dy);
    store<V>(hessian + 2 * kLanes, kt - kt * dy * dy);
    store<V>(hessian + 3 * kLanes, select(touches, k, zero));

    const V piece =
        select(touches, one, zero) + select((multiplier.z > zero) & slides, broadcast<V>(2), zero);
    piece_changed_ = piece_changed_ | (piece != before);
    store<V>(piece_address, piece);
    const V friction = select(slides, cone * (size - half * cone), half * size * size);
    return (half * normal * normal + friction) / k;
  }

  CALLIGRAPHY_INLINE void addHessian(int node, Symmetric3<V>& hessian) const {
    if (!near_[node]) return;
    const Real* in = hessian_ + node * 4 * kLanes;
    hessian.xx = hessian.xx + load<V>(in);
    hessian.xy = hessian.xy + load<V>(in + kLanes);
    hessian.yy = hessian.yy + load<V>(in + 2 * kLanes);
    hessian.zz = hessian.zz + load<V>(in + 3 * kLanes);
  }

  CALLIGRAPHY_INLINE Mask pieceChanged() const { return piece_changed_; }

  Mask update(double tolerance, Mask lanes) {
    const V zero{}, limit = broadcast<V>(static_cast<Real>(tolerance));
    Mask open = zero > broadcast<V>(1);
    for (int node = 1; node < node_count_; ++node) {
      if (!near_[node]) continue;
      Real* address = multiplier_ + node * 3 * kLanes;
      const Vec3<V> old = Vec3<V>::loadFrom(address);
      const Vec3<V> force = Vec3<V>::loadFrom(force_ + node * 3 * kLanes);
      const V k = load<V>(stiffness_ + node * kLanes);
      // The trial friction once more, now cut off at the cone of the new normal force.
      const V tx = old.x + k * load<V>(slip_ + node * 2 * kLanes);
      const V ty = old.y + k * load<V>(slip_ + (node * 2 + 1) * kLanes);
      const V size = sqrt(tx * tx + ty * ty);
      const V cone = friction_ * force.z;
      const V cut = select(size > cone, cone / max(size, broadcast<V>(Real(1e-30))), broadcast<V>(1));
      const Vec3<V> better{cut * tx, cut * ty, force.z};
      const Vec3<V> change = better - old;
      open = open | (squaredNorm(change) > limit * limit * k * k);
      select(lanes, better, old).storeTo(address);
    }
    return open;
  }

  void finish() {
    const V zero{};
    bool engaged = false;
    for (int node = 0; node < node_count_; ++node) {
      Real* multiplier = multiplier_ + node * 3 * kLanes;
      Real* force = force_ + node * 3 * kLanes;
      Real* offset = offset_ + node * 2 * kLanes;
      if (!near_[node]) {
        Vec3<V>{}.storeTo(multiplier);
        Vec3<V>{}.storeTo(force);
        store<V>(offset, zero);
        store<V>(offset + kLanes, zero);
        continue;
      }
      // Cut off at the cone: the place where it stuck has come along.
      const Vec3<V> m = Vec3<V>::loadFrom(multiplier);
      engaged |= any(m.z > zero);
      const V cone = friction_ * m.z;
      const Mask sticks =
          (m.z > zero) & (m.x * m.x + m.y * m.y < broadcast<V>(Real(0.99999)) * cone * cone);
      store<V>(offset, select(sticks, load<V>(slip_ + node * 2 * kLanes), zero));
      store<V>(offset + kLanes, select(sticks, load<V>(slip_ + (node * 2 + 1) * kLanes), zero));
    }
    *engaged_ = engaged;
  }

 private:
  int node_count_;
  V friction_;
  const Real *position_, *stiffness_;
  Real *multiplier_, *offset_, *force_, *slip_, *hessian_, *piece_;
  char *near_, *engaged_;
  Mask piece_changed_{};
  int passes_ = 0;
  bool holds_ = false;  // this pass is the first
};

}  // namespace calligraphy_brush
