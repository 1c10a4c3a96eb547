#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numeric>
#include <sstream>
#include <string>
#include <vector>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/ros/tablet_driver.h"
#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/tablet/evemu.h"
#include "mark_width.h"
#include "shared_data.h"

// Real recordings of pens, written by the simulator. They lie outside of this package.

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector2d;

constexpr std::int64_t kMs = 1'000'000;
// A bent tuft straightens in a quarter of its period, after which it has left the sheet.
constexpr std::int64_t kLeaving_ns = 50 * kMs;
constexpr double kTouchDown = 0.15;      // [s]: since the first ink
constexpr double kTouchDownWay = 0.016;  // [m]: since then; a tuft is set down within two diameters
constexpr double kLargestBlot = 1.5;     // touch-down over the stroke's median width

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Writes samples with the default brush, whose rods are by themselves; each stroke on a clean sheet
/// with a full brush.
class Writer {
 public:
  Writer(const TabletParameters& parameters, const TabletSize& size)
      : simulator_(simulatorParameters()),
        mapping_(parameters, size, measureBrush(simulatorParameters())) {}
  /// CALLIGRAPHY_BRUSH: a preset instead, all its rods.
  static SimulatorParameters simulatorParameters() {
    SimulatorParameters p;
    if (const char* brush = std::getenv("CALLIGRAPHY_BRUSH"))
      loadYamlParameters(findPreset("brushes", brush), p);
    else
      p.brush.rod_count = 64;  // half of the default, for the time of the test
    return p;
  }

  void take(const PenSample& sample) {
    const bool presses = sample.tool == PenTool::kPen && sample.touching;
    if (presses && !pressed_) {
      simulator_.clearPaper();
      simulator_.dip();
      mark_.begin(simulator_);
      way_ = 0.0;
      down_ns_ = sample.stamp_ns;
    }
    const Vector2d place = simulator_.handlePose().position.head<2>();
    simulate(mapping_.take(sample), !presses && !pressed_);
    if (presses) {
      if (pressed_) way_ += (simulator_.handlePose().position.head<2>() - place).norm();
      mark_.take(simulator_, 1e-9 * double(sample.stamp_ns - down_ns_), way_);
    }
    if (!presses && pressed_) finishStroke();
    if (!presses && pressed_) up_ns_ = sample.stamp_ns;
    pressed_ = presses;
    last_ns_ = sample.stamp_ns;
  }

  void finish() {
    simulate(mapping_.leave(last_ns_ + 8 * kMs), false);
    if (pressed_) finishStroke();
    pressed_ = false;
  }

  void check(const std::string& name, int least_strokes) const {
    std::vector<double> ratios = ratios_;
    std::sort(ratios.begin(), ratios.end());
    std::printf(
        "%s: %d poses, %d strokes, %d of them dots; touch-down over median width %.2f (median), %.2f "
        "(most)\n",
        name.c_str(), pose_count_, stroke_count_, stroke_count_ - static_cast<int>(ratios_.size()),
        ratios.empty() ? 0.0 : ratios[ratios.size() / 2], ratios.empty() ? 0.0 : ratios.back());
    EXPECT_EQ(refused_count_, 0);
    EXPECT_EQ(not_finite_count_, 0);
    EXPECT_EQ(ink_in_air_, 0.0) << steps_in_air_with_ink_ << " steps";
    EXPECT_GE(static_cast<int>(ratios_.size()), least_strokes);
    EXPECT_EQ(std::count_if(ratios.begin(), ratios.end(), [](double r) { return !(r <= kLargestBlot); }),
              0);
  }

 private:
  void simulate(const PenActions& actions, bool in_air) {
    for (const HandlePose& pose : actions.poses) {
      ++pose_count_;
      refused_count_ += simulator_.addPose(pose) != PoseVerdict::kAccepted;
      for (double before = simulator_.report().ink_in_tip;
           simulator_.advanceTo(simulator_.time_ns() + kMs) > 0;
           before = simulator_.report().ink_in_tip) {
        const double given = before - simulator_.report().ink_in_tip;
        if (!in_air || !(given > 0.0) || simulator_.time_ns() - up_ns_ <= kLeaving_ns) continue;
        ink_in_air_ += given;
        ++steps_in_air_with_ink_;
        if (std::getenv("VERBOSE") != nullptr)
          std::printf("  stroke %d: %.3g m^3 of ink %.3f s after the lift\n", stroke_count_, given,
                      1e-9 * double(simulator_.time_ns() - up_ns_));
      }
      const HandleWrench wrench = simulator_.handleWrench();
      bool is_finite = wrench.force_P.allFinite() && wrench.torque_P.allFinite() &&
                       std::isfinite(simulator_.report().ink_in_tip);
      for (int rod = 0; rod < simulator_.rodCount(); ++rod)
        is_finite = is_finite && simulator_.nodePosition(rod, simulator_.nodeCount() - 1).allFinite();
      not_finite_count_ += !is_finite;
    }
  }

  void finishStroke() {
    ++stroke_count_;
    std::vector<double> widths;
    double touch_down = 0.0, duration = 0.0;
    for (const auto& [seconds, way, width] : mark_.widths()) {
      widths.push_back(width);
      duration = seconds;
      if (seconds < kTouchDown && way < kTouchDownWay) touch_down = std::max(touch_down, width);
    }
    const double usual = median(widths);
    // A dot is all touch-down.
    if (way_ < 3.0 * usual || duration < 1.5 * kTouchDown) return;
    ratios_.push_back(touch_down / usual);
    if (std::getenv("VERBOSE") != nullptr)
      std::printf("  stroke %d at %.3f s: touch-down %.2f mm, width %.2f mm, %.2f\n", stroke_count_,
                  1e-9 * double(down_ns_), 1e3 * touch_down, 1e3 * usual, touch_down / usual);
  }

  Simulator simulator_;
  PenMapping mapping_;
  bool pressed_ = false;
  StrokeMark mark_;   // of the stroke that is being written
  double way_ = 0.0;  // of the handle in it [m]
  std::int64_t last_ns_ = 0, down_ns_ = 0, up_ns_ = 0;
  int pose_count_ = 0, refused_count_ = 0, not_finite_count_ = 0, stroke_count_ = 0;
  double ink_in_air_ = 0.0;
  int steps_in_air_with_ink_ = 0;
  std::vector<double> ratios_;  // of touch-down to median width, a stroke
};

class Recordings : public testing::Test {
 protected:
  void SetUp() override {
    if (sharedData().empty())
      GTEST_SKIP() << "no recordings in ../shared/data nor in $CALLIGRAPHY_SHARED/data";
  }
};

/// Rows of numbers between commas or blanks; rows that begin otherwise are left out.
std::vector<std::vector<double>> readTable(const fs::path& path) {
  std::ifstream file(path);
  EXPECT_TRUE(file) << path;
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(file, line);) {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream words(line);
    std::vector<double> row;
    for (double value; words >> value;) row.push_back(value);
    if (!row.empty()) rows.push_back(row);
  }
  return rows;
}

TabletRecording readShared(const std::string& name) {
  TabletRecording recording = readEvemu((sharedData() / "evemu" / name).string());
  if (!recording.has_description)
    recording.description =
        readEvemu(CALLIGRAPHY_BRUSH_SOURCE_DIR "/test/tablet/intuos4_6x9.evemu").description;
  return recording;
}

void writeRecording(const std::string& name, int least_strokes) {
  const TabletRecording recording = readShared(name);
  TabletDecoder decoder(recording.description, {});
  Writer writer({}, decoder.size());
  for (const InputEvent& event : recording.events)
    if (const auto sample = decoder.take(event)) writer.take(*sample);
  writer.finish();
  writer.check(name, least_strokes);
}

TEST_F(Recordings, Cintiq12wx) {
  writeRecording("Wacom Cintiq 12WX.events", 1);
}
TEST_F(Recordings, Cintiq13hd) {
  writeRecording("Wacom Cintiq 13HD.events", 3);
}
TEST_F(Recordings, Intuos4) {
  writeRecording("Wacom Intuos4 6x9.stylus-drag.events", 1);
}

TEST_F(Recordings, DecodedCintiq13hdIsThatOfItsTable) {
  const TabletRecording recording = readShared("Wacom Cintiq 13HD.events");
  std::ifstream file(sharedData() / "evemu" / "Wacom_Cintiq_13HD.csv");
  std::string line;
  std::getline(file, line);
  std::getline(file, line);
  ASSERT_EQ(line.rfind("t_s,x,y,pressure,tilt_x,tilt_y,rot_z,distance,touch,prox", 0), 0U) << line;

  TabletDecoder decoder(recording.description, {});
  const auto& axes = recording.description.axes;
  const TabletSize size = decoder.size();
  int rows = 0, tilts = 0, presses = 0;
  for (const InputEvent& event : recording.events) {
    const auto sample = decoder.take(event);
    if (!sample) continue;
    ASSERT_TRUE(std::getline(file, line)) << "the table ends at row " << rows;
    std::vector<std::string> words;
    std::istringstream text(line);
    for (std::string word; std::getline(text, word, ',');) words.push_back(word);
    ASSERT_GE(words.size(), 10U) << line;
    ++rows;
    EXPECT_NEAR(1e-9 * double(sample->stamp_ns - recording.events.front().stamp_ns), std::stod(words[0]),
                2e-6);
    const bool is_near = words[9] == "1";
    // The table counts pen and eraser, not the airbrush and the pencil of this recording.
    if (is_near && sample->tool == PenTool::kNone) ADD_FAILURE() << "row " << rows << ": " << line;
    if (!is_near || sample->tool == PenTool::kNone) continue;
    const double unit = size.width / axes.at(0).maximum;
    EXPECT_NEAR(sample->x / unit, std::stod(words[1]), 1e-6) << line;
    EXPECT_NEAR((size.height - sample->y) / unit, std::stod(words[2]), 1e-6) << line;
    if (!words[3].empty()) {
      EXPECT_NEAR(sample->pressure * 1023, std::stod(words[3]), 1e-6) << line;
      presses += sample->pressure > 0;
    }
    if (sample->tilt_x && !words[4].empty() && !words[5].empty()) {
      EXPECT_NEAR(*sample->tilt_x * 180 / 3.14159265358979323846 + 64, std::stod(words[4]), 1e-6)
          << line;
      EXPECT_NEAR(*sample->tilt_y * 180 / 3.14159265358979323846 + 64, std::stod(words[5]), 1e-6)
          << line;
      ++tilts;
    }
    if (!words[7].empty()) {
      EXPECT_NEAR(sample->distance.value() * 63, std::stod(words[7]), 1e-6) << line;
    }
    EXPECT_EQ(sample->touching, words[8] == "1" && sample->pressure > 0.0) << line;
  }
  EXPECT_FALSE(std::getline(file, line));
  EXPECT_GT(rows, 10000);
  EXPECT_GT(tilts, 5000);
  EXPECT_GT(presses, 500);
}

// ---------------------------------------------------------------- other formats

/// A sample of a pen that has no distance. x to the right and y down, as on screens [m].
PenSample penAt(double x, double y, double pressure, double t, double page_height) {
  PenSample sample;
  sample.stamp_ns = 1'000'000'000 + std::llround(t * 1e9);
  sample.tool = PenTool::kPen;
  sample.has_position = true;
  sample.x = x;
  sample.y = page_height - y;
  sample.pressure = pressure;
  sample.touching = pressure > 0.0;
  return sample;
}

/// Direction as altitude over the page and azimuth from x towards y (down) [rad].
void lean(PenSample& sample, double altitude, double azimuth) {
  sample.tilt_x = std::atan2(std::cos(azimuth), std::tan(altitude));
  sample.tilt_y = std::atan2(std::sin(azimuth), std::tan(altitude));
}

/// Strokes on one page. Only strokes were recorded: here the pen is over their first place for 0.1 s
/// before and over their last for 8 ms after, and away for 0.3 s between two.
constexpr int kHoverReports = 12;

void writeStrokes(const std::string& name, std::vector<std::vector<PenSample>> strokes,
                  const TabletSize& page, int least_strokes) {
  Writer writer({}, page);
  std::int64_t now_ns = 1'000'000'000;
  for (std::vector<PenSample>& stroke : strokes) {
    const std::int64_t shift_ns = now_ns + 8 * kMs * kHoverReports - stroke.front().stamp_ns;
    for (PenSample& sample : stroke) sample.stamp_ns += shift_ns;
    PenSample air = stroke.front();
    air.pressure = 0.0;
    air.touching = false;
    for (int k = kHoverReports; k > 0; --k) {
      air.stamp_ns = stroke.front().stamp_ns - 8 * kMs * k;
      writer.take(air);
    }
    for (const PenSample& sample : stroke) writer.take(sample);
    air = stroke.back();
    air.pressure = 0.0;
    air.touching = false;
    air.stamp_ns += 8 * kMs;
    writer.take(air);
    air.tool = PenTool::kNone;
    air.stamp_ns += 8 * kMs;
    writer.take(air);
    now_ns = air.stamp_ns + 300 * kMs;
  }
  writer.finish();
  writer.check(name, least_strokes);
}

TEST_F(Recordings, WacomUimInk) {
  std::vector<std::vector<PenSample>> strokes;
  double last_stroke = -1.0, last_t = 0.0;
  const auto rows = readTable(sharedData() / "wacom-uim" / "ink.csv");
  ASSERT_GT(rows.size(), 800U);
  for (const auto& row : rows) {
    ASSERT_EQ(row.size(), 7U);
    const double t = row[3] - rows.front()[3];
    if (row[0] == last_stroke && t <= last_t) continue;  // written twice
    if (row[0] != last_stroke) strokes.emplace_back();
    last_stroke = row[0];
    last_t = t;
    // Screen units; the page is laid over a sheet of that aspect.
    strokes.back().push_back(penAt(1e-3 * (row[1] - 240), 1e-3 * (row[2] - 120), row[4], t, 0.18));
    lean(strokes.back().back(), row[5], row[6]);
  }
  writeStrokes("wacom-uim/ink.csv", strokes, {0.18, 0.18, true}, 4);
}

TEST_F(Recordings, WacomUimValueOfInk) {
  std::vector<std::vector<PenSample>> strokes;
  double last_stroke = -1.0, last_t = 0.0;
  for (const auto& row : readTable(sharedData() / "wacom-uim" / "Value_of_Ink.csv")) {
    ASSERT_EQ(row.size(), 7U);
    if (row[0] == last_stroke && row[1] <= last_t) continue;
    if (row[0] != last_stroke) strokes.emplace_back();
    last_stroke = row[0];
    last_t = row[1];
    strokes.back().push_back(penAt(1e-3 * row[2], 1e-3 * row[3], row[4], row[1], 0.22));
    lean(strokes.back().back(), row[5], row[6]);
  }
  ASSERT_EQ(strokes.size(), 471U);
  writeStrokes("wacom-uim/Value_of_Ink.csv", strokes, {0.45, 0.22, true}, 20);
}

TEST_F(Recordings, Libmypaint) {
  Writer writer({}, {0.2, 0.2, true});
  double last_t = -1.0;
  for (const auto& row : readTable(sharedData() / "libmypaint" / "painting30sec.dat")) {
    ASSERT_EQ(row.size(), 4U);
    if (row[0] <= last_t) continue;
    last_t = row[0];
    writer.take(penAt(0.2e-3 * row[1], 0.2e-3 * row[2], row[3], row[0], 0.2));
  }
  writer.finish();
  writer.check("libmypaint/painting30sec.dat", 5);
}

TEST_F(Recordings, HandwritingSample) {
  // Millimetres, y up; azimuth and tilt in tenths of a degree, tilt being the altitude.
  Writer writer({}, {0.05, 0.04, true});
  for (const auto& row : readTable(sharedData() / "handwriting-sample" / "svc_data" / "signal.svc")) {
    if (row.size() != 7) continue;  // the count of rows
    PenSample sample =
        penAt(1e-3 * (row[0] - 50), 1e-3 * (90 - row[1]), row[3] > 0 ? row[6] : 0.0, row[2], 0.04);
    lean(sample, row[5] / 1800 * 3.14159265358979323846, row[4] / 1800 * 3.14159265358979323846);
    writer.take(sample);
  }
  writer.finish();
  writer.check("handwriting-sample/signal.svc", 3);
}

}  // namespace
}  // namespace calligraphy_brush
