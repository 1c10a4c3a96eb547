#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/files/stroke_file.h"
#include "calligraphy_brush/files/svg.h"
#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/sim/simulator_parameters.h"
#include "temporary_folder.h"

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;
const std::string kSource = CALLIGRAPHY_BRUSH_SOURCE_DIR;

/// The problems that a call throws as ParameterError.
template <class Call>
std::vector<std::string> problemsOf(Call&& call) {
  try {
    call();
  } catch (const ParameterError& error) {
    return error.problems();
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

template <class Call>
std::string messageOf(Call&& call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

GreyPicture gradient(int width, int height) {
  GreyPicture picture{width, height, {}};
  for (int k = 0; k < width * height; ++k)
    picture.mono8.push_back(static_cast<std::uint8_t>(k * 7 % 256));
  return picture;
}

TEST(Svg, OutlineOfADiscHasItsAreaAndAHoleIsALineOfItsOwn) {
  constexpr int kSize = 100;
  std::vector<std::uint8_t> mono8;
  for (int row = 0; row < kSize; ++row)
    for (int column = 0; column < kSize; ++column) {
      const double r = std::hypot(column + 0.5 - 50.0, row + 0.5 - 50.0);
      const double dark = std::clamp(std::min(30.5 - r, r - 9.5), 0.0, 1.0);
      mono8.push_back(static_cast<std::uint8_t>(std::lround(255.0 * (1.0 - dark))));
    }
  const auto outlines = traceOutlines(kSize, kSize, mono8);
  ASSERT_EQ(outlines.size(), 2U);
  double area = 0.0;  // the outer line and the hole have opposite senses
  for (const Outline& outline : outlines)
    for (std::size_t i = 0; i < outline.size(); ++i) {
      const OutlinePoint &a = outline[i], &b = outline[(i + 1) % outline.size()];
      area += 0.5 * (a.x * b.y - b.x * a.y);
    }
  EXPECT_NEAR(std::abs(area) / (3.14159265358979 * (30.0 * 30.0 - 10.0 * 10.0)), 1.0, 0.005);
  EXPECT_TRUE(traceOutlines(4, 4, std::vector<std::uint8_t>(16, 255)).empty());
  EXPECT_EQ(traceOutlines(4, 4, std::vector<std::uint8_t>(16, 0)).size(), 1U);
  EXPECT_THROW(traceOutlines(4, 4, {}), std::invalid_argument);
}

TEST(Png, ComesBackAsItWasWritten) {
  const TemporaryFolder folder;
  const GreyPicture picture = gradient(37, 23);
  writePng(folder.path("a.png"), 37, 23, picture.mono8, 4.0);
  const GreyPicture read = readPng(folder.path("a.png"));
  EXPECT_EQ(read.width_px, 37);
  EXPECT_EQ(read.height_px, 23);
  EXPECT_EQ(read.mono8, picture.mono8);
}

TEST(Png, ReplacesAnOldFileAndLeavesNothingElse) {
  const TemporaryFolder folder;
  folder.write("a.png", "old");
  writePng(folder.path("a.png"), 2, 1, {0, 255});
  EXPECT_EQ(readPng(folder.path("a.png")).mono8, (std::vector<std::uint8_t>{0, 255}));
  EXPECT_EQ(folder.fileCount(), 1);
}

TEST(Png, NamesPathAndReasonWhenItCannotWrite) {
  const TemporaryFolder folder;
  const std::string missing = folder.path("missing/a.png");
  const std::string message = messageOf([&] { writePng(missing, 1, 1, {0}); });
  EXPECT_TRUE(contains(message, missing)) << message;
  EXPECT_TRUE(contains(message, "No such file or directory")) << message;
  EXPECT_TRUE(contains(messageOf([&] { writePng(folder.path("."), 1, 1, {0}); }), "folder"));
  EXPECT_TRUE(contains(messageOf([&] { writePng("/dev/null", 1, 1, {0}); }), "not a regular file"));
  EXPECT_EQ(folder.fileCount(), 0);
}

TEST(Png, RefusesPicturesOfAnotherSize) {
  const TemporaryFolder folder;
  EXPECT_THROW(writePng(folder.path("a.png"), 2, 2, {0, 0, 0}), std::invalid_argument);
  EXPECT_THROW(writePng(folder.path("a.png"), 0, 0, {}), std::invalid_argument);
  EXPECT_EQ(folder.fileCount(), 0);
}

TEST(Png, SaysWhatIsNotAPicture) {
  const TemporaryFolder folder;
  EXPECT_TRUE(contains(messageOf([&] { readPng(folder.path("none.png")); }), "No such file"));
  EXPECT_TRUE(contains(messageOf([&] { readPng(folder.write("b.png", "text that is not a picture")); }),
                       "not a PNG"));
  writePng(folder.path("c.png"), 64, 64, gradient(64, 64).mono8);
  const std::string whole = readWhole(folder.path("c.png"));
  EXPECT_TRUE(contains(
      messageOf([&] { readPng(folder.write("d.png", whole.substr(0, whole.size() / 2))); }), "d.png"));
}

TEST(AtomicFile, IsNotThereBeforeTheCommit) {
  const TemporaryFolder folder;
  {
    const AtomicFile file(folder.path("a"));
    EXPECT_FALSE(fs::exists(folder.path("a")));
    EXPECT_EQ(fs::path(file.temporaryPath()).parent_path(), fs::path(folder.path("a")).parent_path());
  }
  EXPECT_EQ(folder.fileCount(), 0) << "the temporary stays behind without a commit";
}

TEST(AtomicFile, HasThePermissionsOfAnyNewFile) {
  const TemporaryFolder folder;
  AtomicFile file(folder.path("a"));
  file.commit();
  folder.write("b", "");
  EXPECT_EQ(fs::status(folder.path("a")).permissions(), fs::status(folder.path("b")).permissions());
}

TEST(YamlParameters, ReadsNestedAndJoinedNamesAndLeavesTheRest) {
  const TemporaryFolder folder;
  SimulatorParameters parameters;
  const double before = parameters.brush.root_diameter;
  loadYamlParameters(
      folder.write("a.yaml", "brush:\n  tip_length: 0.05\n  seed: 7\nrods/scheme: backward_euler\n"),
      parameters);
  EXPECT_EQ(parameters.brush.tip_length, 0.05);
  EXPECT_EQ(parameters.brush.seed, 7);
  EXPECT_EQ(parameters.rods.scheme, "backward_euler");
  EXPECT_EQ(parameters.brush.root_diameter, before);
}

TEST(YamlParameters, AnEmptyFileChangesNothing) {
  const TemporaryFolder folder;
  SimulatorParameters parameters;
  EXPECT_NO_THROW(loadYamlParameters(folder.write("a.yaml", "# nothing\n"), parameters));
}

TEST(YamlParameters, ListsAllProblemsWithLineAndRangeAndChangesNothing) {
  const TemporaryFolder folder;
  const std::string file = folder.write("a.yaml",
                                        "brush:\n"
                                        "  tip_length: 9\n"        // 2
                                        "  seed: 1.5\n"            // 3
                                        "  colour: red\n"          // 4
                                        "  density: [1, 2]\n"      // 5
                                        "  root_diameter: .nan\n"  // 6
                                        "  hair_count:\n"          // 7
                                        "rods: {scheme: magic}\n"  // 8
                                        "paper: 3\n"               // 9
                                        "ink/load: 0.5\n");
  SimulatorParameters parameters;
  const auto problems = problemsOf([&] { loadYamlParameters(file, parameters); });
  const std::string all = ParameterError(problems).what();
  for (const std::string expected :
       {":2: brush/tip_length = 9 is outside [0.005, 0.3] m",
        ":3: brush/seed = 1.5 is not a whole number", ":4: brush/colour is not a parameter",
        ":5: brush/density must be one value", ":6: brush/root_diameter = .nan",
        ":7: brush/hair_count has no value", ":8: rods/scheme = magic is outside backward_euler | bdf2",
        ":9: paper is not a parameter"})
    EXPECT_TRUE(contains(all, file + expected)) << expected << "\nis not in\n" << all;
  EXPECT_EQ(problems.size(), 8u) << all;
  EXPECT_EQ(parameters.ink.load, SimulatorParameters().ink.load);
}

TEST(YamlParameters, SaysWhereTheYamlIsBroken) {
  const TemporaryFolder folder;
  SimulatorParameters parameters;
  const std::string broken = folder.write("a.yaml", "brush:\n  seed: [1\nrods: }\n");
  EXPECT_TRUE(contains(problemsOf([&] { loadYamlParameters(broken, parameters); }).at(0), broken + ":"));
  EXPECT_TRUE(contains(problemsOf([&] { loadYamlParameters(folder.path("none"), parameters); }).at(0),
                       "cannot be read"));
  EXPECT_TRUE(contains(
      problemsOf([&] { loadYamlParameters(folder.write("b", "- 1\n- 2\n"), parameters); }).at(0),
      "must be a map"));
}

TEST(Presets, AllLoadAndAreInRange) {
  for (const std::string kind : {"brushes", "papers"}) {
    int count = 0;
    for (const auto& entry : fs::directory_iterator(kSource + "/config/" + kind)) {
      SimulatorParameters parameters;
      EXPECT_NO_THROW(loadYamlParameters(entry.path().string(), parameters)) << entry.path();
      ++count;
    }
    EXPECT_GE(count, 2) << kind;
  }
}

TEST(Presets, MediumHasTheSizeOfTheDefaults) {
  SimulatorParameters parameters;
  loadYamlParameters(kSource + "/config/brushes/medium.yaml", parameters);
  loadYamlParameters(kSource + "/config/papers/plain.yaml", parameters);
  // The defaults are rods by themselves; a brush is hair that touches, of a shape that suits it.
  EXPECT_TRUE(parameters.contact.bundles);
  const std::vector<std::string> of_hair = {
      "brush/hair_count", "brush/hair_radius", "brush/hair_taper",  "brush/cone",
      "brush/point",      "brush/point_hairs", "brush/convergence", "contact/bundles"};
  const auto defaults = listParameters(SimulatorParameters()), loaded = listParameters(parameters);
  for (std::size_t k = 0; k < defaults.size(); ++k)
    if (std::find(of_hair.begin(), of_hair.end(), defaults[k].name) == of_hair.end()) {
      EXPECT_EQ(loaded[k].value, defaults[k].value) << defaults[k].name;
    }
}

TEST(Presets, DryIsTheMediumBrushButForItsInk) {
  SimulatorParameters medium, dry;
  loadYamlParameters(kSource + "/config/brushes/medium.yaml", medium);
  loadYamlParameters(kSource + "/config/brushes/dry.yaml", dry);
  EXPECT_LT(dry.ink.load, medium.ink.load);
  dry.ink.load = medium.ink.load;
  const auto wanted = listParameters(medium), loaded = listParameters(dry);
  for (std::size_t k = 0; k < wanted.size(); ++k)
    EXPECT_EQ(loaded[k].value, wanted[k].value) << wanted[k].name;
}

TEST(Presets, AreFoundByNameFromTheProgram) {
  unsetenv("CALLIGRAPHY_BRUSH_CONFIG");
  EXPECT_TRUE(fs::equivalent(findPreset("brushes", "medium"), kSource + "/config/brushes/medium.yaml"));
  EXPECT_TRUE(fs::equivalent(findPreset("papers", "plain"), kSource + "/config/papers/plain.yaml"));
}

TEST(Presets, AFileIsTakenAsItIs) {
  const TemporaryFolder folder;
  const std::string file = folder.write("mine.yaml", "");
  EXPECT_EQ(findPreset("brushes", file), file);
  EXPECT_TRUE(
      contains(messageOf([&] { findPreset("brushes", folder.path("none.yaml")); }), "no such file"));
}

TEST(Presets, AnUnknownNameListsTheKnown) {
  const std::string message = messageOf([] { findPreset("brushes", "giant"); });
  for (const char* name : {"giant", "large", "medium", "small"})
    EXPECT_TRUE(contains(message, name)) << message;
  EXPECT_FALSE(contains(message, "\n"));
}

TEST(Presets, TheEnvironmentComesFirst) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path("brushes"));
  const std::string file = folder.write("brushes/medium.yaml", "brush: {seed: 3}\n");
  setenv("CALLIGRAPHY_BRUSH_CONFIG", folder.path("").c_str(), 1);
  EXPECT_TRUE(fs::equivalent(findPreset("brushes", "medium"), file));
  unsetenv("CALLIGRAPHY_BRUSH_CONFIG");
}

TEST(StrokeFile, ReadsListsMapsAndDefaults) {
  const TemporaryFolder folder;
  const auto strokes =
      readStrokeFile(folder.write("a.yaml",
                                  "speed: 0.04\n"
                                  "tilt: 0.1\n"
                                  "strokes:\n"
                                  "  - name: dot\n"
                                  "    tilt: 0.2\n"
                                  "    points:\n"
                                  "      - [0.1, 0.2, 0.003]\n"
                                  "      - {x: 0.11, y: 0.21, depth: -0.002, tilt: 0.3, azimuth: 1, "
                                  "twist: -0.5, time: 0.4, speed: 0.01}\n"
                                  "  - [[0, 0, 0.001], [0.1, 0, 0.001]]\n"
                                  "  - points: [{x: 0.1, y: 0.1, width: 0.004}]\n"));
  ASSERT_EQ(strokes.size(), 3u);
  EXPECT_TRUE(contains(strokes[0].name, "dot"));
  ASSERT_EQ(strokes[0].points.size(), 2u);
  EXPECT_EQ(strokes[0].points[0].depth, 0.003);
  EXPECT_EQ(strokes[0].points[0].tilt, 0.2);
  EXPECT_EQ(strokes[0].points[0].speed, 0.04);
  EXPECT_FALSE(strokes[0].points[0].time.has_value());
  EXPECT_EQ(strokes[0].points[1].depth, -0.002);
  EXPECT_EQ(strokes[0].points[1].tilt, 0.3);
  EXPECT_EQ(strokes[0].points[1].azimuth, 1.0);
  EXPECT_EQ(strokes[0].points[1].twist, -0.5);
  EXPECT_EQ(strokes[0].points[1].time, 0.4);
  EXPECT_EQ(strokes[0].points[1].speed, 0.01);
  EXPECT_EQ(strokes[1].points[1].x, 0.1);
  EXPECT_EQ(strokes[1].points[1].tilt, 0.1);
  EXPECT_EQ(strokes[2].points[0].width, 0.004);
}

TEST(StrokeFile, MayBeJustAListOfStrokes) {
  const TemporaryFolder folder;
  const auto strokes = readStrokeFile(folder.write("a.yaml", "- [[0, 0, 0.001], [0.1, 0, 0.002]]\n"));
  ASSERT_EQ(strokes.size(), 1u);
  EXPECT_EQ(strokes[0].points[1].depth, 0.002);
}

TEST(StrokeFile, ReportsEveryProblemWithItsLine) {
  const TemporaryFolder folder;
  const std::string file =
      folder.write("a.yaml",
                   "speed: fast\n"                                                 // 1
                   "strokes:\n"                                                    // 2
                   "  - ink: red\n"                                                // 3
                   "    points:\n"                                                 // 4
                   "      - [0.1, 0.2]\n"                                          // 5
                   "      - [0.1, .nan, 0.001]\n"                                  // 6
                   "      - {x: 0.1, y: 0.1}\n"                                    // 7
                   "      - {x: 0.1, y: 0.1, depth: 0.1, width: 0.1}\n"            // 8
                   "      - {x: 0.1, y: 0.1, depth: 0.1, tilt: 2, time: 1}\n"      // 9
                   "      - {x: 0.1, y: 0.1, depth: 0.1, time: 0.5, colour: 1}\n"  // 10
                   "      - {y: 0.1, depth: 0.1}\n"                                // 11
                   "  - points: []\n"                                              // 12
                   "  - [[0, 0, 0], {x: 0, y: 0, width: 0.1}]\n");                 // 13
  const auto problems = problemsOf([&] { readStrokeFile(file); });
  const std::string all = ParameterError(problems).what();
  for (const std::string expected :
       {":1: speed must be a number", ":3: stroke 1: unknown key \"ink\"",
        ":5: stroke 1, point 1 must be [x, y, depth]", ":6: stroke 1, point 2: y = .nan is outside",
        ":7: stroke 1, point 3 needs one of depth and width",
        ":8: stroke 1, point 4 needs one of depth and width",
        ":9: stroke 1, point 5: tilt = 2 is outside [0, 1.5] rad",
        ":10: stroke 1, point 6: time = 0.5 s is not after 1 s",
        ":10: stroke 1, point 6: unknown key \"colour\"", ":11: stroke 1, point 7 needs x and y",
        ":12: stroke 2 has no list of points", ":13: stroke 3, point 2 has a width"})
    EXPECT_TRUE(contains(all, file + expected)) << expected << "\nis not in\n" << all;
}

TEST(StrokeFile, RefusesWhatHasNoStrokes) {
  const TemporaryFolder folder;
  for (const char* text :
       {"", "a: 1\n", "strokes: 3\n", "strokes: []\n", "just words\n", "strokes: [\n", "[3]\n"})
    EXPECT_FALSE(problemsOf([&] { readStrokeFile(folder.write("a.yaml", text)); }).empty()) << text;
  EXPECT_TRUE(
      contains(problemsOf([&] { readStrokeFile(folder.path("none")); }).at(0), "cannot be read"));
}

TEST(StrokeFile, EiHasItsEightStrokes) {
  EXPECT_EQ(readStrokeFile(kSource + "/config/strokes/ei.yaml").size(), 8u);
}

}  // namespace
}  // namespace calligraphy_brush
