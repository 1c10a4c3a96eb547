#pragma once

#include <calligraphy_brush/BrushEvent.h>
#include <calligraphy_brush/BrushState.h>
#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/ros/conversions.h"

namespace calligraphy_brush {

constexpr double kDeadline = 30.0;  // [s]

/// Spins until it is so; false when the deadline passes first.
inline bool spinUntil(const std::function<bool()>& is_so, double deadline = kDeadline) {
  const auto start = ros::SteadyTime::now();
  while (!is_so()) {
    if (!ros::ok() || (ros::SteadyTime::now() - start).toSec() > deadline) return false;
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
  }
  return true;
}

/// Holds a subscription and the newest message.
template <class Message>
class Listener {
 public:
  Listener(ros::NodeHandle& node, const std::string& topic) {
    subscriber_ =
        node.subscribe<Message>(topic, 1000, [this](const boost::shared_ptr<const Message>& message) {
          newest = message;
          ++count;
        });
  }
  bool isConnected() const { return subscriber_.getNumPublishers() > 0; }

  boost::shared_ptr<const Message> newest;
  int count = 0;

 private:
  ros::Subscriber subscriber_;
};

/// A short stroke at 125 Hz: down onto the sheet, along it, up again.
///
/// Begins at `start_ns` above (x, y) [m], a brush of tip_length [m]; ends 10 mm further along x.
inline std::vector<HandlePose> makeStroke(std::int64_t start_ns, double x, double y, double tip_length) {
  std::vector<HandlePose> poses;
  constexpr int count = 100;
  for (int k = 0; k <= count; ++k) {
    const double s = static_cast<double>(k) / count;
    const double pressed = 0.006 * std::sin(s * 3.14159265358979) - 0.002;  // −2 .. 4 .. −2 mm
    HandlePose pose;
    pose.stamp_ns = start_ns + k * std::int64_t{8000000};
    pose.position = {x + 0.01 * s, y, tip_length - pressed};
    pose.orientation = Eigen::Quaterniond(Eigen::AngleAxisd(0.1 * s, Eigen::Vector3d::UnitY()));
    poses.push_back(pose);
  }
  return poses;
}

/// Connected to a running brush_simulator, which is reset before each test.
class BrushSimulatorTest : public testing::Test {
 protected:
  void SetUp() override {
    publisher_ = node_.advertise<geometry_msgs::PoseStamped>("handle_pose", 10000);
    ASSERT_TRUE(spinUntil([&] { return publisher_.getNumSubscribers() > 0 && state_.isConnected(); }))
        << "no brush_simulator";
    call("reset");
    ASSERT_TRUE(spinUntilState([](const BrushState& state) { return state.poses_accepted == 0; }));
  }

  /// Calls a private service of the simulator; the message of its answer.
  std::string call(const std::string& service, bool expect_success = true) {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::waitForService("brush_simulator/" + service, ros::Duration(kDeadline)));
    EXPECT_TRUE(ros::service::call("brush_simulator/" + service, trigger)) << service;
    EXPECT_EQ(trigger.response.success != 0, expect_success)
        << service << ": " << trigger.response.message;
    return trigger.response.message;
  }

  /// Waits for a brush_state made after this call for which it is so.
  bool spinUntilState(const std::function<bool(const BrushState&)>& is_so) {
    // The message under way may be older than the call: the second one is not.
    const int seen = state_.count;
    return spinUntil([&] { return state_.count >= seen + 2 && is_so(*state_.newest); });
  }

  void publish(const HandlePose& pose, const std::string& frame = "paper") {
    publisher_.publish(toPoseStamped(pose, frame));
  }
  void publish(const std::vector<HandlePose>& poses, const std::string& frame = "paper") {
    for (const HandlePose& pose : poses) publish(pose, frame);
  }
  bool spinUntilTaken(std::uint64_t accepted, std::uint64_t refused = 0) {
    return spinUntilState([&](const BrushState& state) {
      return state.poses_accepted == accepted && state.poses_refused == refused;
    });
  }

  ros::NodeHandle node_;
  ros::Publisher publisher_;
  Listener<BrushState> state_{node_, "brush_state"};
};

}  // namespace calligraphy_brush
