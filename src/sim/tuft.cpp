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

/// A minimisation of a time step, and the part of the step at which it ends.
struct StageOfStep {
  double end;
  StepCoefficients coefficients;
};

std::vector<StageOfStep> makeStages(const std::string& scheme, const RodParameters& rods) {
  const double h = rods.time_step, c = rods.damping;
  if (scheme == "bdf2") return {{1.0, bdf2(h, c)}};
  if (scheme == "sdirk2")
    return {{kSdirk2Gamma, backwardEuler(kSdirk2Gamma * h, c)}, {1.0, sdirk2SecondStage(h, c)}};
  return {{1.0, backwardEuler(h, c)}};
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
        stages_(makeStages(rods.scheme, rods)),
        first_stages_(makeStages(rods.scheme == "bdf2" ? "backward_euler" : rods.scheme, rods)),
        settings_{rods.tolerance, rods.max_iterations, contact.tolerance, contact.multiplier_updates},
        has_paper_(contact.paper) {
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
      std::fill(batch.contact.engaged.begin(), batch.contact.engaged.end(), char(0));
      batch.load.clear();
      lookAtPaper(batch);
    }
    has_history_ = false;
  }

  void moveEnd(int rod, const Eigen::Isometry3d& X_PE) override {
    const Place& place = placeOf(rod);
    if (!brush_.rods[static_cast<std::size_t>(rod)].end_clamped)
      throw std::invalid_argument("rod " + std::to_string(rod) + " has no far clamp");
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
    for (const StageOfStep& stage : has_history_ ? stages_ : first_stages_) {
      stage_ = &stage;
      X_PH_ = X_PH(stage.end);
      pivot_ = {X_PH_.translation().x(), X_PH_.translation().y(), X_PH_.translation().z()};
      for (std::size_t b = 0; b < batches_.size(); ++b) moveRoots(b, X_PH_, false);
      pool_.run(static_cast<int>(batches_.size()), solve_);
      report.solved_rods = 0;
      for (const Batch& batch : batches_) {
        report.solved_rods += batch.model.rod_count;
        report.iterations += batch.report.iterations;
        report.most_iterations = std::max(report.most_iterations, batch.report.most_iterations);
        report.unconverged += batch.report.unconverged;
      }
    }
    has_history_ = true;
    return report;
  }

  void setNodeForce(int rod, int node, const Eigen::Vector3d& force) override {
    const Place& place = placeOf(rod);
    Batch& batch = batches_[place.batch];
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
            &batch.state.previous_velocity, &batch.contact.multiplier, &batch.contact.offset})
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
    AlignedVector<Real> load;  // on nodes [N], [node][3][lane]; empty where there is none
    // In the handle frame, and the roots in the paper frame; double, since the way of a step is a
    // small difference. [component][lane]
    std::array<double, 3 * kLanes> root_H, clamp_H, root_position;
    std::array<Real, kLanes> lowest;
    std::array<int, kLanes> touching;
    SolveReport report;
  };

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

  void solve(Batch& batch, RodBatchWorkspace<Real>& workspace) {
    const StepCoefficients& coefficients = stage_->coefficients;
    addLoad(batch, coefficients, Real(1), batch.state.velocity);
    batch.report =
        kernel_(RodStep<Real>{batch.model, batch.roots, coefficients, settings_, law_, gravity_,
                              pivot_.data(), has_paper_ ? &batch.contact : nullptr, batch.framed.get(),
                              batch.state, workspace, batch.wrench.data()});
    addLoad(batch, coefficients, Real(-1), batch.state.previous_velocity);
    if (coefficients.from_velocity != 0.0)
      addLoad(batch, coefficients, static_cast<Real>(-coefficients.from_velocity), batch.state.velocity);
    lookAtPaper(batch);
  }

  /// A load F moves a node's target by F/(m · inertia), and so does a change of the velocity that the
  /// step starts from by F/(m · inertia · velocity). Put in before the step and taken out of the
  /// history after it, it costs the kernel nothing.
  static void addLoad(const Batch& batch, const StepCoefficients& coefficients, Real factor,
                      AlignedVector<Real>& velocity) {
    const Real scale = factor / static_cast<Real>(coefficients.inertia * coefficients.velocity);
    for (std::size_t i = 0; i < batch.load.size(); ++i)
      if (batch.load[i] != Real(0))
        velocity[i] += scale * batch.load[i] / batch.model.mass[i / (3 * kLanes) * kLanes + i % kLanes];
  }

  static void lookAtPaper(Batch& batch) {
    const bool engaged = std::any_of(batch.contact.engaged.begin(), batch.contact.engaged.end(),
                                     [](char lanes) { return lanes != 0; });
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
  std::vector<StageOfStep> stages_, first_stages_;  // the first are those of a step without history
  const StageOfStep* stage_ = nullptr;              // that is solved now
  Eigen::Isometry3d X_PH_ = Eigen::Isometry3d::Identity();
  SolverSettings settings_;
  bool has_paper_;
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
