#include "calligraphy_brush/sim/simulator.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "calligraphy_brush/ink/capillary_flow.h"
#include "calligraphy_brush/ink/tip_ink.h"
#include "calligraphy_brush/sim/tip_shape.h"
#include "calligraphy_brush/sim/tuft.h"

namespace calligraphy_brush {
namespace {

// Of simulated time between two calls of Paper::flow(), which divides it as it must [s].
constexpr double kFlowInterval = 0.016;
// Flows along the rods of the tip for one between them, which is slower.
constexpr int kFlowsAcross = 4;

// Rods that touch rest where they move no further [m] in such a time [s]. They are given so long [s] to
// fall together, and to sag as the brush is held.
constexpr double kAtRest = 2e-5, kRestInterval = 0.02, kFallTime = 0.4, kSagTime = 0.1;

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
    case Stage::kFlowInk: return "flow_ink";
    case Stage::kFlowPaper: return "flow_paper";
    case Stage::kCount: break;
  }
  return "unknown";
}

struct Simulator::Implementation {
  Implementation(const SimulatorParameters& p, BrushModel b)
      : parameters(p),
        brush(std::move(b)),
        step_ns(std::llround(p.rods.time_step * 1e9)),
        flow_steps(std::max<std::int64_t>(1, std::llround(kFlowInterval * 1e9 / double(step_ns)))),
        tuft(makeTuft(brush, p.rods, p.contact)),
        track(p.motion),
        ink(brush, p.ink),
        capillary_flow(brush, p.ink),
        paper(p.paper),
        nodes(static_cast<std::size_t>(ink.nodeCount())),
        push(static_cast<std::size_t>(ink.nodeCount())) {
    tellInk();
    startReport();
  }

  void reportInk() {
    report.ink_in_tip = ink.totalVolume();
    report.pigment_in_tip = ink.totalPigment();
  }

  void startReport() {
    report = SimulatorReport{};
    report.ink_capacity = ink.totalCapacity();
    reportInk();
  }

  void clearPaper() {
    paper.clear();
    if (picture) picture->clear();
  }

  /// Puts the brush onto the handle, at rest: rods by themselves straight, those that touch in the shape
  /// that they take there in the air, from that which they have, if any. Straight ones are let fall
  /// together upright first, for how they do so hangs on a hair, or a rounding: so they are the same
  /// wherever they come down.
  void putDown(const Eigen::Isometry3d& X_PH, bool has_shape) {
    liftAll();
    const double high = 2.0 * brush.tip_length;
    const bool touches = parameters.contact.bundles;
    if (touches && !has_shape) {
      Eigen::Isometry3d upright = Eigen::Isometry3d::Identity();
      upright.translation().z() = high;
      tuft->place(upright);
      comeToRest(upright, kFallTime);
    }
    if (touches) {
      Eigen::Isometry3d above = X_PH;
      above.translation().z() += high;
      if (tuft->carry(above)) {
        comeToRest(above, kSagTime);
        tuft->carry(X_PH);
        return;
      }
    }
    tuft->place(X_PH);
  }

  void comeToRest(const Eigen::Isometry3d& X_PH, double longest) {
    const auto ends = [this] {
      std::vector<Eigen::Vector3d> places;
      for (int rod = 0; rod < static_cast<int>(brush.rods.size()); ++rod)
        places.push_back(tuft->nodePosition(rod, nodeCount() - 1));
      return places;
    };
    std::vector<Eigen::Vector3d> before = ends();
    for (double seconds = 0.0; seconds < longest; seconds += kRestInterval) {
      for (int k = 0; k < std::max(1, static_cast<int>(kRestInterval / parameters.rods.time_step)); ++k)
        tuft->step(X_PH);
      const std::vector<Eigen::Vector3d> now = ends();
      double moved = 0.0;
      for (std::size_t rod = 0; rod < now.size(); ++rod)
        moved = std::max(moved, (now[rod] - before[rod]).norm());
      if (moved < kAtRest) return;
      before = now;
    }
  }

  void liftAll() {
    for (int rod = 0; rod < static_cast<int>(brush.rods.size()); ++rod) ink.lift(rod);
  }

  /// Whether nothing is known of the way to a pose that is fit to be added: the brush is put down there.
  bool isNewStart(const HandlePose& pose) const {
    const MotionParameters& motion = parameters.motion;
    const HandlePose& before = track.newest();
    if (pose.stamp_ns <= before.stamp_ns) return false;
    const double gap = 1e-9 * static_cast<double>(pose.stamp_ns - before.stamp_ns);
    if (gap <= motion.hold_after) return false;
    const Eigen::Vector3d point_H(0.0, 0.0, -brush.tip_length);
    const Eigen::Vector3d point_P = pose.position + pose.orientation.normalized() * point_H;
    const Eigen::Vector3d point_before_P = before.position + before.orientation * point_H;
    const double moved =
        std::max((pose.position - before.position).norm(), (point_P - point_before_P).norm());
    return gap > motion.max_gap || moved > motion.hold_distance;
  }

  /// The time step, in order.
  void step() {
    time_ns += step_ns;
    moveRoots();
    solveRods();
    transferInk();
    flowInk();
    flowPaper();
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
    ink.pass(step_ns);
    const bool due = isDrawingDue();
    if (due) paper.beginContact();
    if (due && picture) picture->beginContact();
    bool transferred = false;
    for (int rod = 0; rod < static_cast<int>(brush.rods.size()); ++rod) {
      const RodOnPaper place = tuft->rodOnPaper(rod);
      report.touching_nodes += place.touching;
      report.touching_rods += place.touching > 0;
      report.max_penetration = std::max(report.max_penetration, -place.lowest);
      const bool is_near = place.lowest <= ink.reach(rod);
      const bool was_down = ink.isDown(rod);
      if (!is_near && !was_down) continue;
      if (!was_down) {
        tuft->readRod(rod, nodes);
        ink.touch(rod, nodes);
      } else if (due || !is_near) {
        tuft->readRod(rod, nodes);
        for (int node = 0; node < nodeCount(); ++node)
          push[static_cast<std::size_t>(node)] =
              place.touching > 0 ? tuft->contactForce(rod, node).z() : 0.0;
        ink.transfer(rod, nodes, push, paper, picture.get());
        transferred = true;
        if (!is_near) ink.lift(rod);
      }
    }
    if (transferred) reportInk();
  }

  /// Rods are drawn when the brush has moved so far or so much time has passed, all together. What a rod
  /// sweeps in between is filled exactly, so this depends on neither time step nor resolution.
  bool isDrawingDue() {
    constexpr double kDrawnWay = 1.5e-3;  // [m]
    constexpr std::int64_t kDrawnTime_ns = 7500000;
    const double turn = brush.tip_length * handle.orientation.angularDistance(drawn.orientation);
    const bool due = time_ns - drawn.stamp_ns >= kDrawnTime_ns || time_ns < drawn.stamp_ns ||
                     (handle.position - drawn.position).norm() + turn >= kDrawnWay;
    if (due) {
      drawn = handle;
      drawn.stamp_ns = time_ns;
    }
    return due;
  }
  int nodeCount() const { return ink.nodeCount(); }

  bool isFlowDue() const { return (report.step_count + 1) % flow_steps == 0; }
  double flowSeconds() const { return 1e-9 * static_cast<double>(flow_steps * step_ns); }

  void flowInk() {
    if (!isFlowDue()) return;
    const StageTimer timer(report, Stage::kFlowInk);
    capillary_flow.flowAlong(flowSeconds(), ink);
    if ((report.step_count + 1) % (kFlowsAcross * flow_steps) == 0)
      capillary_flow.flowAcross(kFlowsAcross * flowSeconds(), ink);
    tellInk();
  }
  /// Lets the rods know the ink by which they cling and get soft.
  void tellInk() {
    const RodParameters& rods = parameters.rods;
    if (!parameters.contact.bundles && rods.wet_stiffness == 1.0 && rods.wet_memory == 0.0) return;
    saturation.resize(ink.volume().size());
    for (std::size_t i = 0; i < saturation.size(); ++i)
      saturation[i] = ink.capacity()[i] > 0.0 ? ink.volume()[i] / ink.capacity()[i] : 0.0;
    tuft->setInk(saturation);
  }

  void flowPaper() {
    const StageTimer timer(report, Stage::kFlowPaper);
    if (!isFlowDue()) return;
    paper.flow(flowSeconds());
    if (picture) picture->flow(flowSeconds());
  }

  SimulatorParameters parameters;
  BrushModel brush;
  std::int64_t step_ns;
  std::int64_t flow_steps;  // after which the sheet is moved on
  std::unique_ptr<Tuft> tuft;
  PoseTrack track;
  TipInk ink;
  CapillaryFlow capillary_flow;
  Paper paper;
  std::unique_ptr<Paper> picture;  // see drawAlsoAt
  SimulatorReport report;
  std::int64_t time_ns = 0;
  HandlePose handle;
  HandlePose drawn;                    // when rods were last drawn
  std::vector<Eigen::Vector3d> nodes;  // scratch
  std::vector<double> push;            // scratch
  std::vector<double> saturation;      // scratch
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
  bool after_gap = false;
  if (!s.track.empty() && s.track.checkAlone(pose) == PoseVerdict::kAccepted && s.isNewStart(pose)) {
    advance();
    s.track.clear();
    after_gap = true;
  }
  const bool first = s.track.empty();
  // A tuft that is put down where its point would be below the sheet is spread by it as no brush is: it
  // comes from above, in half of the time that a hold takes at least.
  if (after_gap) {
    const double point =
        (pose.position - pose.orientation.normalized() * Eigen::Vector3d(0.0, 0.0, s.brush.tip_length))
            .z();
    HandlePose above = pose;
    above.stamp_ns -= std::llround(0.5e9 * s.parameters.motion.hold_after);
    above.position.z() -= point;
    if (point < 0.0 && s.track.add(above) == PoseVerdict::kAccepted &&
        s.track.add(pose) != PoseVerdict::kAccepted)
      s.track.clear();
  }
  const PoseVerdict verdict = s.track.empty() ? s.track.add(pose)
                              : first         ? PoseVerdict::kAccepted
                                              : s.track.add(pose);
  if (first && verdict == PoseVerdict::kAccepted) {
    s.handle = s.track.oldest();
    s.time_ns = s.handle.stamp_ns;
    s.drawn = s.handle;
    s.putDown(toIsometry(s.handle), after_gap);
  }
  return verdict;
}

int Simulator::advance() {
  return advanceTo(std::numeric_limits<std::int64_t>::max());
}

int Simulator::advanceTo(std::int64_t stamp_ns) {
  Implementation& s = *implementation_;
  if (s.track.empty()) return 0;
  const std::int64_t end_ns = std::min(stamp_ns, s.track.newest().stamp_ns);
  int steps = 0;
  for (; s.time_ns + s.step_ns <= end_ns; ++steps) s.step();
  s.track.forgetBefore(s.time_ns);
  return steps;
}

void Simulator::drawAlsoAt(double px_per_mm) {
  SimulatorParameters parameters = implementation_->parameters;
  parameters.paper.px_per_mm = px_per_mm;
  checkParameters(parameters);
  implementation_->picture = std::make_unique<Paper>(parameters.paper);
}

void Simulator::dip() {
  implementation_->ink.dip();
  implementation_->tellInk();
  implementation_->reportInk();
}

void Simulator::wipe() {
  implementation_->ink.wipe();
  implementation_->tellInk();
  implementation_->reportInk();
}

void Simulator::clearPaper() {
  implementation_->clearPaper();
}

void Simulator::reset() {
  Implementation& s = *implementation_;
  s.track.clear();
  s.clearPaper();
  s.liftAll();
  s.ink.dip();
  s.tellInk();
  s.handle = s.drawn = HandlePose{};
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
const Paper& Simulator::picture() const {
  const Implementation& s = *implementation_;
  return s.picture ? *s.picture : s.paper;
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

double Simulator::nodeInk(int rod, int node) const {
  const TipInk& ink = implementation_->ink;
  const auto at = static_cast<std::size_t>(rod * ink.nodeCount() + node);
  return ink.capacity()[at] > 0.0 ? ink.volume()[at] / ink.capacity()[at] : 0.0;
}

double Simulator::rodInk(int rod) const {
  const double capacity = implementation_->ink.rodCapacity(rod);
  return capacity > 0.0 ? implementation_->ink.rodVolume(rod) / capacity : 0.0;
}

TipShape Simulator::tipShape() const {
  const Implementation& s = *implementation_;
  return findTipShape(s.brush, *s.tuft);
}

std::uint64_t Simulator::stateHash() const {
  const Implementation& s = *implementation_;
  std::uint64_t hash = s.tuft->hash(14695981039346656037ULL);
  for (const auto* field : {&s.ink.volume(), &s.ink.pigment()})
    hash = hashBytes(field->data(), sizeof(double) * field->size(), hash);
  hash = s.paper.hash(hash);
  return hash;
}

std::string Simulator::kernelName() const {
  return implementation_->tuft->kernelName();
}

}  // namespace calligraphy_brush
