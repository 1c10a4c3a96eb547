#include <ros/master.h>
#include <ros/network.h>
#include <xmlrpcpp/XmlRpcClient.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <string>

#include "../temporary_folder.h"
#include "child.h"
#include "ros_fixture.h"

// What is written live, with dips, wipes and clears, is in the bag of record.launch and gives the same
// bits again.

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;

/// Topics of the simulator that a node is connected to, as the simulator says.
int connectionCount(const std::string& subscriber) {
  XmlRpc::XmlRpcValue request, answer, payload;
  request[0] = ros::this_node::getName();
  request[1] = "/brush_simulator";
  if (!ros::master::execute("lookupNode", request, answer, payload, false)) return 0;
  std::string host;
  std::uint32_t port = 0;
  if (!ros::network::splitURI(static_cast<std::string&>(payload), host, port)) return 0;
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  request.clear();
  request[0] = ros::this_node::getName();
  if (!client.execute("getBusInfo", request, answer) || answer.size() < 3) return 0;
  int count = 0;
  for (int k = 0; k < answer[2].size(); ++k)
    count += answer[2][k][1].getType() == XmlRpc::XmlRpcValue::TypeString &&
             static_cast<std::string&>(answer[2][k][1]) == subscriber &&
             static_cast<std::string&>(answer[2][k][2]) == "o";
  return count;
}

class Live : public BrushSimulatorTest {
 protected:
  std::string bag() const { return folder_.path("live.bag"); }

  /// What stroke_replay makes of the bag, with no word of brush or paper.
  std::string replayedHash() const {
    const std::string command =
        "'" STROKE_REPLAY "' '" + bag() + "' '" + folder_.path("o.png") + "' --quiet --hash";
    FILE* pipe = popen(command.c_str(), "r");
    std::array<char, 256> line{};
    const std::string hash = fgets(line.data(), 256, pipe) != nullptr ? line.data() : "";
    EXPECT_EQ(pclose(pipe), 0) << command;
    return hash.substr(0, hash.find('\n'));
  }

  TemporaryFolder folder_;
};

TEST_F(Live, EqualsReplayWithDipsWipesClearsAndAReset) {
  call("dip_brush");  // before the recording
  Child record({"roslaunch", "calligraphy_brush", "record.launch", "bag:=" + bag()});
  Listener<geometry_msgs::PoseStamped> accepted(node_, "accepted_pose");
  ASSERT_TRUE(spinUntil([&] { return fs::exists(bag() + ".active") && accepted.isConnected(); }));
  ASSERT_TRUE(spinUntil([&] { return connectionCount("/record") >= 3; }));

  std::uint64_t taken = 0, refused = 0;
  std::int64_t start_ns = 1'600'000'000'123'456'789;
  const auto write = [&](double y) {
    auto poses = makeStroke(start_ns, 0.02, y, 0.045);
    start_ns += 2'000'000'000;
    for (std::size_t k = 0; k < poses.size(); ++k) {
      publish(poses[k]);
      if (k == 30) publish(poses[k - 3]);         // late: refused, and not in the bag
      if (k == 40) publish(poses[k], "nowhere");  // refused by the clock of this node
    }
    taken += poses.size();
    refused += 2;
    ASSERT_TRUE(spinUntilTaken(taken, refused));
  };
  write(0.02);
  call("wipe_brush");
  write(0.03);  // dry
  call("dip_brush");
  write(0.04);
  call("clear_paper");
  write(0.05);
  const std::string before_reset = call("state_hash");
  call("reset");
  taken = refused = 0;
  start_ns -= 9'000'000'000;  // back in time
  write(0.06);
  call("dip_brush");
  write(0.07);
  const std::string live = call("state_hash");
  EXPECT_NE(live, before_reset);
  EXPECT_EQ(live.size(), 16U);
  record.end();
  ASSERT_TRUE(spinUntil([&] { return fs::exists(bag()); }));
  EXPECT_EQ(replayedHash(), live);
  // The last dip decides some bits: a replay without events must differ.
  call("dip_brush");
  EXPECT_NE(call("state_hash"), live);
}

TEST_F(Live, EqualsReplayWhenAResetTakesAnotherBrushAndSheet) {
  Child record({"roslaunch", "calligraphy_brush", "record.launch", "bag:=" + bag()});
  Listener<geometry_msgs::PoseStamped> accepted(node_, "accepted_pose");
  ASSERT_TRUE(spinUntil([&] { return fs::exists(bag() + ".active") && accepted.isConnected(); }));
  ASSERT_TRUE(spinUntil([&] { return connectionCount("/record") >= 3; }));
  const auto write = [&](double y) {
    const auto poses = makeStroke(1'600'000'000'123'456'789, 0.02, y, 0.045);
    publish(poses);
    ASSERT_TRUE(spinUntilTaken(poses.size()));
  };
  write(0.02);
  const std::string first = call("state_hash");
  ros::param::set("brush_simulator/brush/seed", 6);
  ros::param::set("brush_simulator/paper/width", 0.1);
  EXPECT_EQ(call("reset").rfind("brush and sheet as the parameters say now", 0), 0U);
  write(0.03);
  const std::string live = call("state_hash");

  // Bad values are refused by name, and nothing changes.
  ros::param::set("brush_simulator/brush/tip_length", -1.0);
  ros::param::set("brush_simulator/paper/width", 99.0);
  const std::string problem = call("reset", false);
  EXPECT_NE(problem.find("/brush_simulator/brush/tip_length = -1 is outside"), std::string::npos)
      << problem;
  EXPECT_NE(problem.find("/brush_simulator/paper/width = 99 is outside"), std::string::npos) << problem;
  EXPECT_EQ(call("state_hash"), live);
  ros::param::set("brush_simulator/brush/tip_length", 0.045);
  ros::param::set("brush_simulator/paper/width", 0.1);

  record.end();
  ASSERT_TRUE(spinUntil([&] { return fs::exists(bag()); }));
  EXPECT_EQ(replayedHash(), live);
  // With the values of before, the same strokes are others: the replay must have taken the new ones.
  ros::param::set("brush_simulator/brush/seed", 5);
  ros::param::set("brush_simulator/paper/width", 0.243);
  call("reset");
  write(0.03);
  EXPECT_NE(call("state_hash"), live);
  call("reset");
  write(0.02);
  EXPECT_EQ(call("state_hash"), first);
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "live_test");
  return RUN_ALL_TESTS();
}
