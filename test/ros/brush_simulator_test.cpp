#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "calligraphy_brush/files/png.h"
#include "ros_fixture.h"

// Run against node and nodelet: what is outside must not tell them apart.

namespace calligraphy_brush {
namespace {

constexpr double kTipLength = 0.02;  // as in brush_simulator.test

template <class Pixels>
long countInked(const Pixels& pixels) {
  return std::count_if(pixels.begin(), pixels.end(), [](auto grey) { return grey < 200; });
}

class OnRos : public BrushSimulatorTest {
 protected:
  void SetUp() override {
    BrushSimulatorTest::SetUp();
    ASSERT_TRUE(spinUntil([&] { return image_.isConnected() && map_.isConnected(); }));
  }

  /// The sheet as it is now: a picture on a topic may be on its way still, the one on disk is not.
  std::vector<std::uint8_t> picture() {
    const std::string path = call("save_image");
    const auto pixels = readPng(path).mono8;
    std::filesystem::remove(path);
    return pixels;
  }

  std::vector<HandlePose> stroke(std::int64_t start_ns = 1000000000000) const {
    return makeStroke(start_ns, 0.02, 0.025, kTipLength);
  }

  Listener<sensor_msgs::Image> image_{node_, "stroke_image"};
  Listener<nav_msgs::OccupancyGrid> map_{node_, "paper_map"};
};

TEST_F(OnRos, AStrokeLeavesInkOnImageAndMap) {
  ASSERT_TRUE(spinUntil([&] { return image_.newest && countInked(image_.newest->data) == 0; }));
  publish(stroke());
  ASSERT_TRUE(spinUntilTaken(101));
  EXPECT_EQ(state_.newest->header.frame_id, "paper");
  EXPECT_GE(state_.newest->header.stamp, ros::Time(1000.799));
  EXPECT_LE(state_.newest->header.stamp, ros::Time(1000.8));
  EXPECT_LT(state_.newest->ink_left, 1.0);
  EXPECT_EQ(state_.newest->groups, 16U) << "rods that do not feel each other";
  EXPECT_GT(state_.newest->tip_width, 1e-4);
  EXPECT_LT(state_.newest->tip_width, 0.01);
  EXPECT_GT(state_.newest->steps, 0U);
  EXPECT_EQ(state_.newest->touching_rods, 0U);  // it is up again
  EXPECT_LT(state_.newest->backlog, 0.01);
  EXPECT_EQ(state_.newest->stage_names.size(), state_.newest->stage_seconds.size());

  const auto expected = picture();
  ASSERT_GT(countInked(expected), 20);
  ASSERT_TRUE(spinUntil([&] { return image_.newest->data == expected; }));
  EXPECT_EQ(image_.newest->encoding, "mono8");
  EXPECT_EQ(image_.newest->header.frame_id, "paper");
  EXPECT_GT(image_.newest->header.stamp, ros::Time(1000.0));
  EXPECT_LE(image_.newest->header.stamp, state_.newest->header.stamp);
  EXPECT_TRUE(spinUntil([&] { return map_.newest->header.stamp == image_.newest->header.stamp; }));
  EXPECT_EQ(map_.newest->data, toOccupancyGrid(*image_.newest, map_.newest->info.resolution).data);
}

TEST_F(OnRos, AStrokeIsShownAndFelt) {
  Listener<visualization_msgs::MarkerArray> markers(node_, "tip_markers");
  Listener<geometry_msgs::WrenchStamped> wrench(node_, "handle_wrench");
  Listener<tf2_msgs::TFMessage> frames(node_, "/tf");
  ASSERT_TRUE(
      spinUntil([&] { return markers.isConnected() && wrench.isConnected() && frames.isConnected(); }));
  // Half of it: the brush stays pressed down.
  auto half = stroke();
  half.resize(51);
  publish(half);
  ASSERT_TRUE(spinUntilTaken(51));
  EXPECT_GT(state_.newest->touching_rods, 0U);

  const ros::Time end = state_.newest->header.stamp;
  ASSERT_TRUE(spinUntil([&] { return wrench.newest && wrench.newest->header.stamp == end; }));
  EXPECT_EQ(wrench.newest->header.frame_id, "paper");
  EXPECT_GT(wrench.newest->wrench.force.z, 0.0) << "the paper pushes up";

  const auto rods = [&]() -> const visualization_msgs::Marker* {
    if (!markers.newest) return nullptr;
    for (const auto& marker : markers.newest->markers)
      if (marker.ns == "rods" && marker.header.stamp == end) return &marker;
    return nullptr;
  };
  ASSERT_TRUE(spinUntil([&] { return rods() != nullptr; }));
  EXPECT_EQ(rods()->points.size(), 2U * 16U * 7U);  // as in brush_simulator.test
  EXPECT_EQ(rods()->header.frame_id, "paper");
  EXPECT_EQ(rods()->colors.size(), rods()->points.size());
  const auto& all = markers.newest->markers;
  const auto contacts =
      std::find_if(all.begin(), all.end(), [](const auto& marker) { return marker.ns == "contacts"; });
  ASSERT_NE(contacts, all.end());
  EXPECT_EQ(contacts->points.size(), state_.newest->touching_nodes);

  ASSERT_TRUE(
      spinUntil([&] { return frames.newest && frames.newest->transforms.at(0).header.stamp == end; }));
  EXPECT_EQ(frames.newest->transforms[0].header.frame_id, "paper");
  EXPECT_EQ(frames.newest->transforms[0].child_frame_id, "brush_handle");
  EXPECT_NEAR(frames.newest->transforms[0].transform.translation.x, half.back().position.x(), 1e-3);
}

TEST_F(OnRos, ServicesActOnBrushAndSheet) {
  publish(stroke());
  ASSERT_TRUE(spinUntilTaken(101));
  ASSERT_GT(countInked(picture()), 0);

  call("clear_paper");
  EXPECT_EQ(countInked(picture()), 0);
  EXPECT_TRUE(spinUntil([&] { return image_.newest && countInked(image_.newest->data) == 0; }));

  call("wipe_brush");
  EXPECT_TRUE(spinUntilState([](const BrushState& state) { return state.ink_left == 0.0; }));
  call("dip_brush");
  EXPECT_TRUE(spinUntilState([](const BrushState& state) { return state.ink_left > 0.999; }));
}

TEST_F(OnRos, AfterResetEarlierTimesBeginANewStrokeWithEqualInk) {
  publish(stroke());
  ASSERT_TRUE(spinUntilTaken(101));
  const auto first = picture();
  call("reset");
  ASSERT_TRUE(spinUntilTaken(0));
  EXPECT_EQ(countInked(picture()), 0);
  publish(stroke(500000000000));
  ASSERT_TRUE(spinUntilTaken(101));
  EXPECT_EQ(picture(), first);
}

TEST_F(OnRos, RefusedPosesAreCountedByKindAndChangeNothing) {
  publish(stroke());
  ASSERT_TRUE(spinUntilTaken(101));
  const auto expected = picture();
  const double expected_ink = state_.newest->ink_left;
  call("reset");
  ASSERT_TRUE(spinUntilTaken(0));

  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const auto poses = stroke();
  for (std::size_t k = 0; k < poses.size(); ++k) {
    publish(poses[k]);
    if (k % 20 != 10) continue;
    HandlePose bad = poses[k + 1];
    bad.position.y() = nan;
    publish(bad);
    bad = poses[k + 1];
    bad.orientation.coeffs().setConstant(nan);
    publish(bad);
    bad = poses[k + 1];
    bad.orientation.coeffs().setZero();
    publish(bad);
    publish(poses[k]);      // the same stamp once more
    publish(poses[k - 1]);  // and an earlier one
    bad = poses[k];
    bad.stamp_ns += 1000000;
    bad.position.x() += 0.1;  // 100 m/s
    publish(bad);
    publish(poses[k + 1], "");
  }
  publish(poses.back(), "nowhere");
  ASSERT_TRUE(spinUntilTaken(101, 5 * 7 + 1));
  EXPECT_EQ(state_.newest->refused_not_finite, 10U);
  EXPECT_EQ(state_.newest->refused_zero_quaternion, 5U);
  EXPECT_EQ(state_.newest->refused_not_later, 10U);
  EXPECT_EQ(state_.newest->refused_too_fast, 5U);
  EXPECT_EQ(state_.newest->refused_unknown_frame, 6U);
  EXPECT_EQ(state_.newest->ink_left, expected_ink);
  EXPECT_EQ(picture(), expected);
}

TEST_F(OnRos, PosesInOtherFramesAreBroughtToThePaperOnceTheFrameIsKnown) {
  publish(stroke());
  ASSERT_TRUE(spinUntilTaken(101));
  const auto expected = picture();
  call("reset");
  ASSERT_TRUE(spinUntilTaken(0));

  // A table whose x is the paper's -y: a quarter turn about z.
  const Eigen::Quaterniond table(Eigen::AngleAxisd(-1.5707963267948966, Eigen::Vector3d::UnitZ()));
  const Eigen::Vector3d table_origin(0.5, -0.25, 0.125);
  HandlePose X_PT;
  X_PT.position = table_origin;
  X_PT.orientation = table;
  const std::string frame = "table";
  std::vector<HandlePose> poses;
  for (HandlePose pose : stroke()) {
    pose.position = table.conjugate() * (pose.position - table_origin);
    pose.orientation = table.conjugate() * pose.orientation;
    poses.push_back(pose);
  }
  publish(poses, frame);
  ASSERT_TRUE(spinUntilState([](const BrushState& state) { return state.poses_waiting == 101; }));
  EXPECT_EQ(state_.newest->poses_accepted, 0U);
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(toTransformStamped(X_PT, "paper", frame));
  ASSERT_TRUE(spinUntilTaken(101));

  // The same but for rounding.
  const auto actual = picture();
  ASSERT_EQ(actual.size(), expected.size());
  int different = 0;
  for (std::size_t pixel = 0; pixel < actual.size(); ++pixel)
    different += std::abs(int{actual[pixel]} - int{expected[pixel]}) > 32 ? 1 : 0;
  EXPECT_LT(different, countInked(expected) / 10);
}

TEST_F(OnRos, AStampFarAheadIsRefusedAndBlocksNothing) {
  HandlePose far = stroke()[0];
  far.stamp_ns = toNanoseconds(ros::Time::now()) + 3600'000'000'000;
  publish(far);  // as the first one
  const auto poses = stroke();
  for (std::size_t k = 0; k < poses.size(); ++k) {
    publish(poses[k]);
    if (k != 50) continue;
    far = poses[k + 1];
    far.stamp_ns += 3600'000'000'000;
    publish(far);
  }
  ASSERT_TRUE(spinUntilTaken(101, 2));
  EXPECT_EQ(state_.newest->refused_too_far_ahead, 2U);
  EXPECT_LT(state_.newest->backlog, 0.01);
}

TEST_F(OnRos, WhenPosesStopTheTipHoldsAndGoesOnElsewhereWithoutALine) {
  const auto poses = stroke();
  publish(std::vector<HandlePose>(poses.begin(), poses.begin() + 51));
  ASSERT_TRUE(spinUntilTaken(51));
  const auto before = picture();
  ASSERT_TRUE(spinUntilState([](const BrushState& state) { return state.holding; }));
  EXPECT_GT(state_.newest->silence, 0.2);
  EXPECT_GT(state_.newest->touching_rods, 0U);
  EXPECT_EQ(picture(), before) << "the tip did not hold";

  // Back 15 mm further along y: nothing may be written between.
  std::vector<HandlePose> rest(poses.begin() + 51, poses.end());
  for (HandlePose& pose : rest) {
    pose.stamp_ns += 1'000'000'000;
    pose.position.y() += 0.015;
  }
  publish(rest);
  ASSERT_TRUE(spinUntilTaken(101));
  const auto after = picture();
  const auto inkedRows = [&](std::size_t first, std::size_t last) {
    constexpr std::size_t width = 100;  // 50 mm of 2 px, as in brush_simulator.test; the top row first
    long count = 0;
    for (std::size_t pixel = first * width; pixel < last * width; ++pixel) count += after[pixel] < 200;
    return count;
  };
  EXPECT_GT(inkedRows(40, 60), 0) << "y = 20 .. 30 mm";
  EXPECT_EQ(inkedRows(28, 40), 0) << "y = 30 .. 36 mm, between the strokes";
  EXPECT_GT(inkedRows(10, 28), 0) << "y = 36 .. 45 mm";
}

TEST_F(OnRos, AfterAPauseOnTheSpotTheStrokeGoesOn) {
  auto poses = stroke();
  publish(poses);
  ASSERT_TRUE(spinUntilTaken(101));
  const auto without_pause = picture();
  call("reset");
  ASSERT_TRUE(spinUntilTaken(0));
  for (std::size_t k = 51; k < poses.size(); ++k) poses[k].stamp_ns += 1'000'000'000;
  publish(poses);
  ASSERT_TRUE(spinUntilTaken(101));
  // The handle stood still for a second: rods settle, and that is all.
  const auto with_pause = picture();
  int different = 0;
  for (std::size_t pixel = 0; pixel < with_pause.size(); ++pixel)
    different += std::abs(int{with_pause[pixel]} - int{without_pause[pixel]}) > 100 ? 1 : 0;
  EXPECT_LT(different, countInked(without_pause) / 5);
}

TEST_F(OnRos, AClockThatDiffersIsNoticed) {
  Listener<diagnostic_msgs::DiagnosticArray> diagnostics(node_, "/diagnostics");
  ASSERT_TRUE(spinUntil([&] { return diagnostics.isConnected(); }));
  for (const double difference : {7.0, -3.0}) {
    call("reset");
    const auto is_noticed = [&] {
      publish(stroke(toNanoseconds(ros::Time::now()) - std::llround(1e9 * difference))[0]);
      return state_.newest && std::abs(state_.newest->clock_difference - difference) < 0.4 &&
             diagnostics.newest && !diagnostics.newest->status.empty() &&
             diagnostics.newest->status[0].message.find("clock") != std::string::npos;
    };
    EXPECT_TRUE(spinUntil(is_noticed)) << difference << " s";
  }
}

TEST_F(OnRos, CommandsWaitForThePosesThatTheyComeAfter) {
  auto commands = node_.advertise<BrushEvent>("brush_command", 10);
  Listener<BrushEvent> events(node_, "brush_events");
  ASSERT_TRUE(spinUntil([&] { return commands.getNumSubscribers() > 0 && events.isConnected(); }));
  const auto poses = stroke();
  BrushEvent command;
  command.kind = BrushEvent::WIPE;
  command.header.stamp = toRosTime(poses[100].stamp_ns);
  commands.publish(command);
  publish(poses);
  ASSERT_TRUE(spinUntilState([](const BrushState& state) { return state.ink_left == 0.0; }));
  EXPECT_GT(countInked(picture()), 20) << "the brush was wiped before it wrote";
  ASSERT_TRUE(spinUntil([&] { return events.newest && events.newest->kind == BrushEvent::WIPE; }));
  EXPECT_EQ(events.newest->header.stamp, command.header.stamp);

  command.kind = 77;
  commands.publish(command);
  command.kind = BrushEvent::DIP;
  command.header.stamp = ros::Time();
  commands.publish(command);
  EXPECT_TRUE(spinUntilState([](const BrushState& state) { return state.ink_left > 0.999; }));
}

TEST_F(OnRos, DiagnosticsTellOfRefusedPoses) {
  Listener<diagnostic_msgs::DiagnosticArray> diagnostics(node_, "/diagnostics");
  ASSERT_TRUE(spinUntil([&] { return diagnostics.isConnected(); }));
  publish(stroke()[0]);
  publish(stroke()[0]);
  const auto warns = [&] {
    return diagnostics.newest && !diagnostics.newest->status.empty() &&
           diagnostics.newest->status[0].level == diagnostic_msgs::DiagnosticStatus::WARN;
  };
  ASSERT_TRUE(spinUntil(warns));
  EXPECT_EQ(diagnostics.newest->status[0].message, "poses refused");
  EXPECT_EQ(diagnostics.newest->status[0].name, "brush_simulator: brush");
  // Nothing new: it calms down.
  ASSERT_TRUE(spinUntil([&] { return !warns(); }));
  EXPECT_EQ(diagnostics.newest->status[0].message, "running");
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "brush_simulator_test");
  return RUN_ALL_TESTS();
}
