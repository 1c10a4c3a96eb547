#pragma once

#include <limits>

#include "calligraphy_brush/common/lanes.h"
#include "calligraphy_brush/rods/rod_batch.h"
#include "calligraphy_brush/rods/time_integration.h"

namespace calligraphy_brush {

/// How hard a step is solved.
struct SolverSettings {
  double tolerance;            ///< error of an edge's direction [rad] at which a rod is done
  int max_iterations;          ///< Newton iterations of a rod in a step
  double contact_tolerance;    ///< residual of a contact [m] at which its multipliers are done
  int max_multiplier_updates;  ///< solves with better multipliers in a step; 1: once
};

/// What a solve did, over the rods of a batch.
struct SolveReport {
  int iterations = 0;       ///< summed over rods
  int most_iterations = 0;  ///< of one rod
  int unconverged = 0;      ///< rods whose step is not within the tolerances
  bool refused = false;     ///< the potential's floor was crossed; the state is as it was
};

/// A potential that sees single nodes, such as the sheet, has kPresent = true and
///
///   void beginPass();                               before the nodes of a rod are visited
///   V add(int node, const Vec3<V>& way, Vec3<V>& gradient);
///       its energy [J] where the node has moved by `way` since the step began; adds its gradient
///       [N] and remembers what addHessian needs
///   void addHessian(int node, Symmetric3<V>& hessian);   [N/m]
///   MaskOf<V> pieceChanged();    whether the last pass over the nodes was on another piece of the
///                                potential (touching or not, sticking or sliding) than the one before
///   MaskOf<V> absent();          lanes in which it was zero, all along the rod, in the last pass
///   void begin();                before the first pass of a step
///   MaskOf<V> admit(V lowest);   rods that were solved without it and must be solved with it, since
///                                their lowest node ended at this height [m]
///   MaskOf<V> update(double tolerance, MaskOf<V> lanes);   finds better multipliers after a solve; the
///                                lanes whose residual was above `tolerance` [m]
///   void adopt(MaskOf<V> lanes);                    these solve again, with their better multipliers
///   void finish();                                  the step has ended
///   static constexpr bool kHasFloor;                whether it is one for rods above a floor, as below
///
///   static constexpr bool kTied;                    whether it ties the rod to others: it has
///                                                   addToRoot(way, gradient), what the clamp has to
///                                                   hold besides, and addBaseHessian(node, hessian),
///                                                   which leaves the ties out
///
/// A lane that does not solve again keeps the multipliers that its last solve felt until the step has
/// ended, so that rounds of its neighbours change nothing of it, not even the forces it reports.
///
/// NoPotential is the absence of one, for rods above `floor` [m]. A step that would take a node
/// below it is not taken at all, so that leaving out what is there never changes a result; `below`
/// receives a 1 for every lane that would go there, else 0.
template <class Real>
struct NoPotential {
  static constexpr bool kPresent = false;
  static constexpr bool kHasFloor = true;
  static constexpr bool kTied = false;
  double floor;
  Real* below;
};

/// The part of an implicit step that does not ask what a rod is: inertia, Newton's method with an
/// energy line search, lane by lane, and the rounds of better multipliers around it.
///
/// A kernel K derives from NewtonStep<K, V, Potential> and has
///
///   void predict();           sets trial_, a guess of the shape, and evaluates there
///   void evaluate();          energy_, lowest_ and the gradient at trial_
///   Mask sweep(V majorant, V& decrement);
///       factors the Newton system; majorant blends its matrix (0) with a positive definite one above
///       it (1). Gives gᵀH⁻¹g and the lanes where the matrix was not positive definite
///   V solveForUpdate(V scale);  next_ = trial_ + scale · Newton's update, evaluated; trial_ itself, to
///                               the bit, where scale is 0. Returns the largest turn of an edge [rad]
///   void nudge(V scale);        the same with a small update to one side
///   static constexpr bool kConstrained;   whether it has constraints with multipliers of its own, and
///   Mask updateConstraints(double tolerance, Mask lanes);   as Potential::update, and
///   void adoptConstraints(Mask lanes);                      as Potential::adopt
///   void restoreConstraints();                              to what they were before the step
///   void finish(const double* pivot, Real* wrench);   moves the state to the end of the step
///
/// A lane that is done is no longer changed, so what a rod does never depends on its neighbours.
template <class Kernel, class V, class Potential>
class NewtonStep {
 public:
  using Real = RealOf<V>;
  using Mask = MaskOf<V>;
  using Vector = Vec3<V>;
  static constexpr int kWidth = widthOf<V>;

 protected:
  NewtonStep(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
             const StepCoefficientsOf<V>& step, double gravity, int lane, Potential& potential,
             RodBatchWorkspace<Real>& workspace, RodBatchState<Real>& state, Real* trial, Real* next)
      : n_(model.node_count),
        potential_(potential),
        trial_(trial),
        next_(next),
        mass_(model.mass.data() + lane),
        edge_(state.edge.data() + lane),
        position_(state.position.data() + lane),
        target_(workspace.target.data()),
        gradient_(workspace.gradient.data()),
        length_(load<V>(model.edge_length.data() + lane)),
        inertia_(step.inertia),
        root_position_(Vector::loadFrom(roots.position.data() + lane)),
        root_displacement_(Vector::loadFrom(roots.displacement.data() + lane)),
        rods_here_(model.rod_count - lane),
        displacement_(state.displacement.data() + lane),
        velocity_(state.velocity.data() + lane),
        previous_velocity_(state.previous_velocity.data() + lane),
        lowest_address_(state.lowest.data() + lane),
        step_(step),
        gravity_(gravity) {}

  static CALLIGRAPHY_INLINE V real(double value) { return broadcast<V>(static_cast<Real>(value)); }
  static constexpr int kVector = 3 * kLanes;         // distance of two nodes in a vector field
  static constexpr int kScratchVector = 3 * kWidth;  // the same in the workspace
  static constexpr double kNudge = 1e-3;             // turn of the first edge off a ridge [rad]

  static CALLIGRAPHY_INLINE Vector fromScratch(const Real* address) {
    return Vector::template loadFrom<kWidth>(address);
  }
  static CALLIGRAPHY_INLINE void toScratch(const Vector& vector, Real* address) {
    vector.template storeTo<kWidth>(address);
  }

  SolveReport run(const SolverSettings& settings, const double* pivot, Real* wrench) {
    SolveReport report;
    self().predict();
    const V one = real(1);
    const Mask nobody = V{} > one;
    V iterations{};
    Mask wanted = !nobody, converged = nobody;
    for (int round = 0; round < settings.max_multiplier_updates; ++round) {
      converged = select(wanted, newton(settings, wanted, iterations), converged);
      if constexpr (Potential::kPresent)
        if (round == 0 && any(potential_.admit(lowest_))) {
          potential_.begin();
          self().predict();
          iterations = V{};
          converged = newton(settings, wanted, iterations);
        }
      Mask open = nobody;
      if constexpr (Potential::kPresent) open = potential_.update(settings.contact_tolerance, wanted);
      if constexpr (Kernel::kConstrained)
        open = open | self().updateConstraints(settings.contact_tolerance, wanted);
      wanted = wanted & open;
      // The last solve stands, with the forces that it felt.
      if (!any(wanted) || round + 1 == settings.max_multiplier_updates) break;
      if constexpr (Potential::kPresent) potential_.adopt(wanted);
      if constexpr (Kernel::kConstrained) self().adoptConstraints(wanted);
      self().evaluate();
    }
    if constexpr (Potential::kHasFloor) {
      const Mask below = lowest_ < real(potential_.floor);
      report.refused = any(below);
      if (report.refused) {
        store<V>(potential_.below, select(below, one, V{}));
        if constexpr (Kernel::kConstrained) self().restoreConstraints();
        return report;
      }
    }
    self().finish(pivot, wrench);

    alignas(64) Real counts[kWidth];
    alignas(64) Real done[kWidth];
    store<V>(counts, iterations);
    if (settings.max_multiplier_updates > 1) converged = converged & !wanted;
    store<V>(done, select(converged, one, V{}));
    for (int k = 0; k < kWidth && k < rods_here_; ++k) {
      const int count = static_cast<int>(counts[k]);
      report.iterations += count;
      report.most_iterations = count > report.most_iterations ? count : report.most_iterations;
      report.unconverged += done[k] == Real(0);
    }
    return report;
  }

  /// Newton's method from trial_, whose energy and gradient are known, in the lanes `active`. Adds
  /// to `iterations`. Returns the lanes that converged.
  Mask newton(const SolverSettings& settings, Mask active, V& iterations) {
    // Newton's error after an update of size u is of the order of u²; below a few roundings of a
    // direction no update can be told from noise.
    const double rounding = 32.0 * static_cast<double>(std::numeric_limits<Real>::epsilon());
    const double least = rounding * rounding;
    const V tolerance = real(settings.tolerance > least ? settings.tolerance : least);
    const V zero{}, one = real(1);
    const Mask nobody = zero > one;
    V last_largest{};
    Mask converged = nobody, nudged = nobody;
    for (int iteration = 0; iteration < settings.max_iterations; ++iteration) {
      iterations = iterations + select(active, one, zero);
      V decrement{};
      // As near to Newton as the curvature allows: a majorant creeps where a rod buckles.
      V majorant{};
      Mask failed = active & self().sweep(majorant, decrement);
      const Mask indefinite = failed;
      for (const double part : {0.1, 0.4, 1.0}) {
        if (!any(failed)) break;
        majorant = select(failed, real(part), majorant);
        failed = failed & self().sweep(majorant, decrement);
      }

      const V energy_before = energy_;
      V scale = select(active, one, zero);
      const V largest = self().solveForUpdate(scale);
      // Where the update is tiny the energies differ by rounding only, and Newton is right. Over a kink
      // of the potential it is not even then, and next to one only where the update is tinier still.
      Mask smooth = !nobody, same_piece = !nobody;
      if constexpr (Potential::kPresent) {
        smooth = potential_.absent();
        same_piece = !potential_.pieceChanged();
      }
      const Mask tiny = largest * largest < tolerance;
      const Mask surely_downhill = same_piece & (tiny | (smooth & (largest <= real(1e-3))));
      const V slack = real(16) * broadcast<V>(std::numeric_limits<Real>::epsilon()) *
                      max(energy_before, -energy_before);
      const auto isUphill = [&] {
        return !(energy_ <= energy_before + slack - real(0.1) * scale * decrement);
      };
      Mask uphill = active & !surely_downhill & isUphill();
      const Mask shortened = uphill;
      for (int halving = 0; any(uphill); ++halving) {
        // With no way down at all the lane keeps its shape, and says that it did not converge.
        scale = select(uphill, halving < 30 ? scale * real(0.5) : zero, scale);
        self().solveForUpdate(scale);
        uphill = uphill & (scale > zero) & isUphill();
      }
      Real* const accepted = next_;
      next_ = trial_;
      trial_ = accepted;

      Mask done = tiny & !shortened;
      if constexpr (Potential::kPresent) {
        // Newton's model promises half the decrement. Friction that now points the other way, on the
        // same piece, breaks the promise, and next time turns back by as much.
        const V broken = energy_ - energy_before + real(0.5) * decrement;
        const Mask kept = smooth | (max(broken, -broken) <= real(0.25) * decrement + slack) |
                          (largest < real(0.25) * last_largest);
        done = done & ((largest < tolerance) | (same_piece & kept));
      }
      last_largest = largest;
      // At rest on a ridge, such as a straight rod that is pressed along its axis: off to one side.
      const Mask ridge = active & done & indefinite & !nudged;
      if (any(ridge)) {
        self().nudge(select(ridge, one, zero));
        Real* const off = next_;
        next_ = trial_;
        trial_ = off;
        nudged = nudged | ridge;
        done = done & !ridge;
      }
      converged = converged | (active & done);
      active = active & !done & (scale > zero);
      if (!any(active)) break;
    }
    return converged;
  }

  /// Where inertia alone would take a node, into target_. Returns a guess of its way in the step.
  CALLIGRAPHY_INLINE Vector aim(int node) {
    const Vector d = Vector::loadFrom(displacement_ + node * kVector);
    const Vector v = Vector::loadFrom(velocity_ + node * kVector);
    Vector y = step_.displacement * d + step_.velocity * v +
               step_.previous_velocity * Vector::loadFrom(previous_velocity_ + node * kVector);
    y.z = y.z - step_.gravity * real(gravity_);
    toScratch(y, target_ + node * kScratchVector);
    return step_.guess_displacement * d + step_.guess_velocity * v;
  }

  /// What a node whose way in the step is `way` adds to Φ; its gradient.
  struct NodeSums {
    V twice_inertia{}, potential{};
    V lowest;
  };
  CALLIGRAPHY_INLINE Vector addNode(int node, const Vector& way, NodeSums& sums) {
    const Vector off = way - fromScratch(target_ + node * kScratchVector);
    const V w = inertia_ * load<V>(mass_ + node * kLanes);
    Vector gradient = w * off;
    sums.twice_inertia = sums.twice_inertia + dot(gradient, off);
    sums.lowest = min(sums.lowest, load<V>(position_ + node * kVector + 2 * kLanes) + way.z);
    if constexpr (Potential::kPresent)
      sums.potential = sums.potential + potential_.add(node, way, gradient);
    return gradient;
  }

  /// Moves the state to the end of the step, at which edges are edge(0), edge(1), ...
  template <class Edge>
  CALLIGRAPHY_INLINE void moveState(Edge&& edge, const double* pivot, Real* wrench) {
    if constexpr (Potential::kPresent) potential_.finish();
    const V from_way = step_.from_way, from_displacement = step_.from_displacement,
            from_velocity = step_.from_velocity;
    const Mask restart = step_.restart > V{};
    const V root_weight = inertia_ * load<V>(mass_);
    Vector root_gradient = root_weight * (root_displacement_ - fromScratch(target_));
    if constexpr (Potential::kTied) potential_.addToRoot(root_displacement_, root_gradient);
    toScratch(root_gradient, gradient_);
    Vector force{}, torque{};
    const Vector centre = wrench ? Vector{real(pivot[0]), real(pivot[1]), real(pivot[2])} : Vector{};
    Vector way = root_displacement_, position = root_position_;
    V lowest = position.z;
    for (int node = 0; node < n_; ++node) {
      if (node > 0) {
        const Vector e = edge(node - 1);
        Real* old = edge_ + (node - 1) * kVector;
        way = way + (e - Vector::loadFrom(old));
        position = position + e;
        lowest = min(lowest, position.z);
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
        const Vector gradient = fromScratch(gradient_ + node * kScratchVector);
        force = force - gradient;
        torque = torque - cross(position - centre, gradient);
      }
    }
    store<V>(lowest_address_, lowest);
    if (wrench) {
      force.storeTo(wrench);
      torque.storeTo(wrench + kVector);
    }
  }

  int n_;
  Potential& potential_;
  Real *trial_, *next_;
  const Real* mass_;
  Real *edge_, *position_, *target_, *gradient_;
  V length_, inertia_;
  Vector root_position_, root_displacement_;
  V energy_{}, lowest_{};  // Φ [J], and height of the lowest node [m], at the last walk

 private:
  CALLIGRAPHY_INLINE Kernel& self() { return static_cast<Kernel&>(*this); }

  int rods_here_;  // lanes from here on that hold a rod
  Real *displacement_, *velocity_, *previous_velocity_, *lowest_address_;
  const StepCoefficientsOf<V>& step_;
  double gravity_;
};

}  // namespace calligraphy_brush
