#pragma once

#include <string>

#include "calligraphy_brush/contact/bundle_pull.h"
#include "calligraphy_brush/contact/bundle_search.h"
#include "calligraphy_brush/contact/paper_contact.h"
#include "calligraphy_brush/rods/framed_kernel.h"
#include "calligraphy_brush/rods/node_springs.h"
#include "calligraphy_brush/rods/rod_kernel.h"
#include "calligraphy_brush/sim/common_motion.h"

namespace calligraphy_brush {

/// One batch of rods and all that its step reads and writes.
template <class Real>
struct RodStep {
  const RodBatchModel<Real>& model;
  const RodBatchRoots<Real>& roots;
  const StepCoefficients& coefficients;
  const SolverSettings& settings;
  double law;                        ///< p of bendingTerms
  double gravity;                    ///< [m/s²]
  const double* pivot;               ///< point of the wrench's torque in the paper frame [m], 3
  PaperContactState<Real>* contact;  ///< null: there is no sheet
  FramedRods<Real>* framed;          ///< null: rods that need no material frames
  RodBatchState<Real>& state;
  RodBatchWorkspace<Real>& workspace;
  Real* wrench;                                         ///< see RodKernel::solve; may be null
  const StepCoefficients* calm_coefficients = nullptr;  ///< for rods that ask for them
  const Real* calm = nullptr;     ///< 1 where a rod takes calm_coefficients, else 0, [lane]; may be null
  const Real* springs = nullptr;  ///< what ties the nodes to other rods, see NodeSprings; null: nothing
  const Real* believed = nullptr;  ///< their way in it
};

/// What couples rods, in phases: BundleSearch's, BundlePull's and CommonMotion's.
template <class Real>
struct Coupling {
  void (*find)(BundleContact<Real>&);
  void (*findCrossings)(BundleContact<Real>&);
  void (*fill)(BundleContact<Real>&);
  void (*spread)(BundleContact<Real>&, int batch);
  void (*push)(BundleContact<Real>&, int tie, bool with_ties);
  void (*gather)(BundleContact<Real>&, int batch);
  void (*cross)(BundleContact<Real>&);
  void (*extrapolate)(double ratio, double relative, bool has_paper, const RodBatchModel<Real>&,
                      const RodBatchRoots<Real>&, RodBatchState<Real>&, BundleBatch<Real>&);
  void (*sumUp)(const RodStep<Real>&, const Real* present, const CommonPlaces<Real>&, Real* scratch,
                Real* sums);
  void (*solveCommon)(CommonMotionState<Real>&);
  void (*shift)(bool has_paper, const RodBatchModel<Real>&, const RodBatchRoots<Real>&,
                RodBatchState<Real>&, BundleBatch<Real>&, const Real* shifts);
};

/// A compiled form of the step for one instruction set.
struct RodStepKernel {
  const char* name;  ///< "avx512", "avx2", "baseline"
  SolveReport (*single)(const RodStep<float>&);
  SolveReport (*twice)(const RodStep<double>&);  ///< double precision
  Coupling<float> coupling_single;
  Coupling<double> coupling_twice;

  SolveReport operator()(const RodStep<float>& step) const { return single(step); }
  SolveReport operator()(const RodStep<double>& step) const { return twice(step); }
  template <class Real>
  const Coupling<Real>& coupling() const {
    if constexpr (sizeof(Real) == sizeof(float))
      return coupling_single;
    else
      return coupling_twice;
  }
};

/// The kernel by its name, or the widest that this processor runs for "best".
/// Throws std::invalid_argument for one that it does not run.
const RodStepKernel& findRodStepKernel(const std::string& name);

/// Each lives in a file of its own, compiled with that instruction set's flags.
extern const RodStepKernel kRodStepAvx512;
extern const RodStepKernel kRodStepAvx2;
extern const RodStepKernel kRodStepBaseline;

namespace rod_step_detail {

template <class V>
StepCoefficientsOf<V> coefficientsOf(const RodStep<RealOf<V>>& step, int lane) {
  const V nobody{};
  return step.calm ? laneCoefficients<V>(step.coefficients, *step.calm_coefficients,
                                         load<V>(step.calm + lane) > nobody)
                   : laneCoefficients<V>(step.coefficients, step.coefficients, nobody > nobody);
}

template <class V>
SolveReport solveBatch(const RodStep<RealOf<V>>& step) {
  SolveReport report;
  const auto add = [&report](const SolveReport& part) {
    report.iterations += part.iterations;
    report.most_iterations =
        part.most_iterations > report.most_iterations ? part.most_iterations : report.most_iterations;
    report.unconverged += part.unconverged;
  };
  for (int lane = 0; lane < step.model.rod_count; lane += widthOf<V>) {
    const StepCoefficientsOf<V> coefficients = coefficientsOf<V>(step, lane);
    const auto solveWith = [&](auto& potential) {
      if (step.framed)
        return FramedKernel<V, std::decay_t<decltype(potential)>>::solve(
            step.model, step.roots, *step.framed, coefficients, step.law, step.gravity, step.settings,
            lane, potential, step.workspace, step.state, step.pivot,
            step.wrench ? step.wrench + lane : nullptr);
      return RodKernel<V, std::decay_t<decltype(potential)>>::solve(
          step.model, step.roots, coefficients, step.law, step.gravity, step.settings, lane, potential,
          step.workspace, step.state, step.pivot, step.wrench ? step.wrench + lane : nullptr);
    };
    const auto solveTied = [&](auto& potential) {
      if (!step.springs) return solveWith(potential);
      NodeSprings<V, std::decay_t<decltype(potential)>> tied(potential, step.springs + lane,
                                                             step.believed + lane);
      return solveWith(tied);
    };
    // Rods that touched nothing and end above the sheet have not met it.
    RealOf<V>* const engaged = step.contact ? step.contact->engaged.data() + lane : nullptr;
    if (!engaged || !any(load<V>(engaged) > V{})) {
      NoPotential<RealOf<V>> nothing{engaged ? 0.0 : -std::numeric_limits<double>::max(), engaged};
      const SolveReport air = solveTied(nothing);
      if (!air.refused) {
        add(air);
        continue;
      }
    }
    PaperContact<V> contact(step.model.node_count, lane, step.state.position.data(), *step.contact);
    add(solveTied(contact));
  }
  return report;
}

/// RodKernel::sumUp over the lanes of a batch without frames, whose rods are tied, and over them all:
/// [place][kCommonRows]. Scratch has as many numbers a lane.
template <class V>
void sumUp(const RodStep<RealOf<V>>& step, const RealOf<V>* present,
           const CommonPlaces<RealOf<V>>& places, RealOf<V>* scratch, RealOf<V>* sums) {
  using Real = RealOf<V>;
  const int rows = step.model.node_count * kCommonRows;
  __builtin_memset(scratch, 0, static_cast<std::size_t>(rows * widthOf<V>) * sizeof(Real));
  for (int lane = 0; lane < step.model.rod_count; lane += widthOf<V>) {
    const StepCoefficientsOf<V> coefficients = coefficientsOf<V>(step, lane);
    const auto sumWith = [&](auto& potential) {
      using Tied = NodeSprings<V, std::decay_t<decltype(potential)>>;
      Tied tied(potential, step.springs + lane, step.believed + lane);
      RodKernel<V, Tied>::sumUp(step.model, step.roots, coefficients, step.law, step.gravity, lane, tied,
                                step.workspace, step.state, present + lane, places, scratch);
    };
    if (step.contact && any(load<V>(step.contact->engaged.data() + lane) > V{})) {
      PaperContact<V> contact(step.model.node_count, lane, step.state.position.data(), *step.contact);
      sumWith(contact);
    } else {
      NoPotential<Real> nothing{0.0, nullptr};
      sumWith(nothing);
    }
  }
  for (int row = 0; row < rows; ++row) sums[row] = sumOf<V>(load<V>(scratch + row * widthOf<V>));
}

/// An edge from a node at height z, turned so far up that it ends no lower than the sheet or its node.
template <class V>
CALLIGRAPHY_INLINE Vec3<V> aboveSheet(Vec3<V> e, V z, V length) {
  using Real = RealOf<V>;
  const V zero{}, below = min(z, zero) - z - e.z;  // by which it has to be raised
  if (!any(below > zero)) return e;
  const V raised = e.z + max(below, zero);
  const V level = e.x * e.x + e.y * e.y;
  const V left =
      sqrt(max(zero, length * length - raised * raised) / max(level, broadcast<V>(Real(1e-30))));
  const MaskOf<V> turns = below > zero;
  return {select(turns, left * e.x, e.x), select(turns, left * e.y, e.y), select(turns, raised, e.z)};
}

/// What is believed of rods in lanes of a batch, edge by edge from the root on: where their nodes go,
/// and the shape that the next solve begins with. No edge goes through the sheet, if there is one.
template <class V>
class RodBeliefs {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;

  RodBeliefs(bool has_paper, const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
             RodBatchState<Real>& state, BundleBatch<Real>& bundle, int lane)
      : has_paper_(has_paper),
        lane_(lane),
        length_(load<V>(model.edge_length.data() + lane)),
        way_(Vector::loadFrom(roots.displacement.data() + lane)),
        point_(Vector::loadFrom(roots.position.data() + lane)),
        state_(state),
        bundle_(bundle) {
    put(0);
  }

  /// The edge up to `node`, brought to its length.
  CALLIGRAPHY_INLINE void take(int node, Vector e) {
    const int at = (node - 1) * kVector + lane_;
    e = (length_ / sqrt(squaredNorm(e))) * e;
    if (has_paper_) e = aboveSheet(e, point_.z, length_);
    e.storeTo(state_.guess.data() + at);
    way_ = way_ + (e - Vector::loadFrom(state_.edge.data() + at));
    point_ = point_ + e;
    put(node);
  }

 private:
  static constexpr int kVector = 3 * kLanes;
  CALLIGRAPHY_INLINE void put(int node) {
    way_.storeTo(bundle_.way.data() + node * kVector + lane_);
    point_.storeTo(bundle_.point.data() + node * kVector + lane_);
  }

  bool has_paper_;
  int lane_;
  V length_;
  Vector way_, point_;
  RodBatchState<Real>& state_;
  BundleBatch<Real>& bundle_;
};

/// Rods go on as they did, for `ratio` of the time of their last way: what others believe of them, and
/// the shape that the next solve begins with. Of what a rod does that its batch does not, the part
/// `relative` is believed to go on.
template <class V>
void extrapolate(double ratio, double relative, bool has_paper, const RodBatchModel<RealOf<V>>& model,
                 const RodBatchRoots<RealOf<V>>& roots, RodBatchState<RealOf<V>>& state,
                 BundleBatch<RealOf<V>>& bundle) {
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  constexpr int kVector = 3 * kLanes, kWidth = widthOf<V>;
  const CommonPlaces<Real>& places = bundle.places;
  const int n = model.node_count;
  // Mean ways at the common places.
  Real* sums = bundle.scratch.data();
  __builtin_memset(sums, 0, static_cast<std::size_t>(4 * n * kWidth) * sizeof(Real));
  for (int lane = 0; lane < kLanes; lane += kWidth)
    for (int node = 0; node < n; ++node) {
      const Vector way = Vector::loadFrom(state.displacement.data() + node * kVector + lane);
      const auto row = static_cast<std::size_t>(node);
      for (int place = places.first[row]; place <= places.last[row]; ++place) {
        const V weight =
            load<V>(bundle.present.data() + lane) * partOfPlace<V>(places, node, place, lane);
        Real* out = sums + 4 * place * kWidth;
        (Vector::template loadFrom<kWidth>(out) + weight * way).template storeTo<kWidth>(out);
        store<V>(out + 3 * kWidth, load<V>(out + 3 * kWidth) + weight);
      }
    }
  Real* means = sums + 4 * n * kWidth;
  for (int place = 0; place < n; ++place) {
    const auto sum = [&](int row) { return sumOf<V>(load<V>(sums + (4 * place + row) * kWidth)); };
    const Real weight = sum(3);
    for (int row = 0; row < 3; ++row)
      means[3 * place + row] = weight > Real(0) ? sum(row) / weight : Real(0);
  }

  state.guess.resize(state.edge.size());
  // Not by the second order of a lone rod's guess, which makes noise of neighbours louder.
  const V scale = broadcast<V>(static_cast<Real>(ratio)),
          own = broadcast<V>(static_cast<Real>(relative));
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    RodBeliefs<V> beliefs(has_paper, model, roots, state, bundle, lane);
    Vector last = Vector::loadFrom(roots.displacement.data() + lane);
    for (int node = 1; node < n; ++node) {
      const auto row = static_cast<std::size_t>(node);
      Vector mean{};
      for (int place = places.first[row]; place <= places.last[row]; ++place) {
        const V weight = partOfPlace<V>(places, node, place, lane);
        mean = mean + weight * Vector{broadcast<V>(means[3 * place]), broadcast<V>(means[3 * place + 1]),
                                      broadcast<V>(means[3 * place + 2])};
      }
      const int at = (node - 1) * kVector + lane;
      const Vector before = Vector::loadFrom(state.displacement.data() + node * kVector + lane);
      const Vector next = scale * (mean + own * (before - mean));
      beliefs.take(node, Vector::loadFrom(state.edge.data() + at) + (next - last));
      last = next;
    }
  }
}

/// Moves what is believed of a batch, and the shape that its next solve begins with, by what its rods do
/// together: shifts [place][3].
template <class V>
void shift(bool has_paper, const RodBatchModel<RealOf<V>>& model, const RodBatchRoots<RealOf<V>>& roots,
           RodBatchState<RealOf<V>>& state, BundleBatch<RealOf<V>>& bundle, const RealOf<V>* shifts) {
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  constexpr int kVector = 3 * kLanes;
  const CommonPlaces<Real>& places = bundle.places;
  for (int lane = 0; lane < kLanes; lane += widthOf<V>) {
    RodBeliefs<V> beliefs(has_paper, model, roots, state, bundle, lane);
    Vector before{};
    for (int node = 1; node < model.node_count; ++node) {
      const auto row = static_cast<std::size_t>(node);
      Vector moved{};
      for (int from = places.first[row]; from <= places.last[row]; ++from) {
        const V part = partOfPlace<V>(places, node, from, lane);
        const auto at = [&](int i) { return broadcast<V>(shifts[from * 3 + i]); };
        moved = moved + part * Vector{at(0), at(1), at(2)};
      }
      const int at = (node - 1) * kVector + lane;
      beliefs.take(node, Vector::loadFrom(state.guess.data() + at) + (moved - before));
      before = moved;
    }
  }
}

template <class Real, int Bytes>
constexpr Coupling<Real> coupling() {
  using V = Lanes<Real, Bytes / static_cast<int>(sizeof(Real))>;
  using Search = BundleSearch<V>;
  using Pull = BundlePull<V>;
  return {&Search::find, &Search::findCrossings,  &Pull::fill,  &Pull::spread,
          &Pull::push,   &Pull::gather,           &Pull::cross, &extrapolate<V>,
          &sumUp<V>,     &CommonMotion<V>::solve, &shift<V>};
}

/// The step in registers of `Bytes` bytes.
template <class Real, int Bytes>
SolveReport solve(const RodStep<Real>& step) {
  return solveBatch<Lanes<Real, Bytes / static_cast<int>(sizeof(Real))>>(step);
}

}  // namespace rod_step_detail
}  // namespace calligraphy_brush
