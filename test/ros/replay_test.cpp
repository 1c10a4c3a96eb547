#include <rosbag/bag.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "calligraphy_brush/files/png.h"
#include "ros_fixture.h"

// The same bag gives the same bits: offline, and played at any speed into the node.

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;

class Replay : public BrushSimulatorTest, public testing::WithParamInterface<double> {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("calligraphy_brush_replay_" + std::to_string(getpid()));
    fs::create_directory(folder_);
    rosbag::Bag bag((folder_ / "stroke.bag").string(), rosbag::bagmode::Write);
    for (const HandlePose& pose : makeStroke(1600000000123456789, 0.02, 0.025, 0.045)) {
      const auto message = toPoseStamped(pose, "paper");
      bag.write("/handle_pose", message.header.stamp, message);
    }
    bag.close();
    const std::string command = "'" STROKE_REPLAY "' '" + (folder_ / "stroke.bag").string() + "' '" +
                                (folder_ / "offline.png").string() +
                                "' --brush medium --paper plain --quiet";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  static fs::path folder_;
};
fs::path Replay::folder_;

TEST_P(Replay, PlayedIntoTheNodeGivesTheBitsOfTheOfflineRun) {
  publisher_.shutdown();  // rosbag play must wait for the node, not for us
  const std::string command = "rosbag play --quiet --wait-for-subscribers --queue 10000 --rate " +
                              std::to_string(GetParam()) + " '" + (folder_ / "stroke.bag").string() +
                              "'";
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
  ASSERT_TRUE(spinUntilTaken(101));
  const std::string path = call("save_image");
  const GreyPicture live = readPng(path);
  fs::remove(path);
  const GreyPicture offline = readPng((folder_ / "offline.png").string());
  EXPECT_EQ(live.width_px, offline.width_px);
  EXPECT_EQ(live.height_px, offline.height_px);
  EXPECT_TRUE(live.mono8 == offline.mono8);
  EXPECT_LT(*std::min_element(live.mono8.begin(), live.mono8.end()), 100) << "nothing was written";
}

INSTANTIATE_TEST_SUITE_P(AtRates, Replay, testing::Values(1.0, 7.0));

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "replay_test");
  return RUN_ALL_TESTS();
}
