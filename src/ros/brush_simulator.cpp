#include "calligraphy_brush/ros/brush_simulator.h"

#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/callback_queue_interface.h>
#include <std_srvs/Trigger.h>
#include <tf2/exceptions.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <iterator>
#include <memory>
#include <sstream>
#include <utility>

#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/ros/ros_parameters.h"

namespace calligraphy_brush {
namespace {

// Every pose is part of the stroke: deep enough for 80 s at 125 Hz.
constexpr std::uint32_t kPoseQueue = 10000;
constexpr double kTfRetryPeriod = 0.005;   // [s]
constexpr double kWarningPeriod = 1.0;     // [s]
constexpr double kDiagnosticPeriod = 1.0;  // [s]
constexpr double kTolerableBacklog = 0.2;  // [s]

/// A function as an entry of a callback queue.
class FunctionCallback : public ros::CallbackInterface {
 public:
  explicit FunctionCallback(std::function<void()> function) : function_(std::move(function)) {}
  CallResult call() override {
    function_();
    return Success;
  }

 private:
  std::function<void()> function_;
};

BrushSimulatorParameters readCheckedParameters(const ros::NodeHandle& private_node) {
  const std::string& ns = private_node.getNamespace();
  auto parameters = readParameters<BrushSimulatorParameters>(private_node);
  // tf2 knows no empty frames and none with a leading slash, which tf took.
  std::vector<std::string> problems;
  for (const auto& [name, frame] : {std::make_pair("paper_frame", parameters.ros.paper_frame),
                                    std::make_pair("handle_frame", parameters.ros.handle_frame)})
    if (frame.empty() || frame.front() == '/')
      problems.push_back(ns + "/ros/" + name + " = \"" + frame +
                         "\" is not a frame name: it must not be empty nor begin with a slash");
  if (parameters.ros.paper_frame == parameters.ros.handle_frame)
    problems.push_back(ns + "/ros/handle_frame = \"" + parameters.ros.handle_frame +
                       "\" is the paper's frame as well");
  if (!problems.empty()) throw ParameterError(problems);
  return parameters;
}

/// What the simulator itself refuses, by full name.
Simulator makeSimulator(const SimulatorParameters& parameters, const std::string& ns) {
  try {
    return Simulator(parameters);
  } catch (const ParameterError& error) {
    auto problems = error.problems();
    for (auto& problem : problems) problem.insert(0, ns + "/");
    throw ParameterError(problems);
  }
}

std::string describePose(const HandlePose& pose) {
  std::ostringstream text;
  text << "stamp " << toRosTime(pose.stamp_ns) << " s, position (" << pose.position.x() << ", "
       << pose.position.y() << ", " << pose.position.z() << ") m, orientation xyzw ("
       << pose.orientation.x() << ", " << pose.orientation.y() << ", " << pose.orientation.z() << ", "
       << pose.orientation.w() << ")";
  return text.str();
}

}  // namespace

double BrushSimulator::Pace::factorSince(const Pace& before) const {
  return wall > before.wall ? (simulated - before.simulated) / (wall - before.wall) : 0.0;
}

BrushSimulator::BrushSimulator(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                               const std::string& name)
    : node_(node),
      private_node_(private_node),
      name_(name),
      parameters_(readCheckedParameters(private_node)),
      simulator_(makeSimulator(parameters_.simulator, private_node.getNamespace())),
      tf_listener_(tf_buffer_, node_),
      image_transport_(node_),
      diagnostics_(node_, private_node_, name_) {
  const bool latch = true;
  image_publisher_ = image_transport_.advertise("stroke_image", 1, latch);
  map_publisher_ = node_.advertise<nav_msgs::OccupancyGrid>("paper_map", 1, latch);
  marker_publisher_ = node_.advertise<visualization_msgs::MarkerArray>("tip_markers", 1, latch);
  wrench_publisher_ = node_.advertise<geometry_msgs::WrenchStamped>("handle_wrench", 100);
  state_publisher_ = node_.advertise<BrushState>("brush_state", 10);

  offerService("clear_paper", [this] {
    simulator_.clearPaper();
    return std::string("the sheet is clean");
  });
  offerService("dip_brush", [this] {
    simulator_.dip();
    return std::string("the tip is full of ink");
  });
  offerService("wipe_brush", [this] {
    simulator_.wipe();
    return std::string("the tip has no ink");
  });
  offerService("reset", [this] {
    reset();
    return std::string("clean sheet, dipped brush, no poses");
  });
  offerService("save_image", [this] { return saveImage(); });

  diagnostics_.setHardwareID("none");
  diagnostics_.add("brush", this, &BrushSimulator::diagnose);

  const auto every = [this](double period, void (BrushSimulator::*publish)()) {
    timers_.push_back(node_.createWallTimer(
        ros::WallDuration(period), [this, publish](const ros::WallTimerEvent&) { (this->*publish)(); }));
  };
  every(1.0 / parameters_.ros.image_rate, &BrushSimulator::publishPictures);
  every(1.0 / parameters_.ros.marker_rate, &BrushSimulator::publishBrush);
  every(1.0 / parameters_.ros.state_rate, &BrushSimulator::publishState);
  timers_.push_back(
      node_.createWallTimer(ros::WallDuration(kDiagnosticPeriod),
                            [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); }));
  tf_retry_timer_ = node_.createWallTimer(
      ros::WallDuration(kTfRetryPeriod), [this](const ros::WallTimerEvent&) { work(); }, false, false);

  // Last: poses may come from here on.
  pose_subscriber_ = node_.subscribe("handle_pose", kPoseQueue, &BrushSimulator::receivePose, this,
                                     ros::TransportHints().tcpNoDelay());
  ROS_INFO_STREAM(name_ << ": " << simulator_.rodCount() << " rods of " << simulator_.nodeCount()
                        << " nodes on " << simulator_.paper().width_px() << " x "
                        << simulator_.paper().height_px() << " px, kernel " << simulator_.kernelName()
                        << ", waiting for poses on " << pose_subscriber_.getTopic());
}

BrushSimulator::~BrushSimulator() {
  // A nodelet is unloaded from another thread. Each of these waits for what is running; that may have
  // started the other once more, hence twice.
  is_closing_ = true;
  pose_subscriber_.shutdown();
  for (int pass = 0; pass < 2; ++pass) {
    tf_retry_timer_.stop();
    node_.getCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
  }
}

// ---------------------------------------------------------------- poses

// Poses are taken from the wire at once and simulated from a later entry of the same callback queue:
// so the node knows how far it is behind.
void BrushSimulator::receivePose(const geometry_msgs::PoseStampedConstPtr& message) {
  waiting_poses_.push_back({message, ros::SteadyTime::now()});
  scheduleWork();
}

void BrushSimulator::scheduleWork() {
  if (work_is_scheduled_) return;
  work_is_scheduled_ = true;
  node_.getCallbackQueue()->addCallback(boost::make_shared<FunctionCallback>([this] {
                                          work_is_scheduled_ = false;
                                          work();
                                        }),
                                        reinterpret_cast<std::uint64_t>(this));
}

// One pose at a time, so that services and timers keep their turn during a backlog.
void BrushSimulator::work() {
  if (is_closing_) return;
  const bool moved_on = simulateNextPose();
  if (moved_on && !waiting_poses_.empty()) scheduleWork();
  if (moved_on || waiting_poses_.empty())
    tf_retry_timer_.stop();
  else
    tf_retry_timer_.start();
}

/// Simulates or refuses the oldest waiting pose. False if there is none, or if it must go on waiting
/// for its transform; those behind it wait too, for they come later in the stroke.
bool BrushSimulator::simulateNextPose() {
  if (waiting_poses_.empty()) return false;
  const WaitingPose waiting = waiting_poses_.front();
  std::string problem;
  const auto pose_P = toPaper(*waiting.message, problem);
  const bool may_wait = !waiting.message->header.frame_id.empty() &&
                        (ros::SteadyTime::now() - waiting.arrival).toSec() < parameters_.ros.tf_timeout;
  if (!pose_P && may_wait) return false;

  waiting_poses_.pop_front();
  if (pose_P)
    simulate(*pose_P);
  else
    refuse(kUnknownFrame, toHandlePose(*waiting.message), problem);
  return true;
}

void BrushSimulator::simulateWaitingPoses() {
  while (simulateNextPose()) {
  }
}

/// The pose in the paper frame, or nothing and why.
std::optional<HandlePose> BrushSimulator::toPaper(const geometry_msgs::PoseStamped& message,
                                                  std::string& problem) const {
  HandlePose pose = toHandlePose(message);
  const std::string& frame = message.header.frame_id;
  // No arithmetic on poses that are in the paper frame: they give the bits that a replay gives.
  if (frame == parameters_.ros.paper_frame) return pose;
  if (frame.empty()) {
    problem = "the pose names no frame";
    return std::nullopt;
  }
  try {
    const auto X_PF =
        tf_buffer_.lookupTransform(parameters_.ros.paper_frame, frame, message.header.stamp);
    const auto& p = X_PF.transform.translation;
    const auto& q = X_PF.transform.rotation;
    // By hand, so that a zero or NaN quaternion stays what it is and is refused as that.
    const Eigen::Quaterniond rotation(q.w, q.x, q.y, q.z);
    pose.position = rotation * pose.position + Eigen::Vector3d(p.x, p.y, p.z);
    pose.orientation = rotation * pose.orientation;
    return pose;
  } catch (const tf2::TransformException& error) {
    problem = "frame \"" + frame + "\": " + error.what();
    return std::nullopt;
  }
}

void BrushSimulator::simulate(const HandlePose& pose) {
  const PoseVerdict verdict = simulator_.addPose(pose);
  switch (verdict) {
    case PoseVerdict::kAccepted: break;
    case PoseVerdict::kNotFinite: return refuse(kNotFinite, pose, toString(verdict));
    case PoseVerdict::kOutOfReach: return refuse(kOutOfReach, pose, toString(verdict));
    case PoseVerdict::kZeroQuaternion: return refuse(kZeroQuaternion, pose, toString(verdict));
    case PoseVerdict::kNotLater: return refuse(kNotLater, pose, toString(verdict));
    case PoseVerdict::kTooFast: return refuse(kTooFast, pose, toString(verdict));
  }
  ++accepted_count_;
  newest_stamp_ns_ = pose.stamp_ns;

  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  const int steps = simulator_.advance();
  pace_.wall += std::chrono::duration<double>(Clock::now() - start).count();
  pace_.simulated += steps * parameters_.simulator.rods.time_step;

  if (wrench_publisher_.getNumSubscribers() > 0)
    wrench_publisher_.publish(toWrenchStamped(simulator_.handleWrench(), makeHeader()));
}

void BrushSimulator::refuse(Refusal refusal, const HandlePose& pose, const std::string& problem) {
  const std::uint64_t count = ++refused_counts_[refusal];
  // Once a second for each kind, so that a frequent kind does not hide a rare one.
  const auto now = ros::SteadyTime::now();
  ros::SteadyTime& warned_at = warned_at_[refusal];
  if (!warned_at.isZero() && (now - warned_at).toSec() < kWarningPeriod) return;
  warned_at = now;
  ROS_WARN_STREAM(name_ << ": refused a pose, " << problem << ": " << describePose(pose) << " (" << count
                        << " of this kind so far)");
}

// ---------------------------------------------------------------- services

/// A private service that answers with what the action returns, or with what it throws.
void BrushSimulator::offerService(const std::string& name, const std::function<std::string()>& action) {
  using Request = std_srvs::Trigger::Request;
  using Response = std_srvs::Trigger::Response;
  const boost::function<bool(Request&, Response&)> answer = [this, action](Request&,
                                                                           Response& response) {
    try {
      // The poses that came before the call belong to what it acts on.
      simulateWaitingPoses();
      response.message = action();
      response.success = true;
    } catch (const std::exception& error) {
      response.message = error.what();
      response.success = false;
      ROS_ERROR_STREAM(name_ << ": " << error.what());
    }
    return true;
  };
  services_.push_back(private_node_.advertiseService(name, answer));
}

void BrushSimulator::reset() {
  simulator_.reset();
  tf_buffer_.clear();  // A replay may begin in the past of what it holds. Static frames stay.
  waiting_poses_.clear();
  newest_stamp_ns_ = 0;
  accepted_count_ = 0;
  refused_counts_ = {};
  pace_ = pace_at_state_ = pace_at_diagnosis_ = {};
  refused_at_diagnosis_ = 0;
  unconverged_at_diagnosis_ = 0;
  image_revision_.reset();
  map_revision_.reset();
  markers_time_ns_.reset();
  frame_time_ns_.reset();
}

std::string BrushSimulator::saveImage() const {
  const Paper& paper = simulator_.paper();
  const std::string path = std::filesystem::absolute(parameters_.ros.image_path).string();
  std::vector<std::uint8_t> picture;
  paper.render(picture);
  writePng(path, paper.width_px(), paper.height_px(), picture, parameters_.simulator.paper.px_per_mm);
  return path;
}

// ---------------------------------------------------------------- publications

/// Results are stamped with the time of the simulation, not of their computation.
std_msgs::Header BrushSimulator::makeHeader() const {
  std_msgs::Header header;
  header.stamp = toRosTime(simulator_.time_ns());
  header.frame_id = parameters_.ros.paper_frame;
  return header;
}

/// Received and not yet simulated [s].
double BrushSimulator::backlog() const {
  if (accepted_count_ == 0) return 0.0;
  std::int64_t newest_ns = newest_stamp_ns_;
  if (!waiting_poses_.empty())
    newest_ns = std::max(newest_ns, toNanoseconds(waiting_poses_.back().message->header.stamp));
  return 1e-9 * static_cast<double>(newest_ns - simulator_.time_ns());
}

std::uint64_t BrushSimulator::refusedCount() const {
  std::uint64_t sum = 0;
  for (const std::uint64_t count : refused_counts_) sum += count;
  return sum;
}

void BrushSimulator::publishPictures() {
  const std::uint64_t revision = simulator_.paper().revision();
  const bool image_is_due = image_publisher_.getNumSubscribers() > 0 && image_revision_ != revision;
  const bool map_is_due = map_publisher_.getNumSubscribers() > 0 && map_revision_ != revision;
  if (!image_is_due && !map_is_due) return;
  const auto image = boost::make_shared<sensor_msgs::Image>(toImage(simulator_.paper(), makeHeader()));
  if (map_is_due) {
    map_publisher_.publish(toOccupancyGrid(*image, simulator_.paper().pixelSize()));
    map_revision_ = revision;
  }
  if (image_is_due) {
    image_publisher_.publish(sensor_msgs::ImageConstPtr(image));
    image_revision_ = revision;
  }
}

void BrushSimulator::publishBrush() {
  const bool has_pose = accepted_count_ > 0;
  const std::int64_t time_ns = simulator_.time_ns();
  if (has_pose && frame_time_ns_ != time_ns) {
    tf_broadcaster_.sendTransform(toTransformStamped(
        simulator_.handlePose(), parameters_.ros.paper_frame, parameters_.ros.handle_frame));
    frame_time_ns_ = time_ns;
  }
  if (marker_publisher_.getNumSubscribers() > 0 && markers_time_ns_ != time_ns) {
    marker_publisher_.publish(toMarkers(simulator_, has_pose, makeHeader()));
    markers_time_ns_ = time_ns;
  }
}

void BrushSimulator::publishState() {
  if (state_publisher_.getNumSubscribers() == 0) return;
  const SimulatorReport& report = simulator_.report();
  BrushState state;
  state.header = makeHeader();
  state.ink_left = report.ink_capacity > 0 ? report.ink_in_tip / report.ink_capacity : 0.0;
  state.touching_rods = static_cast<std::uint32_t>(report.touching_rods);
  state.touching_nodes = static_cast<std::uint32_t>(report.touching_nodes);
  state.max_penetration = report.max_penetration;

  state.steps = static_cast<std::uint64_t>(report.step_count);
  state.last_iterations = static_cast<std::uint32_t>(report.last_iterations);
  state.mean_iterations = report.rod_step_count > 0 ? static_cast<double>(report.iteration_count) /
                                                          static_cast<double>(report.rod_step_count)
                                                    : 0.0;
  state.unconverged = static_cast<std::uint64_t>(report.unconverged_count);
  for (int stage = 0; stage < static_cast<int>(Stage::kCount); ++stage)
    state.stage_names.emplace_back(toString(static_cast<Stage>(stage)));
  state.stage_seconds.assign(report.stage_seconds.begin(), report.stage_seconds.end());
  state.real_time_factor = pace_.factorSince(pace_at_state_);
  pace_at_state_ = pace_;
  state.backlog = backlog();

  state.poses_waiting = static_cast<std::uint32_t>(waiting_poses_.size());
  state.poses_accepted = accepted_count_;
  state.poses_refused = refusedCount();
  state.refused_not_finite = refused_counts_[kNotFinite];
  state.refused_out_of_reach = refused_counts_[kOutOfReach];
  state.refused_zero_quaternion = refused_counts_[kZeroQuaternion];
  state.refused_not_later = refused_counts_[kNotLater];
  state.refused_too_fast = refused_counts_[kTooFast];
  state.refused_unknown_frame = refused_counts_[kUnknownFrame];
  state_publisher_.publish(state);
}

void BrushSimulator::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using Level = diagnostic_msgs::DiagnosticStatus;
  const SimulatorReport& report = simulator_.report();
  const std::uint64_t refused = refusedCount();
  status.summary(Level::OK, accepted_count_ > 0 ? "running" : "waiting for the first pose");
  if (refused > refused_at_diagnosis_) status.mergeSummary(Level::WARN, "poses refused");
  if (report.unconverged_count > unconverged_at_diagnosis_)
    status.mergeSummary(Level::WARN, "steps that did not converge");
  if (backlog() > kTolerableBacklog) status.mergeSummary(Level::WARN, "falling behind the poses");
  status.add("poses accepted", accepted_count_);
  status.add("poses refused: not finite", refused_counts_[kNotFinite]);
  status.add("poses refused: out of reach", refused_counts_[kOutOfReach]);
  status.add("poses refused: zero quaternion", refused_counts_[kZeroQuaternion]);
  status.add("poses refused: not later", refused_counts_[kNotLater]);
  status.add("poses refused: too fast", refused_counts_[kTooFast]);
  status.add("poses refused: unknown frame", refused_counts_[kUnknownFrame]);
  status.add("backlog [s]", backlog());
  status.add("real-time factor", pace_.factorSince(pace_at_diagnosis_));
  status.add("ink in the tip [m^3]", report.ink_in_tip);
  status.add("rods on the sheet", report.touching_rods);
  status.add("unconverged rod steps", report.unconverged_count);
  pace_at_diagnosis_ = pace_;
  refused_at_diagnosis_ = refused;
  unconverged_at_diagnosis_ = report.unconverged_count;
}

}  // namespace calligraphy_brush
