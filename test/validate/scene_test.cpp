#include "scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "statics.h"

using namespace calligraphy_brush::validate;

namespace {

struct Invocation {
  explicit Invocation(const std::vector<std::string>& arguments) {
    std::ostringstream out, error_out;
    code = runValidate(arguments, out, error_out);
    output = out.str();
    error = error_out.str();
  }
  int code;
  std::string output, error;
};

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEST(Validate, PrintsOneJsonObject) {
  const Invocation run({"heavy_cantilever", "--gamma", "10", "--clamp-angle-deg=60", "--nodes", "10"});
  EXPECT_EQ(run.code, 0);
  EXPECT_EQ(run.error, "");
  EXPECT_EQ(run.output.front(), '{');
  EXPECT_EQ(run.output.substr(run.output.size() - 2), "}\n");
  for (const char* name : {"tip_x", "tip_z", "height_over_width", "converged", "iterations"})
    EXPECT_TRUE(contains(run.output, '"' + std::string(name) + "\": ")) << name;
  HeavyCantileverParameters p;
  p.gamma = 10;
  p.clamp_angle_deg = 60;
  p.nodes = 10;
  EXPECT_EQ(run.output, toJson(heavyCantilever(p)) + "\n");
}

TEST(Validate, WritesNullForWhatIsNoNumber) {
  const Invocation run({"heavy_cantilever", "--clamp-angle-deg", "0"});
  EXPECT_TRUE(contains(run.output, "\"height_over_width\": null"));
}

TEST(Validate, TakesFlagsWithAndWithoutAValue) {
  const std::vector<std::string> follower{"tip_load", "--follower", "--beta", "2"},
      follower_true{"tip_load", "--follower", "true", "--beta", "2"},
      dead{"tip_load", "--follower=false", "--beta", "2"};
  EXPECT_EQ(Invocation(follower).output, Invocation(follower_true).output);
  EXPECT_NE(Invocation(follower).output, Invocation(dead).output);
}

TEST(Validate, RefusesWhatItDoesNotUnderstandInOneLine) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong{
      {{}, "usage"},
      {{"nothing"}, "nothing"},
      {{"press", "--dept", "0.1"}, "--dept"},
      {{"press", "depth", "0.1"}, "depth"},
      {{"press", "--depth"}, "--depth"},
      {{"press", "--depth", "--plane"}, "--depth"},
      {{"press", "--depth", "deep"}, "deep"},
      {{"press", "--depth", "0.9"}, "--depth = 0.9 is outside [0, 0.8]"},
      {{"press", "--depth", "nan"}, "--depth"},
      {{"press", "--nodes", "10.5"}, "10.5"},
      {{"press", "--nodes", "99999999999999"}, "--nodes"},
      {{"press", "--precision", "half"}, "half"},
      {{"press", "--plane=maybe"}, "maybe"},
      {{"press", "--tilt-deg", "50", "--mu", "-1"}, "--mu"},
      {{"drag", "--direction", "0"}, "--direction"},
      {{"slide", "--scheme", "euler"}, "euler"},
  };
  for (const auto& [arguments, part] : wrong) {
    const Invocation run(arguments);
    EXPECT_EQ(run.code, 1) << part;
    EXPECT_EQ(run.output, "") << part;
    EXPECT_TRUE(contains(run.error, part)) << run.error;
    EXPECT_EQ(std::count(run.error.begin(), run.error.end(), '\n'), 1) << run.error;
  }
}

TEST(Validate, DocumentsEveryScene) {
  const Invocation list({"--list"});
  EXPECT_EQ(list.code, 0);
  for (const Scene& scene : scenes()) {
    EXPECT_TRUE(contains(list.output, scene.name + ": ")) << scene.name;
    const Invocation help({scene.name, "--help"});
    EXPECT_EQ(help.code, 0);
    for (const char* part : {"Arguments:", "Results:", "--nodes [", "  converged", "  iterations"})
      EXPECT_TRUE(contains(help.output, part)) << scene.name << part;
  }
}
