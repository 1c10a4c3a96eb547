#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "calligraphy_brush/rods/wet_hair.h"
#include "calligraphy_brush/sim/rod_step.h"

namespace calligraphy_brush {

/// A minimisation of a time step, and the part of the step at which it ends. Rods that stick to the
/// sheet take the calm coefficients: between two tangents of a constraint, schemes of second order
/// bounce for ever, where backward Euler comes to rest. As in a change of order, what a step needs of
/// those before it are displacements and velocities, whichever scheme they are from.
struct StageOfStep {
  double end;
  double part;   ///< of the step that it takes
  double ratio;  ///< its length over that of the stage before it
  bool is_first;
  StepCoefficients coefficients, calm;
};

/// Rods of a tuft that are solved together, one in each lane, and how they stand to handle and sheet.
template <class Real>
struct TuftBatch {
  std::vector<int> rods;  // that are in its lanes
  RodBatchModel<Real> model;
  RodBatchState<Real> state;
  RodBatchRoots<Real> roots;
  std::unique_ptr<FramedRods<Real>> framed;  // null: straight, isotropic, free-tipped rods
  PaperContactState<Real> contact;
  AlignedVector<Real> wrench;
  AlignedVector<Real> calm;  // 1 where a rod takes the calm coefficients in this step, else 0
  WetHair<Real> hair;
  AlignedVector<Real> load;    // on nodes [N], [node][3][lane]; empty where there is none
  AlignedVector<Real> push;    // of all loads, over the masses [m/s²]; empty where there is none
  AlignedVector<Real> before;  // velocity without it when the solve began
  // In the handle frame, and the roots in the paper frame; double, since the way of a step is a
  // small difference. [component][lane]
  std::array<double, 3 * kLanes> root_H, clamp_H, director_H, root_position;
  SolveReport report;
  AlignedVector<Real> common, common_scratch;  // see kCommonRows
  RodBatchState<Real> start;                   // the state before a solve that may have to be done again
  AlignedVector<Real> start_frame, start_offset, start_stuck;
  bool asleep = false;       // at rest: a step leaves it as it is
  int still_steps = 0;       // without a change of anything from outside, and without motion from `rest`
  AlignedVector<Real> rest;  // positions when they began

  /// To be called on any change of what its rods feel.
  void wake() {
    asleep = false;
    still_steps = 0;
  }
  /// Nothing presses on its rods, from now on.
  void leavePaper() {
    for (auto* field : {&contact.multiplier, &contact.offset, &contact.force})
      std::fill(field->begin(), field->end(), Real(0));
    std::fill(wrench.begin(), wrench.end(), Real(0));
    for (auto* lanes : {&contact.engaged, &contact.stuck, &contact.touching})
      std::fill(lanes->begin(), lanes->end(), Real(0));
    std::fill(contact.held.begin(), contact.held.end(), char(0));
    load.clear();
  }
  void keepStart() {
    start = state;
    start_offset = contact.offset;
    start_stuck = contact.stuck;
    if (framed) start_frame = framed->frame;
  }
  /// All but the multipliers, which are better now, and the shape, from which to go on.
  void backToStart() {
    start.guess = state.edge;
    state = start;
    contact.offset = start_offset;
    contact.stuck = start_stuck;
    if (framed) framed->frame = start_frame;
  }
};

/// How batches take a stage of a step: what all of them have in common.
template <class Real>
struct StageSolver {
  const RodStepKernel& kernel;
  double law;  ///< p of bendingTerms
  double gravity;
  SolverSettings settings;
  bool has_paper;
  std::vector<RodBatchWorkspace<Real>> workspaces;  ///< [thread]
  const StageOfStep* stage = nullptr;               ///< that is solved now
  std::array<double, 3> pivot{};                    ///< the handle's origin at its end [m]

  /// All stages of a step by the same.
  void chooseScheme(TuftBatch<Real>& batch) const {
    if (stage->is_first)
      std::copy(batch.contact.stuck.begin(), batch.contact.stuck.end(), batch.calm.begin());
  }

  RodStep<Real> stepOf(TuftBatch<Real>& batch, int thread, const BundleBatch<Real>* bundle) {
    return {batch.model,
            batch.roots,
            stage->coefficients,
            settings,
            law,
            gravity,
            pivot.data(),
            has_paper ? &batch.contact : nullptr,
            batch.framed.get(),
            batch.state,
            workspaces[static_cast<std::size_t>(thread)],
            batch.wrench.data(),
            &stage->calm,
            batch.calm.data(),
            bundle ? bundle->springs.data() : nullptr,
            bundle ? bundle->way.data() : nullptr};
  }

  /// bundle: what its rods feel of others; null: nothing.
  void solve(TuftBatch<Real>& batch, int thread, const BundleBatch<Real>* bundle) {
    if (batch.asleep) return;
    chooseScheme(batch);
    if (!batch.push.empty()) putPushIn(batch);
    batch.report = kernel(stepOf(batch, thread, bundle));
    if (!batch.push.empty()) takePushOut(batch);
  }

  /// An acceleration a by loads moves a node's target by a/inertia, and so does a change of the velocity
  /// that the step starts from by a/(inertia · velocity). Put in before the step and taken out of the
  /// history after it, it costs the kernel nothing.
  void putPushIn(TuftBatch<Real>& batch) const {
    alignas(64) std::array<Real, kLanes> factor;
    byScheme(
        batch, [](const StepCoefficients& k) { return 1.0 / (k.inertia * k.velocity); }, factor.data());
    batch.before.resize(batch.push.size());
    for (std::size_t row = 0; row < batch.push.size(); row += kLanes) {
      const Real* push = batch.push.data() + row;
      Real *velocity = batch.state.velocity.data() + row, *before = batch.before.data() + row;
      for (std::size_t lane = 0; lane < kLanes; lane += kRegister) {
        const Register v = load<Register>(velocity + lane);
        store<Register>(before + lane, v);
        store<Register>(velocity + lane,
                        v + load<Register>(factor.data() + lane) * load<Register>(push + lane));
      }
    }
  }

 private:
  /// Of the scheme of each rod.
  template <class Number>
  void byScheme(const TuftBatch<Real>& batch, Number number, Real* of_lane) const {
    const Real usual = static_cast<Real>(number(stage->coefficients)),
               calm = static_cast<Real>(number(stage->calm));
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      of_lane[lane] = batch.calm[lane] != Real(0) ? calm : usual;
  }

  /// The velocity before the step becomes what it was to the bit: a sum that is taken apart is rounded.
  void takePushOut(TuftBatch<Real>& batch) const {
    alignas(64) std::array<Real, kLanes> factor, restart;
    byScheme(
        batch, [](const StepCoefficients& k) { return k.from_velocity / (k.inertia * k.velocity); },
        factor.data());
    byScheme(
        batch, [](const StepCoefficients& k) { return k.restart; }, restart.data());
    for (std::size_t row = 0; row < batch.push.size(); row += kLanes) {
      const Real *push = batch.push.data() + row, *before = batch.before.data() + row;
      Real *velocity = batch.state.velocity.data() + row,
           *previous = batch.state.previous_velocity.data() + row;
      for (std::size_t lane = 0; lane < kLanes; lane += kRegister) {
        const Register v = load<Register>(velocity + lane) -
                           load<Register>(factor.data() + lane) * load<Register>(push + lane);
        store<Register>(velocity + lane, v);
        store<Register>(previous + lane, select(load<Register>(restart.data() + lane) > Register{}, v,
                                                load<Register>(before + lane)));
      }
    }
  }

  /// Of what every processor has.
  using Register = Lanes<Real, 16 / static_cast<int>(sizeof(Real))>;
  static constexpr std::size_t kRegister = 16 / sizeof(Real);
};

}  // namespace calligraphy_brush
