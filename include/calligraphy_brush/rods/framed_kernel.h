#pragma once

#include "calligraphy_brush/rods/joint_energy.h"
#include "calligraphy_brush/rods/newton_step.h"

namespace calligraphy_brush {

/// Implicit time step of any inextensible rod: bending with two stiffnesses, twisting, natural
/// curvature and twist, with the far end free or clamped.
///
/// As RodKernel, but an edge carries its material frame, a unit quaternion q, and the unknowns are
/// three numbers an edge: its turn ω in its own axes, q ← q (1, ω/2)/|(1, ω/2)|. A joint's energy is
/// a function of the two frames it connects, so twist needs no reference frame to be carried in
/// time. Twist has no inertia. The Riccati sweep has a state of six (δx, ω of the edge before) and
/// 3×3 pivots. A clamped far end is a joint to a fixed frame, and its place a spring with a
/// multiplier, improved in rounds with those of the contact.
/// Source: Bergou et al. 2008, Discrete Elastic Rods; 2010, Discrete Viscous Threads, section 4.
template <class V, class Potential>
class FramedKernel : public NewtonStep<FramedKernel<V, Potential>, V, Potential> {
  using Base = NewtonStep<FramedKernel, V, Potential>;
  friend Base;
  static constexpr bool kConstrained = true;
  using Base::edge_, Base::gradient_, Base::inertia_, Base::kNudge, Base::kVector, Base::length_,
      Base::mass_, Base::n_, Base::next_, Base::position_, Base::potential_, Base::real,
      Base::root_displacement_, Base::root_position_, Base::trial_;

 public:
  using Real = typename Base::Real;
  using Mask = typename Base::Mask;
  using Vector = typename Base::Vector;

  /// As RodKernel::solve.
  static SolveReport solve(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
                           FramedRods<Real>& framed, const StepCoefficientsOf<V>& step, double law,
                           double gravity, const SolverSettings& settings, int lane,
                           Potential& potential, RodBatchWorkspace<Real>& workspace,
                           RodBatchState<Real>& state, const double* pivot, Real* wrench) {
    FramedKernel kernel(model, roots, framed, step, law, gravity, lane, potential, workspace, state);
    return kernel.run(settings, pivot, wrench);
  }

 private:
  FramedKernel(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
               FramedRods<Real>& framed, const StepCoefficientsOf<V>& step, double law, double gravity,
               int lane, Potential& potential, RodBatchWorkspace<Real>& workspace,
               RodBatchState<Real>& state)
      : Base(model, roots, step, gravity, lane, potential, workspace, state,
             framed.trial_frame.data() + lane, framed.next_frame.data() + lane),
        joint_(framed.joint.data() + lane),
        frame_(framed.frame.data() + lane),
        tether_(framed.tether_multiplier.data() + lane),
        factor_(framed.factor.data() + lane),
        round_(real(1.0 - 4.0 * law)),
        clamp_(Rotation::loadFrom(framed.clamp_frame.data() + lane)),
        end_frame_(Rotation::loadFrom(framed.end_frame.data() + lane)),
        end_position_(Vector::loadFrom(framed.end_position.data() + lane)),
        tether_stiffness_(load<V>(framed.tether_stiffness.data() + lane)),
        first_multiplier_(Vector::loadFrom(framed.tether_multiplier.data() + lane)) {}

  using Rotation = Quaternion<V>;
  static constexpr int kFrame = 4 * kLanes;
  static constexpr int kJoint = 6 * kLanes;
  static constexpr int kFactor = 27 * kLanes;

  CALLIGRAPHY_INLINE Joint<V> joint(int i) const {
    const Real* at = joint_ + i * kJoint;
    return {load<V>(at),
            load<V>(at + kLanes),
            load<V>(at + 2 * kLanes),
            load<V>(at + 3 * kLanes),
            load<V>(at + 4 * kLanes),
            load<V>(at + 5 * kLanes)};
  }

  /// a* b, of the two quaternions of that rotation the one that turns by less than a half.
  static CALLIGRAPHY_INLINE Rotation between(const Rotation& a, const Rotation& b) {
    const Rotation q = a.conjugate() * b;
    return select(q.w < V{}, Rotation{-q.w, -q.x, -q.y, -q.z}, q);
  }

  CALLIGRAPHY_INLINE Vector edgeOf(const Rotation& q) const {
    Vector d1, d2, t;
    axes(q, d1, d2, t);
    return length_ * t;
  }

  void predict() {
    for (int node = 0; node < n_; ++node) Base::aim(node);
    for (int i = 0; i < n_ - 1; ++i)
      Rotation::loadFrom(frame_ + i * kFrame).storeTo(trial_ + i * kFrame);
    evaluate();
  }

  void evaluate() {
    walk([this](int i) { return Rotation::loadFrom(trial_ + i * kFrame); });
  }

  template <class Frame>
  CALLIGRAPHY_INLINE void walk(Frame&& frame) {
    const V half = real(0.5);
    V elastic{};
    Rotation before = clamp_;
    Vector way = root_displacement_;
    typename Base::NodeSums sums;
    sums.lowest = root_position_.z;
    if constexpr (Potential::kPresent) potential_.beginPass();
    for (int i = 0; i < n_ - 1; ++i) {
      const Rotation q = frame(i);
      elastic = elastic + jointEnergy(between(before, q), joint(i), round_);
      way = way + (edgeOf(q) - Vector::loadFrom(edge_ + i * kVector));
      Vector gradient = Base::addNode(i + 1, way, sums);
      if (i == n_ - 2) {
        const Vector miss = Vector::loadFrom(position_ + (n_ - 1) * kVector) + way - end_position_;
        const Vector multiplier = Vector::loadFrom(tether_);
        elastic = elastic + half * tether_stiffness_ * squaredNorm(miss) + dot(multiplier, miss);
        gradient = gradient + tether_stiffness_ * miss + multiplier;
        miss_ = miss;
      }
      Base::toScratch(gradient, gradient_ + (i + 1) * Base::kScratchVector);
      before = q;
    }
    Base::energy_ = elastic + jointEnergy(between(before, end_frame_), joint(n_ - 1), round_) +
                    real(0.5) * sums.twice_inertia + sums.potential;
    Base::lowest_ = sums.lowest;
  }

  Mask sweep(V majorant, V& decrement) {
    const V weight = inertia_, zero{}, one = real(1), half = real(0.5);
    const V least_pivot = real(8) * broadcast<V>(std::numeric_limits<Real>::epsilon());
    Mask failed = zero > one;
    V spent{};
    JointDerivatives<V> d;

    Symmetric3<V> S{};
    Vector R[3] = {}, p{}, force{};
    V Q[3][3] = {}, q[3] = {};
    const auto addNode = [&](int node) {
      const V w = weight * load<V>(mass_ + node * kLanes);
      S.xx = S.xx + w;
      S.yy = S.yy + w;
      S.zz = S.zz + w;
      if constexpr (Potential::kPresent) potential_.addHessian(node, S);
      const Vector gradient = Base::fromScratch(gradient_ + node * Base::kScratchVector);
      p = p + gradient;
      force = force + gradient;
    };
    addNode(n_ - 1);
    S.xx = S.xx + tether_stiffness_;
    S.yy = S.yy + tether_stiffness_;
    S.zz = S.zz + tether_stiffness_;
    Rotation here = Rotation::loadFrom(trial_ + (n_ - 2) * kFrame);
    jointDerivatives(between(here, end_frame_), joint(n_ - 1), round_, majorant, d);
    for (int a = 0; a < 3; ++a) {
      q[a] = d.gradient0[a];
      for (int b = 0; b < 3; ++b) Q[a][b] = d.hessian00[a][b];
    }

    for (int i = n_ - 2; i >= 0; --i) {
      const Rotation before = i > 0 ? Rotation::loadFrom(trial_ + (i - 1) * kFrame) : clamp_;
      jointDerivatives(between(before, here), joint(i), round_, majorant, d);
      Vector d1, d2, t;
      axes(here, d1, d2, t);
      // A turn ω moves the far end of the edge by l (ω_y d₁ − ω_x d₂), and to second order by
      // l (ω_x ω_z d₁ + ω_y ω_z d₂ − (ω_x² + ω_y²) t)/2.
      const Vector g0 = (-length_) * d2, g1 = length_ * d1;
      V shorten = -length_ * dot(force, t);
      shorten = select(shorten < zero, (one - majorant) * shorten, shorten);
      const V skew = half * (one - majorant) * length_;

      const Vector W[3] = {S * g0 + R[0], S * g1 + R[1], R[2]};
      const V H00 = dot(g0, W[0]) + dot(R[0], g0) + Q[0][0] + d.hessian11[0][0] + shorten;
      const V H01 = dot(g0, W[1]) + dot(R[0], g1) + Q[0][1] + d.hessian11[0][1];
      const V H02 = dot(g0, W[2]) + Q[0][2] + d.hessian11[0][2] + skew * dot(force, d1);
      const V H11 = dot(g1, W[1]) + dot(R[1], g1) + Q[1][1] + d.hessian11[1][1] + shorten;
      const V H12 = dot(g1, W[2]) + Q[1][2] + d.hessian11[1][2] + skew * dot(force, d2);
      const V H22 = Q[2][2] + d.hessian11[2][2];
      const V g[3] = {dot(g0, p) + q[0] + d.gradient1[0], dot(g1, p) + q[1] + d.gradient1[1],
                      q[2] + d.gradient1[2]};

      // Inverse by the adjugate; the leading minors are the pivots' signs.
      const V A00 = H11 * H22 - H12 * H12, A01 = H02 * H12 - H01 * H22, A02 = H01 * H12 - H02 * H11;
      const V A11 = H00 * H22 - H02 * H02, A12 = H01 * H02 - H00 * H12, A22 = H00 * H11 - H01 * H01;
      const V determinant = H00 * A00 + H01 * A01 + H02 * A02;
      const Mask good = (H00 > zero) & (A22 > least_pivot * (H00 * H11)) &
                        (determinant > least_pivot * (A22 * H22)) & (H22 > zero);
      failed = failed | !good;
      const V inverse = select(good, one / determinant, zero);
      const V I[3][3] = {{A00 * inverse, A01 * inverse, A02 * inverse},
                         {A01 * inverse, A11 * inverse, A12 * inverse},
                         {A02 * inverse, A12 * inverse, A22 * inverse}};
      Real* out = factor_ + i * kFactor;
      g0.storeTo(out);
      g1.storeTo(out + 3 * kLanes);
      V k[3];
      Vector X[3];
      for (int a = 0; a < 3; ++a) {
        k[a] = I[a][0] * g[0] + I[a][1] * g[1] + I[a][2] * g[2];
        spent = spent + k[a] * g[a];
        X[a] = I[a][0] * W[0] + I[a][1] * W[1] + I[a][2] * W[2];
        X[a].storeTo(out + (6 + 3 * a) * kLanes);
        store<V>(out + (15 + a) * kLanes, k[a]);
      }
      if (i == 0) break;

      V U[3][3];
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
          U[a][b] =
              I[a][0] * d.hessian01[b][0] + I[a][1] * d.hessian01[b][1] + I[a][2] * d.hessian01[b][2];
          store<V>(out + (18 + 3 * a + b) * kLanes, U[a][b]);
        }
      S.xx = S.xx - (W[0].x * X[0].x + W[1].x * X[1].x + W[2].x * X[2].x);
      S.xy = S.xy - (W[0].x * X[0].y + W[1].x * X[1].y + W[2].x * X[2].y);
      S.xz = S.xz - (W[0].x * X[0].z + W[1].x * X[1].z + W[2].x * X[2].z);
      S.yy = S.yy - (W[0].y * X[0].y + W[1].y * X[1].y + W[2].y * X[2].y);
      S.yz = S.yz - (W[0].y * X[0].z + W[1].y * X[1].z + W[2].y * X[2].z);
      S.zz = S.zz - (W[0].z * X[0].z + W[1].z * X[1].z + W[2].z * X[2].z);
      p = p - (k[0] * W[0] + k[1] * W[1] + k[2] * W[2]);
      for (int b = 0; b < 3; ++b) {
        R[b] = (-U[0][b]) * W[0] - (U[1][b] * W[1] + U[2][b] * W[2]);
        q[b] = d.gradient0[b] -
               (d.hessian01[b][0] * k[0] + d.hessian01[b][1] * k[1] + d.hessian01[b][2] * k[2]);
        for (int c = b; c < 3; ++c)
          Q[b][c] = Q[c][b] =
              d.hessian00[b][c] -
              (d.hessian01[b][0] * U[0][c] + d.hessian01[b][1] * U[1][c] + d.hessian01[b][2] * U[2][c]);
      }
      addNode(i);
      here = before;
    }
    decrement = spent;
    return failed;
  }

  CALLIGRAPHY_INLINE Rotation turned(int i, const V* u, V scale) const {
    const Rotation q = Rotation::loadFrom(trial_ + i * kFrame);
    const V half = real(0.5) * scale;
    const Rotation moved = q * Rotation{real(1), half * u[0], half * u[1], half * u[2]};
    const V inverse = real(1) / sqrt(dot(moved, moved));
    const Rotation result =
        select(scale == V{}, q,
               Rotation{inverse * moved.w, inverse * moved.x, inverse * moved.y, inverse * moved.z});
    result.storeTo(next_ + i * kFrame);
    return result;
  }

  V solveForUpdate(V scale) {
    Vector shift{};
    V u[3] = {}, largest_squared{};
    walk([&](int i) {
      const Real* in = factor_ + i * kFactor;
      V v[3];
      for (int a = 0; a < 3; ++a) {
        v[a] =
            -load<V>(in + (15 + a) * kLanes) - dot(Vector::loadFrom(in + (6 + 3 * a) * kLanes), shift);
        if (i > 0)
          for (int b = 0; b < 3; ++b) v[a] = v[a] - load<V>(in + (18 + 3 * a + b) * kLanes) * u[b];
      }
      for (int a = 0; a < 3; ++a) u[a] = v[a];
      shift = shift + (u[0] * Vector::loadFrom(in) + u[1] * Vector::loadFrom(in + 3 * kLanes));
      largest_squared = max(largest_squared, u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
      return turned(i, u, scale);
    });
    return sqrt(largest_squared);
  }

  /// As RodKernel's, about each edge's first axis.
  void nudge(V scale) {
    walk([&](int i) {
      const V u[3] = {real(kNudge * (n_ - 1 - i) / (n_ - 1)), V{}, V{}};
      return turned(i, u, scale);
    });
  }

  /// A better multiplier for the place of the far end; the lanes that miss it by more than tolerance.
  Mask updateConstraints(double tolerance, Mask lanes) {
    const Vector old = Vector::loadFrom(tether_);
    better_multiplier_ = select(lanes, old + tether_stiffness_ * miss_, better_multiplier_);
    return (tether_stiffness_ > V{}) & (squaredNorm(miss_) > real(tolerance * tolerance));
  }
  void adoptConstraints(Mask lanes) {
    select(lanes, better_multiplier_, Vector::loadFrom(tether_)).storeTo(tether_);
  }

  void restoreConstraints() { first_multiplier_.storeTo(tether_); }

  void finish(const double* pivot, Real* wrench) {
    better_multiplier_.storeTo(tether_);
    Base::moveState(
        [this](int i) {
          const Rotation q = Rotation::loadFrom(trial_ + i * kFrame);
          q.storeTo(frame_ + i * kFrame);
          return edgeOf(q);
        },
        pivot, wrench);
    if (!wrench) return;
    // The torque of the far clamp comes through the rod as well.
    JointDerivatives<V> d;
    const Rotation last = Rotation::loadFrom(trial_ + (n_ - 2) * kFrame);
    jointDerivatives(between(last, end_frame_), joint(n_ - 1), round_, V{}, d);
    Vector d1, d2, t;
    axes(last, d1, d2, t);
    const Vector torque = Vector::loadFrom(wrench + kVector) -
                          (d.gradient0[0] * d1 + d.gradient0[1] * d2 + d.gradient0[2] * t);
    torque.storeTo(wrench + kVector);
  }

  const Real* joint_;
  Real *frame_, *tether_, *factor_;
  V round_;  // of jointStrain
  Rotation clamp_, end_frame_;
  Vector end_position_;
  V tether_stiffness_;
  Vector first_multiplier_, better_multiplier_{}, miss_{};
};

}  // namespace calligraphy_brush
