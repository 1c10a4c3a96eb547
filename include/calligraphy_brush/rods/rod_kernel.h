#pragma once

#include "calligraphy_brush/rods/bending_law.h"
#include "calligraphy_brush/rods/newton_step.h"
#include "calligraphy_brush/rods/rod_batch.h"
#include "calligraphy_brush/rods/time_integration.h"

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
  using Base::energy_, Base::kNudge, Base::kVector, Base::next_, Base::potential_, Base::real,
      Base::trial_;

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

 private:
  RodKernel(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
            const StepCoefficientsOf<V>& step, double law, double gravity, int lane,
            Potential& potential, RodBatchWorkspace<Real>& workspace, RodBatchState<Real>& state)
      : Base(potential, model.rod_count - lane, workspace.trial_edge.data() + lane,
             workspace.next_edge.data() + lane),
        n_(model.node_count),
        spring_(model.spring.data() + lane),
        mass_(model.mass.data() + lane),
        edge_(state.edge.data() + lane),
        position_(state.position.data() + lane),
        displacement_(state.displacement.data() + lane),
        velocity_(state.velocity.data() + lane),
        previous_velocity_(state.previous_velocity.data() + lane),
        guess_(state.guess.empty() ? nullptr : state.guess.data() + lane),
        target_(workspace.target.data() + lane),
        gradient_(workspace.gradient.data() + lane),
        update_(workspace.update.data() + lane),
        factor_(workspace.factor.data() + lane),
        step_(step),
        gravity_(gravity),
        law_(real(law)),
        length_(load<V>(model.edge_length.data() + lane)),
        inverse_length_(real(1) / length_),
        inverse_length_squared_(inverse_length_ * inverse_length_),
        root_position_(Vector::loadFrom(roots.position.data() + lane)),
        root_displacement_(Vector::loadFrom(roots.displacement.data() + lane)),
        clamp_(Vector::loadFrom(roots.clamp.data() + lane)) {}

  static constexpr int kFactor = 18 * kLanes;

  /// Fills target_, and guesses the shape at the end of the step: edges go on turning as they did.
  void predict() {
    const V k_displacement = step_.displacement, k_velocity = step_.velocity,
            k_previous = step_.previous_velocity, fall = step_.gravity * real(-gravity_);
    const auto target = [&](int node, const Vector& d) {
      const Vector v = Vector::loadFrom(velocity_ + node * kVector);
      const Vector v_previous = Vector::loadFrom(previous_velocity_ + node * kVector);
      Vector y = k_displacement * d + k_velocity * v + k_previous * v_previous;
      y.z = y.z + fall;
      y.storeTo(target_ + node * kVector);
    };
    Vector before = Vector::loadFrom(displacement_);
    target(0, before);
    // A guess for a smooth motion; after a jump the old shape is better.
    const V limit = real(0.04) * length_ * length_;
    walk([&](int i) {
      const Vector d = Vector::loadFrom(displacement_ + (i + 1) * kVector);
      target(i + 1, d);
      if (guess_) {
        const Vector known = Vector::loadFrom(guess_ + i * kVector);
        known.storeTo(trial_ + i * kVector);
        return known;
      }
      const Vector turn = d - before;
      before = d;
      const Vector e = Vector::loadFrom(edge_ + i * kVector);
      const Vector guess = e + turn;
      const Vector scaled = (length_ / sqrt(squaredNorm(guess))) * guess;
      const Vector result = select(squaredNorm(turn) < limit, scaled, e);
      result.storeTo(trial_ + i * kVector);
      return result;
    });
  }

  /// Φ and its gradient by node positions, at trial_.
  void evaluate() {
    walk([this](int i) { return Vector::loadFrom(trial_ + i * kVector); });
  }

  /// Φ and its gradient along the rod whose edges are edge(0), edge(1), ...
  template <class Edge>
  CALLIGRAPHY_INLINE void walk(Edge&& edge) {
    const V weight = step_.inertia, half = real(0.5);
    V bending{}, inertia{}, contact{};
    Vector before = clamp_, way = root_displacement_;
    if constexpr (Potential::kPresent) potential_.beginPass();
    for (int i = 0; i < n_ - 1; ++i) {
      const Vector e = edge(i);
      const V s = squaredNorm(e - before) * inverse_length_squared_;
      bending = bending + load<V>(spring_ + i * kLanes) * bendingTerms(s, law_).value;
      way = way + (e - Vector::loadFrom(edge_ + i * kVector));
      const Vector off = way - Vector::loadFrom(target_ + (i + 1) * kVector);
      const V w = weight * load<V>(mass_ + (i + 1) * kLanes);
      Vector gradient = w * off;
      inertia = inertia + half * w * squaredNorm(off);
      if constexpr (Potential::kPresent) contact = contact + potential_.add(i + 1, way, gradient);
      gradient.storeTo(gradient_ + (i + 1) * kVector);
      before = e;
    }
    energy_ = bending * length_ * length_ + inertia + contact;
  }

  /// Unit vectors that span the plane perpendicular to unit t.
  /// Source: Duff et al. 2017, Building an Orthonormal Basis, Revisited, listing 3.
  static CALLIGRAPHY_INLINE void basis(const Vector& t, Vector& p0, Vector& p1) {
    const V sign = select(t.z < V{}, real(-1), real(1));
    const V a = real(-1) / (sign + t.z);
    const V xa = t.x * a;
    const V b = xa * t.y;
    p0 = {real(1) + sign * t.x * xa, sign * b, -sign * t.x};
    p1 = {b, sign + t.y * t.y * a, -t.y};
  }

  // Rows of an edge in factor_. Where the sweep is done with a row it puts a gain there.
  static constexpr int kBasis = 0;  // P, 6
  static constexpr int kCoupling =
      6 * kLanes;  // C of the edge and the one before it, then its gain U, 4
  static constexpr int kOwnGradient = 10 * kLanes;  // q, then the gain k, 2
  static constexpr int kOwnHessian = 12 * kLanes;   // Q, 3
  static constexpr int kGain = kOwnHessian;         // X, 6

  /// Riccati sweep from tip to root: gains of every edge into factor_, and gᵀH⁻¹g into `decrement`.
  /// `majorant` blends the Hessian (0) with a positive definite one above it (1). Returns the lanes
  /// with a bad pivot.
  ///
  /// In two passes, so that neither needs many more registers than there are: what the edges give each
  /// by itself, and then the recursion. Within them the order of the lines keeps few values alive.
  Mask sweep(V majorant, V& decrement) {
    writeJoints(majorant);

    const V weight = step_.inertia, zero{}, one = real(1);
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
      p = p + Vector::loadFrom(gradient_ + (i + 1) * kVector);

      Real* row = factor_ + i * kFactor;
      const Vector P0 = Vector::loadFrom(row + kBasis);
      const Vector W0 = S * P0 + R0;
      const V H00 = Q00 + load<V>(row + kOwnHessian) + dot(P0, W0 + R0);
      const V g0 = q0 + load<V>(row + kOwnGradient) + dot(P0, p);
      const Vector P1 = Vector::loadFrom(row + kBasis + 3 * kLanes);
      V H01 = Q01 + load<V>(row + kOwnHessian + kLanes) + dot(P1, R0);
      const Vector W1 = S * P1 + R1;
      const V H11 = Q11 + load<V>(row + kOwnHessian + 2 * kLanes) + dot(P1, W1 + R1);
      H01 = H01 + dot(P0, W1);
      const V g1 = q1 + load<V>(row + kOwnGradient + kLanes) + dot(P1, p);

      const V determinant = H00 * H11 - H01 * H01;
      const Mask good = (H00 > zero) & (determinant > least_pivot * (H00 * H11));
      failed = failed | !good;
      const V inverse = select(good, one / determinant, zero);
      const V I00 = H11 * inverse, I01 = -H01 * inverse, I11 = H00 * inverse;

      const V k0 = I00 * g0 + I01 * g1, k1 = I01 * g0 + I11 * g1;
      spent = spent + g0 * k0 + g1 * k1;
      store<V>(row + kOwnGradient, k0);
      store<V>(row + kOwnGradient + kLanes, k1);
      const Vector X0 = I00 * W0 + I01 * W1;
      X0.storeTo(row + kGain);
      const Vector X1 = I01 * W0 + I11 * W1;
      X1.storeTo(row + kGain + 3 * kLanes);
      if (i == 0) break;

      S.xx = S.xx - W0.x * X0.x - W1.x * X1.x;
      S.xy = S.xy - W0.x * X0.y - W1.x * X1.y;
      S.xz = S.xz - W0.x * X0.z - W1.x * X1.z;
      S.yy = S.yy - W0.y * X0.y - W1.y * X1.y;
      S.yz = S.yz - W0.y * X0.z - W1.y * X1.z;
      S.zz = S.zz - W0.z * X0.z - W1.z * X1.z;
      p = p - k0 * W0 - k1 * W1;

      const V C00 = load<V>(row + kCoupling), C10 = load<V>(row + kCoupling + 2 * kLanes);
      const V U00 = I00 * C00 + I01 * C10, U10 = I01 * C00 + I11 * C10;
      R0 = (-U00) * W0 - U10 * W1;
      Q00 = -(C00 * U00 + C10 * U10);
      q0 = -(C00 * k0 + C10 * k1);
      const V C01 = load<V>(row + kCoupling + kLanes), C11 = load<V>(row + kCoupling + 3 * kLanes);
      const V U01 = I00 * C01 + I01 * C11, U11 = I01 * C01 + I11 * C11;
      R1 = (-U01) * W0 - U11 * W1;
      Q01 = -(C00 * U01 + C10 * U11);
      Q11 = -(C01 * U01 + C11 * U11);
      q1 = -(C01 * k0 + C11 * k1);
      store<V>(row + kCoupling, U00);
      store<V>(row + kCoupling + kLanes, U01);
      store<V>(row + kCoupling + 2 * kLanes, U10);
      store<V>(row + kCoupling + 3 * kLanes, U11);
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
    Vector e = Vector::loadFrom(trial_ + (n_ - 2) * kVector);
    Vector P0, P1;
    basis(inverse_length_ * e, P0, P1);
    for (int i = n_ - 2;; --i) {
      Real* row = factor_ + i * kFactor;
      P0.storeTo(row + kBasis);
      P1.storeTo(row + kBasis + 3 * kLanes);
      const Vector before = i > 0 ? Vector::loadFrom(trial_ + (i - 1) * kVector) : clamp_;
      const V s = squaredNorm(e - before) * inverse_length_squared_;
      const BendingTerms<V> law = bendingTerms(s, law_);
      const V k = load<V>(spring_ + i * kLanes);
      const V A = two * k * law.first;
      const V B = four * k * law.second * inverse_length_squared_;
      const V curvature = A * (one - lenient * (half * s));

      // Turning e shortens the way of everything beyond it.
      force = force + Vector::loadFrom(gradient_ + (i + 1) * kVector);
      V geometric = -dot(e, force) * inverse_length_squared_;
      geometric = select(geometric < zero, lenient * geometric, geometric);
      const V diagonal = curvature + geometric;

      const V a0 = dot(P0, before), a1 = dot(P1, before);
      const V Ba0 = B * a0, Ba1 = B * a1;
      store<V>(row + kOwnHessian, Q00 + diagonal + Ba0 * a0);
      store<V>(row + kOwnHessian + kLanes, Q01 + Ba0 * a1);
      store<V>(row + kOwnHessian + 2 * kLanes, Q11 + diagonal + Ba1 * a1);
      store<V>(row + kOwnGradient, q0 - A * a0);
      store<V>(row + kOwnGradient + kLanes, q1 - A * a1);
      if (i == 0) break;

      Vector N0, N1;
      basis(inverse_length_ * before, N0, N1);
      const V b0 = dot(N0, e), b1 = dot(N1, e);
      store<V>(row + kCoupling, Ba0 * b0 - A * dot(P0, N0));
      store<V>(row + kCoupling + kLanes, Ba0 * b1 - A * dot(P0, N1));
      store<V>(row + kCoupling + 2 * kLanes, Ba1 * b0 - A * dot(P1, N0));
      store<V>(row + kCoupling + 3 * kLanes, Ba1 * b1 - A * dot(P1, N1));
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

  /// Edge i of trial_ after a turn that moves its end by scale · turn; the edge itself, to the bit,
  /// where scale is 0.
  CALLIGRAPHY_INLINE Vector turned(int i, const Vector& turn, V scale) const {
    const Vector e = Vector::loadFrom(trial_ + i * kVector);
    const Vector moved = e + scale * turn;
    const Vector result = select(scale == V{}, e, (length_ / sqrt(squaredNorm(moved))) * moved);
    result.storeTo(next_ + i * kVector);
    return result;
  }
  CALLIGRAPHY_INLINE Vector turnOf(int i, V u0, V u1) const {
    const Real* row = factor_ + i * kFactor;
    return u0 * Vector::loadFrom(row + kBasis) + u1 * Vector::loadFrom(row + kBasis + 3 * kLanes);
  }

  /// Root to tip: the Newton update into update_, and the edges after it, times scale, into next_.
  /// Returns the largest turn of an edge [rad].
  CALLIGRAPHY_INLINE V solveForUpdate(V scale) {
    Vector shift{};
    V u0{}, u1{}, largest_squared{};
    walk([&](int i) {
      const Real* in = factor_ + i * kFactor;
      V v0 = -load<V>(in + kOwnGradient) - dot(Vector::loadFrom(in + kGain), shift);
      V v1 =
          -load<V>(in + kOwnGradient + kLanes) - dot(Vector::loadFrom(in + kGain + 3 * kLanes), shift);
      if (i > 0) {
        v0 = v0 - load<V>(in + kCoupling) * u0 - load<V>(in + kCoupling + kLanes) * u1;
        v1 = v1 - load<V>(in + kCoupling + 2 * kLanes) * u0 - load<V>(in + kCoupling + 3 * kLanes) * u1;
      }
      u0 = v0;
      u1 = v1;
      store<V>(update_ + i * 2 * kLanes, u0);
      store<V>(update_ + i * 2 * kLanes + kLanes, u1);
      const Vector turn = turnOf(i, u0, u1);
      shift = shift + turn;
      largest_squared = max(largest_squared, u0 * u0 + u1 * u1);
      return turned(i, turn, scale);
    });
    return sqrt(largest_squared) * inverse_length_;
  }

  /// The update in update_ once more, with another scale.
  void retryUpdate(V scale) {
    walk([&](int i) {
      const Real* u = update_ + i * 2 * kLanes;
      return turned(i, turnOf(i, load<V>(u), load<V>(u + kLanes)), scale);
    });
  }

  /// A turn by kNudge at the root, less and less towards the tip.
  void writeNudge() {
    for (int i = 0; i < n_ - 1; ++i) {
      store<V>(update_ + i * 2 * kLanes, real(kNudge * (n_ - 1 - i) / (n_ - 1)) * length_);
      store<V>(update_ + i * 2 * kLanes + kLanes, V{});
    }
  }

  V lowestHeight() const {
    V height = root_position_.z, lowest = height;
    for (int i = 0; i < n_ - 1; ++i) {
      height = height + load<V>(trial_ + i * kVector + 2 * kLanes);
      lowest = min(lowest, height);
    }
    return lowest;
  }

  /// Moves the state to the end of the step.
  void finish(const double* pivot, Real* wrench) {
    if constexpr (Potential::kPresent) potential_.finish();
    const V from_way = step_.from_way, from_displacement = step_.from_displacement,
            from_velocity = step_.from_velocity;
    const Mask restart = step_.restart > V{};
    const V root_weight = step_.inertia * load<V>(mass_);
    Vector root_gradient = root_weight * (root_displacement_ - Vector::loadFrom(target_));
    if constexpr (Potential::kActsOnRoot) potential_.addToRoot(root_displacement_, root_gradient);
    root_gradient.storeTo(gradient_);
    Vector force{}, torque{};
    const Vector centre = wrench ? Vector{real(pivot[0]), real(pivot[1]), real(pivot[2])} : Vector{};
    Vector way = root_displacement_, position = root_position_;
    for (int node = 0; node < n_; ++node) {
      if (node > 0) {
        const Vector e = Vector::loadFrom(trial_ + (node - 1) * kVector);
        Real* old = edge_ + (node - 1) * kVector;
        way = way + (e - Vector::loadFrom(old));
        position = position + e;
        e.storeTo(old);
      }
      const int at = node * kVector;
      const Vector old_velocity = Vector::loadFrom(velocity_ + at);
      const Vector velocity =
          from_way * way +
          (from_displacement * Vector::loadFrom(displacement_ + at) + from_velocity * old_velocity);
      velocity.storeTo(velocity_ + at);
      select(restart, velocity, old_velocity).storeTo(previous_velocity_ + at);
      way.storeTo(displacement_ + at);
      position.storeTo(position_ + at);
      if (wrench) {
        const Vector gradient = Vector::loadFrom(gradient_ + at);
        force = force - gradient;
        torque = torque - cross(position - centre, gradient);
      }
    }
    if (wrench) {
      force.storeTo(wrench);
      torque.storeTo(wrench + kVector);
    }
  }

  int n_;
  const Real *spring_, *mass_;
  Real *edge_, *position_, *displacement_, *velocity_, *previous_velocity_;
  const Real* guess_;
  Real *target_, *gradient_, *update_, *factor_;
  const StepCoefficientsOf<V>& step_;
  double gravity_;
  V law_;  // p of bendingTerms
  V length_, inverse_length_, inverse_length_squared_;
  Vector root_position_, root_displacement_, clamp_;
};

}  // namespace calligraphy_brush
