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
/// Time for which a list of pairs serves at least [s], unless rods have moved so many margins: one that
/// comes up from where it was not listed is noticed when it overlaps, and pushed off.
constexpr double kSearchInterval = 8e-3;
constexpr double kFarInMargins = 2.5;
/// Smallest part of a common Newton step that is tried.
constexpr double kLeastPart = 0.125;

/// What wet hair remembers goes on about so often [s], and at least once in so many steps.
constexpr double kMemoryInterval = 8e-3;
constexpr double kMemorySteps = 16;

/// A minimisation of a time step, and the part of the step at which it ends. Rods that stick to the
/// sheet take the calm coefficients: between two tangents of a constraint, schemes of second order
/// bounce for ever, where backward Euler comes to rest. As in a change of order, what a step needs of
/// those before it are displacements and velocities, whichever scheme they are from.
struct StageOfStep {
  double end;
  StepCoefficients coefficients, calm;
};

std::vector<StageOfStep> makeStages(const std::string& scheme, const RodParameters& rods) {
  const double h = rods.time_step, c = rods.damping, g = kSdirk2Gamma;
  if (scheme == "bdf2") return {{1.0, bdf2(h, c), calmStep(h, c)}};
  if (scheme == "sdirk2")
    return {{g, backwardEuler(g * h, c), backwardEuler(g * h, c)},
            {1.0, sdirk2SecondStage(h, c), backwardEuler((1 - g) * h, c)}};
  return {{1.0, backwardEuler(h, c), backwardEuler(h, c)}};
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
        has_paper_(contact.paper),
        memory_steps_(static_cast<int>(
            std::clamp(std::floor(kMemoryInterval / rods.time_step), 1.0, kMemorySteps))),
        coupling_rounds_(contact.coupling_rounds),
        coupling_iterations_(contact.coupling_iterations),
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
    energy_settings_.max_iterations = 0;
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
      for (auto* field : {&batch.contact.multiplier, &batch.contact.offset, &batch.contact.force})
        std::fill(field->begin(), field->end(), Real(0));
      std::fill(batch.wrench.begin(), batch.wrench.end(), Real(0));
      for (auto* lanes : {&batch.contact.engaged, &batch.contact.stuck, &batch.contact.touching})
        std::fill(lanes->begin(), lanes->end(), Real(0));
      std::fill(batch.contact.held.begin(), batch.contact.held.end(), char(0));
      batch.load.clear();
      batch.push.clear();
      forgetBends(batch.framed.get(), batch.hair);
    }
    steps_ = 0;
    if (bundles_) bundles_->found_at.clear();
    has_history_ = false;
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
    if (!handle_rests)
      for (Batch& batch : batches_) wake(batch);
    if (remembers() && steps_++ % memory_steps_ == 0)
      pool_.run(static_cast<int>(batches_.size()), relax_);
    for (std::size_t i = 0; i < stages.size(); ++i) {
      stage_ = &stages[i];
      X_PH_ = poses[i];
      pivot_ = {X_PH_.translation().x(), X_PH_.translation().y(), X_PH_.translation().z()};
      report.coupling_error = 0.0;
      if (bundles_) {
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
    if (handle_rests && sleep_ > 0.0 && !bundles_)  // not while others may pull
      for (Batch& batch : batches_) fallAsleep(batch);
    has_history_ = true;
    return report;
  }

  void setInk(const std::vector<double>& saturation) override {
    for (Batch& batch : batches_)
      if (soak(batch.rods, saturation, batch.hair, batch.model, batch.framed.get())) wake(batch);
    if (!bundles_) return;
    for (std::size_t i = 0; i < bundles_->saturation.size(); ++i)
      bundles_->saturation[i] = static_cast<Real>(saturation[i]);
    updateCohesion(*bundles_);
  }
  int groups(double part, std::vector<int>& group_of_rod) const override {
    if (!bundles_) return Tuft::groups(part, group_of_rod);
    const int n = bundles_->node_count;
    return findGroups(*bundles_, std::min(n - 1, static_cast<int>((1.0 - part) * n)), group_of_rod);
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
    CoupledBatch<Real> coupled;  // what ties the rods to others
    RodBatchState<Real> start;   // the state before a solve that may have to be done again
    AlignedVector<Real> start_frame, start_offset, start_stuck;
    bool asleep = false;  // at rest: a step leaves it as it is
    int still_steps = 0;  // without a change of anything from outside, and without motion from `rest`
    AlignedVector<Real> rest;  // positions when they began
  };

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
    bundles_ = std::make_unique<BundleContact<Real>>(makeBundleContact<Real>(brush_, contact));
    bundles_->slip = kSlipSpeed * rods.time_step;
    search_interval_ = std::max(1, static_cast<int>(std::lround(kSearchInterval / rods.time_step)));
    for (Batch& batch : batches_) {
      CoupledBatch<Real>& coupled = batch.coupled;
      const int n = batch.model.node_count;
      coupled.springs.resize(static_cast<std::size_t>(n * 4 * kLanes));
      coupled.factor.resize(static_cast<std::size_t>(n * kRodFactorRows * kLanes));
      for (auto* field : {&coupled.residual, &coupled.solution, &coupled.direction, &coupled.own,
                          &coupled.image, &coupled.answer})
        field->resize(static_cast<std::size_t>((n - 1) * 2 * kLanes));
      coupled.present.resize(kLanes);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const bool present = lane < batch.rods.size();
        coupled.present[lane] = present ? Real(1) : Real(0);
        coupled.first_node[lane] = n * (present ? batch.rods[lane] : bundles_->rod_count);
      }
      forEachNode(batch, [&](std::size_t node, std::size_t lane, std::size_t at) {
        bundles_->hold[at] =
            batch.contact.stiffness[node * kLanes + lane] / static_cast<Real>(contact.stiffness);
      });
    }
  }

  /// Calls visit(node, lane, rod · node count + node) for every node of the rods in a batch.
  template <class Visit>
  void forEachNode(const Batch& batch, Visit&& visit) const {
    const auto n = static_cast<std::size_t>(batch.model.node_count);
    for (std::size_t lane = 0; lane < batch.rods.size(); ++lane)
      for (std::size_t node = 0; node < n; ++node)
        visit(node, lane, static_cast<std::size_t>(batch.rods[lane]) * n + node);
  }

  /// A step of rods that touch. Each is solved as if the others did what is believed of them, at first
  /// that they go on as they did, all at once. Then beliefs are improved by a step of Newton's method
  /// for all of them together (see CoupledRods), as far as it lowers the energy, and each is solved once
  /// more, until beliefs and deeds agree. The springs that a rod feels lie above the coupled energy, so
  /// a solve lowers it too (see BundleContact).
  void solveTogether(TuftReport& report) {
    BundleContact<Real>& bundles = *bundles_;
    const Coupling<Real>& coupling = kernel_.template coupling<Real>();
    forBatches([&](Batch& batch) {
      keepStart(batch);
      chooseScheme(batch);
      extrapolate(batch);
    });
    const double moved = motionSinceSearch(bundles) / bundles.margin;
    if (moved > kFarInMargins || (++steps_since_search_ >= search_interval_ && moved > 1.0)) {
      coupling.find(bundles);
      takePairs(bundles);
      steps_since_search_ = 0;
    }
    if (bundles.empty()) {
      for (Batch& batch : batches_) batch.state.guess.clear();
      pool_.run(static_cast<int>(batches_.size()), solve_);
      return;
    }
    coupling.pull(bundles);
    double energy = energyOfStep();
    for (int round = 1;; ++round) {
      forBatches([&](Batch& batch) { coupling.writeSprings(bundles, batch.coupled); });
      pool_.run(static_cast<int>(batches_.size()), solve_);
      forBatches([&](Batch& batch) { coupling.believe(bundles, batch.state, batch.coupled); });
      report.coupling_error = 0.0;
      for (const Batch& batch : batches_)
        report.coupling_error = std::max(report.coupling_error, batch.coupled.largest);
      report.coupling_rounds = round;
      if (report.coupling_error < coupling_tolerance_ || round == coupling_rounds_) return;
      report.coupling_iterations += findDirection();
      for (Batch& batch : batches_) {
        report.iterations += batch.report.iterations;
        batch.coupled.shape = batch.state.edge;
        backToStart(batch);
      }
      // Halved until the energy is below that of the beliefs before; if need be, only what rods did.
      for (double part = 1.0;; part = part > kLeastPart ? 0.5 * part : 0.0) {
        forBatches([&](Batch& batch) {
          if (!batch.framed)
            coupling.move(bundles, batch.model, batch.roots, batch.state, batch.coupled, part);
        });
        coupling.pull(bundles);
        const double now = energyOfStep();
        if (part > 0.0 && !(now <= energy)) continue;
        energy = now;
        break;
      }
    }
  }

  /// Rods go on as they did: into what is believed, and the shapes that the next solve begins with.
  void extrapolate(Batch& batch) {
    batch.state.guess = batch.state.edge;
    // Not by the second order of a lone rod's guess, which makes noise of neighbours louder.
    const Real part = static_cast<Real>(stage_->end);
    const auto n = static_cast<std::size_t>(batch.model.node_count);
    const auto way = [&](std::size_t node, std::size_t at) {
      return node == 0 ? batch.roots.displacement[at]
                       : part * batch.state.displacement[node * 3 * kLanes + at];
    };
    for (std::size_t edge = 0; edge + 1 < n; ++edge) {
      Real* e = batch.state.guess.data() + edge * 3 * kLanes;
      for (std::size_t at = 0; at < 3 * kLanes; ++at) e[at] += way(edge + 1, at) - way(edge, at);
      for (std::size_t lane = 0; lane < kLanes; ++lane, ++e) {
        const Real scale =
            batch.model.edge_length[lane] /
            std::sqrt(e[0] * e[0] + e[kLanes] * e[kLanes] + e[2 * kLanes] * e[2 * kLanes]);
        for (std::size_t i = 0; i < 3; ++i) e[i * kLanes] *= scale;
      }
    }
    forEachNode(batch, [&](std::size_t node, std::size_t lane, std::size_t at) {
      for (std::size_t i = 0; i < 3; ++i) {
        const Real moved = way(node, i * kLanes + lane);
        bundles_->way[4 * at + i] = moved;
        bundles_->point[4 * at + i] = batch.state.position[(node * 3 + i) * kLanes + lane] + moved;
      }
    });
  }

  /// Of the rods and the pairs, at the shapes in state.guess and after BundlePull::pull there [J]. Rods
  /// with frames are left out: what is believed of them changes only by their own solves.
  double energyOfStep() {
    pool_.run(static_cast<int>(batches_.size()), [this](int index, int thread) {
      Batch& batch = batches_[static_cast<std::size_t>(index)];
      if (batch.framed) return;
      if (!batch.push.empty()) putPushIn(batch);
      RodBatchWorkspace<Real>& workspace = workspaces_[static_cast<std::size_t>(thread)];
      batch.coupled.product = kernel_(stepOf(batch, workspace, energy_settings_, nullptr)).energy;
      if (!batch.push.empty()) batch.state.velocity = batch.before;
    });
    return bundles_->energy + sumOfProducts();
  }

  /// From where the rods are towards where all of them together would be, by conjugate gradients that
  /// stop at the edge of the region in which springs between closest points can be trusted. Returns how
  /// many. Source: Steihaug 1983, The Conjugate Gradient Method and Trust Regions in Large Scale
  /// Optimization.
  int findDirection() {
    BundleContact<Real>& bundles = *bundles_;
    const Coupling<Real>& coupling = kernel_.template coupling<Real>();
    coupling.multiply(bundles);
    forBatches([&](Batch& batch) { coupling.begin(bundles, batch.coupled); });
    const double trusted = 2.0 * bundles.margin;
    double length = 0.0, last_product = 0.0, gone = 0.0;
    for (int iteration = 0;; ++iteration) {
      forBatches([&](Batch& batch) { coupling.advance(batch.coupled, length); });
      const double product = sumOfProducts();
      if (!(product > 0.0) || iteration == coupling_iterations_ || gone >= trusted) return iteration;
      const double turn = iteration > 0 ? product / last_product : 0.0;
      last_product = product;
      forBatches([&](Batch& batch) { coupling.redirect(bundles, batch.coupled, turn); });
      coupling.multiply(bundles);
      forBatches([&](Batch& batch) { coupling.answer(bundles, batch.coupled); });
      const double curvature = sumOfProducts();
      if (!(curvature > 0.0)) return iteration;
      length = product / curvature;
      double largest = 0.0;
      for (const Batch& batch : batches_) largest = std::max(largest, batch.coupled.largest);
      if (length * largest < coupling_tolerance_) return iteration;
      length = std::min(length, (trusted - gone) / largest);
      gone += length * largest;
    }
  }

  /// Calls task(batch) for all of them, in parallel.
  template <class Task>
  void forBatches(Task&& task) {
    pool_.run(static_cast<int>(batches_.size()),
              [&](int index, int) { task(batches_[static_cast<std::size_t>(index)]); });
  }
  double sumOfProducts() const {
    double sum = 0.0;
    for (const Batch& batch : batches_)
      if (!batch.framed) sum += batch.coupled.product;
    return sum;
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

  RodStep<Real> stepOf(Batch& batch, RodBatchWorkspace<Real>& workspace, const SolverSettings& settings,
                       const Real* springs) {
    return {batch.model,
            batch.roots,
            stage_->coefficients,
            settings,
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
            springs};
  }

  void solve(Batch& batch, RodBatchWorkspace<Real>& workspace) {
    if (batch.asleep) return;
    chooseScheme(batch);
    if (!batch.push.empty()) putPushIn(batch);
    // Conjugate gradients want the factors of all batches.
    if (bundles_) std::swap(workspace.factor, batch.coupled.factor);
    batch.report =
        kernel_(stepOf(batch, workspace, settings_,
                       bundles_ && !bundles_->empty() ? batch.coupled.springs.data() : nullptr));
    if (bundles_) std::swap(workspace.factor, batch.coupled.factor);
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
  SolverSettings settings_, energy_settings_ = settings_;
  bool has_paper_;
  int memory_steps_;  // from one call of relaxBends to the next
  int steps_ = 0;     // since place()
  int coupling_rounds_, coupling_iterations_;
  double coupling_tolerance_;
  std::unique_ptr<BundleContact<Real>> bundles_;  // null: the rods do not feel each other
  bool has_history_ = false;
  int search_interval_ = 1, steps_since_search_ = 0;
  std::array<double, 3> pivot_{};
  std::vector<Batch> batches_;
  std::vector<Place> place_;  // of each rod
  std::vector<RodBatchWorkspace<Real>> workspaces_;
  std::function<void(int, int)> solve_, step_, relax_;  // of a batch; step_ moves its roots first
};

}  // namespace

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
