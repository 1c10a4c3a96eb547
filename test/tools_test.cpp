#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <std_msgs/String.h>
#include <sys/wait.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <regex>
#include <sstream>
#include <string>

#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/sim/simulator.h"
#include "pose_bag.h"
#include "temporary_folder.h"

// stroke_writer and stroke_replay as a user runs them, without a ROS master.

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;
const std::string kSource = CALLIGRAPHY_BRUSH_SOURCE_DIR;

const char* const kStrokes =
    "speed: 0.1\n"
    "strokes:\n"
    "  - [[0.02, 0.02, 0.001], [0.03, 0.02, 0.006], [0.04, 0.03, 0.0]]\n";
const char* const kSmallPaper = "paper: {width: 0.06, height: 0.05, px_per_mm: 4.0}\n";

class Tools : public ::testing::Test {
 protected:
  struct Result {
    int exit_code = -1;
    std::string out, err;
  };

  Result run(const std::string& program, const std::string& arguments) const {
    // A master that is not there: nothing may wait for it.
    const std::string command =
        "cd " + folder.path("") + " && ROS_MASTER_URI=http://127.0.0.1:1 " PROGRAMS "/" + program + " " +
        arguments + " >" + folder.path("out.txt") + " 2>" + folder.path("err.txt");
    const int status = std::system(command.c_str());
    Result result{WIFEXITED(status) ? WEXITSTATUS(status) : -1, readWhole(folder.path("out.txt")),
                  readWhole(folder.path("err.txt"))};
    fs::remove(folder.path("out.txt"));
    fs::remove(folder.path("err.txt"));
    return result;
  }

  /// Exit 1, one line on stderr that has `part`, and no file that was not there before.
  void expectRefused(const std::string& program, const std::string& arguments,
                     const std::string& part) const {
    const int files = folder.fileCount();
    const Result result = run(program, arguments);
    const std::string what = program + " " + arguments + "\n" + result.err;
    EXPECT_EQ(result.exit_code, 1) << what;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << what;
    EXPECT_NE(result.err.find(part), std::string::npos) << what << "lacks " << part;
    EXPECT_EQ(result.err.rfind(program + ": ", 0), 0u) << what;
    EXPECT_EQ(folder.fileCount(), files) << what;
  }

  std::string writeBag(const std::string& name) const {
    folder.write("s.yaml", kStrokes);
    EXPECT_EQ(run("stroke_writer", "s.yaml --quiet --bag " + name).exit_code, 0);
    return folder.path(name);
  }

  TemporaryFolder folder;
};

TEST_F(Tools, HaveHelp) {
  for (const char* program : {"stroke_writer", "stroke_replay", "stroke_score", "watch_stroke"}) {
    const Result result = run(program, "--help");
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_NE(result.out.find("Usage: " + std::string(program)), std::string::npos);
    EXPECT_EQ(result.err, "");
  }
}

TEST_F(Tools, TheSameStrokesGiveTheSameBytes) {
  writeBag("a.bag");
  writeBag("b.bag");
  EXPECT_EQ(readWhole(folder.path("a.bag")), readWhole(folder.path("b.bag")));
}

TEST_F(Tools, ABagGivesBackThePosesToTheBit) {
  std::vector<HandlePose> poses(3);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    poses[k].stamp_ns = 1'000'000'000 + 8'000'000 * static_cast<std::int64_t>(k);
    poses[k].position = {0.1 / 3, 0.2, 0.05 - 1e-3 * static_cast<double>(k)};
  }
  writePoseBag(folder.path("a.bag"), poses, "paper");
  for (const char* topic : {"handle_pose", "/handle_pose"}) {
    const PoseBag read = readPoseBag(folder.path("a.bag"), topic, "paper");
    EXPECT_TRUE(read.unreachable.empty());
    ASSERT_EQ(read.poses.size(), poses.size());
    for (std::size_t k = 0; k < poses.size(); ++k) {
      EXPECT_EQ(read.poses[k].stamp_ns, poses[k].stamp_ns);
      EXPECT_EQ(read.poses[k].position, poses[k].position);
      EXPECT_EQ(read.poses[k].orientation.coeffs(), poses[k].orientation.coeffs());
    }
  }
}

TEST_F(Tools, ReplayDoesWhatTheNodeDoes) {
  const std::string bag = writeBag("a.bag");
  folder.write("p.yaml", kSmallPaper);
  const Result result = run("stroke_replay", "a.bag a.png --paper ./p.yaml");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("real time"), std::string::npos) << result.out;

  SimulatorParameters parameters;
  loadYamlParameters(kSource + "/config/brushes/medium.yaml", parameters);
  parameters.paper.width = 0.06;
  parameters.paper.height = 0.05;
  Simulator simulator(parameters);
  for (const HandlePose& pose : readPoseBag(bag, "handle_pose", "paper").poses) {
    simulator.addPose(pose);
    simulator.advance();
  }
  std::vector<std::uint8_t> picture;
  simulator.paper().render(picture);
  EXPECT_EQ(readPng(folder.path("a.png")).mono8, picture);
  EXPECT_LT(*std::min_element(picture.begin(), picture.end()), 100) << "nothing was written";
}

TEST_F(Tools, ReplayOptionsDoWhatTheySay) {
  writeBag("a.bag");
  folder.write("p.yaml", kSmallPaper);
  Result result =
      run("stroke_replay", "a.bag a.png --paper ./p.yaml --px-per-mm 2 --quiet --brush small");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out + result.err, "");
  EXPECT_EQ(readPng(folder.path("a.png")).width_px, 120);
  for (const char* threads : {"1", "2"})
    ASSERT_EQ(run("stroke_replay",
                  "a.bag t" + std::string(threads) + ".png --paper ./p.yaml --threads " + threads)
                  .exit_code,
              0);
  EXPECT_EQ(readPng(folder.path("t1.png")).mono8, readPng(folder.path("t2.png")).mono8);
}

/// Two strokes that are far from each other, the left one first.
const char* const kTwoStrokes =
    "speed: 0.05\n"
    "strokes:\n"
    "  - [[0.015, 0.010, 0.004], [0.015, 0.025, 0.009], [0.015, 0.040, 0.002]]\n"
    "  - [[0.045, 0.010, 0.004], [0.045, 0.025, 0.009], [0.045, 0.040, 0.002]]\n";

int darkPixels(const GreyPicture& picture, bool left) {
  int count = 0;
  for (int row = 0; row < picture.height_px; ++row)
    for (int column = 0; column < picture.width_px; ++column)
      count += (2 * column < picture.width_px) == left &&
               picture.mono8[static_cast<std::size_t>(row * picture.width_px + column)] < 128;
  return count;
}

/// Of what is darker than half.
double intersectionOverUnion(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  double both = 0.0, either = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    both += a[i] < 128 && b[i] < 128;
    either += a[i] < 128 || b[i] < 128;
  }
  return both / either;
}

TEST_F(Tools, ReplayTakesStrokesBackAndShowsThemOneByOne) {
  folder.write("p.yaml", kSmallPaper);
  folder.write("s.yaml", kTwoStrokes);
  ASSERT_EQ(run("stroke_writer", "s.yaml --quiet --bag s.bag").exit_code, 0);
  const std::string common = " --quiet --paper ./p.yaml ";
  ASSERT_EQ(run("stroke_replay", "s.bag all.png --strokes s.png --outline s.svg" + common).exit_code, 0);
  const GreyPicture all = readPng(folder.path("all.png"));
  const int left = darkPixels(all, true), right = darkPixels(all, false);
  ASSERT_GT(left, 300);
  ASSERT_GT(right, 300);

  // As many pictures as strokes, each with what its stroke added.
  EXPECT_FALSE(fs::exists(folder.path("s_03.png")));
  const GreyPicture first = readPng(folder.path("s_01.png")), second = readPng(folder.path("s_02.png"));
  EXPECT_EQ(darkPixels(first, false) + darkPixels(second, true), 0);
  std::vector<std::uint8_t> together = first.mono8;
  for (std::size_t i = 0; i < together.size(); ++i) together[i] = std::min(together[i], second.mono8[i]);
  EXPECT_GT(intersectionOverUnion(together, all.mono8), 0.95);  // ink goes on to flow

  // Without the last one the sheet is as if it had not been written.
  ASSERT_EQ(run("stroke_replay", "s.bag one.png --undo 1" + common).exit_code, 0);
  const GreyPicture one = readPng(folder.path("one.png"));
  EXPECT_EQ(darkPixels(one, false), 0);
  for (int row = 0; row < one.height_px; ++row)
    for (int column = 0; column < one.width_px / 2; ++column) {
      const auto at = static_cast<std::size_t>(row * one.width_px + column);
      ASSERT_NEAR(one.mono8[at], all.mono8[at], 8) << row << " " << column;  // it flowed in other steps
    }
  ASSERT_EQ(run("stroke_replay", "s.bag none.png --undo 2" + common).exit_code, 0);
  const GreyPicture none = readPng(folder.path("none.png"));
  EXPECT_EQ(std::count(none.mono8.begin(), none.mono8.end(), 255),
            static_cast<std::ptrdiff_t>(none.mono8.size()));
  expectRefused("stroke_replay", "s.bag o.png --undo 3" + common, "undo = 3, but there are 2 strokes");
  expectRefused("stroke_replay", "s.bag o.png --undo -1" + common, "--undo = -1 is below 0");
}

TEST_F(Tools, ReplayOutlinesEachStroke) {
  folder.write("p.yaml", kSmallPaper);
  folder.write("s.yaml", kTwoStrokes);
  ASSERT_EQ(run("stroke_writer", "s.yaml --quiet --bag s.bag").exit_code, 0);
  ASSERT_EQ(
      run("stroke_replay", "s.bag all.png --strokes s.png --outline s.svg --quiet --paper ./p.yaml")
          .exit_code,
      0);
  const std::string svg = readWhole(folder.path("s.svg"));
  EXPECT_EQ(svg.find("id=\"stroke_03\""), std::string::npos);
  for (const bool left : {true, false}) {
    const std::string name = left ? "_01" : "_02";
    const auto begin = svg.find("id=\"stroke" + name + "\"");
    ASSERT_NE(begin, std::string::npos);
    const auto data = svg.find(" d=\"", begin) + 4;
    // Area of what is within the lines, holes taken off: half the sum of cross products, in mm².
    double area = 0.0, x0 = 0.0, y0 = 0.0, x = 0.0, y = 0.0;
    std::string path = svg.substr(data, svg.find('"', data) - data);
    path = std::regex_replace(path, std::regex("[MZ]"), " $& ");
    std::replace(path.begin(), path.end(), 'L', ' ');
    std::istringstream words(path);
    bool starts = false;
    for (std::string word; words >> word;) {
      if (word == "M" || word == "Z") {
        if (word == "Z") area += 0.5 * (x * y0 - x0 * y);
        starts = word == "M";
        continue;
      }
      double to_x = std::stod(word), to_y = 0.0;
      ASSERT_TRUE(words >> to_y);
      EXPECT_EQ(to_x < 30.0, left);
      if (starts) {
        x0 = to_x;
        y0 = to_y;
      } else {
        area += 0.5 * (x * to_y - to_x * y);
      }
      starts = false;
      x = to_x;
      y = to_y;
    }
    const double inked = darkPixels(readPng(folder.path("s" + name + ".png")), left) / 16.0;
    EXPECT_NEAR(std::abs(area) / inked, 1.0, 0.06) << name;
  }
}

TEST_F(Tools, ReplayAtTwiceTheResolutionShowsTheSameStroke) {
  // Streaks that are finer than a pixel are not the same: a broad stroke on a smooth sheet.
  folder.write("p.yaml", "paper: {width: 0.13, height: 0.05, roughness: 0.0, unevenness: 0.0}\n");
  folder.write("s.yaml",
               "speed: 0.04\n"
               "strokes:\n"
               "  - - {x: 0.030, y: 0.025, depth: 0.000, tilt: 0.35, azimuth: 0.0}\n"
               "    - {x: 0.036, y: 0.025, depth: 0.014, tilt: 0.35, azimuth: 0.0}\n"
               "    - {x: 0.095, y: 0.025, depth: 0.014, tilt: 0.35, azimuth: 0.0}\n"
               "    - {x: 0.098, y: 0.025, depth: 0.000, tilt: 0.35, azimuth: 0.0}\n");
  ASSERT_EQ(run("stroke_writer", "s.yaml --quiet --bag s.bag").exit_code, 0);
  for (const char* px_per_mm : {"8", "16"})
    ASSERT_EQ(
        run("stroke_replay", "s.bag " + std::string(px_per_mm) +
                                 ".png --quiet --brush medium --paper ./p.yaml --px-per-mm " + px_per_mm)
            .exit_code,
        0);
  const GreyPicture coarse = readPng(folder.path("8.png")), fine = readPng(folder.path("16.png"));
  ASSERT_EQ(fine.width_px, 2 * coarse.width_px);
  std::vector<std::uint8_t> mean;
  for (int row = 0; row < coarse.height_px; ++row)
    for (int column = 0; column < coarse.width_px; ++column) {
      int sum = 2;
      for (const int k : {0, 1})
        for (const int l : {0, 1})
          sum += fine.mono8[static_cast<std::size_t>((2 * row + k) * fine.width_px + 2 * column + l)];
      mean.push_back(static_cast<std::uint8_t>(sum / 4));
    }
  EXPECT_GE(intersectionOverUnion(coarse.mono8, mean), 0.97);
}

TEST_F(Tools, ReplayBringsOtherFramesToThePaper) {
  rosbag::Bag bag(folder.path("f.bag"), rosbag::bagmode::Write);
  geometry_msgs::TransformStamped X_PB;
  X_PB.header.frame_id = "paper";
  X_PB.child_frame_id = "board";
  X_PB.transform.translation.x = 0.5;
  X_PB.transform.rotation.z = X_PB.transform.rotation.w = std::sqrt(0.5);
  tf2_msgs::TFMessage tree;
  tree.transforms.push_back(X_PB);
  bag.write("/tf_static", ros::Time(1.0), tree);
  HandlePose pose;
  pose.position = {0.1, 0.2, 0.3};
  for (const char* frame : {"board", "paper", "moon", ""}) {
    pose.stamp_ns += 2'000'000'000;
    const auto message = toPoseStamped(pose, frame);
    bag.write("/handle_pose", message.header.stamp, message);
  }
  bag.close();
  const PoseBag read = readPoseBag(folder.path("f.bag"), "handle_pose", "paper");
  ASSERT_EQ(read.poses.size(), 2u);
  EXPECT_LT((read.poses[0].position - Eigen::Vector3d(0.3, 0.1, 0.3)).norm(), 1e-12);
  EXPECT_EQ(read.poses[1].position, pose.position);
  EXPECT_EQ(read.unreachable.size(), 2u);
}

TEST_F(Tools, ReplayRefusesBadInput) {
  writeBag("a.bag");
  folder.write("text.bag", "this is not a bag, but it has some text in it\n");
  folder.write("empty.bag", "");
  folder.write("half.bag", readWhole(folder.path("a.bag")).substr(0, 5000));
  folder.write("bad.yaml", "brush:\n  tip_length: 7\n");
  {
    rosbag::Bag bag(folder.path("other.bag"), rosbag::bagmode::Write);
    bag.write("/handle_pose", ros::Time(1.0), std_msgs::String());
  }
  {
    rosbag::Bag bag(folder.path("nothing.bag"), rosbag::bagmode::Write);
    bag.write("/chatter", ros::Time(1.0), std_msgs::String());
  }
  HandlePose broken;
  broken.stamp_ns = 1'000'000'000;
  broken.orientation.coeffs().setZero();
  writePoseBag(folder.path("broken.bag"), {broken}, "paper");
  HandlePose far;
  far.stamp_ns = 1'000'000'000;
  writePoseBag(folder.path("moon.bag"), {far}, "moon");

  expectRefused("stroke_replay", "", "needs a bag and a picture");
  expectRefused("stroke_replay", "a.bag", "needs a bag and a picture");
  expectRefused("stroke_replay", "none.bag o.png", "none.bag: No such file");
  expectRefused("stroke_replay", ". o.png", "not a regular file");
  expectRefused("stroke_replay", "text.bag o.png", "text.bag: not a readable bag");
  expectRefused("stroke_replay", "empty.bag o.png", "empty.bag: not a readable bag");
  expectRefused("stroke_replay", "half.bag o.png", "half.bag: not a readable bag");
  expectRefused("stroke_replay", "nothing.bag o.png", "no topic handle_pose; there is /chatter");
  expectRefused("stroke_replay", "other.bag o.png", "std_msgs/String");
  expectRefused("stroke_replay", "a.bag o.png --topic pen", "no topic pen");
  expectRefused("stroke_replay", "broken.bag o.png", "no pose to simulate");
  expectRefused("stroke_replay", "moon.bag o.png", "\"moon\" is not connected");
  expectRefused("stroke_replay", "a.bag missing/o.png", "cannot write missing/o.png");
  expectRefused("stroke_replay", "a.bag .", "it is a folder");
  expectRefused("stroke_replay", "a.bag o.png --brush giant",
                "known: acrylic, dry, full, large, medium, pointed, short, small");
  expectRefused("stroke_replay", "a.bag o.png --brush none.yaml", "no such file");
  expectRefused("stroke_replay", "a.bag o.png --brush ./bad.yaml",
                "bad.yaml:2: brush/tip_length = 7 is outside");
  expectRefused("stroke_replay", "a.bag o.png --px-per-mm 1000", "paper/px_per_mm = 1000 is outside");
  expectRefused("stroke_replay", "a.bag o.png --px-per-mm many", "many");
  expectRefused("stroke_replay", "a.bag o.png --threads 0", "rods/threads = 0 is outside");
  expectRefused("stroke_replay", "a.bag o.png --colour red", "colour");
  expectRefused("stroke_replay", "a.bag o.png third", "");
}

TEST_F(Tools, WatchRefusesBadInput) {
  writeBag("a.bag");
  expectRefused("watch_stroke", "", "needs the bag");
  expectRefused("watch_stroke", "none.bag", "none.bag");
  expectRefused("watch_stroke", "a.bag --topic pen", "has no messages on pen");
  expectRefused("watch_stroke", "a.bag --patience 0.1", "no ROS master");
}

TEST_F(Tools, WriterRefusesBadInput) {
  folder.write("s.yaml", kStrokes);
  folder.write("bad.yaml", "strokes:\n  - [[0, 0]]\n");
  folder.write("broken.yaml", "strokes: [\n");
  folder.write("g.json", "{\"strokes\": [\"M 0 0 A 3 Z\"], \"medians\": [[[1, 1]]]}");
  folder.write("half.json", "{\"strokes\": [\"M 0 0");
  expectRefused("stroke_writer", "", "needs a stroke file or --glyph");
  expectRefused("stroke_writer", "s.yaml", "needs --bag FILE or --publish");
  expectRefused("stroke_writer", "s.yaml --glyph g.json --bag o.bag", "needs a stroke file or --glyph");
  expectRefused("stroke_writer", ". --bag o.bag", ".: cannot be read: it is a folder");
  expectRefused("stroke_writer", "--glyph . --bag o.bag", ".: cannot be read: it is a folder");
  expectRefused("stroke_writer", "none.yaml --bag o.bag", "none.yaml: cannot be read");
  expectRefused("stroke_writer", "bad.yaml --bag o.bag",
                "bad.yaml:2: stroke 1, point 1 must be [x, y, depth]");
  expectRefused("stroke_writer", "broken.yaml --bag o.bag", "broken.yaml:");
  expectRefused("stroke_writer", "--glyph none.json --bag o.bag", "none.json: cannot be read");
  expectRefused("stroke_writer", "--glyph g.json --bag o.bag", "command 'A'");
  expectRefused("stroke_writer", "--glyph half.json --bag o.bag", "half.json");
  expectRefused("stroke_writer", "s.yaml --bag missing/o.bag", "cannot write missing/o.bag");
  expectRefused("stroke_writer", "s.yaml --bag .", "it is a folder");
  expectRefused("stroke_writer", "s.yaml --bag o.bag --rate 0", "rate = 0 is outside");
  expectRefused("stroke_writer", "s.yaml --bag o.bag --rate nan", "rate = nan is outside");
  expectRefused("stroke_writer", "s.yaml --bag o.bag --brush giant",
                "known: acrylic, dry, full, large, medium, pointed, short, small");
  expectRefused("stroke_writer", "--glyph g.json --size -1 --bag o.bag", "--size = -1 is outside");
  expectRefused("stroke_writer", "--glyph g.json --origin 1 --bag o.bag", "--origin needs two numbers");
  expectRefused("stroke_writer", "s.yaml --publish", "no ROS master at");
}

TEST_F(Tools, ScoreRefusesBadInput) {
  expectRefused("stroke_score", "", "needs one of --recorded FOLDER, --glyphs FOLDER and --footprint");
  expectRefused("stroke_score", "--footprint --glyphs g.json", "needs one of");
  expectRefused("stroke_score", "--recorded none", "meta.json: cannot be read");
  expectRefused("stroke_score", "--glyphs none.json", "none.json: cannot be read");
  expectRefused("stroke_score", "--recorded none --rows some", "--rows = some is not one of");
  expectRefused("stroke_score", "--recorded none --px-per-mm nan", "--px-per-mm = nan is outside");
  expectRefused("stroke_score", "--footprint --csv missing/o.csv", "cannot write missing/o.csv");
}

TEST_F(Tools, WriterWritesACharacterWhereItIsTold) {
  folder.write("g.json",
               "{\"strokes\": [\"M 100 300 L 900 300 L 900 400 L 100 400 Z\"], \"medians\": [[[130, "
               "350], [870, 350]]]}");
  folder.write("p.yaml", kSmallPaper);
  const Result result =
      run("stroke_writer", "--glyph g.json --size 0.03 --origin 0.02 0.01 --bag g.bag --paper ./p.yaml");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  ASSERT_EQ(run("stroke_replay", "g.bag g.png --quiet --paper ./p.yaml").exit_code, 0);
  const GreyPicture picture = readPng(folder.path("g.png"));
  double sum = 0.0, x = 0.0, y = 0.0;
  for (int row = 0; row < picture.height_px; ++row)
    for (int column = 0; column < picture.width_px; ++column) {
      const double dark = 255 - picture.mono8[static_cast<std::size_t>(row * picture.width_px + column)];
      sum += dark;
      x += dark * (column + 0.5) / 4e3;
      y += dark * (picture.height_px - row - 0.5) / 4e3;
    }
  ASSERT_GT(sum, 0.0);
  EXPECT_NEAR(x / sum, 0.02 + 0.03 * 500 / 1024, 0.004);
  EXPECT_NEAR(y / sum, 0.01 + 0.03 * (350 + 124) / 1024, 0.0015);
}

/// How often the tip goes from the air to the sheet.
int touchDowns(const std::vector<HandlePose>& poses) {
  const double tip_length = makeBrush(BrushParameters()).tip_length;
  int count = 0;
  for (std::size_t k = 1; k < poses.size(); ++k)
    count += poses[k - 1].position.z() > tip_length && poses[k].position.z() <= tip_length;
  return count;
}

TEST(Ei, KeepsAllLiquidAndPigmentToTheEnd) {
  const PoseBag bag = readPoseBag(kSource + "/config/strokes/ei.bag", "handle_pose", "paper");
  // Slow and hardly drying; fast and dry before the end.
  for (const bool thirsty : {false, true}) {
    SimulatorParameters parameters;
    parameters.ink.concentration = 0.5;
    if (thirsty) {
      parameters.paper.diffusivity = 6e-7;
      parameters.paper.evaporation = 2e-6;
    }
    Simulator simulator(parameters);
    const double liquid = simulator.report().ink_in_tip, pigment = simulator.report().pigment_in_tip;
    for (const HandlePose& pose : bag.poses) {
      simulator.addPose(pose);
      simulator.advance();
    }
    const Paper& paper = simulator.paper();
    ASSERT_GT(paper.inkVolume(), 1e-9);
    EXPECT_GT(paper.evaporatedVolume(), 0.0);
    EXPECT_NEAR(simulator.report().ink_in_tip + paper.waterVolume() + paper.evaporatedVolume(), liquid,
                1e-9 * paper.inkVolume());
    EXPECT_NEAR(simulator.report().pigment_in_tip + paper.inkVolume(), pigment,
                1e-9 * paper.inkVolume());
  }
}

TEST_F(Tools, EiIsEightStrokesAndFollowsFromItsStrokeFile) {
  ASSERT_EQ(run("stroke_writer", kSource + "/config/strokes/ei.yaml --quiet --bag ei.bag").exit_code, 0);
  const std::string kept = kSource + "/config/strokes/ei.bag";
  // The brush is measured by simulation, so the motions agree only as far as the physics did not change.
  for (const std::string& bag : {folder.path("ei.bag"), kept}) {
    const PoseBag read = readPoseBag(bag, "handle_pose", "paper");
    EXPECT_EQ(touchDowns(read.poses), 8) << bag;
    PoseTrack track{MotionParameters()};
    for (const HandlePose& pose : read.poses) ASSERT_EQ(track.add(pose), PoseVerdict::kAccepted) << bag;
  }
  EXPECT_LT(fs::file_size(kept), 500u * 1000u);
}

}  // namespace
}  // namespace calligraphy_brush
