#include <geometry_msgs/WrenchStamped.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <iomanip>
#include <random>
#include <sstream>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/ros/brush_simulator_parameters.h"
#include "calligraphy_brush/ros/gantry.h"
#include "calligraphy_brush/sim/simulator.h"
#include "ros_fixture.h"

// An arm moves the brush: its joints, robot_state_publisher and tf are between the poses and the sheet.

namespace calligraphy_brush {
namespace {

TEST(Gantry, JointsPutTheHandleAtThePose) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  for (int k = 0; k < 1000; ++k) {
    HandlePose pose;
    pose.position = {number(random), number(random), number(random)};
    pose.orientation =
        Eigen::Quaterniond(number(random), number(random), number(random), number(random)).normalized();
    if (k == 0) pose.orientation.setIdentity();
    if (k == 1) pose.orientation = Eigen::AngleAxisd(std::acos(0.0), Eigen::Vector3d::UnitY());
    const auto joints = gantryJoints(pose);
    const Eigen::Quaterniond R = Eigen::AngleAxisd(joints[3], Eigen::Vector3d::UnitX()) *
                                 Eigen::AngleAxisd(joints[4], Eigen::Vector3d::UnitY()) *
                                 Eigen::AngleAxisd(joints[5], Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d p =
        Eigen::Vector3d(joints[0], joints[1], joints[2]) - R * Eigen::Vector3d(0, 0, kGantryGrip);
    EXPECT_LT(R.angularDistance(pose.orientation), 1e-7);
    EXPECT_LT((p - pose.position).norm(), 1e-12);
  }
}

class Robot : public testing::Test {
 protected:
  ros::NodeHandle node_;
};

TEST_F(Robot, WritesThroughTfWhatThePosesWriteAndIsPushedBackAt500Hz) {
  auto publisher = node_.advertise<geometry_msgs::PoseStamped>("wanted_pose", 10000);
  Listener<BrushState> state(node_, "brush_state");
  Listener<geometry_msgs::PoseStamped> accepted(node_, "accepted_pose");
  Listener<geometry_msgs::WrenchStamped> wrench(node_, "handle_wrench");
  std::vector<geometry_msgs::PoseStamped> taken;
  const auto takes = node_.subscribe<geometry_msgs::PoseStamped>(
      "accepted_pose", 1000,
      [&](const geometry_msgs::PoseStampedConstPtr& message) { taken.push_back(*message); });
  ASSERT_TRUE(spinUntil([&] {
    return publisher.getNumSubscribers() > 0 && state.isConnected() && accepted.isConnected() &&
           wrench.isConnected() && takes.getNumPublishers() > 0;
  }));
  // The whole chain is connected when a pose goes through it.
  HandlePose first;
  first.position = {0.02, 0.03, 0.08};
  ASSERT_TRUE(spinUntil([&] {
    first.stamp_ns = toNanoseconds(ros::Time::now());
    publisher.publish(toPoseStamped(first, "paper"));
    ros::WallDuration(0.02).sleep();
    return accepted.count > 0 && wrench.count > 0;
  }));
  std_srvs::Trigger reset;
  ASSERT_TRUE(ros::service::call("brush_simulator/reset", reset));
  // The poses before it are through, too.
  ASSERT_TRUE(spinUntil([&] { return state.newest && state.newest->poses_accepted == 0; }));
  taken.clear();

  auto poses = makeStroke(toNanoseconds(ros::Time::now()), 0.02, 0.03, 0.045);
  const int wrenches_before = wrench.count;
  std::vector<double> upward;
  const auto forces = node_.subscribe<geometry_msgs::WrenchStamped>(
      "handle_wrench", 1000, [&](const geometry_msgs::WrenchStampedConstPtr& message) {
        upward.push_back(message->wrench.force.z);
      });
  // One after another: robot_state_publisher keeps one joint state, the newest. The forces of the steps
  // to each are waited for, too: those of poses that come faster than time are thinned out.
  constexpr std::int64_t wrench_period_ns = 2'000'000;
  for (const HandlePose& pose : poses) {
    publisher.publish(toPoseStamped(pose, "paper"));
    ASSERT_TRUE(spinUntil([&] {
      return !taken.empty() && toNanoseconds(taken.back().header.stamp) == pose.stamp_ns &&
             (pose.stamp_ns == poses.front().stamp_ns ||
              toNanoseconds(wrench.newest->header.stamp) > pose.stamp_ns - wrench_period_ns);
    }));
  }
  // Evenly, and more than one for each pose: four are due in the 8 ms between two.
  ASSERT_TRUE(
      spinUntil([&] { return wrench.count - wrenches_before > 3 * static_cast<int>(poses.size()); }));
  EXPECT_GT(*std::max_element(upward.begin(), upward.end()), 0.0) << "the sheet did not push back";

  ASSERT_EQ(taken.size(), poses.size());
  for (const auto& message : taken) {
    const HandlePose pose = toHandlePose(message);
    const auto sent = std::find_if(poses.begin(), poses.end(), [&](const HandlePose& candidate) {
      return candidate.stamp_ns == pose.stamp_ns;
    });
    ASSERT_NE(sent, poses.end());
    EXPECT_LT((pose.position - sent->position).norm(), 1e-12);
    EXPECT_LT(pose.orientation.angularDistance(sent->orientation), 1e-7);
  }
  // Those poses, offline, give these bits.
  SimulatorParameters parameters;
  {
    BrushSimulatorParameters all;
    loadYamlParameters(CALLIGRAPHY_BRUSH_SOURCE_DIR "/test/ros/live_brush.yaml", all);
    loadYamlParameters(CALLIGRAPHY_BRUSH_SOURCE_DIR "/config/papers/half_hanshi.yaml", all);
    parameters = all.simulator;
  }
  Simulator simulator(parameters);
  for (const auto& message : taken) {
    simulator.addPose(toHandlePose(message));
    simulator.advance();
  }
  EXPECT_GT(simulator.paper().inkVolume(), 0.0);
  std_srvs::Trigger hash;
  ASSERT_TRUE(ros::service::call("brush_simulator/state_hash", hash));
  std::ostringstream expected;
  expected << std::hex << std::setfill('0') << std::setw(16) << simulator.stateHash();
  EXPECT_EQ(hash.response.message, expected.str());
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "robot_test");
  return RUN_ALL_TESTS();
}
