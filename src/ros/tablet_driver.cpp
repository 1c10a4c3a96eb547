#include "calligraphy_brush/ros/tablet_driver.h"

#include <geometry_msgs/PoseStamped.h>
#include <rosbag/bag.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <sstream>
#include <stdexcept>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/tablet/tablet_device.h"

namespace calligraphy_brush {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr int kReadTimeout_ms = 20;
constexpr std::uint32_t kQueue = 10000;  // every pose is part of the stroke: 50 s at 200 Hz

double lowestNode(const Simulator& simulator) {
  double lowest = std::numeric_limits<double>::infinity();
  for (int rod = 0; rod < simulator.rodCount(); ++rod)
    lowest = std::min(lowest, simulator.nodePosition(rod, simulator.nodeCount() - 1).z());
  return lowest;
}

std::string describeTablet(const TabletDescription& description, const TabletDecoder& decoder) {
  const TabletSize& size = decoder.size();
  std::ostringstream text;
  text << "\"" << description.name << "\", " << std::lround(1e3 * size.width) << " x "
       << std::lround(1e3 * size.height) << " mm" << (size.is_known ? "" : " (guessed)");
  return text.str();
}

/// Says how it went.
void callAndLog(const std::string& service) {
  const ServiceOutcome outcome = callTrigger(service);
  if (outcome.success)
    ROS_INFO_STREAM("tablet: " << service << ": " << outcome.message);
  else
    ROS_WARN_STREAM("tablet: " << outcome.message);
}

}  // namespace

BrushOnSheet measureBrush(const SimulatorParameters& given) {
  SimulatorParameters parameters = given;
  parameters.contact.paper = false;
  Simulator simulator(parameters);
  HandlePose pose;
  pose.orientation = Eigen::AngleAxisd(0.25 * 3.14159265358979323846, Eigen::Vector3d::UnitY());
  simulator.addPose(pose);
  const double before = lowestNode(simulator);
  pose.stamp_ns = kSecond_ns;
  simulator.addPose(pose);
  simulator.advance();

  BrushOnSheet brush;
  brush.tip_length = parameters.brush.tip_length;
  const double sine_squared = 0.5;
  brush.sag = std::max(0.0, before - lowestNode(simulator)) / (brush.tip_length * sine_squared);
  brush.width = parameters.paper.width;
  brush.height = parameters.paper.height;
  return brush;
}

TabletSample toTabletSample(const PenSample& sample, std::int64_t stamp_ns) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  TabletSample message;
  message.header.stamp = toRosTime(stamp_ns);
  message.tool = sample.tool == PenTool::kPen      ? TabletSample::PEN
                 : sample.tool == PenTool::kEraser ? TabletSample::ERASER
                                                   : TabletSample::NONE;
  message.x = sample.has_position ? sample.x : nan;
  message.y = sample.has_position ? sample.y : nan;
  message.touching = sample.touching;
  message.pressure = sample.pressure;
  message.distance = sample.distance.value_or(nan);
  message.tilt_x = sample.tilt_x.value_or(nan);
  message.tilt_y = sample.tilt_y.value_or(nan);
  message.rotation = sample.rotation.value_or(nan);
  message.wheel = sample.wheel.value_or(nan);
  message.stylus = sample.stylus;
  message.stylus2 = sample.stylus2;
  message.stylus3 = sample.stylus3;
  message.serial = sample.serial;
  return message;
}

std::size_t writeTabletBag(const std::string& path, const TabletRecording& recording,
                           const TabletDriverParameters& parameters) {
  TabletReader reader(recording.description, parameters.tablet, measureBrush(parameters.simulator));
  const std::int64_t shift_ns =
      !recording.events.empty() && recording.events.front().stamp_ns < kSecond_ns ? kSecond_ns : 0;
  AtomicFile output(path);
  std::uint32_t pose_count = 0, sample_count = 0;
  try {
    rosbag::Bag bag(output.temporaryPath(), rosbag::bagmode::Write);
    bag.setCompression(rosbag::compression::BZ2);
    const auto writePoses = [&](const PenActions& actions) {
      for (const HandlePose& pose : actions.poses) {
        auto message = toPoseStamped(pose, parameters.ros.paper_frame);
        message.header.seq = pose_count++;
        bag.write("handle_pose", message.header.stamp, message);
      }
    };
    for (InputEvent event : recording.events) {
      event.stamp_ns += shift_ns;
      const auto report = reader.take(event);
      if (!report) continue;
      writePoses(report->actions);
      TabletSample sample = toTabletSample(report->sample, event.stamp_ns);
      sample.header.seq = sample_count++;
      bag.write("tablet_sample", sample.header.stamp, sample);
    }
    if (!recording.events.empty()) writePoses(reader.leave(recording.events.back().stamp_ns + shift_ns));
    bag.close();
  } catch (const rosbag::BagException& error) {
    const std::string what = error.what();
    throw std::runtime_error("cannot write " + path + ": " + what.substr(0, what.find('\n')));
  }
  if (pose_count == 0) throw std::runtime_error("no pen came near in this recording: nothing to write");
  output.commit();
  return pose_count;
}

// ---------------------------------------------------------------- driver

TabletDriver::TabletDriver(ros::NodeHandle node, const TabletDriverParameters& parameters)
    : node_(std::move(node)), parameters_(parameters), brush_(measureBrush(parameters.simulator)) {
  pose_publisher_ = node_.advertise<geometry_msgs::PoseStamped>("handle_pose", kQueue);
  sample_publisher_ = node_.advertise<TabletSample>("tablet_sample", kQueue);
}

void TabletDriver::publish(const PenActions& actions) {
  for (const HandlePose& pose : actions.poses)
    pose_publisher_.publish(toPoseStamped(pose, parameters_.ros.paper_frame));
  const auto call = [&](const char* name) {
    services_.post([service = node_.resolveName(name)] { callAndLog(service); });
  };
  if (actions.dips) call("brush_simulator/dip_brush");
  if (actions.wipes) call("brush_simulator/wipe_brush");
  if (actions.clears) call("brush_simulator/clear_paper");
}

void TabletDriver::publish(const TabletReport& report) {
  publish(report.actions);
  if (sample_publisher_.getNumSubscribers() > 0)
    sample_publisher_.publish(toTabletSample(report.sample, report.sample.stamp_ns));
}

void TabletDriver::runDevice() {
  const TabletDeviceParameters& wanted = parameters_.tablet.device;
  std::string said;
  const auto sayOnce = [&](const std::string& what) {
    if (what != said) ROS_WARN_STREAM("tablet: " << what);
    said = what;
  };
  while (ros::ok()) {
    std::unique_ptr<TabletDevice> device;
    std::unique_ptr<TabletReader> reader;
    try {
      const TabletSearch search = findTablets();
      if (const auto path = chooseTablet(search, wanted.name)) {
        device = std::make_unique<TabletDevice>(*path, wanted.grab);
        reader = std::make_unique<TabletReader>(device->description(), parameters_.tablet, brush_);
      } else {
        sayOnce("waiting for " + (wanted.name.empty() ? "a pen tablet" : "\"" + wanted.name + "\"") +
                (search.unreadable.empty()
                     ? std::string()
                     : "; " + std::to_string(search.unreadable.size()) +
                           " input devices may not be read, " + search.unreadable.front() +
                           " for one: add yourself to the group input"));
      }
    } catch (const ParameterError&) {
      throw;  // waiting does not help
    } catch (const std::exception& error) {
      sayOnce(error.what());
      device.reset();
    }
    if (device == nullptr) {
      ros::WallDuration(parameters_.ros.search_period).sleep();
      ros::spinOnce();
      continue;
    }
    said.clear();
    ROS_INFO_STREAM("tablet: reading " << device->path() << ", "
                                       << describeTablet(device->description(), reader->decoder()));
    std::vector<InputEvent> events;
    std::int64_t drops = 0;
    bool is_there = true;
    while (ros::ok() && is_there) {
      events.clear();
      is_there = device->read(events, kReadTimeout_ms);
      for (const InputEvent& event : events)
        if (const auto report = reader->take(event)) publish(*report);
      if (events.empty()) publish(reader->rest(static_cast<std::int64_t>(ros::WallTime::now().toNSec())));
      if (device->dropCount() != drops) {
        drops = device->dropCount();
        ROS_WARN_STREAM("tablet: the kernel dropped events, this machine is too busy ("
                        << drops << " times so far)");
      }
      ros::spinOnce();
    }
    publish(reader->leave(static_cast<std::int64_t>(ros::WallTime::now().toNSec())));
    if (ros::ok()) sayOnce("\"" + device->description().name + "\" is gone");
  }
}

void TabletDriver::runRecording(const TabletRecording& recording, double speed) {
  if (recording.events.empty()) throw std::runtime_error("the recording has no events");
  TabletReader reader(recording.description, parameters_.tablet, brush_);
  ROS_INFO_STREAM("tablet: a recording of " << describeTablet(recording.description, reader.decoder()));
  while (ros::ok() && pose_publisher_.getNumSubscribers() == 0) {
    ROS_INFO_ONCE("tablet: waiting for someone who listens to handle_pose");
    ros::WallDuration(0.05).sleep();
    ros::spinOnce();
  }
  const ros::WallTime start = ros::WallTime::now();
  const std::int64_t first_ns = recording.events.front().stamp_ns;
  const auto start_ns = static_cast<std::int64_t>(start.toNSec());
  const std::int64_t shift_ns = start_ns - first_ns;
  for (InputEvent event : recording.events) {
    if (!ros::ok()) return;
    if (speed > 0.0) {
      const ros::WallTime due =
          start + ros::WallDuration(1e-9 * static_cast<double>(event.stamp_ns - first_ns) / speed);
      for (auto now = ros::WallTime::now(); now < due && ros::ok(); now = ros::WallTime::now()) {
        const double so_far = speed * (now - start).toSec();
        publish(reader.rest(start_ns + static_cast<std::int64_t>(1e9 * so_far)));
        ros::WallTime::sleepUntil(std::min(due, now + ros::WallDuration(1e-3 * kReadTimeout_ms)));
      }
    }
    event.stamp_ns += shift_ns;
    if (const auto report = reader.take(event)) publish(*report);
    ros::spinOnce();
  }
  publish(reader.leave(recording.events.back().stamp_ns + shift_ns));
  // What is still on its way goes out before the node ends.
  ros::WallDuration(1.0).sleep();
  ROS_INFO("tablet: the recording is over");
}

}  // namespace calligraphy_brush
