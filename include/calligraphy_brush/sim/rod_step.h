#pragma once

#include <string>

#include "calligraphy_brush/contact/bundle_pull.h"
#include "calligraphy_brush/contact/bundle_search.h"
#include "calligraphy_brush/contact/paper_contact.h"
#include "calligraphy_brush/rods/framed_kernel.h"
#include "calligraphy_brush/rods/node_springs.h"
#include "calligraphy_brush/rods/rod_kernel.h"
#include "calligraphy_brush/sim/coupled_rods.h"

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
};

/// What couples rods, in phases: BundleSearch's, BundlePull's and CoupledRods'.
template <class Real>
struct Coupling {
  void (*find)(BundleContact<Real>&);
  void (*pull)(BundleContact<Real>&);
  void (*multiply)(BundleContact<Real>&);
  void (*writeSprings)(const BundleContact<Real>&, CoupledBatch<Real>&);
  void (*believe)(BundleContact<Real>&, const RodBatchState<Real>&, CoupledBatch<Real>&);
  void (*begin)(const BundleContact<Real>&, CoupledBatch<Real>&);
  void (*advance)(CoupledBatch<Real>&, double);
  void (*redirect)(BundleContact<Real>&, CoupledBatch<Real>&, double);
  void (*answer)(const BundleContact<Real>&, CoupledBatch<Real>&);
  void (*move)(BundleContact<Real>&, const RodBatchModel<Real>&, const RodBatchRoots<Real>&,
               RodBatchState<Real>&, CoupledBatch<Real>&, double);
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
SolveReport solveBatch(const RodStep<RealOf<V>>& step) {
  SolveReport report;
  const auto add = [&report](const SolveReport& part) {
    report.iterations += part.iterations;
    report.most_iterations =
        part.most_iterations > report.most_iterations ? part.most_iterations : report.most_iterations;
    report.unconverged += part.unconverged;
    report.energy += part.energy;
  };
  for (int lane = 0; lane < step.model.rod_count; lane += widthOf<V>) {
    const V nobody{};
    const auto coefficients =
        step.calm ? laneCoefficients<V>(step.coefficients, *step.calm_coefficients,
                                        load<V>(step.calm + lane) > nobody)
                  : laneCoefficients<V>(step.coefficients, step.coefficients, nobody > nobody);
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
      NodeSprings<V, std::decay_t<decltype(potential)>> tied(potential, step.springs + lane);
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

template <class Real, int Bytes>
constexpr Coupling<Real> coupling() {
  using V = Lanes<Real, Bytes / static_cast<int>(sizeof(Real))>;
  using Pull = BundlePull<V>;
  using Rods = CoupledRods<V>;
  return {&BundleSearch<V>::find, &Pull::pull,    &Pull::multiply, &Rods::writeSprings, &Rods::believe,
          &Rods::begin,           &Rods::advance, &Rods::redirect, &Rods::answer,       &Rods::move};
}

/// The step in registers of `Bytes` bytes.
template <class Real, int Bytes>
SolveReport solve(const RodStep<Real>& step) {
  return solveBatch<Lanes<Real, Bytes / static_cast<int>(sizeof(Real))>>(step);
}

}  // namespace rod_step_detail
}  // namespace calligraphy_brush
