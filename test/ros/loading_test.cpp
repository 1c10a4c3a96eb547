#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/ros.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <string>
#include <vector>

namespace {

/// Runs a command; its output, both streams, and the exit code.
int run(const std::string& command, std::string& output) {
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (pipe == nullptr) return -1;
  std::array<char, 4096> buffer{};
  while (fgets(buffer.data(), static_cast<int>(buffer.size()), pipe) != nullptr) output += buffer.data();
  const int status = pclose(pipe);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

void setBadParameters(const std::string& ns) {
  ros::param::set(ns + "/brush/tip_length", 7);
  ros::param::set(ns + "/brush/rod_count", "many");
  ros::param::set(ns + "/rods/time_stepp", 0.001);
  ros::param::set(ns + "/paper/px_per_mm", -4.0);
  ros::param::set(ns + "/ros/state_rate", 0);
}

void expectAllAreNamed(const std::string& ns, const std::string& output) {
  for (const char* line :
       {"/brush/tip_length = 7 is outside [",
        "/brush/rod_count = many is not a whole number, legal are [",
        "/rods/time_stepp = 0.001 is not a known parameter", "/paper/px_per_mm = -4 is outside [",
        "/ros/state_rate = 0 is outside [0.1, 1000] Hz"})
    EXPECT_NE(output.find(ns + line), std::string::npos) << line << "\nis not in\n" << output;
}

TEST(BadParameters, NodeNamesAllOfThemAndExitsWith1) {
  setBadParameters("/bad_node");
  std::string output;
  EXPECT_EQ(run("'" BRUSH_SIMULATOR_NODE "' __name:=bad_node", output), 1);
  expectAllAreNamed("/bad_node", output);
}

TEST(BadParameters, NamesOfFramesAndFilesAreChecked) {
  ros::param::set("/bad_frames/ros/paper_frame", "/paper");
  ros::param::set("/bad_frames/ros/handle_frame", "");
  ros::param::set("/bad_frames/ros/image_path", "");
  std::string output;
  EXPECT_EQ(run("'" BRUSH_SIMULATOR_NODE "' __name:=bad_frames", output), 1);
  EXPECT_NE(output.find("/bad_frames/ros/paper_frame = \"/paper\" is not a frame name"),
            std::string::npos);
  EXPECT_NE(output.find("/bad_frames/ros/handle_frame = \"\" is not a frame name"), std::string::npos);
  EXPECT_NE(output.find("/bad_frames/ros/image_path = \"\" is not the name of a file"),
            std::string::npos);
}

TEST(BadParameters, NodeletIsNotLoadedAndItsManagerLivesOn) {
  ASSERT_TRUE(ros::service::waitForService("manager/load_nodelet", ros::Duration(30)));
  setBadParameters("/bad_nodelet");
  nodelet::NodeletLoad load;
  load.request.name = "/bad_nodelet";
  load.request.type = "calligraphy_brush/brush_simulator";
  EXPECT_FALSE(ros::service::call("manager/load_nodelet", load) && load.response.success);

  load.request.name = "/good_nodelet";
  ASSERT_TRUE(ros::service::call("manager/load_nodelet", load));
  EXPECT_TRUE(load.response.success);
  nodelet::NodeletList list;
  ASSERT_TRUE(ros::service::call("manager/list", list));
  EXPECT_EQ(list.response.nodelets, std::vector<std::string>{"/good_nodelet"});
  nodelet::NodeletUnload unload;
  unload.request.name = load.request.name;
  EXPECT_TRUE(ros::service::call("manager/unload_nodelet", unload) && unload.response.success);
}

TEST(Nodelet, CanBeUnloadedWhilePosesCome) {
  ros::NodeHandle node;
  auto publisher = node.advertise<geometry_msgs::PoseStamped>("handle_pose", 10000);
  ASSERT_TRUE(ros::service::waitForService("manager/load_nodelet", ros::Duration(30)));
  for (int round = 0; round < 5; ++round) {
    nodelet::NodeletLoad load;
    load.request.name = "/short_lived_" + std::to_string(round);
    load.request.type = "calligraphy_brush/brush_simulator";
    ASSERT_TRUE(ros::service::call("manager/load_nodelet", load) && load.response.success);
    while (publisher.getNumSubscribers() == 0) ros::WallDuration(0.001).sleep();
    geometry_msgs::PoseStamped pose;
    pose.pose.orientation.w = 1;
    pose.pose.position.z = 0.04;
    for (int k = 0; k < 2000; ++k) {
      pose.header.stamp = ros::Time(1.0 + 0.008 * k);
      pose.header.frame_id = k % 2 == 0 || round % 2 == 0 ? "paper" : "unknown";
      publisher.publish(pose);
    }
    nodelet::NodeletUnload unload;
    unload.request.name = load.request.name;
    EXPECT_TRUE(ros::service::call("manager/unload_nodelet", unload) && unload.response.success);
  }
  nodelet::NodeletList list;
  EXPECT_TRUE(ros::service::call("manager/list", list)) << "the manager died";
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "loading_test");
  const ros::NodeHandle node;
  return RUN_ALL_TESTS();
}
