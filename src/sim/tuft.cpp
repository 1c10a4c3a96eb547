#include "calligraphy_brush/sim/tuft.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include "calligraphy_brush/common/thread_pool.h"
#include "calligraphy_brush/rods/wet_hair.h"
#include "calligraphy_brush/sim/projection_tuft.h"
#include "calligraphy_brush/sim/rod_step.h"

namespace calligraphy_brush {
namespace {

/// Relative speed of touching rods at which friction is fully there [m/s].
constexpr double kSlipSpeed = 1e-3;
/// A list of pairs serves for so long [s] while rods or liquid move; when those of it have moved by so
/// many margins relative to each other, or rods anywhere, it is done at once. One that comes up from
/// where it was not listed is noticed when it overlaps, and pushed off. Where next to nothing moves
/// nobody looks, and rods come to rest. By the clock rather than by how far they have come: what differs
/// by a rounding then goes on alike.
constexpr double kLeastMargins = 0.02, kSearchMargins = 2.0, kFarMargins = 6.0;
constexpr double kSearchTime = 15.5e-3;
/// Time for which a rod is believed to go on with what it does by itself [s]. Believed for too long,
/// small shocks of pairs that come and go add up; the shorter, the more rounds until rods know what
/// their neighbours do.
constexpr double kRelativeTime = 10e-3, kLeastRelative = 0.3;
/// How groups of rods are tied hardly changes from step to step: it is summed up again after so many,
/// and after a search.
constexpr int kTieSteps = 4;
/// How far a common motion is trusted in a step, in margins.
constexpr double kTrustInMargins = 2.0;

/// What wet hair remembers goes on about so often [s], and at least once in so many steps.
constexpr double kMemoryInterval = 8e-3;
constexpr double kMemorySteps = 16;

/// A minimisation of a time step, and the part of the step at which it ends. Rods that stick to the
/// sheet take the calm coefficients: between two tangents of a constraint, schemes of second order
/// bounce for ever, where backward Euler comes to rest. As in a change of order, what a step needs of
/// those before it are displacements and velocities, whichever scheme they are from.
struct StageOfStep {
  double end;
  double part;   ///< of the step that it takes
  double ratio;  ///< its length over that of the stage before it
  StepCoefficients coefficients, calm;
};

std::vector<StageOfStep> makeStages(const std::string& scheme, const RodParameters& rods) {
  const double h = rods.time_step, c = rods.damping, g = kSdirk2Gamma;
  if (scheme == "bdf2") return {{1.0, 1.0, 1.0, bdf2(h, c), calmStep(h, c)}};
  if (scheme == "sdirk2")
    return {{g, g, g / (1 - g), backwardEuler(g * h, c), backwardEuler(g * h, c)},
            {1.0, 1 - g, (1 - g) / g, sdirk2SecondStage(h, c), backwardEuler((1 - g) * h, c)}};
  return {{1.0, 1.0, 1.0, backwardEuler(h, c), backwardEuler(h, c)}};
}

template <class Real>
class TuftOf : public Tuft {
 public:
  TuftOf(const BrushModel& brush, const RodParameters& rods, const ContactParameters& contact)
      : brush_(brush),
        kernel_(findRodStepKernel(rods.instruction_set)),
        pool_(rods.threads),
        law_(rods.bending_law == "tangent" ? kTangentLaw
             : rods.bending_law == "arc"   ? kArcLaw
                                           : kSineLaw),
        clamp_(rods.clamp == "half" ? ClampRule::kHalf : ClampRule::kCorrected),
        gravity_(rods.gravity),
        sleep_(rods.sleep),
        stages_(makeStages(rods.scheme, rods)),
        first_stages_(makeStages(rods.scheme == "bdf2" ? "backward_euler" : rods.scheme, rods)),
        settings_{rods.tolerance, rods.max_iterations, contact.tolerance, contact.multiplier_updates},
        time_step_(rods.time_step),
        has_paper_(contact.paper),
        memory_steps_(static_cast<int>(
            std::clamp(std::floor(kMemoryInterval / rods.time_step), 1.0, kMemorySteps))),
        coupling_rounds_(contact.coupling_rounds),
        relative_(std::max(std::exp(-rods.time_step / kRelativeTime), kLeastRelative)),
        coupling_tolerance_(contact.coupling_tolerance) {
    // Rods that need material frames are kept apart: the others are far cheaper.
    place_.resize(brush_.rods.size());
    for (const bool framed : {false, true}) {
      std::vector<int> indices;
      for (std::size_t rod = 0; rod < brush_.rods.size(); ++rod)
        if (brush_.rods[rod].needsFrames() == framed) indices.push_back(static_cast<int>(rod));
      // A batch takes the iterations of the lane that needs most, and neighbours meet the sheet
      // together.
      groupNeighbours(brush_, kLanes, indices.begin(), indices.end());
      for (std::size_t first = 0; first < indices.size(); first += kLanes) {
        const auto end =
            indices.begin() + static_cast<std::ptrdiff_t>(std::min(first + kLanes, indices.size()));
        addBatch({indices.begin() + static_cast<std::ptrdiff_t>(first), end}, framed, rods, contact);
      }
    }
    if (contact.bundles && brush_.rods.size() > 1) tie(rods, contact);
    for (int thread = 0; thread < pool_.threadCount(); ++thread)
      workspaces_.push_back(makeRodBatchWorkspace<Real>(brush_.rods.front().nodeCount()));
    solve_ = [this](int index, int thread) {
      solve(batches_[static_cast<std::size_t>(index)], workspaces_[static_cast<std::size_t>(thread)]);
    };
    step_ = [this](int index, int thread) {
      moveRoots(batches_[static_cast<std::size_t>(index)], X_PH_, false);
      solve_(index, thread);
    };
    relax_ = [this](int index, int) { relaxBends(batches_[static_cast<std::size_t>(index)]); };
  }

  void place(const Eigen::Isometry3d& X_PH) override {
    X_PH_ = X_PH;
    for (Batch& batch : batches_) {
      wake(batch);
      moveRoots(batch, X_PH, true);
      placeAtRest(batch.model, batch.roots, batch.state, batch.framed.get());
      leavePaper(batch);
      batch.push.clear();
      forgetBends(batch.framed.get(), batch.hair);
    }
    steps_ = 0;
    moved_since_search_ = std::numeric_limits<double>::max();
    if (bundles_) forgetPairs(*bundles_);
    letGo();
    since_search_ = 0.0;
    has_history_ = false;
  }

  bool carry(const Eigen::Isometry3d& X_PH) override {
    const Eigen::Isometry3d motion = X_PH * X_PH_.inverse();
    X_PH_ = X_PH;
    for (Batch& batch : batches_) {
      wake(batch);
      moveRoots(batch, X_PH, true);
      carryShape(motion, batch.model, batch.roots, batch.state, batch.framed.get());
      leavePaper(batch);
      turnBends(motion.linear(), batch.hair);
      batch.push.clear();
      if (batch.hair.is_bent && !batch.framed) sumLoads(batch);
    }
    if (bundles_)
      for (BundleBatch<Real>& bundle : bundles_->batches) turnPulls(motion.linear(), bundle.springs);
    has_history_ = false;
    return true;
  }

  void moveEnd(int rod, const Eigen::Isometry3d& X_PE) override {
    const Place& place = placeOf(rod);
    if (!brush_.rods[static_cast<std::size_t>(rod)].end_clamped)
      throw std::invalid_argument("rod " + std::to_string(rod) + " has no far clamp");
    wake(batches_[place.batch]);
    FramedRods<Real>& framed = *batches_[place.batch].framed;
    // Lanes beyond the last rod follow it.
    const bool is_last = place.lane + 1 == batches_[place.batch].rods.size();
    for (std::size_t lane = place.lane; lane < (is_last ? kLanes : place.lane + 1); ++lane) {
      for (int i = 0; i < 3; ++i)
        framed.end_position[static_cast<std::size_t>(i * kLanes) + lane] =
            static_cast<Real>(X_PE.translation()[i]);
      writeRotation(X_PE.linear(), static_cast<int>(lane), framed.end_frame);
    }
  }
  Eigen::Vector3d endForce(int rod) const override {
    const Place& place = placeOf(rod);
    Eigen::Vector3d force(0, 0, 0);
    if (batches_[place.batch].framed)
      for (int i = 0; i < 3; ++i)
        force[i] =
            double(batches_[place.batch]
                       .framed->tether_multiplier[static_cast<std::size_t>(i * kLanes) + place.lane]);
    return force;
  }

  TuftReport step(const Eigen::Isometry3d& X_PH) override {
    const Eigen::Isometry3d from = X_PH_;
    return stepAlong([&](double part) {
      if (part == 1.0) return X_PH;
      Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
      X.translation() = from.translation() + part * (X_PH.translation() - from.translation());
      X.linear() = Eigen::Quaterniond(from.linear())
                       .slerp(part, Eigen::Quaterniond(X_PH.linear()))
                       .toRotationMatrix();
      return X;
    });
  }

  TuftReport stepAlong(const std::function<Eigen::Isometry3d(double)>& X_PH) override {
    TuftReport report;
    const std::vector<StageOfStep>& stages = has_history_ ? stages_ : first_stages_;
    std::array<Eigen::Isometry3d, 2> poses;
    bool handle_rests = true;
    for (std::size_t i = 0; i < stages.size(); ++i) {
      poses[i] = X_PH(stages[i].end);
      handle_rests = handle_rests && poses[i].matrix() == X_PH_.matrix();
    }
    if (!handle_rests || (bundles_ && !allAsleep()))
      for (Batch& batch : batches_)
        if (!handle_rests || batch.asleep) wake(batch);
    if (remembers() && steps_++ % memory_steps_ == 0)
      pool_.run(static_cast<int>(batches_.size()), relax_);
    for (std::size_t i = 0; i < stages.size(); ++i) {
      stage_ = &stages[i];
      X_PH_ = poses[i];
      pivot_ = {X_PH_.translation().x(), X_PH_.translation().y(), X_PH_.translation().z()};
      report.coupling_error = 0.0;
      if (bundles_ && !allAsleep()) {
        for (Batch& batch : batches_) moveRoots(batch, X_PH_, false);
        solveTogether(report);
      } else {
        pool_.run(static_cast<int>(batches_.size()), step_);
      }
      report.solved_rods = 0;
      for (const Batch& batch : batches_) {
        if (batch.asleep) continue;
        report.solved_rods += batch.model.rod_count;
        report.iterations += batch.report.iterations;
        report.most_iterations = std::max(report.most_iterations, batch.report.most_iterations);
        report.unconverged += batch.report.unconverged;
      }
    }
    if (handle_rests && sleep_ > 0.0) {
      for (Batch& batch : batches_) fallAsleep(batch);
      // Rods that feel each other rest all at once or not at all.
      if (bundles_ && !allAsleep())
        for (Batch& batch : batches_)
          if (batch.asleep) {
            batch.asleep = false;
            batch.still_steps = 32;
          }
    }
    has_history_ = true;
    return report;
  }

  void setInk(const std::vector<double>& saturation) override {
    for (Batch& batch : batches_)
      if (soak(batch.rods, saturation, batch.hair, batch.model, batch.framed.get())) wake(batch);
    if (bundles_ && takeInk(*bundles_, saturation)) {
      for (Batch& batch : batches_) wake(batch);
      moved_since_search_ = std::max(moved_since_search_, 2.0 * kLeastMargins * bundles_->margin);
      kernel_.template coupling<Real>().fill(*bundles_);
    }
  }
  int groups(double part, std::vector<int>& group_of_rod) const override {
    if (!bundles_) return Tuft::groups(part, group_of_rod);
    const int n = bundles_->node_count;
    return findGroups(
        *bundles_, std::min(n - 1, static_cast<int>((1.0 - part) * n)),
        [this](int rod, int node) { return nodePosition(rod, node); }, group_of_rod);
  }

  void setNodeForce(int rod, int node, const Eigen::Vector3d& force) override {
    const Place& place = placeOf(rod);
    Batch& batch = batches_[place.batch];
    wake(batch);
    batch.load.resize(batch.state.velocity.size());
    for (int i = 0; i < 3; ++i)
      batch.load[static_cast<std::size_t>((node * 3 + i) * kLanes) + place.lane] =
          static_cast<Real>(force[i]);
    sumLoads(batch);
  }

  Eigen::Vector3d nodePosition(int rod, int node) const override {
    return vectorAt(batchOf(rod).state.position, rod, node);
  }
  Eigen::Vector3d contactForce(int rod, int node) const override {
    return vectorAt(batchOf(rod).contact.force, rod, node);
  }
  Eigen::Matrix<double, 6, 1> rodWrench(int rod) const override {
    Eigen::Matrix<double, 6, 1> wrench;
    for (int i = 0; i < 6; ++i)
      wrench[i] = double(batchOf(rod).wrench[static_cast<std::size_t>(i * kLanes) + placeOf(rod).lane]);
    if (batchOf(rod).hair.is_bent)
      wrench.tail<3>() -=
          torqueOfCouples(batchOf(rod).state, batchOf(rod).hair, static_cast<int>(placeOf(rod).lane));
    return wrench;
  }
  RodOnPaper rodOnPaper(int rod) const override {
    const Batch& batch = batchOf(rod);
    const std::size_t lane = placeOf(rod).lane;
    return {double(batch.state.lowest[lane]), static_cast<int>(batch.contact.touching[lane])};
  }
  void readRod(int rod, std::vector<Eigen::Vector3d>& nodes) const override {
    nodes.resize(static_cast<std::size_t>(batchOf(rod).model.node_count));
    for (int node = 0; node < batchOf(rod).model.node_count; ++node)
      nodes[static_cast<std::size_t>(node)] = nodePosition(rod, node);
  }
  const char* kernelName() const override { return kernel_.name; }

  std::uint64_t hash(std::uint64_t seed) const override {
    for (const Batch& batch : batches_)
      for (const auto* field :
           {&batch.state.edge, &batch.state.position, &batch.state.displacement, &batch.state.velocity,
            &batch.state.previous_velocity, &batch.contact.multiplier, &batch.contact.offset,
            &batch.contact.engaged, &batch.contact.stuck})
        seed = hashBytes(field->data(), field->size() * sizeof(Real), seed);
    for (const Batch& batch : batches_)
      if (batch.framed)
        seed = hashBytes(batch.framed->frame.data(), batch.framed->frame.size() * sizeof(Real), seed);
    for (const Batch& batch : batches_)
      for (const auto* field : {&batch.hair.wet, &batch.hair.strain})
        seed = hashBytes(field->data(), field->size() * sizeof(Real), seed);
    const int phase = steps_ % memory_steps_;
    return remembers() ? hashBytes(&phase, sizeof phase, seed) : seed;
  }

 private:
  struct Batch {
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
    RodBatchState<Real> start;  // the state before a solve that may have to be done again
    AlignedVector<Real> start_frame, start_offset, start_stuck;
    bool asleep = false;  // at rest: a step leaves it as it is
    int still_steps = 0;  // without a change of anything from outside, and without motion from `rest`
    AlignedVector<Real> rest;  // positions when they began
  };

  /// Nothing presses on its rods, from now on.
  static void leavePaper(Batch& batch) {
    for (auto* field : {&batch.contact.multiplier, &batch.contact.offset, &batch.contact.force})
      std::fill(field->begin(), field->end(), Real(0));
    std::fill(batch.wrench.begin(), batch.wrench.end(), Real(0));
    for (auto* lanes : {&batch.contact.engaged, &batch.contact.stuck, &batch.contact.touching})
      std::fill(lanes->begin(), lanes->end(), Real(0));
    std::fill(batch.contact.held.begin(), batch.contact.held.end(), char(0));
    batch.load.clear();
  }

  /// To be called on any change of what the rods of a batch feel.
  static void wake(Batch& batch) {
    batch.asleep = false;
    batch.still_steps = 0;
  }

  /// Of what every processor has.
  using Register = Lanes<Real, 16 / static_cast<int>(sizeof(Real))>;
  static constexpr std::size_t kRegister = 16 / sizeof(Real);

  /// Whole batches rest, since a lane costs nothing beside others. Motion is measured over many steps,
  /// so that neither a turning point of a swing nor slow creep is taken for rest.
  void fallAsleep(Batch& batch) const {
    if (batch.asleep) return;
    const auto& position = batch.state.position;
    // Looked at now and then, at times that no swing has in common.
    const int still = batch.still_steps;
    bool moved = still == 0 || batch.report.unconverged > 0;
    if (still == 5 || still == 12 || still == 20 || still == 32)
      for (std::size_t i = position.size(); i-- > 0 && !moved;)
        moved = std::abs(position[i] - batch.rest[i]) > static_cast<Real>(sleep_);
    if (moved) {
      batch.rest = position;
      batch.still_steps = 0;
    }
    batch.asleep = batch.still_steps++ == 32;
  }

  bool allAsleep() const {
    return std::all_of(batches_.begin(), batches_.end(),
                       [](const Batch& batch) { return batch.asleep; });
  }

  void addBatch(const std::vector<int>& rods, bool framed, const RodParameters& parameters,
                const ContactParameters& contact) {
    Batch batch;
    batch.rods = rods;
    batch.model = makeRodBatchModel<Real>(brush_.rods, rods, clamp_);
    batch.state = makeRodBatchState(batch.model);
    batch.roots = makeRodBatchRoots<Real>();
    if (framed)
      batch.framed = std::make_unique<FramedRods<Real>>(makeFramedRods<Real>(brush_.rods, rods, clamp_));
    batch.hair =
        makeWetHair(batch.model, batch.framed.get(), parameters, memory_steps_ * parameters.time_step);
    batch.contact = makePaperContactState<Real>(batch.model.node_count);
    batch.contact.friction = static_cast<Real>(contact.paper_friction);
    for (std::size_t i = 0; i < batch.contact.stiffness.size(); ++i)
      batch.contact.stiffness[i] = static_cast<Real>(
          contact.stiffness * (stages_.back().coefficients.inertia * double(batch.model.mass[i]) +
                               double(batch.model.stiffness[i])));
    batch.wrench.resize(6 * kLanes);
    batch.calm.resize(kLanes);
    batch.rest = batch.state.position;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const RodModel& rod = brush_.rods[static_cast<std::size_t>(rods[std::min(lane, rods.size() - 1)])];
      for (int i = 0; i < 3; ++i) {
        const auto at = static_cast<std::size_t>(i * kLanes) + lane;
        batch.root_H[at] = rod.root_H[i];
        batch.clamp_H[at] = rod.direction_H[i] * double(batch.model.edge_length[lane]);
        batch.director_H[at] = firstDirector(rod)[i];
      }
    }
    for (std::size_t lane = 0; lane < rods.size(); ++lane)
      place_[static_cast<std::size_t>(rods[lane])] = {batches_.size(), lane};
    batches_.push_back(std::move(batch));
  }

  /// Where a rod is: its batch, and its lane there.
  struct Place {
    std::size_t batch, lane;
  };
  const Place& placeOf(int rod) const { return place_[static_cast<std::size_t>(rod)]; }
  const Batch& batchOf(int rod) const { return batches_[placeOf(rod).batch]; }

  Eigen::Vector3d vectorAt(const AlignedVector<Real>& field, int rod, int node) const {
    const auto at = static_cast<std::size_t>(node * 3 * kLanes) + placeOf(rod).lane;
    return {double(field[at]), double(field[at + kLanes]), double(field[at + 2 * kLanes])};
  }

  static void writeRotation(const Eigen::Matrix3d& R, int lane, AlignedVector<Real>& field) {
    const Eigen::Quaterniond q(R);
    const double values[4] = {q.w(), q.x(), q.y(), q.z()};
    for (int i = 0; i < 4; ++i)
      field[static_cast<std::size_t>(i * kLanes + lane)] = static_cast<Real>(values[i]);
  }

  static Eigen::Vector3d firstDirector(const RodModel& rod) {
    return (rod.director_H - rod.director_H.dot(rod.direction_H) * rod.direction_H).normalized();
  }

  void moveRoots(Batch& batch, const Eigen::Isometry3d& X_PH, bool placing) const {
    if (batch.asleep) return;
    const int rod_count = batch.model.rod_count;
    // Component by component over all lanes, into local arrays, so that it is compiled to registers.
    for (std::size_t i = 0; i < 3; ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      const double x = X_PH.linear()(row, 0), y = X_PH.linear()(row, 1), z = X_PH.linear()(row, 2);
      const double shift = X_PH.translation()[row];
      const double *root = batch.root_H.data(), *clamp = batch.clamp_H.data();
      double* old = batch.root_position.data() + i * kLanes;
      std::array<Real, kLanes> position, way, direction;
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const double now =
            shift + x * root[lane] + y * root[kLanes + lane] + z * root[2 * kLanes + lane];
        position[lane] = static_cast<Real>(now);
        way[lane] = static_cast<Real>(now - old[lane]);
        old[lane] = now;
        direction[lane] =
            static_cast<Real>(x * clamp[lane] + y * clamp[kLanes + lane] + z * clamp[2 * kLanes + lane]);
      }
      if (placing) way.fill(Real(0));
      const auto at = static_cast<std::ptrdiff_t>(i * kLanes);
      std::copy(position.begin(), position.end(), batch.roots.position.begin() + at);
      std::copy(way.begin(), way.end(), batch.roots.displacement.begin() + at);
      std::copy(direction.begin(), direction.end(), batch.roots.clamp.begin() + at);
    }
    if (batch.framed)
      for (int lane = 0; lane < kLanes; ++lane) {
        const RodModel& rod = brush_.rods[static_cast<std::size_t>(
            batch.rods[static_cast<std::size_t>(std::min(lane, rod_count - 1))])];
        Eigen::Matrix3d R;
        R.col(2) = rod.direction_H;
        R.col(0) = firstDirector(rod);
        R.col(1) = R.col(2).cross(R.col(0));
        writeRotation(X_PH.linear() * R, lane, batch.framed->clamp_frame);
      }
  }

  /// Lets the rods feel each other.
  void tie(const RodParameters& rods, const ContactParameters& contact) {
    std::vector<std::vector<int>> batches;
    for (const Batch& batch : batches_) batches.push_back(batch.rods);
    bundles_ = std::make_unique<BundleContact<Real>>(makeBundleContact<Real>(brush_, contact, batches));
    bundles_->slip = kSlipSpeed * rods.time_step;
    const auto n = static_cast<std::size_t>(bundles_->node_count);
    for (std::size_t i = 0; i < batches_.size(); ++i) {
      Batch& batch = batches_[i];
      batch.common.assign(n * kCommonRows, Real(0));
      batch.common_scratch.assign(n * kCommonRows * kLanes, Real(0));
      for (std::size_t at = 0; at < n * kLanes; ++at)
        bundles_->batches[i].hold[at] =
            batch.contact.stiffness[at] / static_cast<Real>(contact.stiffness);
    }
    common_.node_count = bundles_->node_count;
    common_.factor.assign((n - 1) * kCommonFactorRows * kLanes, Real(0));
    for (int count = static_cast<int>(batches_.size());; count = (count + kJoined - 1) / kJoined) {
      CommonLevel<Real> level;
      level.count = count;
      const std::size_t rows = n * kLanes * static_cast<std::size_t>((count + kLanes - 1) / kLanes);
      level.sums.assign(rows * kCommonRows, Real(0));
      level.hold.assign(rows, Real(0));
      level.shift.assign(rows * 3, Real(0));
      level.pull.assign(rows * 3, Real(0));
      // Lanes without a group have mass alone, and so stay where they are.
      for (std::size_t at = 0; at < rows; ++at)
        level.sums[(at / kLanes * kCommonRows + kCommonMass) * kLanes + at % kLanes] = Real(1);
      common_.levels.push_back(std::move(level));
      if (count == 1) break;
    }
  }

  /// The gradients of NodeSprings, [node][4][lane].
  static void turnPulls(const Eigen::Matrix3d& turn, AlignedVector<Real>& springs) {
    for (std::size_t row = 0; row < springs.size(); row += 4 * kLanes)
      for (std::size_t at = row; at < row + kLanes; ++at) {
        const Eigen::Vector3d turned =
            turn * Eigen::Vector3d(double(springs[at]), double(springs[at + kLanes]),
                                   double(springs[at + 2 * kLanes]));
        for (std::size_t i = 0; i < 3; ++i)
          springs[at + i * kLanes] = static_cast<Real>(turned[static_cast<Eigen::Index>(i)]);
      }
  }

  /// What pulled until now does not any more.
  void letGo() {
    if (!bundles_) return;
    for (BundleBatch<Real>& bundle : bundles_->batches) {
      std::fill(bundle.springs.begin(), bundle.springs.end(), Real(0));
      for (auto* field : {&bundle.turns, &bundle.anchors})
        std::fill(field->begin(), field->end(), Real(0));
    }
    since_ties_ = kTieSteps;
    for (CommonLevel<Real>& level : common_.levels) {
      level.tie_count = 0;
      std::fill(level.hold.begin(), level.hold.end(), Real(0));
    }
  }

  /// A step of rods that touch. Each is solved as if the others did what is believed of them, at first
  /// that they go on as they did, and then that groups of them do what they would do together (see
  /// CommonMotion). The springs that a rod feels lie above the coupled energy (see BundleContact), and
  /// where rods rest they rest whatever is believed of their motion: one such round a step is stable and
  /// ends in the common minimum. With more rounds what rods did is believed of them, and they are solved
  /// again, until beliefs and deeds agree.
  void solveTogether(TuftReport& report) {
    BundleContact<Real>& bundles = *bundles_;
    const Coupling<Real>& coupling = kernel_.template coupling<Real>();
    forBatches([&](Batch& batch, BundleBatch<Real>& bundle) {
      if (coupling_rounds_ > 1) keepStart(batch);
      chooseScheme(batch);
      coupling.extrapolate(stage_->ratio, std::pow(relative_, stage_->part), has_paper_, batch.model,
                           batch.roots, batch.state, bundle);
    });
    since_search_ += stage_->part * time_step_;
    const WaysApart apart = noteWays(bundles);
    moved_apart_ += apart.of_step;
    const auto moved = [&](double margins) {
      return std::max(moved_since_search_, moved_apart_) > margins * bundles.margin;
    };
    const bool searches = moved_since_search_ > kSearchMargins * bundles.margin || moved(kFarMargins) ||
                          ((moved(kLeastMargins) || bundles.is_flowing) && since_search_ > kSearchTime);
    if (searches) search();
    const bool crosses = apart.largest > kApartMargins * bundles.margin;
    if (crosses) coupling.findCrossings(bundles);
    if (searches || crosses) takeCrossings(bundles);
    if (bundles.empty()) {
      letGo();
      for (Batch& batch : batches_) batch.state.guess.clear();
      pool_.run(static_cast<int>(batches_.size()), solve_);
      return;
    }
    for (int round = 1;; ++round) {
      report.coupling_rounds = round;
      moveTogether();
      pull(round == 1 && (searches || ++since_ties_ >= kTieSteps));
      pool_.run(static_cast<int>(batches_.size()), solve_);
      report.coupling_error = 0.0;
      for (std::size_t i = 0; i < batches_.size(); ++i)
        report.coupling_error =
            std::max(report.coupling_error, disagreement(batches_[i], bundles.batches[i]));
      if (report.coupling_error < coupling_tolerance_ || round == coupling_rounds_) break;
      forBatches([&](Batch& batch, BundleBatch<Real>& bundle) {
        bundle.way = batch.state.displacement;
        bundle.point = batch.state.position;
        backToStart(batch);
      });
      for (const Batch& batch : batches_) report.iterations += batch.report.iterations;
    }
    Real most = 0;
    for (const BundleTie<Real>& tie : bundles.ties) most = std::max(most, tie.most_relative);
    moved_since_search_ += std::sqrt(double(most));
  }

  void search() {
    BundleContact<Real>& bundles = *bundles_;
    const Coupling<Real>& coupling = kernel_.template coupling<Real>();
    coupling.find(bundles);
    takeHits(bundles, since_search_);
    since_search_ = 0.0;
    coupling.fill(bundles);
    moved_since_search_ = moved_apart_ = 0.0;
  }

  /// What the pairs pull, into the springs, and how groups are tied.
  void pull(bool with_ties) {
    BundleContact<Real>& bundles = *bundles_;
    const Coupling<Real>& coupling = kernel_.template coupling<Real>();
    const int batches = static_cast<int>(batches_.size());
    pool_.run(batches, [&](int batch, int) { coupling.spread(bundles, batch); });
    for (const std::vector<int>& ties : bundles.phases)
      pool_.run(static_cast<int>(ties.size()), [&](int i, int) {
        coupling.push(bundles, ties[static_cast<std::size_t>(i)], with_ties);
      });
    pool_.run(batches, [&](int batch, int) { coupling.gather(bundles, batch); });
    coupling.cross(bundles);
    if (!with_ties) return;
    tieGroups();
    since_ties_ = 0;
  }

  /// The ties of batches, and those of larger groups by them.
  void tieGroups() {
    const int n = bundles_->node_count;
    const auto join = [](CommonLevel<Real>& level, int a, int b, const std::vector<Real>& stiffness) {
      if (a == b) return;
      for (int i = 0; i < level.tie_count; ++i) {
        auto& tie = level.ties[static_cast<std::size_t>(i)];
        if (tie.a != a || tie.b != b) continue;
        for (std::size_t k = 0; k < stiffness.size(); ++k) tie.stiffness[k] += stiffness[k];
        return;
      }
      const auto next = static_cast<std::size_t>(level.tie_count++);
      if (next == level.ties.size()) level.ties.emplace_back();
      level.ties[next].a = a;
      level.ties[next].b = b;
      level.ties[next].stiffness = stiffness;
    };
    for (CommonLevel<Real>& level : common_.levels) level.tie_count = 0;
    for (const auto& tie : bundles_->ties) join(common_.levels.front(), tie.a, tie.b, tie.stiffness);
    for (std::size_t i = 1; i < common_.levels.size(); ++i)
      for (int k = 0; k < common_.levels[i - 1].tie_count; ++k) {
        const auto& tie = common_.levels[i - 1].ties[static_cast<std::size_t>(k)];
        join(common_.levels[i], tie.a / kJoined, tie.b / kJoined, tie.stiffness);
      }
    for (CommonLevel<Real>& level : common_.levels) {
      std::fill(level.hold.begin(), level.hold.end(), Real(0));
      for (int i = 0; i < level.tie_count; ++i) {
        const auto& tie = level.ties[static_cast<std::size_t>(i)];
        for (const int group : {tie.a, tie.b})
          for (int place = 1; place < n; ++place)
            level.hold[static_cast<std::size_t>((group / kLanes * n + place) * kLanes +
                                                group % kLanes)] +=
                Real(2) * tie.stiffness[static_cast<std::size_t>(place)];
      }
    }
  }

  /// Stiffness of inertia where a group has no rods, which keeps its place there [N/m].
  static constexpr Real kLeastMass = Real(1e-6);

  /// Moves what is believed by what groups of rods do together.
  void moveTogether() {
    BundleContact<Real>& bundles = *bundles_;
    const Coupling<Real>& coupling = kernel_.template coupling<Real>();
    const int n = bundles.node_count;
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int thread) {
      Batch& batch = batches_[static_cast<std::size_t>(index)];
      const BundleBatch<Real>& bundle = bundles.batches[static_cast<std::size_t>(index)];
      if (batch.framed) return;
      if (!batch.push.empty()) putPushIn(batch);
      coupling.sumUp(stepOf(batch, workspaces_[static_cast<std::size_t>(thread)], &bundle),
                     bundle.present.data(), bundle.places, batch.common_scratch.data(),
                     batch.common.data());
      for (int place = 0; place < n; ++place) {
        Real* sums = batch.common.data() + place * kCommonRows;
        sums[kCommonTurn] = bundle.turns[static_cast<std::size_t>(place)];
        for (int i = 0; i < 3; ++i)
          sums[kCommonContact + i] += bundle.anchors[static_cast<std::size_t>(place)];
      }
      if (!batch.push.empty()) batch.state.velocity = batch.before;
    });
    CommonLevel<Real>& level = common_.levels.front();
    const auto at = [&](std::size_t batch, int node, int rows) {
      return (batch / kLanes * static_cast<std::size_t>(n) + static_cast<std::size_t>(node)) *
                 static_cast<std::size_t>(rows) * kLanes +
             batch % kLanes;
    };
    for (std::size_t i = 0; i < batches_.size(); ++i) {
      // Rods with frames do not take part; what has next to no mass does not weigh on its larger group.
      if (batches_[i].framed) {
        for (int node = 1; node < n; ++node)
          level.sums[at(i, node, kCommonRows) + kCommonMass * kLanes] = kLeastMass;
        continue;
      }
      const Real* sums = batches_[i].common.data();
      for (int node = 1; node < n; ++node)
        for (std::size_t row = 0; row < kCommonRows; ++row)
          level.sums[at(i, node, kCommonRows) + row * kLanes] =
              sums[static_cast<std::size_t>(node * kCommonRows) + row] +
              (row == kCommonMass ? kLeastMass : Real(0));
    }
    coupling.solveCommon(common_);
    Real square = 0;
    for (std::size_t row = 0; row < level.shift.size(); row += 3 * kLanes)
      for (std::size_t k = row; k < row + kLanes; ++k) {
        const Real x = level.shift[k], y = level.shift[k + kLanes], z = level.shift[k + 2 * kLanes];
        square = std::max(square, x * x + y * y + z * z);
      }
    const Real largest = std::sqrt(square);
    const Real scale = std::min(Real(1), static_cast<Real>(kTrustInMargins * bundles.margin) /
                                             std::max(largest, std::numeric_limits<Real>::min()));
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int) {
      Batch& batch = batches_[static_cast<std::size_t>(index)];
      if (batch.framed) return;
      for (int place = 0; place < n; ++place)
        for (std::size_t row = 0; row < 3; ++row)
          batch.common[static_cast<std::size_t>(3 * place) + row] =
              scale * level.shift[at(static_cast<std::size_t>(index), place, 3) + row * kLanes];
      coupling.shift(has_paper_, batch.model, batch.roots, batch.state,
                     bundles.batches[static_cast<std::size_t>(index)], batch.common.data());
    });
  }

  /// Largest distance between what was believed of a batch's nodes and what they did [m].
  static double disagreement(const Batch& batch, const BundleBatch<Real>& bundle) {
    Register largest{};
    const Real *did = batch.state.displacement.data(), *believed = bundle.way.data();
    for (std::size_t row = 0; row < bundle.way.size(); row += 3 * kLanes)
      for (std::size_t lane = row; lane < row + kLanes; lane += kRegister)
        largest = max(largest, squaredNorm(Vec3<Register>::loadFrom(did + lane) -
                                           Vec3<Register>::loadFrom(believed + lane)));
    double square = 0.0;
    for (std::size_t k = 0; k < kRegister; ++k) square = std::max(square, double(largest[k]));
    return std::sqrt(square);
  }

  /// Calls task(batch, its bundles) for all of them, in parallel.
  template <class Task>
  void forBatches(Task&& task) {
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int) {
      task(batches_[static_cast<std::size_t>(index)],
           bundles_->batches[static_cast<std::size_t>(index)]);
    });
  }

  static void keepStart(Batch& batch) {
    batch.start = batch.state;
    batch.start_offset = batch.contact.offset;
    batch.start_stuck = batch.contact.stuck;
    if (batch.framed) batch.start_frame = batch.framed->frame;
  }
  /// All but the multipliers, which are better now, and the shape, from which to go on.
  static void backToStart(Batch& batch) {
    batch.start.guess = batch.state.edge;
    batch.state = batch.start;
    batch.contact.offset = batch.start_offset;
    batch.contact.stuck = batch.start_stuck;
    if (batch.framed) batch.framed->frame = batch.start_frame;
  }

  /// All stages of a step by the same.
  void chooseScheme(Batch& batch) const {
    if (stage_->end < 1.0 || stages_.size() == 1)
      std::copy(batch.contact.stuck.begin(), batch.contact.stuck.end(), batch.calm.begin());
  }

  RodStep<Real> stepOf(Batch& batch, RodBatchWorkspace<Real>& workspace,
                       const BundleBatch<Real>* bundle) {
    return {batch.model,
            batch.roots,
            stage_->coefficients,
            settings_,
            law_,
            gravity_,
            pivot_.data(),
            has_paper_ ? &batch.contact : nullptr,
            batch.framed.get(),
            batch.state,
            workspace,
            batch.wrench.data(),
            &stage_->calm,
            batch.calm.data(),
            bundle ? bundle->springs.data() : nullptr,
            bundle ? bundle->way.data() : nullptr};
  }

  void solve(Batch& batch, RodBatchWorkspace<Real>& workspace) {
    if (batch.asleep) return;
    chooseScheme(batch);
    if (!batch.push.empty()) putPushIn(batch);
    const BundleBatch<Real>* bundle =
        bundles_ && !bundles_->empty()
            ? &bundles_->batches[static_cast<std::size_t>(&batch - batches_.data())]
            : nullptr;
    batch.report = kernel_(stepOf(batch, workspace, bundle));
    if (!batch.push.empty()) takePushOut(batch);
  }

  /// An acceleration a by loads moves a node's target by a/inertia, and so does a change of the velocity
  /// that the step starts from by a/(inertia · velocity). Put in before the step and taken out of the
  /// history after it, it costs the kernel nothing. Of the scheme of each rod.
  template <class Number>
  void byScheme(const Batch& batch, Number number, Real* of_lane) const {
    const Real usual = static_cast<Real>(number(stage_->coefficients)),
               calm = static_cast<Real>(number(stage_->calm));
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      of_lane[lane] = batch.calm[lane] != Real(0) ? calm : usual;
  }

  void putPushIn(Batch& batch) const {
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

  /// The velocity before the step becomes what it was to the bit: a sum that is taken apart is rounded.
  void takePushOut(Batch& batch) const {
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

  /// What `push` is by loads and wet hair.
  static void sumLoads(Batch& batch) {
    if (batch.hair.is_bent && !batch.framed)
      batch.push = batch.hair.push;
    else
      batch.push.assign(batch.load.size(), Real(0));
    for (std::size_t i = 0; i < batch.load.size(); ++i)
      batch.push[i] += batch.load[i] / batch.model.mass[i / (3 * kLanes) * kLanes + i % kLanes];
  }

  /// Whether hair takes on its bend.
  bool remembers() const { return !batches_.front().hair.strain.empty(); }

  void relaxBends(Batch& batch) const {
    if (batch.asleep) return;
    alignas(64) std::array<Real, 3 * kLanes> director;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const double* d = batch.director_H.data() + lane;
        const auto row = static_cast<Eigen::Index>(i);
        director[i * kLanes + lane] =
            static_cast<Real>(X_PH_.linear()(row, 0) * d[0] + X_PH_.linear()(row, 1) * d[kLanes] +
                              X_PH_.linear()(row, 2) * d[2 * kLanes]);
      }
    const bool moves = relax(law_, batch.model, batch.roots, director.data(), batch.state,
                             batch.framed.get(), batch.hair);
    if (moves) batch.still_steps = 0;
    if (batch.hair.is_bent && !batch.framed) sumLoads(batch);
  }

  BrushModel brush_;
  const RodStepKernel& kernel_;
  ThreadPool pool_;
  double law_;  // p of bendingTerms
  ClampRule clamp_;
  double gravity_;
  double sleep_;                                    // see RodParameters
  std::vector<StageOfStep> stages_, first_stages_;  // the first are those of a step without history
  const StageOfStep* stage_ = nullptr;              // that is solved now
  Eigen::Isometry3d X_PH_ = Eigen::Isometry3d::Identity();
  SolverSettings settings_;
  double time_step_;
  bool has_paper_;
  int memory_steps_;  // from one call of relaxBends to the next
  int steps_ = 0;     // since place()
  int coupling_rounds_;
  double relative_;  // part of what a rod does by itself that is believed to go on
  double coupling_tolerance_;
  std::unique_ptr<BundleContact<Real>> bundles_;  // null: the rods do not feel each other
  bool has_history_ = false;
  CommonMotionState<Real> common_;
  int since_ties_ = 0;               // steps since groups were tied
  double since_search_ = 0.0;        // time [s]
  double moved_apart_ = 0.0;         // rods anywhere, since the search [m]
  double moved_since_search_ = 0.0;  // neighbours, relative to each other [m]
  std::array<double, 3> pivot_{};
  std::vector<Batch> batches_;
  std::vector<Place> place_;  // of each rod
  std::vector<RodBatchWorkspace<Real>> workspaces_;
  std::function<void(int, int)> solve_, step_, relax_;  // of a batch; step_ moves its roots first
};

}  // namespace

bool Tuft::carry(const Eigen::Isometry3d&) {
  return false;
}

void Tuft::moveEnd(int rod, const Eigen::Isometry3d&) {
  throw std::invalid_argument("rod " + std::to_string(rod) + " has no far clamp");
}

void Tuft::setNodeForce(int, int, const Eigen::Vector3d&) {
  throw std::invalid_argument(std::string("the ") + kernelName() + " scheme takes no loads on nodes");
}

void Tuft::setInk(const std::vector<double>&) {}

int Tuft::groups(double, std::vector<int>& group_of_rod) const {
  for (std::size_t rod = 0; rod < group_of_rod.size(); ++rod) group_of_rod[rod] = static_cast<int>(rod);
  return static_cast<int>(group_of_rod.size());
}

Eigen::Vector3d Tuft::endForce(int) const {
  return {0, 0, 0};
}

std::unique_ptr<Tuft> makeTuft(const BrushModel& brush, const RodParameters& rods,
                               const ContactParameters& contact) {
  std::vector<std::string> problems = findParameterProblems(rods);
  for (const auto& problem : findParameterProblems(contact)) problems.push_back(problem);
  if (!problems.empty()) throw ParameterError(problems);
  if (brush.rods.empty()) throw std::invalid_argument("a brush needs at least one rod");
  for (const RodModel& rod : brush.rods)
    if (rod.nodeCount() != brush.rods.front().nodeCount() || rod.nodeCount() < 3)
      throw std::invalid_argument("all rods of a brush must have equally many nodes, at least 3");
  if (rods.scheme == "projection") return std::make_unique<ProjectionTuft>(brush, rods, contact);
  if (rods.precision == "double") return std::make_unique<TuftOf<double>>(brush, rods, contact);
  return std::make_unique<TuftOf<float>>(brush, rods, contact);
}

std::uint64_t hashBytes(const void* data, std::size_t size, std::uint64_t seed) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) seed = (seed ^ bytes[i]) * 1099511628211ULL;
  return seed;
}

}  // namespace calligraphy_brush
