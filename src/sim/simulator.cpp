#include "calligraphy_brush/sim/simulator.h"

#include <chrono>
#include <cmath>

#include "calligraphy_brush/ink/tip_ink.h"
#include "calligraphy_brush/sim/tuft.h"

namespace calligraphy_brush {
namespace {

/// Adds the wall time of a scope to a stage. Time is only ever reported: nothing depends on it.
class StageTimer {
 public:
  StageTimer(SimulatorReport& report, Stage stage)
      : seconds_(report.stage_seconds[static_cast<std::size_t>(stage)]), begin_(Clock::now()) {}
  ~StageTimer() { seconds_ += std::chrono::duration<double>(Clock::now() - begin_).count(); }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  double& seconds_;
  Clock::time_point begin_;
};

Eigen::Isometry3d toIsometry(const HandlePose& pose) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.linear() = pose.orientation.toRotationMatrix();
  X.translation() = pose.position;
  return X;
}

}  // namespace

const char* toString(Stage stage) {
  switch (stage) {
    case Stage::kMoveRoots: return "move_roots";
    case Stage::kSolveRods: return "solve_rods";
    case Stage::kTransferInk: return "transfer_ink";
    case Stage::kCount: break;
  }
  return "unknown";
}

struct Simulator::Implementation {
  Implementation(const SimulatorParameters& p, BrushModel b)
      : parameters(p),
        brush(std::move(b)),
        step_ns(std::llround(p.rods.time_step * 1e9)),
        tuft(makeTuft(brush, p.rods, p.contact)),
        track(p.motion),
        ink(brush, p.ink),
        paper(p.paper) {
    startReport();
  }

  void startReport() {
    report = SimulatorReport{};
    report.ink_capacity = ink.totalCapacity();
    report.ink_in_tip = ink.totalVolume();
  }

  void liftAll() {
    for (int rod = 0; rod < static_cast<int>(brush.rods.size()); ++rod) ink.lift(rod);
  }

  /// The time step, in order.
  void step() {
    time_ns += step_ns;
    moveRoots();
    solveRods();
    transferInk();
    ++report.step_count;
  }

  void moveRoots() {
    const StageTimer timer(report, Stage::kMoveRoots);
    handle = track.at(time_ns);
  }
  /// Where the handle was after a part of the step that ends now.
  Eigen::Isometry3d handleAfter(double part) const {
    return toIsometry(part == 1.0 ? handle
                                  : track.at(time_ns - std::llround((1.0 - part) * double(step_ns))));
  }

  void solveRods() {
    const StageTimer timer(report, Stage::kSolveRods);
    const TuftReport solved = tuft->stepAlong([this](double part) { return handleAfter(part); });
    report.rod_step_count += solved.solved_rods;
    report.iteration_count += solved.iterations;
    report.unconverged_count += solved.unconverged;
    report.last_iterations = solved.most_iterations;
  }

  void transferInk() {
    const StageTimer timer(report, Stage::kTransferInk);
    report.touching_rods = report.touching_nodes = 0;
    report.max_penetration = 0.0;
    for (int rod = 0; rod < static_cast<int>(brush.rods.size()); ++rod) {
      const RodOnPaper place = tuft->rodOnPaper(rod);
      report.touching_nodes += place.touching;
      report.touching_rods += place.touching > 0;
      report.max_penetration = std::max(report.max_penetration, -place.lowest);
      if (place.lowest > ink.reach(rod)) {
        ink.lift(rod);
      } else {
        tuft->readRod(rod, nodes);
        ink.transfer(rod, nodes, paper);
      }
    }
    report.ink_in_tip = ink.totalVolume();
  }

  SimulatorParameters parameters;
  BrushModel brush;
  std::int64_t step_ns;
  std::unique_ptr<Tuft> tuft;
  PoseTrack track;
  TipInk ink;
  Paper paper;
  SimulatorReport report;
  std::int64_t time_ns = 0;
  HandlePose handle;
  std::vector<Eigen::Vector3d> nodes;  // scratch
};

Simulator::Simulator(const SimulatorParameters& parameters) {
  checkParameters(parameters);
  implementation_ = std::make_unique<Implementation>(parameters, makeBrush(parameters.brush));
}

Simulator::Simulator(const SimulatorParameters& parameters, BrushModel brush) {
  checkParameters(parameters);
  implementation_ = std::make_unique<Implementation>(parameters, std::move(brush));
}

Simulator::~Simulator() = default;
Simulator::Simulator(Simulator&&) noexcept = default;
Simulator& Simulator::operator=(Simulator&&) noexcept = default;

PoseVerdict Simulator::addPose(const HandlePose& pose) {
  Implementation& s = *implementation_;
  const auto max_gap_ns = static_cast<std::int64_t>(s.parameters.motion.max_gap * 1e9);
  if (!s.track.empty() && pose.stamp_ns > s.track.newest().stamp_ns &&
      pose.stamp_ns - s.track.newest().stamp_ns > max_gap_ns &&
      s.track.checkAlone(pose) == PoseVerdict::kAccepted) {
    advance();
    s.track.clear();
  }
  const bool first = s.track.empty();
  const PoseVerdict verdict = s.track.add(pose);
  if (first && verdict == PoseVerdict::kAccepted) {
    s.handle = s.track.newest();
    s.time_ns = s.handle.stamp_ns;
    s.tuft->place(toIsometry(s.handle));
    s.liftAll();
  }
  return verdict;
}

int Simulator::advance() {
  Implementation& s = *implementation_;
  if (s.track.empty()) return 0;
  int steps = 0;
  for (; s.time_ns + s.step_ns <= s.track.newest().stamp_ns; ++steps) s.step();
  s.track.forgetBefore(s.time_ns);
  return steps;
}

void Simulator::dip() {
  implementation_->ink.dip();
  implementation_->report.ink_in_tip = implementation_->ink.totalVolume();
}

void Simulator::wipe() {
  implementation_->ink.wipe();
  implementation_->report.ink_in_tip = implementation_->ink.totalVolume();
}

void Simulator::clearPaper() {
  implementation_->paper.clear();
}

void Simulator::reset() {
  Implementation& s = *implementation_;
  s.track.clear();
  s.paper.clear();
  s.liftAll();
  s.ink.dip();
  s.handle = HandlePose{};
  s.time_ns = 0;
  s.tuft->place(Eigen::Isometry3d::Identity());
  s.startReport();
}

const SimulatorParameters& Simulator::parameters() const {
  return implementation_->parameters;
}
const BrushModel& Simulator::brush() const {
  return implementation_->brush;
}
const Paper& Simulator::paper() const {
  return implementation_->paper;
}
const SimulatorReport& Simulator::report() const {
  return implementation_->report;
}
std::int64_t Simulator::time_ns() const {
  return implementation_->time_ns;
}
HandlePose Simulator::handlePose() const {
  return implementation_->handle;
}

HandleWrench Simulator::handleWrench() const {
  Eigen::Matrix<double, 6, 1> sum = Eigen::Matrix<double, 6, 1>::Zero();
  for (int rod = 0; rod < rodCount(); ++rod) sum += implementation_->tuft->rodWrench(rod);
  return {sum.head<3>(), sum.tail<3>()};
}

int Simulator::rodCount() const {
  return static_cast<int>(implementation_->brush.rods.size());
}
int Simulator::nodeCount() const {
  return implementation_->brush.rods.front().nodeCount();
}

Eigen::Vector3d Simulator::nodePosition(int rod, int node) const {
  return implementation_->tuft->nodePosition(rod, node);
}
bool Simulator::nodeTouches(int rod, int node) const {
  return nodeContactForce(rod, node).z() > 0.0;
}
Eigen::Vector3d Simulator::nodeContactForce(int rod, int node) const {
  return implementation_->tuft->contactForce(rod, node);
}

double Simulator::rodInk(int rod) const {
  const double capacity = implementation_->ink.capacity(rod);
  return capacity > 0.0 ? implementation_->ink.volume(rod) / capacity : 0.0;
}

std::uint64_t Simulator::stateHash() const {
  const Implementation& s = *implementation_;
  std::uint64_t hash = s.tuft->hash(14695981039346656037ULL);
  for (int rod = 0; rod < rodCount(); ++rod) {
    const double volume = s.ink.volume(rod);
    hash = hashBytes(&volume, sizeof volume, hash);
  }
  for (int row = 0; row < s.paper.height_px(); ++row)
    hash =
        hashBytes(s.paper.row(row), sizeof(float) * static_cast<std::size_t>(s.paper.width_px()), hash);
  return hash;
}

std::string Simulator::kernelName() const {
  return implementation_->tuft->kernelName();
}

}  // namespace calligraphy_brush
