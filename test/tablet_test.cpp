#include <gtest/gtest.h>
#include <linux/input-event-codes.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>
#include <vector>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/tablet/evemu.h"
#include "calligraphy_brush/tablet/pen_mapping.h"
#include "calligraphy_brush/tablet/report_clock.h"
#include "calligraphy_brush/tablet/tablet_decoder.h"
#include "calligraphy_brush/tablet/tablet_device.h"
#include "temporary_folder.h"

namespace calligraphy_brush {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;
constexpr std::int64_t kMs = 1'000'000;

/// A tablet of 200 mm x 100 mm as a Wacom of today describes itself.
TabletDescription makeTablet() {
  TabletDescription d;
  d.name = "Test Tablet Pen";
  d.bus = 3;
  d.vendor = 0x56a;
  d.product = 0x1234;
  d.version = 0x110;
  d.properties = {INPUT_PROP_POINTER};
  d.codes[EV_SYN] = {SYN_REPORT, SYN_DROPPED};
  d.codes[EV_KEY] = {BTN_TOOL_PEN, BTN_TOOL_RUBBER, BTN_TOUCH, BTN_STYLUS, BTN_STYLUS2};
  d.codes[EV_MSC] = {MSC_SERIAL};
  d.axes[ABS_X] = {0, 20000, 4, 0, 100};
  d.axes[ABS_Y] = {0, 10000, 4, 0, 100};
  d.axes[ABS_Z] = {-900, 899, 0, 0, 287};
  d.axes[ABS_PRESSURE] = {0, 1000, 0, 0, 0};
  d.axes[ABS_DISTANCE] = {0, 100, 0, 0, 0};
  d.axes[ABS_TILT_X] = {-64, 63, 0, 0, 57};
  d.axes[ABS_TILT_Y] = {-64, 63, 0, 0, 57};
  for (const auto& [code, axis] : d.axes) d.codes[EV_ABS].insert(code);
  return d;
}

/// Feeds a decoder as the kernel would.
class Kernel {
 public:
  explicit Kernel(const TabletDescription& d, const TabletParameters& p = {}) : decoder(d, p) {}
  void key(std::uint16_t code, int value) { EXPECT_FALSE(decoder.take({now, EV_KEY, code, value})); }
  void abs(std::uint16_t code, int value) { EXPECT_FALSE(decoder.take({now, EV_ABS, code, value})); }
  PenSample report(std::int64_t after_ns = 5 * kMs) {
    const auto sample = decoder.take({now, EV_SYN, SYN_REPORT, 0});
    EXPECT_TRUE(sample.has_value());
    now += after_ns;
    return sample.value_or(PenSample{});
  }
  TabletDecoder decoder;
  std::int64_t now = 1'000'000'000;
};

// ---------------------------------------------------------------- evemu files

TEST(Evemu, WhatIsWrittenIsReadBack) {
  const TabletDescription d = makeTablet();
  const std::vector<InputEvent> events = {{1369413757964832000, EV_ABS, ABS_TILT_X, -12},
                                          {1369413757964832000, EV_KEY, BTN_TOOL_PEN, 1},
                                          {1369413758000001000, EV_SYN, SYN_REPORT, 0}};
  std::ostringstream text;
  writeEvemuDescription(text, d);
  for (const InputEvent& event : events) writeEvemuEvent(text, event);
  const TemporaryFolder folder;
  const TabletRecording read = readEvemu(folder.write("a.events", text.str()));
  EXPECT_TRUE(read.has_description);
  EXPECT_EQ(read.description.name, d.name);
  EXPECT_EQ(read.description.product, d.product);
  EXPECT_EQ(read.description.properties, d.properties);
  EXPECT_EQ(read.description.codes, d.codes);
  ASSERT_EQ(read.description.axes.size(), d.axes.size());
  for (const auto& [code, axis] : d.axes) {
    const TabletAxis& other = read.description.axes.at(code);
    EXPECT_EQ(other.minimum, axis.minimum);
    EXPECT_EQ(other.maximum, axis.maximum);
    EXPECT_EQ(other.fuzz, axis.fuzz);
    EXPECT_EQ(other.resolution, axis.resolution);
  }
  ASSERT_EQ(read.events.size(), events.size());
  for (std::size_t k = 0; k < events.size(); ++k) {
    EXPECT_EQ(read.events[k].stamp_ns, events[k].stamp_ns);
    EXPECT_EQ(read.events[k].type, events[k].type);
    EXPECT_EQ(read.events[k].code, events[k].code);
    EXPECT_EQ(read.events[k].value, events[k].value);
  }
}

TEST(Evemu, LeadingZerosAreDecimalAndOldFilesHaveNoResolution) {
  const TemporaryFolder folder;
  const auto read = readEvemu(folder.write("a",
                                           "# EVEMU 1.1\nN: Old\nA: 00 0 59552 4 0\r\n"
                                           "E: 0.000010 0003 001a -012\t# comment\n"));
  EXPECT_EQ(read.events.at(0).value, -12);
  EXPECT_EQ(read.events.at(0).stamp_ns, 10'000);
  EXPECT_EQ(read.description.axes.at(0).resolution, 0);
}

TEST(Evemu, WhatIsWrongIsNamedWithItsLine) {
  const TemporaryFolder folder;
  const auto problem = [&](const std::string& text) -> std::string {
    try {
      readEvemu(folder.write("bad.events", text));
    } catch (const std::runtime_error& error) {
      const std::string what = error.what();
      EXPECT_EQ(what.rfind(folder.path("bad.events"), 0), 0U) << what;
      return what.substr(folder.path("bad.events").size());
    }
    return "";
  };
  EXPECT_EQ(problem("N: a\nE: 1.000000 0003 0000\n"), ":2: needs time, type, code and value");
  EXPECT_EQ(problem("E: 1.5 0003 0000 1\n"), ":1: \"1.5\" is not a time as seconds.microseconds");
  EXPECT_EQ(problem("E: 1.000000 0003 0000 1e3\n"),
            ":1: \"1e3\" is not a number in [-2147483648, 2147483647]");
  EXPECT_EQ(problem("N: a\nX: 1\n"), ":2: unknown kind of line: X: 1");
  EXPECT_EQ(problem("hello\n"), ":1: not a line of an evemu recording: hello");
  EXPECT_NE(problem("# nothing\n").find("not an evemu recording"), std::string::npos);
  EXPECT_THROW(readEvemu(folder.path("absent")), std::runtime_error);
}

// ---------------------------------------------------------------- decoder

TEST(PenTablet, IsKnownByWhatItCanDo) {
  EXPECT_TRUE(isPenTablet(makeTablet()));
  TabletDescription no_tool = makeTablet();  // pens of some cheap tablets
  no_tool.codes[EV_KEY] = {BTN_TOUCH};
  EXPECT_TRUE(isPenTablet(no_tool));
  TabletDescription touchscreen = no_tool;
  touchscreen.axes[ABS_MT_POSITION_X] = {0, 100, 0, 0, 0};
  EXPECT_FALSE(isPenTablet(touchscreen));
  TabletDescription touchpad = no_tool;
  touchpad.codes[EV_KEY].insert(BTN_TOOL_FINGER);
  EXPECT_FALSE(isPenTablet(touchpad));
  TabletDescription mouse = makeTablet();
  mouse.axes.clear();
  EXPECT_FALSE(isPenTablet(mouse));
  EXPECT_THROW(TabletDecoder(mouse, {}), std::invalid_argument);
}

TEST(PenTablet, IsFoundByNamePathOrPartOfAName) {
  TabletSearch search;
  EXPECT_FALSE(chooseTablet(search, ""));
  search.tablets = {{"/dev/input/event3", makeTablet()}, {"/dev/input/event12", makeTablet()}};
  search.tablets[1].description.name = "Other Pen";
  EXPECT_EQ(chooseTablet(search, ""), "/dev/input/event3");
  EXPECT_EQ(chooseTablet(search, "other"), "/dev/input/event12");
  EXPECT_EQ(chooseTablet(search, "Test Tablet Pen"), "/dev/input/event3");
  EXPECT_FALSE(chooseTablet(search, "Cintiq"));
  EXPECT_FALSE(chooseTablet(search, "/dev/input/no such device"));
  EXPECT_EQ(chooseTablet(search, "/dev/null"), "/dev/null");
  EXPECT_THROW(TabletDevice("/dev/null", false), std::runtime_error);
  EXPECT_TRUE(findTablets("/no/such/folder").tablets.empty());
}

TEST(Decoder, AxesAreInSiUnits) {
  Kernel kernel(makeTablet());
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.abs(ABS_X, 5000);
  kernel.abs(ABS_Y, 2000);
  kernel.abs(ABS_PRESSURE, 250);
  kernel.key(BTN_TOUCH, 1);
  kernel.abs(ABS_DISTANCE, 30);
  kernel.abs(ABS_TILT_X, 57);
  kernel.abs(ABS_TILT_Y, -57);
  kernel.abs(ABS_Z, -900);
  const PenSample s = kernel.report();
  EXPECT_EQ(s.tool, PenTool::kPen);
  EXPECT_TRUE(s.touching);
  EXPECT_NEAR(s.x, 0.05, 1e-12);
  EXPECT_NEAR(s.y, 0.08, 1e-12);  // up, the kernel's is down
  EXPECT_NEAR(s.pressure, 0.25, 1e-12);
  EXPECT_NEAR(s.distance.value(), 0.3, 1e-12);
  EXPECT_NEAR(s.tilt_x.value(), 1.0, 1e-12);
  EXPECT_NEAR(s.tilt_y.value(), -1.0, 1e-12);
  EXPECT_NEAR(s.rotation.value(), 0.5 * kPi, 1e-12);  // buttons to the right
  EXPECT_FALSE(s.wheel);
}

TEST(Decoder, TiltWithoutResolutionIsCentredOn64Of127) {
  TabletDescription d = makeTablet();
  d.axes[ABS_TILT_X] = d.axes[ABS_TILT_Y] = {0, 127, 0, 0, 0};
  Kernel kernel(d);
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.abs(ABS_TILT_X, 64);
  kernel.abs(ABS_TILT_Y, 0);
  const PenSample s = kernel.report();
  EXPECT_EQ(s.tilt_x.value(), 0.0);
  EXPECT_NEAR(s.tilt_y.value(), -64.0 / 180.0 * kPi, 1e-12);
}

TEST(Decoder, SizeIsFromResolutionOrParametersOrGuessedSquare) {
  TabletDescription d = makeTablet();
  TabletDeviceParameters p;
  EXPECT_NEAR(findTabletSize(d, p).width, 0.2, 1e-12);
  p.height = 0.2;
  EXPECT_NEAR(findTabletSize(d, p).height, 0.2, 1e-12);
  p = {};
  d.axes[ABS_X].resolution = d.axes[ABS_Y].resolution = 0;
  EXPECT_FALSE(findTabletSize(d, p).is_known);
  EXPECT_NEAR(findTabletSize(d, p).width / findTabletSize(d, p).height, 2.0, 1e-12);
  p.width = 0.3;
  EXPECT_TRUE(findTabletSize(d, p).is_known);
  EXPECT_NEAR(findTabletSize(d, p).height, 0.15, 1e-12);
}

TEST(Decoder, ZerosOfALeavingPenAreNoPlaceAndNoLean) {
  Kernel kernel(makeTablet());
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.abs(ABS_X, 5000);
  kernel.abs(ABS_Y, 2000);
  kernel.abs(ABS_TILT_X, 20);
  kernel.abs(ABS_TILT_Y, 20);
  const PenSample before = kernel.report();
  for (const int axis : {ABS_X, ABS_Y, ABS_TILT_X, ABS_TILT_Y})
    kernel.abs(static_cast<std::uint16_t>(axis), 0);
  kernel.key(BTN_TOOL_PEN, 0);
  const PenSample away = kernel.report();
  EXPECT_EQ(away.tool, PenTool::kNone);
  EXPECT_EQ(away.x, before.x);
  EXPECT_EQ(away.y, before.y);
  EXPECT_FALSE(away.touching);
  // Back, not having said how it leans.
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.abs(ABS_X, 6000);
  kernel.abs(ABS_Y, 2000);
  const PenSample back = kernel.report();
  EXPECT_NEAR(back.x, 0.06, 1e-12);
  EXPECT_FALSE(back.tilt_x);
}

TEST(Decoder, DroppedEventsAreNoReportAndTheNextStateIsWhole) {
  Kernel kernel(makeTablet());
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.abs(ABS_X, 5000);
  kernel.abs(ABS_Y, 2000);
  kernel.report();
  kernel.abs(ABS_X, 6000);
  EXPECT_FALSE(kernel.decoder.take({kernel.now, EV_SYN, SYN_DROPPED, 0}));
  kernel.abs(ABS_X, 9999);  // of a report whose beginning is lost
  EXPECT_FALSE(kernel.decoder.take({kernel.now, EV_SYN, SYN_REPORT, 0}));
  kernel.abs(ABS_X, 7000);  // what the device answers when it is asked
  kernel.abs(ABS_PRESSURE, 500);
  kernel.key(BTN_TOUCH, 1);
  const PenSample s = kernel.report();
  EXPECT_NEAR(s.x, 0.07, 1e-12);
  EXPECT_TRUE(s.touching);
  EXPECT_EQ(kernel.decoder.dropCount(), 1);
}

TEST(Decoder, PressureWithoutTouchDoesNotTouch) {
  Kernel kernel(makeTablet());
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.abs(ABS_PRESSURE, 3);
  EXPECT_FALSE(kernel.report().touching);
  kernel.key(BTN_TOUCH, 1);
  EXPECT_TRUE(kernel.report().touching);
  kernel.abs(ABS_PRESSURE, 0);
  EXPECT_FALSE(kernel.report().touching);
}

TEST(Decoder, EraserIsTheEraserEvenWithThePensKeyHeld) {
  Kernel kernel(makeTablet());
  kernel.key(BTN_TOOL_PEN, 1);
  kernel.key(BTN_TOOL_RUBBER, 1);
  EXPECT_EQ(kernel.report().tool, PenTool::kEraser);
}

// ---------------------------------------------------------------- time

TEST(ReportClock, EvenStampsComeOutAsTheyAre) {
  for (const std::int64_t interval : {2 * kMs, 5 * kMs, 8 * kMs, 16 * kMs}) {
    ReportClock clock;
    for (int k = 0; k < 300; ++k)
      EXPECT_EQ(clock.take(1'000'000'000 + k * interval), 1'000'000'000 + k * interval);
  }
}

TEST(EvenPath, EvenStampsLeavePlacesAsTheyAre) {
  EvenPath path;
  for (int k = 0; k < 300; ++k) {
    const Vector2d place(0.1 * std::sin(0.1 * k), 0.1 * std::cos(0.13 * k));
    EXPECT_LT((path.take(1'000'000'000 + 8 * kMs * k, place) - place).norm(), 1e-9);
  }
}

TEST(EvenPath, JitterOfUsbDoesNotShowInTheSpeed) {
  // Measured every 5 ms, fetched every 4.
  EvenPath path;
  Vector2d last = Vector2d::Zero();
  std::int64_t last_ns = 0;
  double slowest = 1e9, fastest = 0.0;
  for (int k = 0; k < 400; ++k) {
    const std::int64_t measured_ns = 5 * kMs * k;
    const std::int64_t stamp_ns = 1'000'000'000 + (measured_ns + 4 * kMs - 1) / (4 * kMs) * (4 * kMs);
    const Vector2d place = path.take(stamp_ns, {0.2e-9 * double(measured_ns), 0.0});
    if (k > 60) {
      const double speed = (place.x() - last.x()) / (1e-9 * double(stamp_ns - last_ns));
      slowest = std::min(slowest, speed);
      fastest = std::max(fastest, speed);
    }
    last = place;
    last_ns = stamp_ns;
  }
  EXPECT_GT(slowest, 0.19);
  EXPECT_LT(fastest, 0.21);
}

TEST(ReportClock, GoesForwardWhateverTheStamps) {
  ReportClock clock;
  std::uint64_t random = 1;
  std::int64_t stamp_ns = 1'000'000'000, last_ns = 0;
  for (int k = 0; k < 5000; ++k) {
    random = random * 6364136223846793005ULL + 1442695040888963407ULL;
    stamp_ns +=
        1 + static_cast<std::int64_t>((random >> 33) % (k % 100 == 0 ? 100'000'000 : 12'000'000));
    const std::int64_t time_ns = clock.take(stamp_ns);
    EXPECT_GT(time_ns, last_ns);
    EXPECT_LT(std::abs(time_ns - stamp_ns), 40 * kMs);
    last_ns = time_ns;
  }
}

// ---------------------------------------------------------------- mapping

/// Where the point of the undeformed brush is, were it not pressed: what the pen's tip shall be.
Vector3d point(const HandlePose& pose, const BrushOnSheet& brush, double depth) {
  const Vector3d u = pose.orientation * Vector3d::UnitZ();
  return pose.position - (brush.tip_length - depth) * u +
         brush.sag * brush.tip_length * (u.z() * u - Vector3d::UnitZ());
}

TabletSize tabletSize() {
  return {0.2, 0.1, true};
}

/// Without tilt the brush is held upright, so that levels are heights.
TabletParameters upright() {
  TabletParameters p;
  p.grip.tilt = 0.0;
  return p;
}

PenSample makeSample(double x, double y, double pressure, std::int64_t stamp_ns) {
  PenSample sample;
  sample.stamp_ns = stamp_ns;
  sample.tool = PenTool::kPen;
  sample.has_position = true;
  sample.x = x;
  sample.y = y;
  sample.pressure = pressure;
  sample.touching = pressure > 0.0;
  return sample;
}

TEST(Mapping, AspectIsKeptAndMiddlesMeetHoweverTheTabletIsTurned) {
  for (const std::string rotation : {"0", "90", "180", "270"})
    for (const std::string fit : {"whole", "cover", "true_size"}) {
      TabletParameters p;
      p.area.rotation = rotation;
      p.area.fit = fit;
      p.area.left = 0.1;
      p.area.top = 0.8;
      const BrushOnSheet brush{0.045, 0.0, 0.24, 0.33};
      const PenMapping mapping(p, tabletSize(), brush);
      SCOPED_TRACE(rotation + " " + fit);
      const Vector2d middle = mapping.placeOnSheet(0.11, 0.04);
      EXPECT_LT((middle - Vector2d(0.12, 0.165)).norm(), 1e-12);
      const Vector2d right = mapping.placeOnSheet(0.12, 0.04) - middle;
      const Vector2d up = mapping.placeOnSheet(0.11, 0.05) - middle;
      EXPECT_NEAR(right.norm(), up.norm(), 1e-12);
      EXPECT_NEAR(right.dot(up), 0.0, 1e-12);
      EXPECT_GT(right.x() * up.y() - right.y() * up.x(), 0.0);  // not mirrored
      const double angle = std::atan2(right.y(), right.x());
      EXPECT_NEAR(std::remainder(angle - std::stod(rotation) * kPi / 180.0, 2 * kPi), 0.0, 1e-12);
      // The part that is used, 0.18 x 0.08 m, against the sheet.
      const bool lies = rotation == "0" || rotation == "180";
      const double by_width = 0.24 / (lies ? 0.18 : 0.08), by_height = 0.33 / (lies ? 0.08 : 0.18);
      const double scale = fit == "whole"   ? std::min(by_width, by_height)
                           : fit == "cover" ? std::max(by_width, by_height)
                                            : 1.0;
      EXPECT_NEAR(right.norm(), 0.01 * scale, 1e-12);
    }
}

TEST(Mapping, AreasThatAreNoneAreRefusedByName) {
  const auto problems = [](const TabletParameters& p, const TabletSize& size) {
    try {
      const PenMapping mapping(p, size, {});
    } catch (const ParameterError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  TabletParameters p;
  p.area.left = 0.5;
  p.area.right = 0.5;
  p.area.bottom = 0.9;
  p.area.top = 0.1;
  const std::string text = problems(p, tabletSize());
  EXPECT_NE(text.find("area/left = 0.5 is not below area/right = 0.5"), std::string::npos) << text;
  EXPECT_NE(text.find("area/bottom = 0.9 is not below area/top = 0.1"), std::string::npos) << text;
  p = {};
  p.area.fit = "true_size";
  EXPECT_NE(problems(p, {0.2, 0.1, false}).find("device/width"), std::string::npos);
  p.pressure.gamma = -1;
  EXPECT_NE(problems(p, tabletSize()).find("pressure/gamma = -1 is outside"), std::string::npos);
}

TEST(Mapping, PressureAndDistanceMeetWithoutAJump) {
  TabletParameters p;
  for (const double gamma : {0.5, 1.0, 2.0}) {
    p.pressure.gamma = gamma;
    const PenMapping mapping(p, tabletSize(), {});
    const double clearance = p.pressure.clearance;
    EXPECT_EQ(mapping.pressedLevel(0.0), -clearance);
    EXPECT_EQ(mapping.hoverLevel(0.2, 0.2), -clearance);
    EXPECT_EQ(mapping.hoverLevel(0.0, 0.2), -clearance);  // closer than it was in the last touch
    EXPECT_NEAR(mapping.hoverLevel(1.0, 0.2), -clearance - p.pressure.hover_height, 1e-15);
    EXPECT_NEAR(mapping.pressedLevel(1.0), p.pressure.full_depth * 0.045, 1e-15);
    double last = mapping.pressedLevel(0.0);
    for (int k = 1; k <= 100000; ++k) {
      const double level = mapping.pressedLevel(1e-5 * k);
      EXPECT_GE(level, last);
      EXPECT_LT(level - last, gamma < 1.0 ? 1e-4 : 1e-5);  // √q is steep at its start, but has no jump
      last = level;
    }
    // Light touches write.
    EXPECT_GT(mapping.pressedLevel(p.pressure.threshold + p.pressure.touch), 0.0);
  }
}

/// Poses of a pen at rest: the filters have come to their ends.
HandlePose settled(PenMapping& mapping, PenSample sample) {
  HandlePose pose;
  for (int k = 0; k < 400; ++k) {
    sample.stamp_ns += 8 * kMs;
    for (const HandlePose& p : mapping.take(sample).poses) pose = p;
  }
  return pose;
}

TEST(Mapping, ShaftPointsWhereThePenDoesWithTheTabletTurned) {
  // The pen leans by `tilt` towards `azimuth` of the desk, which is that of the sheet.
  for (const std::string rotation : {"0", "90", "180", "270"})
    for (int k = 0; k < 24; ++k) {
      const double turn = std::stod(rotation) * kPi / 180.0, azimuth = 2 * kPi * k / 24, tilt = 0.7;
      TabletParameters p;
      p.area.rotation = rotation;
      const BrushOnSheet brush{0.045, 0.1, 0.3, 0.3};
      PenMapping mapping(p, tabletSize(), brush);
      PenSample sample = makeSample(0.05, 0.03, 0.4, 1'000'000'000);
      // What the turned tablet measures: projections onto its own axes; its y tilt counts to the writer.
      sample.tilt_x = std::atan(std::tan(tilt) * std::cos(azimuth - turn));
      sample.tilt_y = -std::atan(std::tan(tilt) * std::sin(azimuth - turn));
      const HandlePose pose = settled(mapping, sample);
      const Vector3d u = pose.orientation * Vector3d::UnitZ();
      const Vector3d expected(std::sin(tilt) * std::cos(azimuth), std::sin(tilt) * std::sin(azimuth),
                              std::cos(tilt));
      EXPECT_LT((u - expected).norm(), 1e-9) << rotation << " " << azimuth;
      // No turn about the shaft that the pen did not make.
      EXPECT_NEAR(Quaterniond::FromTwoVectors(Vector3d::UnitZ(), u).angularDistance(pose.orientation),
                  0.0, 1e-6);
      // The pen's tip is where the brush's would touch.
      const Vector3d tip = point(pose, brush, mapping.pressedLevel(0.4));
      const Vector2d place = mapping.placeOnSheet(0.05, 0.03);
      EXPECT_LT((tip - Vector3d(place.x(), place.y(), 0.0)).norm(), 1e-9);
    }
}

TEST(Mapping, BarrelTurnsTheBrushAsItTurnsThePen) {
  // Buttons that point to `heading` on the desk, from +x counterclockwise, turn the handle's y axis
  // there.
  for (const std::string rotation : {"0", "90", "180", "270"})
    for (int k = 0; k < 8; ++k) {
      const double turn = std::stod(rotation) * kPi / 180.0, heading = 2 * kPi * k / 8;
      TabletParameters p = upright();
      p.area.rotation = rotation;
      PenMapping mapping(p, tabletSize(), {});
      PenSample sample = makeSample(0.05, 0.03, 0.4, 1'000'000'000);
      sample.rotation = 0.5 * kPi - (heading - turn);  // clockwise from the tablet's up
      const Vector3d buttons = settled(mapping, sample).orientation * Vector3d::UnitY();
      EXPECT_LT((buttons - Vector3d(std::cos(heading), std::sin(heading), 0)).norm(), 1e-6);
    }
}

TEST(Mapping, WithoutTiltTheGripIsThatOfTheParameters) {
  TabletParameters p;
  p.grip.tilt = 0.5;
  p.grip.azimuth = 1.0;
  p.area.rotation = "90";
  PenMapping mapping(p, tabletSize(), {});
  const auto poses = mapping.take(makeSample(0.1, 0.05, 0.0, 1'000'000'000)).poses;
  ASSERT_EQ(poses.size(), 1U);
  const Vector3d u = poses[0].orientation * Vector3d::UnitZ();
  EXPECT_LT(
      (u - Vector3d(std::sin(0.5) * std::cos(1.0), std::sin(0.5) * std::sin(1.0), std::cos(0.5))).norm(),
      1e-12);
}

TEST(Mapping, LeanIsLimitedAndScaledInItsOwnDirection) {
  TabletParameters p;
  p.tilt.max = 0.6;
  p.tilt.gain = 0.5;
  PenMapping mapping(p, tabletSize(), {});
  PenSample sample = makeSample(0.1, 0.05, 0.0, 1'000'000'000);
  sample.tilt_x = 0.8;
  sample.tilt_y = 0.0;
  Vector3d u = settled(mapping, sample).orientation * Vector3d::UnitZ();
  EXPECT_NEAR(std::atan2(u.x(), u.z()), 0.4, 1e-9);
  sample.stamp_ns += 10'000 * kMs;
  sample.tilt_x = 1.57;  // beyond any pen
  sample.tilt_y = 1.57;
  u = settled(mapping, sample).orientation * Vector3d::UnitZ();
  EXPECT_NEAR(std::acos(u.z()), 0.6, 1e-9);
  EXPECT_NEAR(std::atan2(u.y(), u.x()), -0.25 * kPi, 1e-9);
}

TEST(Mapping, EachReportIsOnePoseAtItsStamp) {
  PenMapping mapping(upright(), tabletSize(), {});
  for (int k = 0; k < 100; ++k) {
    const std::int64_t stamp_ns = 1'600'000'000'123'456'000 + 8 * kMs * k;
    const auto poses =
        mapping.take(makeSample(0.1 + 0.0005 * k, 0.05, k < 50 ? 0.0 : 0.3, stamp_ns)).poses;
    ASSERT_EQ(poses.size(), 1U);
    EXPECT_EQ(poses[0].stamp_ns, stamp_ns);
    const Vector2d place = mapping.placeOnSheet(0.1 + 0.0005 * k, 0.05);
    EXPECT_LT((poses[0].position.head<2>() - place).norm(), 1e-9);
  }
}

TEST(Mapping, PenThatArrivesTouchingDoesNotWriteThroughTheAir) {
  PenMapping mapping(upright(), tabletSize(), {});
  auto first = mapping.take(makeSample(0.1, 0.05, 0.5, 1'000'000'000)).poses;
  ASSERT_EQ(first.size(), 1U);
  EXPECT_GT(first[0].position.z(), 0.045);
  std::vector<HandlePose> later;
  for (int k = 1; k <= 200; ++k)
    later = mapping.take(makeSample(0.1, 0.05, 0.5, 1'000'000'000 + 8 * kMs * k)).poses;
  ASSERT_EQ(later.size(), 1U);
  EXPECT_NEAR(later[0].position.z(), 0.045 - mapping.pressedLevel(0.5), 1e-12);
}

/// Levels of an upright brush that a pen puts down at t = 0 [s], read every `interval`.
std::vector<double> levelsOfATouch(double pressure, std::int64_t interval_ns, double seconds) {
  PenMapping mapping(upright(), tabletSize(), {});
  std::vector<double> levels;
  for (std::int64_t t = -400 * kMs; t <= std::llround(1e9 * seconds); t += interval_ns) {
    const auto poses =
        mapping.take(makeSample(0.1, 0.05, t < 0 ? 0.0 : pressure, 10'000'000'000 + t)).poses;
    if (t >= 0) levels.push_back(BrushOnSheet().tip_length - poses.back().position.z());
  }
  return levels;
}

TEST(Mapping, SetsTheBrushDownWithoutThrowingIt) {
  const TabletPressureParameters p;
  for (const double pressure : {0.1, 0.4, 1.0}) {
    const std::vector<double> levels = levelsOfATouch(pressure, kMs, 0.6);
    double speed_before = 0.01, fastest = 0.0;  // of the first millisecond
    for (std::size_t k = 1; k < levels.size(); ++k) {
      const double speed = (levels[k] - levels[k - 1]) / 1e-3;
      EXPECT_GE(speed, 0.0);
      EXPECT_LE(std::abs(speed - speed_before), 1e-3 * 10.0 + 1e-9) << "thrown or stopped at " << k;
      if (levels[k - 1] >= 0.0) {
        EXPECT_LE(speed, p.press_speed + 1e-9);
      }
      fastest = std::max(fastest, speed);
      speed_before = speed;
    }
    EXPECT_LT(fastest, p.press_speed + p.clearance / p.settle);
    // But soon: at the sheet, and at half of its depth.
    const PenMapping mapping(upright(), tabletSize(), {});
    const double depth = mapping.pressedLevel(pressure);
    const auto when = [&levels](double level) {
      return std::find_if(levels.begin(), levels.end(), [level](double l) { return l >= level; }) -
             levels.begin();
    };
    EXPECT_LT(when(0.0), 90) << pressure;
    EXPECT_LT(when(0.5 * depth), 90 + 0.5e3 * depth / p.press_speed) << pressure;
    EXPECT_NEAR(levels.back(), depth, 1e-6);
  }
}

TEST(Mapping, ComesDownAlikeHoweverOftenThePenReports) {
  const std::vector<double> fine = levelsOfATouch(0.4, kMs, 0.4);
  for (const std::int64_t interval : {2, 5, 8, 16}) {
    const std::vector<double> coarse = levelsOfATouch(0.4, interval * kMs, 0.4);
    // The first report of the touch ends the interval in which it may have begun.
    for (std::size_t k = 1; k < coarse.size(); ++k) {
      const std::size_t at = k * static_cast<std::size_t>(interval);
      EXPECT_GE(coarse[k], fine[at] - 1e-6) << interval;
      EXPECT_LE(coarse[k],
                fine[std::min(fine.size() - 1, at + static_cast<std::size_t>(interval))] + 1e-6)
          << interval;
    }
  }
}

TEST(Mapping, LeavingLiftsTheBrushWhereItWas) {
  PenMapping mapping(upright(), tabletSize(), {});
  mapping.take(makeSample(0.1, 0.05, 0.5, 1'000'000'000));
  const HandlePose down = mapping.take(makeSample(0.1, 0.05, 0.5, 1'008'000'000)).poses.at(0);
  const auto up = mapping.leave(1'016'000'000).poses;
  ASSERT_EQ(up.size(), 1U);
  EXPECT_EQ(up[0].position.head<2>(), down.position.head<2>());
  EXPECT_NEAR(up[0].position.z(), 0.045 + TabletPressureParameters().clearance, 1e-12);
  EXPECT_TRUE(mapping.leave(1'024'000'000).poses.empty());
  PenSample none;
  none.stamp_ns = 1'032'000'000;
  EXPECT_TRUE(mapping.take(none).poses.empty());
}

TEST(Mapping, LiftsTheBrushNoFasterThanAWetTuftBears) {
  const auto touch = [](PenMapping& mapping) {
    for (int k = 0; k <= 400; ++k)
      mapping.take(makeSample(0.1, 0.05, k == 0 ? 0.0 : 0.8, 1'000'000'000 + k * kMs));
    return mapping.take(makeSample(0.1, 0.05, 0.8, 1'401'000'000)).poses.back();
  };
  PenMapping left(upright(), tabletSize(), {}), raised(upright(), tabletSize(), {});
  std::vector<HandlePose> leaving{touch(left)}, rising{touch(raised)};
  for (const HandlePose& pose : left.leave(1'402'000'000).poses) leaving.push_back(pose);
  for (int k = 2; k < 40; ++k)
    for (const HandlePose& pose : raised.take(makeSample(0.1, 0.05, 0.0, 1'400'000'000 + k * kMs)).poses)
      rising.push_back(pose);
  for (const auto* poses : {&leaving, &rising}) {
    double speed = 0.0, fastest = 0.0, before = 0.0;
    for (std::size_t k = 1; k < poses->size(); ++k) {
      const HandlePose &from = (*poses)[k - 1], &to = (*poses)[k];
      const double seconds = 1e-9 * double(to.stamp_ns - from.stamp_ns);
      const double now = (to.position.z() - from.position.z()) / seconds;
      // Where it brakes the place to stop at comes towards it.
      EXPECT_LE(now - speed, 1.05 * 100.0 * std::max(seconds, before)) << k;
      EXPECT_LE(speed - now, 2.1 * 100.0 * std::max(seconds, before)) << k;
      before = seconds;
      speed = now;
      fastest = std::max(fastest, now);
    }
    EXPECT_GT(fastest, 0.5);
    EXPECT_GT(poses->back().position.z(), 0.045 + TabletPressureParameters().clearance - 1e-9);
  }
  EXPECT_LT(leaving.back().stamp_ns, 1'460'000'000);
}

TEST(Mapping, PauseIsHeldUntilThePenMovesOn) {
  PenMapping mapping(upright(), tabletSize(), {});
  mapping.take(makeSample(0.1, 0.05, 0.0, 1'000'000'000));
  const HandlePose before = mapping.take(makeSample(0.1, 0.05, 0.0, 1'008'000'000)).poses.at(0);
  const auto poses = mapping.take(makeSample(0.101, 0.05, 0.5, 2'000'000'000)).poses;
  ASSERT_EQ(poses.size(), 3U);
  for (int k : {0, 1}) EXPECT_EQ(poses[static_cast<std::size_t>(k)].position, before.position);
  EXPECT_EQ(poses[0].stamp_ns, 1'016'000'000);
  EXPECT_EQ(poses[1].stamp_ns, 1'992'000'000);
  EXPECT_EQ(poses[2].stamp_ns, 2'000'000'000);
}

TEST(Mapping, PenThatRestsOnTheTabletPressesTheBrushToItsDepth) {
  const auto begin = [](PenMapping& mapping) {
    mapping.take(makeSample(0.1, 0.05, 0.0, 1'000'000'000));
    mapping.take(makeSample(0.1, 0.05, 0.5, 1'008'000'000));
  };
  PenMapping mapping(upright(), tabletSize(), {}), live(upright(), tabletSize(), {});
  begin(mapping);
  auto poses = mapping.take(makeSample(0.1, 0.05, 0.5, 2'000'000'000)).poses;
  ASSERT_GT(poses.size(), 10U);
  EXPECT_NEAR(poses.back().position.z(), 0.045 - mapping.pressedLevel(0.5), 1e-5);
  EXPECT_LT(poses[poses.size() - 2].stamp_ns, 2'000'000'000);
  const HandlePose& settled = poses[poses.size() - 3];  // then it stays to the end
  EXPECT_LT(settled.stamp_ns, 1'500'000'000);
  EXPECT_NEAR(settled.position.z(), 0.045 - mapping.pressedLevel(0.5), 1e-5);

  // Whoever waits gets the same poses as they are due.
  begin(live);
  std::vector<HandlePose> waited;
  const auto keep = [&](const PenActions& actions) {
    waited.insert(waited.end(), actions.poses.begin(), actions.poses.end());
  };
  for (int k = 0; k < 45; ++k) {
    const std::int64_t now_ns = 1'010'000'000 + k * 22 * kMs;
    keep(live.rest(now_ns));
    EXPECT_TRUE(waited.empty() || waited.back().stamp_ns < now_ns);
  }
  EXPECT_EQ(waited.size(), poses.size() - 2);
  keep(live.take(makeSample(0.1, 0.05, 0.5, 2'000'000'000)));
  ASSERT_EQ(waited.size(), poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    EXPECT_EQ(waited[k].stamp_ns, poses[k].stamp_ns);
    EXPECT_EQ(waited[k].position, poses[k].position);
  }
}

TEST(Mapping, TuftOfAPenThatHasLeftStraightens) {
  PenMapping mapping(upright(), tabletSize(), {});
  mapping.take(makeSample(0.1, 0.05, 0.5, 1'000'000'000));
  const HandlePose up = mapping.leave(1'008'000'000).poses.at(0);
  EXPECT_TRUE(mapping.rest(1'040'000'000).poses.empty());
  const auto poses = mapping.rest(1'070'000'000).poses;
  ASSERT_EQ(poses.size(), 1U);
  EXPECT_EQ(poses[0].position, up.position);
  EXPECT_EQ(poses[0].stamp_ns, up.stamp_ns + 50 * kMs);
  EXPECT_TRUE(mapping.rest(9'000'000'000).poses.empty());
}

TEST(Mapping, StampsRiseByAMillisecondAndSurviveAClockSetBack) {
  PenMapping mapping(upright(), tabletSize(), {});
  std::int64_t last_ns = 0;
  std::int64_t now_ns = 100'000'000'000;
  for (int k = 0; k < 200; ++k) {
    now_ns += k == 100 ? -50'000'000'000 : k % 3 == 0 ? 10'000 : 8 * kMs;
    for (const HandlePose& pose : mapping.take(makeSample(0.1, 0.05, 0.1, now_ns)).poses) {
      EXPECT_GE(pose.stamp_ns - last_ns, kMs);
      EXPECT_TRUE(k == 0 || pose.stamp_ns - last_ns <= 10 * kMs) << pose.stamp_ns - last_ns;
      last_ns = pose.stamp_ns;
    }
  }
}

TEST(Mapping, ButtonsAndEraserActOnceEachTime) {
  TabletParameters p;
  p.buttons.clear = "stylus2";
  PenMapping mapping(p, tabletSize(), {});
  PenSample sample = makeSample(0.1, 0.05, 0.0, 1'000'000'000);
  const auto take = [&] {
    sample.stamp_ns += 8 * kMs;
    return mapping.take(sample);
  };
  EXPECT_FALSE(take().dips);
  sample.stylus = true;
  EXPECT_TRUE(take().dips);
  EXPECT_FALSE(take().dips);
  sample.stylus = false;
  sample.stylus2 = true;
  EXPECT_TRUE(take().clears);
  sample.stylus2 = false;
  take();
  sample.tool = PenTool::kEraser;
  EXPECT_FALSE(take().wipes);
  sample.touching = true;
  sample.pressure = 0.9;
  const PenActions touch = take();
  EXPECT_TRUE(touch.wipes);
  EXPECT_FALSE(take().wipes);
  ASSERT_EQ(touch.poses.size(), 1U);
  EXPECT_GT(touch.poses[0].position.z(), 0.045) << "the eraser end writes";
  sample.touching = false;
  take();
  sample.touching = true;
  EXPECT_TRUE(take().wipes);
}

TEST(Mapping, DistanceOfContactIsLearntFromTheTouch) {
  TabletParameters p = upright();
  PenMapping mapping(p, tabletSize(), {});
  PenSample sample = makeSample(0.1, 0.05, 0.0, 1'000'000'000);
  const auto height = [&](double distance, double pressure) {
    sample.stamp_ns += 8 * kMs;
    sample.distance = distance;
    sample.pressure = pressure;
    sample.touching = pressure > 0;
    return mapping.take(sample).poses.at(0).position.z() - 0.045;
  };
  const auto settledHeight = [&](double distance, double pressure) {
    double last = 0.0;
    for (int k = 0; k < 200; ++k) last = height(distance, pressure);
    return last;
  };
  EXPECT_GT(height(0.5, 0.0), p.pressure.clearance + 1e-3);
  EXPECT_LT(settledHeight(0.5, 0.3), 0.0);
  EXPECT_NEAR(settledHeight(0.5, 0.0), p.pressure.clearance, 1e-9);
  EXPECT_GT(height(0.75, 0.0), p.pressure.clearance + 1e-3);
}

TEST(TabletParameters, IllegalValuesAreRefused) {
  EXPECT_NO_THROW(checkParameters(TabletParameters()));
  TabletParameters parameters;
  int fields = 0;
  visitParameters(parameters, [&](const std::string& name, auto& field, const auto& legal, const char*,
                                  const char*) {
    using Field = std::remove_reference_t<decltype(field)>;
    const Field good = field;
    if constexpr (std::is_same_v<Field, double>) {
      for (const double bad :
           {std::nan(""), std::nextafter(legal.low, -1e9), std::nextafter(legal.high, 1e9)}) {
        field = bad;
        try {
          const PenMapping mapping(parameters, tabletSize(), {});
          ADD_FAILURE() << name << " = " << bad << " was taken";
        } catch (const ParameterError& error) {
          EXPECT_NE(std::string(error.what()).find(name), std::string::npos);
        }
      }
      ++fields;
    } else if constexpr (std::is_same_v<Field, std::string>) {
      if (!legal.empty()) {
        field = "no such choice";
        EXPECT_THROW(PenMapping(parameters, tabletSize(), {}), ParameterError) << name;
        ++fields;
      }
    }
    field = good;
  });
  EXPECT_GT(fields, 15);
}

}  // namespace
}  // namespace calligraphy_brush
