#pragma once

#include <string>

#include "calligraphy_brush/contact/paper_contact.h"
#include "calligraphy_brush/rods/framed_kernel.h"
#include "calligraphy_brush/rods/rod_kernel.h"

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
  Real* wrench;  ///< see RodKernel::solve; may be null
};

/// A compiled form of the step for one instruction set.
struct RodStepKernel {
  const char* name;  ///< "avx512", "avx2", "baseline"
  SolveReport (*single)(const RodStep<float>&);
  SolveReport (*twice)(const RodStep<double>&);  ///< double precision

  SolveReport operator()(const RodStep<float>& step) const { return single(step); }
  SolveReport operator()(const RodStep<double>& step) const { return twice(step); }
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
  };
  for (int lane = 0; lane < step.model.rod_count; lane += widthOf<V>) {
    const auto solveWith = [&](auto& potential) {
      if (step.framed)
        return FramedKernel<V, std::decay_t<decltype(potential)>>::solve(
            step.model, step.roots, *step.framed, step.coefficients, step.law, step.gravity,
            step.settings, lane, potential, step.workspace, step.state, step.pivot,
            step.wrench ? step.wrench + lane : nullptr);
      return RodKernel<V, std::decay_t<decltype(potential)>>::solve(
          step.model, step.roots, step.coefficients, step.law, step.gravity, step.settings, lane,
          potential, step.workspace, step.state, step.pivot, step.wrench ? step.wrench + lane : nullptr);
    };
    // Rods that touched nothing and end above the sheet have not met it.
    if (!step.contact || !step.contact->engaged[static_cast<std::size_t>(lane)]) {
      NoPotential nothing{step.contact ? 0.0 : -std::numeric_limits<double>::max()};
      const SolveReport air = solveWith(nothing);
      if (!air.refused) {
        add(air);
        continue;
      }
    }
    PaperContact<V> contact(step.model.node_count, lane, step.state.position.data(), *step.contact);
    add(solveWith(contact));
  }
  return report;
}

/// The step in registers of `Bytes` bytes.
template <class Real, int Bytes>
SolveReport solve(const RodStep<Real>& step) {
  return solveBatch<Lanes<Real, Bytes / static_cast<int>(sizeof(Real))>>(step);
}

}  // namespace rod_step_detail
}  // namespace calligraphy_brush
