#pragma once

#include "calligraphy_brush/common/orthonormal_basis.h"
#include "calligraphy_brush/rods/bending_law.h"
#include "calligraphy_brush/rods/newton_step.h"
#include "calligraphy_brush/rods/rod_batch.h"

namespace calligraphy_brush {

/// Implicit time step of straight, isotropic, free-tipped, inextensible rods, one a lane.
///
/// Minimises over all shapes of the rod that its edges of fixed length can take
///
///   Φ = Σ_i ½ w_i |d_i − target_i|² + Σ_j k_j f(|t_j − t_{j−1}|²) + Σ_i potential_i
///
/// (d: way of a node in the step; k: joint stiffness; f: bendingTerms; t₋₁: the clamp direction) by
/// Newton's method with an energy line search. Unknowns are two numbers u an edge e, in the plane
/// perpendicular to it: e ← l (e + P u)/|e + P u|, so the length is kept to rounding. The Newton
/// system is dense, since an edge moves all nodes beyond it, but has the structure of a linear
/// quadratic control problem: with the state (δx of the edge's first node, u of the edge before)
/// the cost to go is a quadratic form of five variables, and a Riccati sweep from tip to root with
/// 2×2 pivots solves it in O(n). A pivot that is not positive means that Φ is not convex there;
/// those lanes repeat the sweep with a positive definite majorant.
///
/// Twist is at rest in such a rod, and so is not computed (Bergou et al. 2008, section 5).
template <class V, class Potential>
class RodKernel : public NewtonStep<RodKernel<V, Potential>, V, Potential> {
  using Base = NewtonStep<RodKernel, V, Potential>;
  friend Base;
  static constexpr bool kConstrained = false;
  using Base::edge_, Base::gradient_, Base::inertia_, Base::kNudge, Base::kVector, Base::length_,
      Base::mass_, Base::n_, Base::next_, Base::potential_, Base::real, Base::root_displacement_,
      Base::root_position_, Base::trial_;
  using Base::fromScratch, Base::toScratch, Base::kScratchVector;

 public:
  using Real = typename Base::Real;
  using Mask = typename Base::Mask;
  using Vector = typename Base::Vector;

  /// law: p of bendingTerms. Solves lanes `lane` .. lane + kWidth − 1 and moves their state to the end
  /// of the step. `wrench`, if not null, receives [force x y z, torque x y z about `pivot`][lane] that
  /// each rod puts on its clamp [N, N m].
  static SolveReport solve(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
                           const StepCoefficientsOf<V>& step, double law, double gravity,
                           const SolverSettings& settings, int lane, Potential& potential,
                           RodBatchWorkspace<Real>& workspace, RodBatchState<Real>& state,
                           const double* pivot, Real* wrench) {
    RodKernel kernel(model, roots, step, law, gravity, lane, potential, workspace, state);
    return kernel.run(settings, pivot, wrench);
  }

  /// Adds what rods in the lanes where `present` is 1, and not 0, are together, at the shape that a step
  /// begins with, to `sums`: [place][kCommonRows][lane of V]. Of the potential's stiffness that which
  /// ties rods to others is left out.
  static void sumUp(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
                    const StepCoefficientsOf<V>& step, double law, double gravity, int lane,
                    Potential& potential, RodBatchWorkspace<Real>& workspace, RodBatchState<Real>& state,
                    const Real* present, const CommonPlaces<Real>& places, Real* sums) {
    RodKernel kernel(model, roots, step, law, gravity, lane, potential, workspace, state);
    kernel.predict();
    kernel.addUp(load<V>(present), places, lane, sums);
  }

 private:
  RodKernel(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
            const StepCoefficientsOf<V>& step, double law, double gravity, int lane,
            Potential& potential, RodBatchWorkspace<Real>& workspace, RodBatchState<Real>& state)
      : Base(model, roots, step, gravity, lane, potential, workspace, state, workspace.trial_edge.data(),
             workspace.next_edge.data()),
        spring_(model.spring.data() + lane),
        guess_(state.guess.empty() ? nullptr : state.guess.data() + lane),
        factor_(workspace.factor.data()),
        law_(real(law)),
        inverse_length_(real(1) / length_),
        inverse_length_squared_(inverse_length_ * inverse_length_),
        clamp_(Vector::loadFrom(roots.clamp.data() + lane)) {}

  /// Guesses the shape at the end of the step: nodes go on as they did.
  void predict() {
    Vector before = Base::aim(0);
    // A guess for a smooth motion; after a jump the old shape is better.
    const V limit = real(0.04) * length_ * length_;
    walk([&](int i) {
      const Vector way = Base::aim(i + 1);
      if (guess_) {
        const Vector known = Vector::loadFrom(guess_ + i * kVector);
        toScratch(known, trial_ + i * kScratchVector);
        return known;
      }
      const Vector turn = way - before;
      before = way;
      const Vector e = Vector::loadFrom(edge_ + i * kVector);
      const Vector guess = e + turn;
      const Vector scaled = (length_ / sqrt(squaredNorm(guess))) * guess;
      const Vector result = select(squaredNorm(turn) < limit, scaled, e);
      toScratch(result, trial_ + i * kScratchVector);
      return result;
    });
  }

  /// Φ and its gradient by node positions, at trial_.
  void evaluate() {
    walk([this](int i) { return fromScratch(trial_ + i * kScratchVector); });
  }

  /// Φ and its gradient along the rod whose edges are edge(0), edge(1), ...
  template <class Edge>
  CALLIGRAPHY_INLINE void walk(Edge&& edge) {
    V bending{};
    Vector before = clamp_, way = root_displacement_;
    typename Base::NodeSums sums;
    sums.lowest = root_position_.z;
    if constexpr (Potential::kPresent) potential_.beginPass();
    for (int i = 0; i < n_ - 1; ++i) {
      const Vector e = edge(i);
      const V s = squaredNorm(e - before) * inverse_length_squared_;
      bending = bending + load<V>(spring_ + i * kLanes) * bendingTerms(s, law_).value;
      way = way + (e - Vector::loadFrom(edge_ + i * kVector));
      toScratch(Base::addNode(i + 1, way, sums), gradient_ + (i + 1) * kScratchVector);
      before = e;
    }
    Base::energy_ = bending * length_ * length_ + real(0.5) * sums.twice_inertia + sums.potential;
    Base::lowest_ = sums.lowest;
  }

  // Rows of an edge in factor_, see RodBatchWorkspace. Where the sweep is done with a row it puts a gain
  // there.
  static constexpr int kRow = Base::kWidth;
  static constexpr int kBasis = kRodFactorBasis * kRow;
  static constexpr int kCoupling =
      kRodFactorCoupling * kRow;  // C of the edge and the one before it, then U
  static constexpr int kOwnGradient = kRodFactorStep * kRow;  // q, then k
  static constexpr int kOwnHessian = kRodFactorGain * kRow;   // Q, 3, then X
  static constexpr int kGain = kOwnHessian;
  static constexpr int kFactor = kRodFactorRows * kRow;

  /// Riccati sweep from tip to root: gains of every edge into factor_, and gᵀH⁻¹g into `decrement`.
  /// `majorant` blends the Hessian (0) with a positive definite one above it (1). Returns the lanes
  /// with a bad pivot.
  ///
  /// In two passes, so that neither needs many more registers than there are: what the edges give each
  /// by itself, and then the recursion. Within them the order of the lines keeps few values alive.
  Mask sweep(V majorant, V& decrement) {
    writeJoints(majorant);

    const V weight = inertia_, zero{}, one = real(1);
    const V least_pivot = real(8) * broadcast<V>(std::numeric_limits<Real>::epsilon());
    Mask failed = zero > one;
    V spent{};

    // Cost to go from the far end of an edge, ½(δx,u)ᵀ[[S,R],[Rᵀ,Q]](δx,u) + p·δx + q·u, without what
    // the edge itself adds to Q and q.
    Symmetric3<V> S{};
    Vector R0{}, R1{}, p{};
    V Q00{}, Q01{}, Q11{}, q0{}, q1{};
    for (int i = n_ - 2;; --i) {
      const V w = weight * load<V>(mass_ + (i + 1) * kLanes);
      S.xx = S.xx + w;
      S.yy = S.yy + w;
      S.zz = S.zz + w;
      if constexpr (Potential::kPresent) potential_.addHessian(i + 1, S);
      p = p + fromScratch(gradient_ + (i + 1) * kScratchVector);

      Real* row = factor_ + i * kFactor;
      const Vector P0 = fromScratch(row + kBasis);
      const Vector W0 = S * P0 + R0;
      const V H00 = Q00 + load<V>(row + kOwnHessian) + dot(P0, W0 + R0);
      const V g0 = q0 + load<V>(row + kOwnGradient) + dot(P0, p);
      const Vector P1 = fromScratch(row + kBasis + 3 * kRow);
      V H01 = Q01 + load<V>(row + kOwnHessian + kRow) + dot(P1, R0);
      const Vector W1 = S * P1 + R1;
      const V H11 = Q11 + load<V>(row + kOwnHessian + 2 * kRow) + dot(P1, W1 + R1);
      H01 = H01 + dot(P0, W1);
      const V g1 = q1 + load<V>(row + kOwnGradient + kRow) + dot(P1, p);

      const V determinant = H00 * H11 - H01 * H01;
      const Mask good = (H00 > zero) & (determinant > least_pivot * (H00 * H11));
      failed = failed | !good;
      const V inverse = select(good, one / determinant, zero);
      const V I00 = H11 * inverse, I01 = -H01 * inverse, I11 = H00 * inverse;

      const V k0 = I00 * g0 + I01 * g1, k1 = I01 * g0 + I11 * g1;
      spent = spent + g0 * k0 + g1 * k1;
      store<V>(row + kOwnGradient, k0);
      store<V>(row + kOwnGradient + kRow, k1);
      const Vector X0 = I00 * W0 + I01 * W1;
      toScratch(X0, row + kGain);
      const Vector X1 = I01 * W0 + I11 * W1;
      toScratch(X1, row + kGain + 3 * kRow);
      if (i == 0) break;

      S.xx = S.xx - W0.x * X0.x - W1.x * X1.x;
      S.xy = S.xy - W0.x * X0.y - W1.x * X1.y;
      S.xz = S.xz - W0.x * X0.z - W1.x * X1.z;
      S.yy = S.yy - W0.y * X0.y - W1.y * X1.y;
      S.yz = S.yz - W0.y * X0.z - W1.y * X1.z;
      S.zz = S.zz - W0.z * X0.z - W1.z * X1.z;
      p = p - k0 * W0 - k1 * W1;

      const V C00 = load<V>(row + kCoupling), C10 = load<V>(row + kCoupling + 2 * kRow);
      const V U00 = I00 * C00 + I01 * C10, U10 = I01 * C00 + I11 * C10;
      R0 = (-U00) * W0 - U10 * W1;
      Q00 = -(C00 * U00 + C10 * U10);
      q0 = -(C00 * k0 + C10 * k1);
      const V C01 = load<V>(row + kCoupling + kRow), C11 = load<V>(row + kCoupling + 3 * kRow);
      const V U01 = I00 * C01 + I01 * C11, U11 = I01 * C01 + I11 * C11;
      R1 = (-U01) * W0 - U11 * W1;
      Q01 = -(C00 * U01 + C10 * U11);
      Q11 = -(C01 * U01 + C11 * U11);
      q1 = -(C01 * k0 + C11 * k1);
      store<V>(row + kCoupling, U00);
      store<V>(row + kCoupling + kRow, U01);
      store<V>(row + kCoupling + 2 * kRow, U10);
      store<V>(row + kCoupling + 3 * kRow, U11);
    }
    decrement = spent;
    return failed;
  }

  /// First pass of the sweep: for every edge its basis P, the gradient q and the Hessian Q of its two
  /// joints by its own turn, and the coupling C with the edge before it, into factor_.
  void writeJoints(V majorant) {
    const V zero{}, one = real(1), two = real(2), half = real(0.5), four = real(4);
    const V lenient = one - majorant;
    Vector force{};                     // gradient of Φ by a shift of all nodes beyond the edge
    V Q00{}, Q01{}, Q11{}, q0{}, q1{};  // of the joint at the far end of the edge
    Vector e = fromScratch(trial_ + (n_ - 2) * kScratchVector);
    Vector P0, P1;
    orthonormalBasis(inverse_length_ * e, P0, P1);
    for (int i = n_ - 2;; --i) {
      Real* row = factor_ + i * kFactor;
      toScratch(P0, row + kBasis);
      toScratch(P1, row + kBasis + 3 * kRow);
      const Vector before = i > 0 ? fromScratch(trial_ + (i - 1) * kScratchVector) : clamp_;
      const V s = squaredNorm(e - before) * inverse_length_squared_;
      const BendingTerms<V> law = bendingTerms(s, law_);
      const V k = load<V>(spring_ + i * kLanes);
      const V A = two * k * law.first;
      const V B = four * k * law.second * inverse_length_squared_;
      const V curvature = A * (one - lenient * (half * s));

      // Turning e shortens the way of everything beyond it.
      force = force + fromScratch(gradient_ + (i + 1) * kScratchVector);
      V geometric = -dot(e, force) * inverse_length_squared_;
      geometric = select(geometric < zero, lenient * geometric, geometric);
      const V diagonal = curvature + geometric;

      const V a0 = dot(P0, before), a1 = dot(P1, before);
      const V Ba0 = B * a0, Ba1 = B * a1;
      store<V>(row + kOwnHessian, Q00 + diagonal + Ba0 * a0);
      store<V>(row + kOwnHessian + kRow, Q01 + Ba0 * a1);
      store<V>(row + kOwnHessian + 2 * kRow, Q11 + diagonal + Ba1 * a1);
      store<V>(row + kOwnGradient, q0 - A * a0);
      store<V>(row + kOwnGradient + kRow, q1 - A * a1);
      if (i == 0) break;

      Vector N0, N1;
      orthonormalBasis(inverse_length_ * before, N0, N1);
      const V b0 = dot(N0, e), b1 = dot(N1, e);
      store<V>(row + kCoupling, Ba0 * b0 - A * dot(P0, N0));
      store<V>(row + kCoupling + kRow, Ba0 * b1 - A * dot(P0, N1));
      store<V>(row + kCoupling + 2 * kRow, Ba1 * b0 - A * dot(P1, N0));
      store<V>(row + kCoupling + 3 * kRow, Ba1 * b1 - A * dot(P1, N1));
      const V Bb0 = B * b0, Bb1 = B * b1;
      Q00 = curvature + Bb0 * b0;
      Q01 = Bb0 * b1;
      Q11 = curvature + Bb1 * b1;
      q0 = -A * b0;
      q1 = -A * b1;
      e = before;
      P0 = N0;
      P1 = N1;
    }
  }

  /// Edge i of trial_ after a turn that moves its end by scale · turn, into next_; the edge itself, to
  /// the bit, where scale is 0. It is measured, since |e|² + |scale · turn|² would add up errors of the
  /// length where turns are large.
  CALLIGRAPHY_INLINE Vector turned(int i, const Vector& turn, V scale) const {
    const Vector e = fromScratch(trial_ + i * kScratchVector);
    const Vector moved = e + scale * turn;
    const Vector result = select(scale == V{}, e, (length_ / sqrt(squaredNorm(moved))) * moved);
    toScratch(result, next_ + i * kScratchVector);
    return result;
  }
  CALLIGRAPHY_INLINE Vector turnOf(int i, V u0, V u1) const {
    const Real* row = factor_ + i * kFactor;
    return u0 * fromScratch(row + kBasis) + u1 * fromScratch(row + kBasis + 3 * kRow);
  }

  /// Root to tip: the edges after the Newton update, times scale, into next_. Returns the largest turn
  /// of an edge by the whole update [rad].
  CALLIGRAPHY_INLINE V solveForUpdate(V scale) {
    Vector shift{};
    V u0{}, u1{}, largest_squared{};
    walk([&](int i) {
      const Real* in = factor_ + i * kFactor;
      V v0 = -load<V>(in + kOwnGradient), v1 = -load<V>(in + kOwnGradient + kRow);
      if (i > 0) {
        v0 = v0 - load<V>(in + kCoupling) * u0 - load<V>(in + kCoupling + kRow) * u1;
        v1 = v1 - load<V>(in + kCoupling + 2 * kRow) * u0 - load<V>(in + kCoupling + 3 * kRow) * u1;
      }
      // The shift last, since it is known last.
      u0 = v0 - dot(fromScratch(in + kGain), shift);
      u1 = v1 - dot(fromScratch(in + kGain + 3 * kRow), shift);
      const Vector turn = turnOf(i, u0, u1);
      shift = shift + turn;
      largest_squared = max(largest_squared, u0 * u0 + u1 * u1);
      return turned(i, turn, scale);
    });
    return sqrt(largest_squared) * inverse_length_;
  }

  /// As solveForUpdate, with a turn by kNudge at the root, less and less towards the tip.
  void nudge(V scale) {
    walk([&](int i) {
      return turned(i, turnOf(i, real(kNudge * (n_ - 1 - i) / (n_ - 1)) * length_, V{}), scale);
    });
  }

  void addUp(V present, const CommonPlaces<Real>& places, int lane, Real* sums) const {
    const auto jointOf = [&](int i, const Vector& e, const Vector& before) {
      const V s = squaredNorm(e - before) * inverse_length_squared_;
      return real(2) * load<V>(spring_ + i * kLanes) * bendingTerms(s, law_).first;
    };
    const V joint_scale = load<V>(places.joint.data() + lane);
    // A node's numbers go to the places around it, by the part that it has of their shifts.
    const auto give = [&](int node, const Vector& gradient, const Vector& e, V joint, V taut) {
      Symmetric3<V> touched{};
      if constexpr (Potential::kTied) potential_.addBaseHessian(node, touched);
      const V mass = inertia_ * load<V>(mass_ + node * kLanes);
      const auto at = static_cast<std::size_t>(node);
      for (int to = places.first[at]; to <= places.last[at]; ++to) {
        const V part = present * partOfPlace<V>(places, node, to, lane);
        Real* out = sums + to * kCommonRows * kRow;
        const auto add = [&](int row, V value) {
          store<V>(out + row * kRow, load<V>(out + row * kRow) + part * value);
        };
        const auto addVector = [&](int row, const Vector& v) {
          add(row, v.x);
          add(row + 1, v.y);
          add(row + 2, v.z);
        };
        addVector(kCommonGradient, gradient);
        addVector(kCommonEdge, e);
        add(kCommonBend, joint_scale * joint);
        add(kCommonTurn, taut);
        // Alike in all directions of the sheet, however the axes lie.
        const V level = broadcast<V>(Real(0.5)) * (touched.xx + touched.yy);
        addVector(kCommonContact, Vector{level, level, touched.zz});
        add(kCommonMass, mass);
      }
    };
    // What turns an edge is all that pulls beyond it, but for what its length takes, and its joints. A
    // node is given what its two edges differ by: nothing where the rod is at rest, however it pulls.
    Vector pull{}, turn_after{}, after{};
    V joint_after{};
    for (int i = n_ - 2; i >= 0; --i) {
      const Vector e = fromScratch(trial_ + i * kScratchVector);
      const Vector before = i > 0 ? fromScratch(trial_ + (i - 1) * kScratchVector) : clamp_;
      const V joint = jointOf(i, e, before);
      pull = pull + fromScratch(gradient_ + (i + 1) * kScratchVector);
      Vector turn = pull - joint * before - joint_after * after;
      turn = turn - (dot(turn, e) * inverse_length_squared_) * e;
      const V taut = max(V{}, -dot(pull, e) * inverse_length_squared_);
      give(i + 1, turn - turn_after, e, joint, taut);
      turn_after = turn;
      after = e;
      joint_after = joint;
    }
  }

  void finish(const double* pivot, Real* wrench) {
    Base::moveState([this](int i) { return fromScratch(trial_ + i * kScratchVector); }, pivot, wrench);
  }

  const Real* spring_;
  const Real* guess_;
  Real* factor_;
  V law_;  // p of bendingTerms
  V inverse_length_, inverse_length_squared_;
  Vector clamp_;
};

}  // namespace calligraphy_brush
