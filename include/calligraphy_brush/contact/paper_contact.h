#pragma once

#include <limits>
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

  /// 1 where a rod felt the sheet in the last step, else 0: [lane]. Where it did not, all of the above
  /// is zero.
  AlignedVector<Real> engaged;

  /// 1 where a node of a rod stuck to the sheet in the last step, or slid by less than the tolerance
  /// of a contact, else 0: [lane].
  AlignedVector<Real> stuck;

  AlignedVector<Real> touching;  ///< nodes of a rod that the sheet pushed in the last step, [lane]

  /// Not 0 where multiplier, offset or force of a node may be other than zero, in the first of the lanes
  /// that are solved together: [node][lane].
  std::vector<char> held;

  // Scratch of a step.
  AlignedVector<Real> slip;     ///< offset at the end of the step [m], [node][2][lane]
  AlignedVector<Real> hessian;  ///< xx, xy, yy, zz [N/m], [node][4][lane]
  AlignedVector<Real> better;   ///< multipliers after the last solve [N], [node][3][lane]
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
  state.stuck.resize(kLanes);
  state.touching.resize(kLanes);
  state.held.resize(rows(1));
  state.multiplier.resize(rows(3));
  state.offset.resize(rows(2));
  state.force.resize(rows(3));
  state.slip.resize(rows(2));
  state.hessian.resize(rows(4));
  state.better.resize(rows(3));
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
  static constexpr bool kHasFloor = false;
  static constexpr bool kTied = false;
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
        better_(state.better.data() + lane),
        piece_(state.piece.data() + lane),
        near_(state.near.data()),
        held_(state.held.data() + lane),
        engaged_(state.engaged.data() + lane),
        stuck_(state.stuck.data() + lane),
        touching_(state.touching.data() + lane),
        here_(load<V>(engaged_) > V{}) {
    begin();
  }

  CALLIGRAPHY_INLINE void beginPass() {
    piece_changed_ = present_ = V{} > broadcast<V>(1);
    holds_ = passes_++ == 0;
  }

  CALLIGRAPHY_INLINE V add(int node, const Vec3<V>& way, Vec3<V>& gradient) {
    const V zero{}, one = broadcast<V>(1), half = broadcast<V>(Real(0.5));
    const V height = load<V>(position_ + (node * 3 + 2) * kLanes) + way.z;
    Real* piece_address = piece_ + node * kLanes;
    const auto leave = [&] {
      if (near_[node]) {
        piece_changed_ = piece_changed_ | (load<V>(piece_address) != zero);
        near_[node] = 0;
      }
      return zero;
    };
    if (!held_[node * kLanes] && !any(here_ & (height < zero))) return leave();
    const V k = hardening_ * load<V>(stiffness_ + node * kLanes);
    const Vec3<V> multiplier = Vec3<V>::loadFrom(multiplier_ + node * 3 * kLanes);
    V normal = multiplier.z - k * height;
    Mask touches = here_ & (normal > zero);
    if (holds_) touches = touches | (multiplier.z > zero);
    normal = select(touches, normal, zero);
    const Mask present = touches | (multiplier.z > zero);
    present_ = present_ | present;
    if (!any(present)) return leave();
    if (!near_[node]) {
      store<V>(piece_address, zero);
      multiplier.storeTo(better_ + node * 3 * kLanes);
      near_[node] = held_[node * kLanes] = 1;
    }
    const V before = load<V>(piece_address);

    const V sx = load<V>(offset_ + node * 2 * kLanes) + way.x;
    const V sy = load<V>(offset_ + (node * 2 + 1) * kLanes) + way.y;
    const V tx = multiplier.x + k * sx, ty = multiplier.y + k * sy;
    const V cone = friction_ * multiplier.z;
    const V size = sqrt(tx * tx + ty * ty);
    const Mask slides = size >= cone;  // so without a cone there is no friction, whatever the way
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
  CALLIGRAPHY_INLINE Mask absent() const { return !present_; }

  /// Rods that did not feel the sheet in the last step are solved without it, and solved again if that
  /// takes them below it. So what a rod does never depends on whether its neighbours touch.
  Mask admit(V lowest) {
    const Mask below = (lowest < V{}) & (!here_);
    here_ = here_ | below;
    return below;
  }
  void begin() {
    for (int node = 0; node < node_count_; ++node) near_[node] = 0;
    passes_ = 0;
  }

  Mask update(double tolerance, Mask lanes) {
    tolerance_ = tolerance;
    const V limit = broadcast<V>(static_cast<Real>(tolerance));
    V worst_squared{};
    for (int node = 1; node < node_count_; ++node) {
      if (!near_[node]) continue;
      const Vec3<V> old = Vec3<V>::loadFrom(multiplier_ + node * 3 * kLanes);
      const Vec3<V> force = Vec3<V>::loadFrom(force_ + node * 3 * kLanes);
      const V k = hardening_ * load<V>(stiffness_ + node * kLanes);
      // The trial friction once more, now cut off at the cone of the new normal force.
      const V tx = old.x + k * load<V>(slip_ + node * 2 * kLanes);
      const V ty = old.y + k * load<V>(slip_ + (node * 2 + 1) * kLanes);
      const V size = sqrt(tx * tx + ty * ty);
      const V cone = friction_ * force.z;
      const V cut = select(size > cone, cone / max(size, broadcast<V>(Real(1e-30))), broadcast<V>(1));
      const Vec3<V> better{cut * tx, cut * ty, force.z};
      // As far as numbers of this precision tell.
      const V noise = broadcast<V>(64 * std::numeric_limits<Real>::epsilon());
      const V change = squaredNorm(better - old) - noise * noise * squaredNorm(better);
      worst_squared = max(worst_squared, change / (k * k));
      Real* address = better_ + node * 3 * kLanes;
      select(lanes, better, Vec3<V>::loadFrom(address)).storeTo(address);
    }
    // The usual rule for a penalty: harder where a round gained little. Not for the last 10 µm,
    // since a hard contact is a narrow, curved valley.
    slow_ = (worst_squared > broadcast<V>(Real(0.0625)) * last_worst_squared_) &
            (worst_squared > broadcast<V>(Real(1e-10)));
    last_worst_squared_ = worst_squared;
    return worst_squared > limit * limit;
  }

  void adopt(Mask lanes) {
    for (int node = 1; node < node_count_; ++node) {
      if (!near_[node]) continue;
      Real* address = multiplier_ + node * 3 * kLanes;
      select(lanes, Vec3<V>::loadFrom(better_ + node * 3 * kLanes), Vec3<V>::loadFrom(address))
          .storeTo(address);
    }
    hardening_ = select(lanes & slow_, min(broadcast<V>(4) * hardening_, broadcast<V>(Real(kHardest))),
                        hardening_);
  }

  void finish() {
    const V zero{};
    const V least = broadcast<V>(static_cast<Real>(tolerance_));
    Mask engaged = zero > broadcast<V>(1), stuck = engaged;
    V touching{};
    for (int node = 0; node < node_count_; ++node) {
      Real* multiplier = multiplier_ + node * 3 * kLanes;
      Real* force = force_ + node * 3 * kLanes;
      Real* offset = offset_ + node * 2 * kLanes;
      if (!near_[node]) {
        if (!held_[node * kLanes]) continue;
        held_[node * kLanes] = 0;
        Vec3<V>{}.storeTo(multiplier);
        Vec3<V>{}.storeTo(force);
        store<V>(offset, zero);
        store<V>(offset + kLanes, zero);
        continue;
      }
      // Cut off at the cone: the place where it stuck has come along.
      // What is left within the tolerance is taken up over some steps. All at once, the multipliers and
      // the rod's inertia would swing each other where the rod is heavy against the contact: nearly
      // along its axis, where a little way of the end is a long way of the rest. But for the direction
      // of what slides: friction that points where the node went some steps ago leads a tuft astray.
      const Vec3<V> old = Vec3<V>::loadFrom(multiplier);
      const Vec3<V> better = Vec3<V>::loadFrom(better_ + node * 3 * kLanes);
      const auto isWithinCone = [&](const Vec3<V>& f) {
        const V cone = friction_ * f.z;
        return f.x * f.x + f.y * f.y < broadcast<V>(Real(kOnCone)) * cone * cone;
      };
      const Mask presses = better.z > zero, slides = presses & !isWithinCone(better);
      Vec3<V> m = select(presses, old + broadcast<V>(Real(kTakeUp)) * (better - old), better);
      const V part = m.z / select(slides, better.z, broadcast<V>(1));
      m.x = select(slides, part * better.x, m.x);
      m.y = select(slides, part * better.y, m.y);
      m.storeTo(multiplier);
      const Vec3<V> push = Vec3<V>::loadFrom(force);
      engaged = engaged | (m.z > zero) | (squaredNorm(push) > zero);
      touching = touching + select(push.z > zero, broadcast<V>(1), zero);
      const Mask sticks = (m.z > zero) & isWithinCone(m);
      const V sx = load<V>(slip_ + node * 2 * kLanes), sy = load<V>(slip_ + (node * 2 + 1) * kLanes);
      stuck = stuck | sticks | ((m.z > zero) & (sx * sx + sy * sy < least * least));
      store<V>(offset, select(sticks, load<V>(slip_ + node * 2 * kLanes), zero));
      store<V>(offset + kLanes, select(sticks, load<V>(slip_ + (node * 2 + 1) * kLanes), zero));
    }
    store<V>(engaged_, select(engaged, broadcast<V>(1), zero));
    store<V>(stuck_, select(stuck, broadcast<V>(1), zero));
    store<V>(touching_, touching);
  }

 private:
  int node_count_;
  V friction_;
  const Real *position_, *stiffness_;
  Real *multiplier_, *offset_, *force_, *slip_, *hessian_, *better_, *piece_;
  char *near_, *held_;
  Real *engaged_, *stuck_, *touching_;
  Mask here_;  // lanes for which there is a sheet
  static constexpr double kHardest = 64;
  static constexpr double kTakeUp = 0.2;      // of what is left, in a step
  static constexpr double kOnCone = 0.99999;  // of the square of full friction, from which a node slides
  V hardening_ = broadcast<V>(1);             // factor of all stiffnesses in this step
  V last_worst_squared_ = broadcast<V>(std::numeric_limits<Real>::infinity());
  Mask slow_{};
  Mask piece_changed_{}, present_{};
  int passes_ = 0;
  double tolerance_ = 0;  // of the last update
  bool holds_ = false;    // this pass is the first
};

}  // namespace calligraphy_brush
