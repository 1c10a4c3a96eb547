#include "calligraphy_brush/sim/tuft.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include "bundle_coupling.h"
#include "calligraphy_brush/common/thread_pool.h"
#include "calligraphy_brush/rods/wet_hair.h"
#include "calligraphy_brush/sim/projection_tuft.h"
#include "calligraphy_brush/sim/rod_step.h"
#include "tuft_batch.h"

namespace calligraphy_brush {
namespace {

/// What wet hair remembers goes on about so often [s], and at least once in so many steps.
constexpr double kMemoryInterval = 8e-3;
constexpr double kMemorySteps = 16;

std::vector<StageOfStep> makeStages(const std::string& scheme, const RodParameters& rods) {
  const double h = rods.time_step, c = rods.damping, g = kSdirk2Gamma;
  if (scheme == "bdf2") return {{1.0, 1.0, 1.0, true, bdf2(h, c), calmStep(h, c)}};
  if (scheme == "sdirk2")
    return {{g, g, g / (1 - g), true, backwardEuler(g * h, c), backwardEuler(g * h, c)},
            {1.0, 1 - g, (1 - g) / g, false, sdirk2SecondStage(h, c), backwardEuler((1 - g) * h, c)}};
  return {{1.0, 1.0, 1.0, true, backwardEuler(h, c), backwardEuler(h, c)}};
}

template <class Real>
class TuftOf : public Tuft {
 public:
  TuftOf(const BrushModel& brush, const RodParameters& rods, const ContactParameters& contact)
      : brush_(brush),
        pool_(rods.threads),
        clamp_(rods.clamp == "half" ? ClampRule::kHalf : ClampRule::kCorrected),
        sleep_(rods.sleep),
        stages_(makeStages(rods.scheme, rods)),
        first_stages_(makeStages(rods.scheme == "bdf2" ? "backward_euler" : rods.scheme, rods)),
        solver_{findRodStepKernel(rods.instruction_set),
                rods.bending_law == "tangent" ? kTangentLaw
                : rods.bending_law == "arc"   ? kArcLaw
                                              : kSineLaw,
                rods.gravity,
                {rods.tolerance, rods.max_iterations, contact.tolerance, contact.multiplier_updates},
                contact.paper,
                {}},
        memory_steps_(static_cast<int>(
            std::clamp(std::floor(kMemoryInterval / rods.time_step), 1.0, kMemorySteps))) {
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
    if (contact.bundles && brush_.rods.size() > 1)
      coupling_ =
          std::make_unique<BundleCoupling<Real>>(brush_, rods, contact, batches_, solver_, pool_);
    for (int thread = 0; thread < pool_.threadCount(); ++thread)
      solver_.workspaces.push_back(makeRodBatchWorkspace<Real>(brush_.rods.front().nodeCount()));
    step_ = [this](int index, int thread) {
      moveRoots(batches_[static_cast<std::size_t>(index)], X_PH_, false);
      solver_.solve(batches_[static_cast<std::size_t>(index)], thread, nullptr);
    };
    relax_ = [this](int index, int) { relaxBends(batches_[static_cast<std::size_t>(index)]); };
  }

  void place(const Eigen::Isometry3d& X_PH) override {
    X_PH_ = X_PH;
    for (Batch& batch : batches_) {
      batch.wake();
      moveRoots(batch, X_PH, true);
      placeAtRest(batch.model, batch.roots, batch.state, batch.framed.get());
      batch.leavePaper();
      batch.push.clear();
      forgetBends(batch.framed.get(), batch.hair);
    }
    steps_ = 0;
    if (coupling_) coupling_->forget();
    has_history_ = false;
  }

  bool carry(const Eigen::Isometry3d& X_PH) override {
    const Eigen::Isometry3d motion = X_PH * X_PH_.inverse();
    X_PH_ = X_PH;
    for (Batch& batch : batches_) {
      batch.wake();
      moveRoots(batch, X_PH, true);
      carryShape(motion, batch.model, batch.roots, batch.state, batch.framed.get());
      batch.leavePaper();
      turnBends(motion.linear(), batch.hair);
      batch.push.clear();
      if (batch.hair.is_bent && !batch.framed) sumLoads(batch);
    }
    if (coupling_) coupling_->turn(motion.linear());
    has_history_ = false;
    return true;
  }

  void moveEnd(int rod, const Eigen::Isometry3d& X_PE) override {
    const Place& place = placeOf(rod);
    if (!brush_.rods[static_cast<std::size_t>(rod)].end_clamped)
      throw std::invalid_argument("rod " + std::to_string(rod) + " has no far clamp");
    batches_[place.batch].wake();
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
    if (!handle_rests || (coupling_ && !allAsleep()))
      for (Batch& batch : batches_)
        if (!handle_rests || batch.asleep) batch.wake();
    if (remembers() && steps_++ % memory_steps_ == 0)
      pool_.run(static_cast<int>(batches_.size()), relax_);
    for (std::size_t i = 0; i < stages.size(); ++i) {
      solver_.stage = &stages[i];
      X_PH_ = poses[i];
      solver_.pivot = {X_PH_.translation().x(), X_PH_.translation().y(), X_PH_.translation().z()};
      report.coupling_error = 0.0;
      if (coupling_ && !allAsleep()) {
        for (Batch& batch : batches_) moveRoots(batch, X_PH_, false);
        coupling_->solve(report);
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
      if (coupling_ && !allAsleep())
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
      if (soak(batch.rods, saturation, batch.hair, batch.model, batch.framed.get())) batch.wake();
    if (coupling_ && coupling_->setInk(saturation))
      for (Batch& batch : batches_) batch.wake();
  }
  int groups(double part, std::vector<int>& group_of_rod) const override {
    if (!coupling_) return Tuft::groups(part, group_of_rod);
    const int n = coupling_->contact().node_count;
    return findGroups(
        coupling_->contact(), std::min(n - 1, static_cast<int>((1.0 - part) * n)),
        [this](int rod, int node) { return nodePosition(rod, node); }, group_of_rod);
  }

  void setNodeForce(int rod, int node, const Eigen::Vector3d& force) override {
    const Place& place = placeOf(rod);
    Batch& batch = batches_[place.batch];
    batch.wake();
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
  const char* kernelName() const override { return solver_.kernel.name; }

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
    if (coupling_) seed = coupling_->hash(seed);
    const int phase = steps_ % memory_steps_;
    return remembers() ? hashBytes(&phase, sizeof phase, seed) : seed;
  }

 private:
  using Batch = TuftBatch<Real>;

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
    const bool moves = relax(solver_.law, batch.model, batch.roots, director.data(), batch.state,
                             batch.framed.get(), batch.hair);
    if (moves) batch.still_steps = 0;
    if (batch.hair.is_bent && !batch.framed) sumLoads(batch);
  }

  BrushModel brush_;
  ThreadPool pool_;
  ClampRule clamp_;
  double sleep_;                                    // see RodParameters
  std::vector<StageOfStep> stages_, first_stages_;  // the first are those of a step without history
  Eigen::Isometry3d X_PH_ = Eigen::Isometry3d::Identity();
  StageSolver<Real> solver_;
  int memory_steps_;  // from one call of relaxBends to the next
  int steps_ = 0;     // since place()
  bool has_history_ = false;
  std::vector<Batch> batches_;
  std::vector<Place> place_;                        // of each rod
  std::unique_ptr<BundleCoupling<Real>> coupling_;  // null: the rods do not feel each other
  std::function<void(int, int)> step_, relax_;      // of a batch; step_ moves its roots first
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
