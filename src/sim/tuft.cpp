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
#include "calligraphy_brush/sim/projection_tuft.h"
#include "calligraphy_brush/sim/rod_step.h"

namespace calligraphy_brush {
namespace {

/// Relative speed of touching rods at which friction is fully there [m/s].
constexpr double kSlipSpeed = 1e-3;

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
        coupling_rounds_(contact.coupling_rounds),
        coupling_tolerance_(contact.coupling_tolerance) {
    // Rods that need material frames are kept apart: the others are far cheaper.
    place_.resize(brush_.rods.size());
    for (const bool framed : {false, true}) {
      std::vector<int> indices;
      for (std::size_t rod = 0; rod < brush_.rods.size(); ++rod)
        if (brush_.rods[rod].needsFrames() == framed) indices.push_back(static_cast<int>(rod));
      for (std::size_t first = 0; first < indices.size(); first += kLanes) {
        const auto end =
            indices.begin() + static_cast<std::ptrdiff_t>(std::min(first + kLanes, indices.size()));
        addBatch({indices.begin() + static_cast<std::ptrdiff_t>(first), end}, framed, contact);
      }
    }
    if (contact.bundles && brush_.rods.size() > 1) tie(rods, contact);
    for (int thread = 0; thread < pool_.threadCount(); ++thread)
      workspaces_.push_back(makeRodBatchWorkspace<Real>(brush_.rods.front().nodeCount()));
    solve_ = [this](int index, int thread) {
      solve(batches_[static_cast<std::size_t>(index)], workspaces_[static_cast<std::size_t>(thread)]);
    };
  }

  void place(const Eigen::Isometry3d& X_PH) override {
    X_PH_ = X_PH;
    for (std::size_t b = 0; b < batches_.size(); ++b) {
      Batch& batch = batches_[b];
      moveRoots(b, X_PH, true);
      placeAtRest(batch.model, batch.roots, batch.state, batch.framed.get());
      for (auto* field : {&batch.contact.multiplier, &batch.contact.offset, &batch.contact.force})
        std::fill(field->begin(), field->end(), Real(0));
      std::fill(batch.wrench.begin(), batch.wrench.end(), Real(0));
      for (auto* flags : {&batch.contact.engaged, &batch.contact.stuck})
        std::fill(flags->begin(), flags->end(), Real(0));
      batch.load.clear();
      wake(batch);
      lookAtPaper(batch);
    }
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
    for (std::size_t i = 0; i < stages.size(); ++i) {
      stage_ = &stages[i];
      X_PH_ = poses[i];
      pivot_ = {X_PH_.translation().x(), X_PH_.translation().y(), X_PH_.translation().z()};
      for (std::size_t b = 0; b < batches_.size(); ++b)
        if (!batches_[b].asleep) moveRoots(b, X_PH_, false);
      report.coupling_error = 0.0;
      if (bundles_)
        solveTogether(report);
      else
        pool_.run(static_cast<int>(batches_.size()), solve_);
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
    return wrench;
  }
  RodOnPaper rodOnPaper(int rod) const override {
    const Batch& batch = batchOf(rod);
    const std::size_t lane = placeOf(rod).lane;
    return {double(batch.lowest[lane]), batch.touching[lane]};
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
    return seed;
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
    AlignedVector<Real> load;  // on nodes [N], [node][3][lane]; empty where there is none
    // In the handle frame, and the roots in the paper frame; double, since the way of a step is a
    // small difference. [component][lane]
    std::array<double, 3 * kLanes> root_H, clamp_H, root_position;
    std::array<Real, kLanes> lowest;
    std::array<int, kLanes> touching;
    SolveReport report;
    AlignedVector<Real> springs;  // what ties the rods to others, see NodeSprings
    RodBatchState<Real> start;    // the state before a solve that may have to be done again
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

  void addBatch(const std::vector<int>& rods, bool framed, const ContactParameters& contact) {
    Batch batch;
    batch.rods = rods;
    batch.model = makeRodBatchModel<Real>(brush_.rods, rods, clamp_);
    batch.state = makeRodBatchState(batch.model);
    batch.roots = makeRodBatchRoots<Real>();
    if (framed)
      batch.framed = std::make_unique<FramedRods<Real>>(makeFramedRods<Real>(brush_.rods, rods, clamp_));
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

  void moveRoots(std::size_t b, const Eigen::Isometry3d& X_PH, bool placing) {
    Batch& batch = batches_[b];
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
        R.col(0) = (rod.director_H - rod.director_H.dot(rod.direction_H) * rod.direction_H).normalized();
        R.col(1) = R.col(2).cross(R.col(0));
        writeRotation(X_PH.linear() * R, lane, batch.framed->clamp_frame);
      }
  }

  /// Lets the rods feel each other.
  void tie(const RodParameters& rods, const ContactParameters& contact) {
    bundles_ = std::make_unique<BundleContact<Real>>(makeBundleContact<Real>(brush_, contact));
    bundles_->slip = kSlipSpeed * rods.time_step;
    for (Batch& batch : batches_) {
      batch.springs.resize(static_cast<std::size_t>(batch.model.node_count * 9 * kLanes));
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
  /// that they go on as they did, all at once; then once more with what they did, until beliefs and
  /// deeds agree. The springs that a rod feels lie above the coupled energy, so every round lowers it
  /// (see BundleContact), and the rounds end at its minimum.
  void solveTogether(TuftReport& report) {
    BundleContact<Real>& bundles = *bundles_;
    for (Batch& batch : batches_)
      forEachNode(batch, [&](std::size_t node, std::size_t lane, std::size_t at) {
        for (std::size_t i = 0; i < 3; ++i) {
          const std::size_t in = (node * 3 + i) * kLanes + lane;
          const Real way = node == 0 ? batch.roots.displacement[i * kLanes + lane]
                                     : static_cast<Real>(stage_->end) * batch.state.displacement[in];
          bundles.way[4 * at + i] = way;
          bundles.point[4 * at + i] = batch.state.position[in] + way;
        }
      });
    if (pairsAreStale(bundles)) findPairs(bundles);
    for (Batch& batch : batches_) batch.state.guess.clear();
    if (bundles.empty()) {
      pool_.run(static_cast<int>(batches_.size()), solve_);
      return;
    }
    for (Batch& batch : batches_) keepStart(batch);
    for (int round = 0;; ++round) {
      kernel_.pull(bundles);
      for (Batch& batch : batches_) writeSprings(bundles, batch.rods, batch.springs.data());
      pool_.run(static_cast<int>(batches_.size()), solve_);
      Real largest = 0;
      for (Batch& batch : batches_)
        forEachNode(batch, [&](std::size_t node, std::size_t lane, std::size_t at) {
          for (std::size_t i = 0; i < 3; ++i) {
            const std::size_t in = (node * 3 + i) * kLanes + lane;
            const Real way = batch.state.displacement[in];
            largest = std::max(largest, std::abs(way - bundles.way[4 * at + i]));
            bundles.way[4 * at + i] = way;
            bundles.point[4 * at + i] = batch.state.position[in];
          }
        });
      report.coupling_error = double(largest);
      report.coupling_rounds = round + 1;
      if (report.coupling_error < coupling_tolerance_ || round + 1 == coupling_rounds_) return;
      for (Batch& batch : batches_) {
        report.iterations += batch.report.iterations;
        backToStart(batch);
      }
    }
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

  void solve(Batch& batch, RodBatchWorkspace<Real>& workspace) {
    if (batch.asleep) return;
    // All stages of a step by the same scheme.
    if (stage_->end < 1.0 || stages_.size() == 1)
      std::copy(batch.contact.stuck.begin(), batch.contact.stuck.end(), batch.calm.begin());
    addLoad(
        batch, [](const StepCoefficients&) { return 1.0; }, batch.state.velocity);
    batch.report = kernel_(
        RodStep<Real>{batch.model, batch.roots, stage_->coefficients, settings_, law_, gravity_,
                      pivot_.data(), has_paper_ ? &batch.contact : nullptr, batch.framed.get(),
                      batch.state, workspace, batch.wrench.data(), &stage_->calm, batch.calm.data(),
                      bundles_ && !bundles_->empty() ? batch.springs.data() : nullptr});
    addLoad(
        batch, [](const StepCoefficients& k) { return k.restart - 1.0; }, batch.state.previous_velocity);
    addLoad(
        batch, [](const StepCoefficients& k) { return -k.from_velocity; }, batch.state.velocity);
    lookAtPaper(batch);
  }

  /// A load F moves a node's target by F/(m · inertia), and so does a change of the velocity that the
  /// step starts from by F/(m · inertia · velocity). Put in before the step and taken out of the
  /// history after it, it costs the kernel nothing. `part`: of it, by the coefficients.
  template <class Part>
  void addLoad(const Batch& batch, Part part, AlignedVector<Real>& velocity) const {
    const auto factor = [&](const StepCoefficients& k) {
      return static_cast<Real>(part(k) / (k.inertia * k.velocity));
    };
    const Real usual = factor(stage_->coefficients), calm = factor(stage_->calm);
    for (std::size_t i = 0; i < batch.load.size(); ++i)
      if (batch.load[i] != Real(0))
        velocity[i] += (batch.calm[i % kLanes] != Real(0) ? calm : usual) * batch.load[i] /
                       batch.model.mass[i / (3 * kLanes) * kLanes + i % kLanes];
  }

  static void lookAtPaper(Batch& batch) {
    const bool engaged = std::any_of(batch.contact.engaged.begin(), batch.contact.engaged.end(),
                                     [](Real lane) { return lane != 0; });
    std::array<Real, kLanes>
        lowest;  // apart from the positions, so that loops are compiled to registers
    std::array<int, kLanes> touching;
    lowest.fill(std::numeric_limits<Real>::max());
    touching.fill(0);
    for (int node = 0; node < batch.model.node_count; ++node) {
      const Real* z = batch.state.position.data() + (node * 3 + 2) * kLanes;
      const Real* push = batch.contact.force.data() + (node * 3 + 2) * kLanes;
      for (std::size_t lane = 0; lane < kLanes; ++lane)
        lowest[lane] = z[lane] < lowest[lane] ? z[lane] : lowest[lane];
      if (!engaged) continue;
      for (std::size_t lane = 0; lane < kLanes; ++lane) touching[lane] += push[lane] > 0;
    }
    batch.lowest = lowest;
    batch.touching = touching;
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
  bool has_paper_;
  int coupling_rounds_;
  double coupling_tolerance_;
  std::unique_ptr<BundleContact<Real>> bundles_;  // null: the rods do not feel each other
  bool has_history_ = false;
  std::array<double, 3> pivot_{};
  std::vector<Batch> batches_;
  std::vector<Place> place_;  // of each rod
  std::vector<RodBatchWorkspace<Real>> workspaces_;
  std::function<void(int, int)> solve_;
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
