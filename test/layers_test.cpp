#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

// The compiler does not keep the rooms apart: all headers lie on one path, those of ROS too.

namespace {

namespace fs = std::filesystem;

const fs::path kSource = CALLIGRAPHY_BRUSH_SOURCE_DIR;

/// What each room may include beside itself.
const std::map<std::string, std::set<std::string>> kRooms = {
    {"common", {}},
    {"motion", {"common"}},
    {"tablet", {"common", "motion"}},
    {"brush", {"common"}},
    {"rods", {"common", "brush"}},
    {"contact", {"common", "brush"}},
    {"paper", {"common"}},
    {"ink", {"common", "brush", "paper"}},
    {"sim", {"common", "motion", "brush", "rods", "contact", "paper", "ink"}},
    {"files", {"common", "motion", "brush", "sim"}},
    {"writing", {"common", "motion", "brush", "sim", "paper", "files"}},
    {"vision", {"common"}},
    {"score", {"common", "motion", "brush", "paper", "sim", "files", "writing"}},
    {"ros",
     {"common", "motion", "tablet", "vision", "brush", "rods", "contact", "paper", "ink", "sim",
      "files"}},
    {"tools",
     {"common", "motion", "tablet", "brush", "rods", "contact", "paper", "ink", "sim", "files",
      "writing", "score", "ros"}},
    {"rviz", {"common", "motion", "tablet", "sim", "files", "ros"}},
};

const std::set<std::string> kRoomsWithRos = {"ros", "rviz", "tools"};

/// Why a line of a file in `room` may not be there; empty if it may.
std::string findFault(const std::string& room, const std::string& line) {
  static const std::regex include(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"].*)");
  static const std::regex ros_header(
      R"((ros|rosbag|rosconsole|tf2?|tf2_\w+|\w+_msgs|\w+_srvs|nodelet|pluginlib|class_loader|image_transport|diagnostic_updater|message_filters|dynamic_reconfigure|xmlrpcpp|rviz)/.*|Q[A-Z]\w+|Ogre\w+\.h|calligraphy_brush/[^/]+)");
  static const std::regex own_header(R"(calligraphy_brush/(\w+)/.*)");
  std::smatch match;
  if (!std::regex_match(line, match, include)) return "";
  const bool quoted = match[1] == "\"";
  const std::string header = match[2];
  if (std::regex_match(header, match, own_header)) {
    const std::string other = match[1];
    if (kRooms.count(other) == 0) return "the table of rooms has no " + other;
    if (other != room && kRooms.at(room).count(other) == 0) return room + " may not include " + other;
    return "";
  }
  if (std::regex_match(header, ros_header) && kRoomsWithRos.count(room) == 0)
    return room + " may not know ROS";
  if (quoted && header.find('/') != std::string::npos) return "a private header of another folder";
  return "";
}

std::vector<fs::path> sourceFiles() {
  std::vector<fs::path> files;
  for (const fs::path& root : {kSource / "include/calligraphy_brush", kSource / "src"})
    for (const auto& entry : fs::recursive_directory_iterator(root))
      if (entry.is_regular_file()) files.push_back(entry.path().lexically_relative(root));
  return files;
}

TEST(Layers, EveryFileLiesInARoom) {
  const auto files = sourceFiles();
  ASSERT_GT(files.size(), 20U);
  for (const fs::path& file : files) EXPECT_EQ(kRooms.count(file.begin()->string()), 1U) << file;
}

TEST(Layers, NoRoomIncludesWhatTheTableForbids) {
  int include_count = 0;
  for (const fs::path& root : {kSource / "include/calligraphy_brush", kSource / "src"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root)) {
      if (!entry.is_regular_file()) continue;
      const std::string room = entry.path().lexically_relative(root).begin()->string();
      if (kRooms.count(room) == 0) continue;  // the test above reports it
      std::ifstream file(entry.path());
      std::string line;
      for (int number = 1; std::getline(file, line); ++number) {
        include_count += line.find("#include") != std::string::npos ? 1 : 0;
        const std::string fault = findFault(room, line);
        EXPECT_EQ(fault, "") << entry.path() << ":" << number << ": " << line;
      }
    }
  }
  EXPECT_GT(include_count, 100);
}

TEST(Layers, TheCheckFindsForbiddenLines) {
  EXPECT_NE(findFault("tablet", "#include <rviz/tool.h>"), "");
  EXPECT_NE(findFault("tablet", "#include <QMouseEvent>"), "");
  EXPECT_NE(findFault("rods", "#include \"calligraphy_brush/contact/contact_parameters.h\""), "");
  EXPECT_NE(findFault("sim", "#include <ros/ros.h>"), "");
  EXPECT_NE(findFault("files", "#  include  <sensor_msgs/Image.h>  // picture"), "");
  EXPECT_NE(findFault("writing", "#include <calligraphy_brush/BrushState.h>"), "");
  EXPECT_NE(findFault("sim", "#include \"../rods/rod_step.h\""), "");
  EXPECT_NE(findFault("ros", "#include \"calligraphy_brush/writing/stroke_plan.h\""), "");
  EXPECT_EQ(findFault("rods", "#include \"calligraphy_brush/brush/brush_model.h\""), "");
  EXPECT_EQ(findFault("rods", "#include <vector>"), "");
  EXPECT_EQ(findFault("ros", "#include <ros/ros.h>"), "");
}

}  // namespace
