#include <calligraphy_brush/TabletSample.h>
#include <linux/input-event-codes.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "../temporary_folder.h"
#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/ros/brush_simulator_parameters.h"
#include "calligraphy_brush/ros/tablet_driver.h"
#include "calligraphy_brush/tablet/evemu.h"
#include "child.h"
#include "ros_fixture.h"

// tablet_driver_node reads a recording and moves the brush of brush_simulator_node: a pen comes near,
// dips with its button, writes, leaves; its eraser end touches and wipes.

namespace calligraphy_brush {
namespace {

constexpr std::int64_t kMs = 1'000'000;

/// What a hand did with a tablet of 200 mm x 125 mm, 200 reports a second.
class Recorder {
 public:
  Recorder() {
    TabletDescription& d = recording.description;
    d.name = "Test Tablet Pen";
    d.bus = 3;
    d.codes[EV_SYN] = {SYN_REPORT};
    d.codes[EV_KEY] = {BTN_TOOL_PEN, BTN_TOOL_RUBBER, BTN_TOUCH, BTN_STYLUS};
    d.axes[ABS_X] = {0, 20000, 0, 0, 100};
    d.axes[ABS_Y] = {0, 12500, 0, 0, 100};
    d.axes[ABS_PRESSURE] = {0, 1000, 0, 0, 0};
    d.axes[ABS_TILT_X] = {-64, 63, 0, 0, 57};
    d.axes[ABS_TILT_Y] = {-64, 63, 0, 0, 57};
    for (const auto& [code, axis] : d.axes) d.codes[EV_ABS].insert(code);
    recording.has_description = true;
  }

  void set(std::uint16_t type, std::uint16_t code, int value) {
    recording.events.push_back({now_ns, type, code, value});
  }
  void report() {
    set(EV_SYN, SYN_REPORT, 0);
    now_ns += 5 * kMs;
    ++report_count;
  }
  /// Reports for a time, with the pen going evenly from x to x [mm] and from pressure to pressure.
  void move(double from_x, double to_x, double from_pressure, double to_pressure, int reports) {
    for (int k = 1; k <= reports; ++k) {
      const double s = static_cast<double>(k) / reports;
      set(EV_ABS, ABS_X, static_cast<int>(100 * (from_x + s * (to_x - from_x))));
      set(EV_ABS, ABS_Y, 6000 + k % 2);  // a report without news is none
      set(EV_ABS, ABS_PRESSURE,
          static_cast<int>(1000 * (from_pressure + s * (to_pressure - from_pressure))));
      set(EV_ABS, ABS_TILT_X, 10);
      set(EV_ABS, ABS_TILT_Y, 20);
      report();
    }
  }

  TabletRecording recording;
  std::int64_t now_ns = 1000 * kMs;
  int report_count = 0;
};

Recorder recordAStroke() {
  Recorder hand;
  hand.set(EV_KEY, BTN_TOOL_PEN, 1);
  hand.move(50, 55, 0, 0, 20);
  hand.set(EV_KEY, BTN_STYLUS, 1);  // dips
  hand.move(55, 60, 0, 0, 10);
  hand.set(EV_KEY, BTN_STYLUS, 0);
  hand.move(60, 60, 0, 0, 60);
  hand.set(EV_KEY, BTN_TOUCH, 1);
  hand.move(60, 62, 0, 0.7, 30);
  hand.move(62, 130, 0.7, 0.7, 100);
  hand.move(130, 135, 0.7, 0, 30);
  hand.set(EV_KEY, BTN_TOUCH, 0);
  hand.move(135, 150, 0, 0, 60);
  hand.set(EV_KEY, BTN_TOOL_PEN, 0);
  hand.report();
  hand.now_ns += 300 * kMs;
  hand.set(EV_KEY, BTN_TOOL_RUBBER, 1);
  hand.move(40, 42, 0, 0, 10);
  hand.set(EV_KEY, BTN_TOUCH, 1);  // wipes
  hand.move(42, 60, 0.5, 0.5, 20);
  hand.set(EV_KEY, BTN_TOUCH, 0);
  hand.move(60, 62, 0, 0, 10);
  hand.set(EV_KEY, BTN_TOOL_RUBBER, 0);
  hand.report();
  return hand;
}

class TabletDriverNode : public testing::Test {
 protected:
  ros::NodeHandle node_;
};

TEST_F(TabletDriverNode, WritesWhatARecordingSaysAndDipsAndWipesTheSimulator) {
  const TemporaryFolder folder;
  const Recorder hand = recordAStroke();
  {
    std::ofstream file(folder.path("stroke.events"));
    writeEvemuDescription(file, hand.recording.description);
    for (const InputEvent& event : hand.recording.events) writeEvemuEvent(file, event);
  }

  Listener<BrushState> state(node_, "brush_state");
  std::vector<std::uint8_t> events;
  const auto takes_events = node_.subscribe<BrushEvent>(
      "brush_events", 100, [&](const BrushEventConstPtr& event) { events.push_back(event->kind); });
  std::vector<geometry_msgs::PoseStamped> accepted;
  const auto takes_accepted = node_.subscribe<geometry_msgs::PoseStamped>(
      "accepted_pose", 10000,
      [&](const geometry_msgs::PoseStampedConstPtr& pose) { accepted.push_back(*pose); });
  Listener<TabletSample> samples(node_, "tablet_sample");
  Listener<sensor_msgs::Image> image(node_, "stroke_image");
  ASSERT_TRUE(spinUntil([&] {
    return state.isConnected() && image.isConnected() && takes_events.getNumPublishers() > 0 &&
           takes_accepted.getNumPublishers() > 0;
  }));
  // No ink before: what is on the sheet afterwards came by the button.
  std_srvs::Trigger wipe;
  ASSERT_TRUE(ros::service::call("brush_simulator/wipe_brush", wipe));
  ASSERT_TRUE(spinUntil([&] { return !events.empty() && image.newest; }));
  ASSERT_EQ(events, std::vector<std::uint8_t>{BrushEvent::WIPE});
  const auto inkAt = [&] {
    std::vector<std::size_t> columns;
    for (std::size_t k = 0; k < image.newest->data.size(); ++k)
      if (image.newest->data[k] < 200) columns.push_back(k % image.newest->width);
    return columns;
  };
  ASSERT_TRUE(inkAt().empty());

  Child driver({PROGRAMS "/tablet_driver_node", "--recording", folder.path("stroke.events")});
  ASSERT_TRUE(spinUntil([&] { return events.size() >= 3; })) << events.size() << " events";
  EXPECT_EQ(driver.wait(), 0);

  // The poses are those that the same code makes without ROS, at stamps that all differ by the same.
  BrushSimulatorParameters all;
  loadYamlParameters(CALLIGRAPHY_BRUSH_SOURCE_DIR "/test/ros/live_brush.yaml", all);
  loadYamlParameters(CALLIGRAPHY_BRUSH_SOURCE_DIR "/config/papers/half_hanshi.yaml", all);
  TabletReader reader(hand.recording.description, TabletParameters(), measureBrush(all.simulator));
  std::vector<HandlePose> expected;
  const auto add = [&](const PenActions& actions) {
    expected.insert(expected.end(), actions.poses.begin(), actions.poses.end());
  };
  for (const InputEvent& event : hand.recording.events)
    if (const auto report = reader.take(event)) add(report->actions);
  add(reader.leave(hand.recording.events.back().stamp_ns));
  ASSERT_TRUE(spinUntil([&] { return accepted.size() >= expected.size(); }))
      << accepted.size() << " of " << expected.size();
  ASSERT_EQ(accepted.size(), expected.size());
  const std::int64_t shift_ns = toNanoseconds(accepted.front().header.stamp) - expected.front().stamp_ns;
  for (std::size_t k = 0; k < expected.size(); ++k) {
    const HandlePose pose = toHandlePose(accepted[k]);
    EXPECT_EQ(accepted[k].header.frame_id, "paper");
    EXPECT_EQ(pose.stamp_ns - shift_ns, expected[k].stamp_ns) << k;
    EXPECT_LT((pose.position - expected[k].position).norm(), 1e-12) << k;
    EXPECT_LT(pose.orientation.angularDistance(expected[k].orientation), 1e-7) << k;
  }
  // The first ones may be gone before this node is connected; the driver waits for the simulator only.
  EXPECT_GT(samples.count, hand.report_count / 2);
  EXPECT_EQ(samples.newest->tool, TabletSample::NONE);

  // The button dipped, then it wrote, then the eraser wiped.
  EXPECT_EQ(events, (std::vector<std::uint8_t>{BrushEvent::WIPE, BrushEvent::DIP, BrushEvent::WIPE}));
  ASSERT_TRUE(spinUntil([&] { return state.newest && state.newest->ink_left == 0.0; }));
  EXPECT_EQ(state.newest->poses_refused, 0U);
  ASSERT_TRUE(spinUntil([&] { return !inkAt().empty() && state.newest->holding; }));
  auto columns = inkAt();
  EXPECT_GT(columns.size(), 500U);
  // The line from 62 mm to 130 mm of 200 mm lies where the sheet has it; the tip trails by up to 2 cm.
  std::sort(columns.begin(), columns.end());
  const double px_per_mm = image.newest->width / 243.0;
  const double scale = std::min(243.0 / 200.0, 167.0 / 125.0);
  const auto place = [&](double x) { return (243.0 / 2 + scale * (x - 100.0)) * px_per_mm; };
  EXPECT_GT(columns.front(), place(60) - 20 * px_per_mm);
  EXPECT_LT(columns.back(), place(135) + 20 * px_per_mm);
  EXPECT_LT(columns[columns.size() / 10], place(80));
  EXPECT_GT(columns[columns.size() * 9 / 10], place(110));
}

TEST_F(TabletDriverNode, SaysWhatIsWrongWithARecordingAndEnds) {
  const TemporaryFolder folder;
  const auto complaint = [&](const std::string& text) {
    const std::string file = folder.write("bad.events", text), said = folder.path("said");
    Child driver(
        {"sh", "-c",
         "exec '" PROGRAMS "/tablet_driver_node' --recording '" + file + "' 2> '" + said + "'"});
    EXPECT_EQ(driver.wait(), 1) << text;
    return readWhole(said);
  };
  EXPECT_NE(complaint("not a recording\n").find("bad.events:1: not a line of an evemu recording"),
            std::string::npos);
  EXPECT_NE(complaint("N: no events\n").find("bad.events: no events"), std::string::npos);
  EXPECT_NE(complaint("N: a mouse\nE: 1.000000 0000 0000 0\n").find("a mouse"), std::string::npos);
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "tablet_driver_test");
  return RUN_ALL_TESTS();
}
