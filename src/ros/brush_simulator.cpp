#include "calligraphy_brush/ros/brush_simulator.h"

#include <nav_msgs/OccupancyGrid.h>
#include <ros/callback_queue_interface.h>
#include <std_srvs/Trigger.h>
#include <tf2/exceptions.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <filesystem>
#include <iomanip>
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
constexpr std::uint32_t kTransformQueue = 10000;
constexpr std::uint32_t kCommandQueue = 1000;
constexpr double kTfRetryPeriod = 0.005;   // [s]
constexpr double kWarningPeriod = 1.0;     // [s]
constexpr double kDiagnosticPeriod = 1.0;  // [s]
constexpr double kTolerableBacklog = 0.2;  // [s]
constexpr double kRecordingAge = 86400.0;  // [s]; no clock is as wrong

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
  const std::string& path = parameters.ros.image_path;
  if (path.empty() || path.back() == '/')
    problems.push_back(ns + "/ros/image_path = \"" + path + "\" is not the name of a file");
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

std::string toHexadecimal(std::uint64_t number) {
  std::ostringstream text;
  text << std::hex << std::setfill('0') << std::setw(16) << number;
  return text.str();
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
      image_transport_(node_),
      diagnostics_(node_, private_node_, name_) {
  const bool latch = true;
  image_publisher_ = image_transport_.advertise("stroke_image", 1, latch);
  map_publisher_ = node_.advertise<nav_msgs::OccupancyGrid>("paper_map", 1, latch);
  marker_publisher_ = node_.advertise<visualization_msgs::MarkerArray>("tip_markers", 1, latch);
  if (parameters_.ros.wrench_rate > 0.0)
    wrench_timer_ = node_.createWallTimer(
        ros::WallDuration(1.0 / parameters_.ros.wrench_rate),
        [this](const ros::WallTimerEvent&) { publishWrench(); }, false, false);
  wrench_publisher_ = node_.advertise<geometry_msgs::WrenchStamped>(
      "handle_wrench", 100, [this](const ros::SingleSubscriberPublisher&) {
        if (parameters_.ros.wrench_rate > 0.0) wrench_timer_.start();
      });
  state_publisher_ = node_.advertise<BrushState>("brush_state", 10);
  accepted_publisher_ = node_.advertise<geometry_msgs::PoseStamped>("accepted_pose", kPoseQueue);
  event_publisher_ = node_.advertise<BrushEvent>("brush_events", kCommandQueue, latch);
  parameter_publisher_ = node_.advertise<ParameterValues>("brush_parameters", 1, latch);
  publishParameters();

  offerService("clear_paper", [this] {
    applyEvent(BrushEvent::CLEAR_PAPER);
    return std::string("the sheet is clean");
  });
  offerService("dip_brush", [this] {
    applyEvent(BrushEvent::DIP);
    return std::string("the tip is full of ink");
  });
  offerService("wipe_brush", [this] {
    applyEvent(BrushEvent::WIPE);
    return std::string("the tip has no ink");
  });
  offerService("reset", [this] {
    const bool is_new = takeNewParameters();
    applyEvent(BrushEvent::RESET);
    return std::string(is_new ? "brush and sheet as the parameters say now; " : "") +
           "clean sheet, dipped brush, no poses";
  });
  offerService("save_image", [this] { return saveImage(); });
  offerService("state_hash", [this] { return toHexadecimal(simulator_.stateHash()); });

  diagnostics_.setHardwareID("none");
  diagnostics_.add("brush", this, &BrushSimulator::diagnose);

  const auto every = [this](double period, void (BrushSimulator::*publish)()) {
    timers_.push_back(node_.createWallTimer(
        ros::WallDuration(period), [this, publish](const ros::WallTimerEvent&) { (this->*publish)(); }));
  };
  every(1.0 / parameters_.ros.image_rate, &BrushSimulator::publishPictures);
  every(1.0 / parameters_.ros.marker_rate, &BrushSimulator::publishBrushAtRest);
  every(1.0 / parameters_.ros.state_rate, &BrushSimulator::publishState);
  every(std::clamp(0.2 * parameters_.simulator.motion.hold_after, 0.005, 1.0),
        &BrushSimulator::watchPoses);
  every(kDiagnosticPeriod, &BrushSimulator::compareClocks);
  timers_.push_back(
      node_.createWallTimer(ros::WallDuration(kDiagnosticPeriod),
                            [this](const ros::WallTimerEvent&) { diagnostics_.force_update(); }));
  tf_retry_timer_ = node_.createWallTimer(
      ros::WallDuration(kTfRetryPeriod), [this](const ros::WallTimerEvent&) { work(); }, false, false);

  // Last: poses may come from here on. Transforms come through the same queue as poses, in their turn:
  // none is simulated before the others that came with it.
  const auto no_delay = ros::TransportHints().tcpNoDelay();
  for (const bool are_static : {true, false}) {
    const boost::function<void(const ros::MessageEvent<const tf2_msgs::TFMessage>&)> receive =
        [this, are_static](const ros::MessageEvent<const tf2_msgs::TFMessage>& event) {
          receiveTransforms(event, are_static);
        };
    (are_static ? static_tf_subscriber_ : tf_subscriber_) = node_.subscribe<tf2_msgs::TFMessage>(
        are_static ? "/tf_static" : "/tf", kTransformQueue, receive, ros::VoidConstPtr(), no_delay);
  }
  command_subscriber_ =
      node_.subscribe("brush_command", kCommandQueue, &BrushSimulator::receiveCommand, this, no_delay);
  std::string source = "tf frame " + parameters_.ros.handle_frame;
  if (parameters_.ros.handle_source == "topic") {
    pose_subscriber_ =
        node_.subscribe("handle_pose", kPoseQueue, &BrushSimulator::receivePose, this, no_delay);
    source = pose_subscriber_.getTopic();
  }
  ROS_INFO_STREAM(name_ << ": " << simulator_.rodCount() << " rods of " << simulator_.nodeCount()
                        << " nodes on " << simulator_.paper().width_px() << " x "
                        << simulator_.paper().height_px() << " px, kernel " << simulator_.kernelName()
                        << ", waiting for poses on " << source);
}

BrushSimulator::~BrushSimulator() {
  // A nodelet is unloaded from another thread. Each of these waits for what is running; that may have
  // started the other once more, hence twice.
  is_closing_ = true;
  pose_subscriber_.shutdown();
  tf_subscriber_.shutdown();
  static_tf_subscriber_.shutdown();
  command_subscriber_.shutdown();
  for (int pass = 0; pass < 2; ++pass) {
    tf_retry_timer_.stop();
    node_.getCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
  }
}

// ---------------------------------------------------------------- poses

// Poses are taken from the wire at once and simulated from a later entry of the same callback queue:
// so the node knows how far it is behind.
void BrushSimulator::receivePose(const geometry_msgs::PoseStampedConstPtr& message) {
  const WaitingPose waiting{message, ros::SteadyTime::now(), ros::Time::now()};
  const double difference = (waiting.arrival_stamp - message->header.stamp).toSec();
  least_difference_ = std::min(least_difference_.value_or(difference), difference);
  if (waiting_poses_.size() >= kPoseQueue)
    return refuse(kTooMany, toHandlePose(*message), std::to_string(kPoseQueue) + " wait before it");
  waiting_poses_.push_back(waiting);
  scheduleWork();
}

void BrushSimulator::receiveTransforms(const ros::MessageEvent<const tf2_msgs::TFMessage>& event,
                                       bool are_static) {
  const bool frame_moves_brush = parameters_.ros.handle_source == "frame";
  for (const auto& transform : event.getConstMessage()->transforms) {
    // What this node or, from a recording, another one before it says of the brush it simulates.
    if (!frame_moves_brush && transform.child_frame_id == parameters_.ros.handle_frame) continue;
    try {
      tf_buffer_.setTransform(transform, event.getPublisherName(), are_static);
    } catch (const tf2::TransformException& error) {
      ROS_WARN_STREAM_THROTTLE(kWarningPeriod, name_ << ": refused a transform: " << error.what());
    }
  }
  if (frame_moves_brush)
    takeHandleFrame();
  else if (!waiting_poses_.empty())
    scheduleWork();
}

/// Takes where tf has the handle for a pose, if that is later than the one before: after each message of
/// tf, so none is left out. The stamp is the latest at which the whole chain of frames is known.
void BrushSimulator::takeHandleFrame() {
  try {
    const auto X_PH = tf_buffer_.lookupTransform(parameters_.ros.paper_frame,
                                                 parameters_.ros.handle_frame, ros::Time(0));
    if (X_PH.header.stamp.isZero()) {
      if (!warned_of_fixed_frame_)
        ROS_WARN_STREAM(name_ << ": frame " << parameters_.ros.handle_frame << " is fixed to "
                              << parameters_.ros.paper_frame << ": it has no time, and moves no brush");
      warned_of_fixed_frame_ = true;
      return;
    }
    if (X_PH.header.stamp == handle_frame_stamp_) return;
    handle_frame_stamp_ = X_PH.header.stamp;
    receivePose(boost::make_shared<geometry_msgs::PoseStamped>(
        toPoseStamped(toHandlePose(X_PH), parameters_.ros.paper_frame)));
  } catch (const tf2::TransformException&) {
    // The frames are not connected yet; who waits for them is told that there are no poses.
  }
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
  const double ahead = secondsAhead(waiting);
  if (ahead > parameters_.ros.max_ahead) {
    waiting_poses_.pop_front();
    std::ostringstream text;
    text << "its stamp is " << ahead << " s ahead of "
         << (accepted_count_ > 0 ? "the pose before and the time since that came" : "this host's clock")
         << ", ros/max_ahead is " << parameters_.ros.max_ahead << " s";
    refuse(kTooFarAhead, toHandlePose(*waiting.message), text.str());
    return true;
  }
  const auto pose_P = toPaper(*waiting.message, problem);
  const bool may_wait = !waiting.message->header.frame_id.empty() &&
                        (ros::SteadyTime::now() - waiting.arrival).toSec() < parameters_.ros.tf_timeout;
  if (!pose_P && may_wait) return false;

  waiting_poses_.pop_front();
  if (pose_P)
    simulate(*pose_P, waiting);
  else
    refuse(kUnknownFrame, toHandlePose(*waiting.message), problem);
  return true;
}

/// How much further a stamp is than time has gone on [s]. Of the differences between clocks and of
/// delays it knows nothing after the first pose.
double BrushSimulator::secondsAhead(const WaitingPose& waiting) const {
  const ros::Time& stamp = waiting.message->header.stamp;
  if (accepted_count_ == 0) return (stamp - waiting.arrival_stamp).toSec();
  const double stamps = 1e-9 * static_cast<double>(toNanoseconds(stamp) - newest_stamp_ns_);
  const double elapsed = ros::Time::isSystemTime()
                             ? (waiting.arrival - newest_arrival_).toSec()
                             : (waiting.arrival_stamp - newest_arrival_stamp_).toSec();
  return stamps - elapsed;
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
    return transformed(X_PF, pose);
  } catch (const tf2::TransformException& error) {
    problem = "frame \"" + frame + "\": " + error.what();
    return std::nullopt;
  }
}

void BrushSimulator::simulate(const HandlePose& pose, const WaitingPose& waiting) {
  applyCommandsWhile([&](std::int64_t stamp_ns) { return stamp_ns < pose.stamp_ns; });
  const PoseVerdict verdict = simulator_.addPose(pose);
  switch (verdict) {
    case PoseVerdict::kAccepted: break;
    case PoseVerdict::kNotFinite: return refuse(kNotFinite, pose, toString(verdict));
    case PoseVerdict::kOutOfReach: return refuse(kOutOfReach, pose, toString(verdict));
    case PoseVerdict::kZeroQuaternion: return refuse(kZeroQuaternion, pose, toString(verdict));
    case PoseVerdict::kNotLater: return refuse(kNotLater, pose, toString(verdict));
    case PoseVerdict::kTooFast: return refuse(kTooFast, pose, toString(verdict));
  }
  if (is_holding_)
    ROS_INFO_STREAM(name_ << ": poses are back after " << (waiting.arrival - newest_arrival_).toSec()
                          << " s");
  is_holding_ = false;
  ++accepted_count_;
  newest_stamp_ns_ = pose.stamp_ns;
  newest_arrival_ = waiting.arrival;
  newest_arrival_stamp_ = waiting.arrival_stamp;
  if (accepted_publisher_.getNumSubscribers() > 0)
    accepted_publisher_.publish(toPoseStamped(pose, parameters_.ros.paper_frame));

  advance();
  applyCommandsWhile([&](std::int64_t stamp_ns) { return stamp_ns <= newest_stamp_ns_; });
  // At once, and not when a timer would: what is shown is as new as it can be.
  if ((ros::SteadyTime::now() - brush_published_at_).toSec() >= 1.0 / parameters_.ros.marker_rate)
    publishBrush();
}

/// Runs the time steps up to the newest pose, and publishes or puts aside the wrenches.
void BrushSimulator::advance() {
  const bool wrench_is_watched = wrench_publisher_.getNumSubscribers() > 0;
  const bool wrench_is_paced = wrench_is_watched && parameters_.ros.wrench_rate > 0.0;
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  int steps = 0;
  std::size_t wrenches = 0;
  if (wrench_is_paced) {
    const auto period_ns = std::llround(1e9 / parameters_.ros.wrench_rate);
    const std::int64_t time_ns = simulator_.time_ns();
    if (next_wrench_ns_ <= time_ns || next_wrench_ns_ > time_ns + period_ns)
      next_wrench_ns_ = time_ns + period_ns;
    for (; next_wrench_ns_ <= newest_stamp_ns_; next_wrench_ns_ += period_ns, ++wrenches) {
      steps += simulator_.advanceTo(next_wrench_ns_);
      waiting_wrenches_.push_back(toWrenchStamped(simulator_.handleWrench(), makeHeader()));
    }
  }
  steps += simulator_.advance();
  pace_.wall += std::chrono::duration<double>(Clock::now() - start).count();
  pace_.simulated += steps * parameters_.simulator.rods.time_step;

  if (wrench_is_watched && !wrench_is_paced)
    wrench_publisher_.publish(toWrenchStamped(simulator_.handleWrench(), makeHeader()));
  // Poses that come unevenly, or all at once, must not make the force late for ever.
  if (waiting_wrenches_.size() > 2 * wrenches + 1)
    waiting_wrenches_.erase(waiting_wrenches_.begin(),
                            waiting_wrenches_.end() - static_cast<std::ptrdiff_t>(wrenches));
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

/// Says when poses stop and the tip holds. The simulation needs no such clock: it goes by the stamps.
void BrushSimulator::watchPoses() {
  if (accepted_count_ == 0 || is_holding_ || !waiting_poses_.empty()) return;
  const double silence = (ros::SteadyTime::now() - newest_arrival_).toSec();
  if (silence <= parameters_.simulator.motion.hold_after) return;
  is_holding_ = true;
  // Commands for later than the newest pose: none comes to wait for.
  applyCommandsWhile([](std::int64_t) { return true; });
  const int touching = simulator_.report().touching_rods;
  if (touching > 0)
    ROS_WARN_STREAM(name_ << ": no pose for " << silence << " s: the tip holds, " << touching
                          << " rods on the sheet");
  else
    ROS_INFO_STREAM(name_ << ": no pose for " << silence << " s: the tip holds, above the sheet");
}

/// Says once when the clock that stamps the poses is not this one's.
void BrushSimulator::compareClocks() {
  if (!least_difference_) return;
  clock_difference_ = *least_difference_;
  least_difference_.reset();
  const bool differ = std::abs(clock_difference_) > parameters_.ros.clock_tolerance;
  if (differ && !warned_of_clocks_) {
    std::ostringstream text;
    text << name_ << ": poses are stamped " << std::abs(clock_difference_) << " s "
         << (clock_difference_ > 0 ? "before" : "after") << " they arrive, ";
    if (std::abs(clock_difference_) >= kRecordingAge)
      ROS_INFO_STREAM(text.str() << "as those of a recording are");
    else
      ROS_WARN_STREAM(
          text.str() << "more than ros/clock_tolerance: the clocks of the hosts differ, or "
                        "the way is as long. The stroke goes by the stamps and is not harmed");
  }
  warned_of_clocks_ = differ;
}

// ---------------------------------------------------------------- events

/// Changes brush or sheet after the newest accepted pose, and tells it with that place.
void BrushSimulator::applyEvent(std::uint8_t kind) {
  const auto event = boost::make_shared<BrushEvent>();
  event->header.stamp = toRosTime(newest_stamp_ns_);
  event->header.frame_id = parameters_.ros.paper_frame;
  event->kind = kind;
  switch (kind) {
    case BrushEvent::DIP: simulator_.dip(); break;
    case BrushEvent::WIPE: simulator_.wipe(); break;
    case BrushEvent::CLEAR_PAPER: simulator_.clearPaper(); break;
    case BrushEvent::RESET:
      reset();
      publishParameters();  // A recording tells by these which parameters hold from here on.
      break;
    default: return;
  }
  markers_time_ns_.reset();  // the ink in the rods is shown
  event_publisher_.publish(event);
}

void BrushSimulator::receiveCommand(const BrushEventConstPtr& command) {
  if (command->kind < BrushEvent::DIP || command->kind > BrushEvent::RESET) {
    ROS_WARN_STREAM(name_ << ": refused a brush_command: kind = " << int{command->kind}
                          << " is outside [1, 4]");
    return;
  }
  if (waiting_commands_.size() >= kCommandQueue) {
    ROS_WARN_STREAM(name_ << ": refused a brush_command: " << kCommandQueue << " wait before it");
    return;
  }
  if (command->header.stamp.isZero()) simulateWaitingPoses();
  waiting_commands_.push_back(command);
  applyCommandsWhile([&](std::int64_t stamp_ns) { return stamp_ns <= newest_stamp_ns_ || is_holding_; });
}

/// Applies waiting commands, in the order in which they came, as long as their stamps [ns] are due.
template <class IsDue>
void BrushSimulator::applyCommandsWhile(const IsDue& is_due) {
  while (!waiting_commands_.empty() && is_due(toNanoseconds(waiting_commands_.front()->header.stamp))) {
    const std::uint8_t kind = waiting_commands_.front()->kind;
    waiting_commands_.pop_front();
    applyEvent(kind);
  }
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

/// Makes brush and sheet anew if the parameter server has other values for them than before. Throws, and
/// then all is as it was, if it has bad ones.
bool BrushSimulator::takeNewParameters() {
  const SimulatorParameters parameters = readCheckedParameters(private_node_).simulator;
  if (toParameterValues(parameters).values == toParameterValues(parameters_.simulator).values)
    return false;
  simulator_ = makeSimulator(parameters, private_node_.getNamespace());
  parameters_.simulator = parameters;
  return true;
}

void BrushSimulator::reset() {
  simulator_.reset();
  tf_buffer_.clear();  // A replay may begin in the past of what it holds. Static frames stay.
  waiting_poses_.clear();
  newest_stamp_ns_ = 0;
  handle_frame_stamp_ = ros::Time();
  is_holding_ = false;
  least_difference_.reset();
  clock_difference_ = 0.0;
  warned_of_clocks_ = false;
  waiting_wrenches_.clear();
  newest_wrench_.reset();
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

void BrushSimulator::publishParameters() {
  ParameterValues message = toParameterValues(parameters_.simulator);
  message.header.stamp = ros::Time::now();
  message.header.frame_id = parameters_.ros.paper_frame;
  parameter_publisher_.publish(message);
}

/// The next wrench in its turn; the newest again when there is none.
void BrushSimulator::publishWrench() {
  if (wrench_publisher_.getNumSubscribers() == 0) {
    wrench_timer_.stop();
    waiting_wrenches_.clear();
    newest_wrench_.reset();
    return;
  }
  if (!waiting_wrenches_.empty()) {
    newest_wrench_ = waiting_wrenches_.front();
    waiting_wrenches_.pop_front();
  }
  if (newest_wrench_) wrench_publisher_.publish(*newest_wrench_);
}

/// For a brush that poses do not move now: after a service, or for a new subscriber.
void BrushSimulator::publishBrushAtRest() {
  const double period = 1.0 / parameters_.ros.marker_rate;
  if (accepted_count_ == 0 || (ros::SteadyTime::now() - newest_arrival_).toSec() >= period)
    publishBrush();
}

void BrushSimulator::publishBrush() {
  brush_published_at_ = ros::SteadyTime::now();
  const bool has_pose = accepted_count_ > 0;
  const std::int64_t time_ns = simulator_.time_ns();
  if (has_pose && parameters_.ros.handle_source == "topic" && frame_time_ns_ != time_ns) {
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
  const TipShape tip = simulator_.tipShape();
  state.groups = static_cast<std::uint32_t>(tip.groups);
  state.tip_width = tip.width;
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

  state.holding = is_holding_;
  if (accepted_count_ > 0) state.silence = (ros::SteadyTime::now() - newest_arrival_).toSec();
  state.clock_difference = clock_difference_;
  state.poses_waiting = static_cast<std::uint32_t>(waiting_poses_.size());
  state.poses_accepted = accepted_count_;
  state.poses_refused = refusedCount();
  state.refused_not_finite = refused_counts_[kNotFinite];
  state.refused_out_of_reach = refused_counts_[kOutOfReach];
  state.refused_zero_quaternion = refused_counts_[kZeroQuaternion];
  state.refused_not_later = refused_counts_[kNotLater];
  state.refused_too_fast = refused_counts_[kTooFast];
  state.refused_unknown_frame = refused_counts_[kUnknownFrame];
  state.refused_too_far_ahead = refused_counts_[kTooFarAhead];
  state.refused_too_many = refused_counts_[kTooMany];
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
  if (is_holding_)
    status.mergeSummary(report.touching_rods > 0 ? Level::WARN : Level::OK, "no poses: the tip holds");
  if (std::abs(clock_difference_) > parameters_.ros.clock_tolerance &&
      std::abs(clock_difference_) < kRecordingAge)
    status.mergeSummary(Level::WARN, "stamps of the poses are not of this host's clock");
  if (backlog() > kTolerableBacklog) status.mergeSummary(Level::WARN, "falling behind the poses");
  status.add("poses accepted", accepted_count_);
  status.add("poses refused: not finite", refused_counts_[kNotFinite]);
  status.add("poses refused: out of reach", refused_counts_[kOutOfReach]);
  status.add("poses refused: zero quaternion", refused_counts_[kZeroQuaternion]);
  status.add("poses refused: not later", refused_counts_[kNotLater]);
  status.add("poses refused: too fast", refused_counts_[kTooFast]);
  status.add("poses refused: unknown frame", refused_counts_[kUnknownFrame]);
  status.add("poses refused: too far ahead", refused_counts_[kTooFarAhead]);
  status.add("poses refused: too many waiting", refused_counts_[kTooMany]);
  status.add("least arrival minus stamp [s]", clock_difference_);
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
