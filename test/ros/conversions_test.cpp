#include "calligraphy_brush/ros/conversions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace calligraphy_brush {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std_msgs::Header makeHeader() {
  std_msgs::Header header;
  header.frame_id = "paper";
  header.stamp = ros::Time(12, 34);
  return header;
}

Simulator makeSimulator() {
  SimulatorParameters parameters;
  parameters.brush.rod_count = 5;
  parameters.brush.node_count = 4;
  parameters.paper.width = 0.03;
  parameters.paper.height = 0.02;
  parameters.paper.px_per_mm = 1.0;
  return Simulator(parameters);
}

TEST(Time, SurvivesTheRoundTripExactly) {
  for (const std::int64_t stamp_ns :
       {std::int64_t{0}, std::int64_t{1}, std::int64_t{1700000000123456789},
        std::int64_t{4294967295999999999}})
    EXPECT_EQ(toNanoseconds(toRosTime(stamp_ns)), stamp_ns);
}

TEST(Time, IsClampedToWhatRosCanHold) {
  EXPECT_EQ(toRosTime(-5), ros::Time(0, 0));
  EXPECT_EQ(toNanoseconds(toRosTime(std::numeric_limits<std::int64_t>::max())), 4294967295999999999);
}

TEST(Pose, SurvivesTheRoundTripExactly) {
  HandlePose pose;
  pose.stamp_ns = 1700000000123456789;
  pose.position = {0.1, -1.0 / 3.0, 1e-17};
  pose.orientation = Eigen::Quaterniond(0.1, 0.7, -0.3, 2.0);  // not of unit length: it stays so
  const auto message = toPoseStamped(pose, "paper");
  EXPECT_EQ(message.header.frame_id, "paper");
  const HandlePose back = toHandlePose(message);
  EXPECT_EQ(back.stamp_ns, pose.stamp_ns);
  EXPECT_EQ(back.position, pose.position);
  EXPECT_EQ(back.orientation.coeffs(), pose.orientation.coeffs());
}

TEST(Pose, MalformedOnesArriveMalformed) {
  geometry_msgs::PoseStamped message;  // a zero quaternion
  message.pose.position.y = kNaN;
  const HandlePose pose = toHandlePose(message);
  EXPECT_TRUE(std::isnan(pose.position.y()));
  EXPECT_EQ(pose.orientation.norm(), 0.0);
}

TEST(Transform, IsThePose) {
  HandlePose pose;
  pose.stamp_ns = 1500000000;
  pose.position = {1, 2, 3};
  pose.orientation = Eigen::Quaterniond(0.5, -0.5, 0.5, 0.5);
  const auto message = toTransformStamped(pose, "paper", "brush_handle");
  EXPECT_EQ(message.header.frame_id, "paper");
  EXPECT_EQ(message.child_frame_id, "brush_handle");
  EXPECT_EQ(message.header.stamp, ros::Time(1.5));
  EXPECT_EQ(message.transform.translation.z, 3.0);
  EXPECT_EQ(message.transform.rotation.w, 0.5);
  EXPECT_EQ(message.transform.rotation.x, -0.5);
}

TEST(Wrench, HasForceAndTorqueInThePaperFrame) {
  const auto message = toWrenchStamped({{1, 2, 3}, {4, 5, 6}}, makeHeader());
  EXPECT_EQ(message.header.frame_id, "paper");
  EXPECT_EQ(message.wrench.force.x, 1.0);
  EXPECT_EQ(message.wrench.force.z, 3.0);
  EXPECT_EQ(message.wrench.torque.x, 4.0);
  EXPECT_EQ(message.wrench.torque.z, 6.0);
}

TEST(Picture, ShowsInkWhereItLiesOnTheSheet) {
  PaperParameters parameters;
  parameters.width = 0.03;
  parameters.height = 0.02;
  parameters.px_per_mm = 1.0;
  Paper paper(parameters);
  // Near the right end of the lower edge.
  paper.addDisc(0.0265, 0.0025, 0.002, 1e-3);

  const auto image = toImage(paper, makeHeader());
  EXPECT_EQ(image.encoding, "mono8");
  EXPECT_EQ(image.header.stamp, ros::Time(12, 34));
  ASSERT_EQ(image.width, 30U);
  ASSERT_EQ(image.height, 20U);
  ASSERT_EQ(image.step, 30U);
  ASSERT_EQ(image.data.size(), 600U);
  const auto pixel = [&](std::size_t column, std::size_t row) {
    return image.data[row * image.step + column];
  };
  EXPECT_LT(pixel(26, 17), 5);  // 2.5 mm above the lowest row of a picture that begins at the top
  EXPECT_EQ(pixel(26, 2), 255);
  EXPECT_EQ(pixel(2, 17), 255);

  const auto map = toOccupancyGrid(image, paper.pixelSize());
  EXPECT_EQ(map.header, image.header);
  EXPECT_EQ(map.info.width, 30U);
  EXPECT_EQ(map.info.height, 20U);
  EXPECT_FLOAT_EQ(map.info.resolution, 0.001F);
  EXPECT_EQ(map.info.origin.position.x, 0.0);
  EXPECT_EQ(map.info.origin.position.y, 0.0);
  EXPECT_EQ(map.info.origin.orientation.w, 1.0);
  ASSERT_EQ(map.data.size(), 600U);
  EXPECT_EQ(map.data[2 * 30 + 26], 100);  // row 0 of a map is the lowest
  EXPECT_EQ(map.data[17 * 30 + 26], 0);
}

TEST(Picture, GreysOfTheMapAreThoseOfTheImageInSteps) {
  sensor_msgs::Image image;
  image.width = 256;
  image.height = 1;
  image.step = 256;
  for (int grey = 0; grey < 256; ++grey) image.data.push_back(static_cast<std::uint8_t>(grey));
  const auto map = toOccupancyGrid(image, 0.001);
  EXPECT_EQ(map.data.front(), 100);
  EXPECT_EQ(map.data.back(), 0);
  for (std::size_t grey = 0; grey < 256; ++grey)
    EXPECT_NEAR(map.data[grey], 100.0 * (255.0 - static_cast<double>(grey)) / 255.0, 0.501) << grey;
}

TEST(Pose, IsBroughtToAnotherFrame) {
  HandlePose X_PF;
  X_PF.position = {0.5, 0.0, 0.0};
  X_PF.orientation = Eigen::AngleAxisd(std::acos(-1.0) / 2, Eigen::Vector3d::UnitZ());
  HandlePose pose;
  pose.stamp_ns = 7;
  pose.position = {0.1, 0.2, 0.3};
  const HandlePose moved = transformed(toTransformStamped(X_PF, "paper", "frame"), pose);
  EXPECT_EQ(moved.stamp_ns, 7);
  EXPECT_LT((moved.position - Eigen::Vector3d(0.3, 0.1, 0.3)).norm(), 1e-15);
  EXPECT_LT(moved.orientation.angularDistance(X_PF.orientation), 1e-15);
  pose.orientation.coeffs().setZero();
  EXPECT_EQ(transformed(toTransformStamped(X_PF, "paper", "frame"), pose).orientation.norm(), 0.0);
}

TEST(Parameters, ComeBackToTheBit) {
  SimulatorParameters parameters;
  parameters.brush.tip_length = 0.1 / 3;
  parameters.rods.scheme = "sdirk2";
  parameters.contact.paper = false;
  parameters.brush.rod_count = 77;
  const auto message = toParameterValues(parameters);
  const SimulatorParameters read = toSimulatorParameters(message);
  EXPECT_EQ(toParameterValues(read).values, message.values);
  EXPECT_EQ(read.brush.tip_length, parameters.brush.tip_length);
  EXPECT_EQ(read.rods.scheme, "sdirk2");
  EXPECT_FALSE(read.contact.paper);
  EXPECT_EQ(read.brush.rod_count, 77);
}

TEST(Parameters, EachWrongOneIsNamed) {
  ParameterValues message;
  message.names = {"brush/tip_length", "brush/colour", "brush/seed"};
  message.values = {"7", "red", "many"};
  try {
    toSimulatorParameters(message);
    FAIL() << "taken";
  } catch (const ParameterError& error) {
    EXPECT_EQ(error.problems().size(), 3U) << error.what();
  }
  message.values.pop_back();
  EXPECT_THROW(toSimulatorParameters(message), ParameterError);
}

TEST(Markers, ShowAllRodsAsOneListOfLines) {
  Simulator simulator = makeSimulator();
  HandlePose pose;
  pose.stamp_ns = 1;
  pose.position = {0.01, 0.01, 0.1};
  ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
  simulator.advance();

  const auto message = toMarkers(simulator, true, makeHeader());
  std::set<std::string> names;
  for (const auto& marker : message.markers) {
    EXPECT_EQ(marker.header, makeHeader());
    names.insert(marker.ns);
    if (marker.ns == "force" || marker.ns == "contacts") {  // none in the air
      EXPECT_EQ(marker.action, visualization_msgs::Marker::DELETE);
      continue;
    }
    EXPECT_EQ(marker.action, visualization_msgs::Marker::ADD);
    EXPECT_GT(marker.scale.x, 0.0);
    if (marker.ns == "rods") {
      EXPECT_EQ(marker.type, visualization_msgs::Marker::LINE_LIST);
      ASSERT_EQ(marker.points.size(), 5U * 3U * 2U);
      EXPECT_EQ(marker.colors.size(), marker.points.size());
      EXPECT_EQ(marker.points[0].x, simulator.nodePosition(0, 0).x());
      EXPECT_EQ(marker.points[1].z, simulator.nodePosition(0, 1).z());
      EXPECT_EQ(marker.points.back().y, simulator.nodePosition(4, 3).y());
    }
    if (marker.ns == "paper") {
      EXPECT_NEAR(marker.points[2].x, 0.03, 1e-12);
      EXPECT_NEAR(marker.points[2].y, 0.02, 1e-12);
    }
    if (marker.ns == "ferrule") {
      EXPECT_NEAR(marker.pose.position.z - 0.5 * marker.scale.z, 0.1, 1e-12);
    }
  }
  EXPECT_EQ(names, (std::set<std::string>{"contacts", "ferrule", "force", "paper", "rods", "shaft"}));
}

visualization_msgs::Marker findMarker(const Simulator& simulator, const std::string& name) {
  for (const auto& marker : toMarkers(simulator, true, makeHeader()).markers)
    if (marker.ns == name) return marker;
  ADD_FAILURE() << "no marker " << name;
  return {};
}

TEST(Markers, ColourEveryNodeByItsInk) {
  SimulatorParameters parameters = makeSimulator().parameters();
  parameters.ink.load = 0.5;  // fills the lower half
  Simulator simulator(parameters);
  const auto rods = findMarker(simulator, "rods");
  const auto brightness = [&](std::size_t end) {
    const auto& color = rods.colors[end];
    return color.r + color.g + color.b;
  };
  const std::size_t ends = 2 * (static_cast<std::size_t>(simulator.nodeCount()) - 1);
  for (std::size_t rod = 0; rod < 5; ++rod) {
    EXPECT_EQ(simulator.nodeInk(static_cast<int>(rod), 0), 0.0);
    EXPECT_EQ(simulator.nodeInk(static_cast<int>(rod), simulator.nodeCount() - 1), 1.0);
    EXPECT_GT(brightness(rod * ends), 1.5);
    EXPECT_LT(brightness(rod * ends + ends - 1), 0.2);
    for (std::size_t end = 1; end + 1 < ends; end += 2)  // of both lines at a node
      EXPECT_EQ(rods.colors[rod * ends + end], rods.colors[rod * ends + end + 1]);
  }
  simulator.wipe();
  for (const auto& color : findMarker(simulator, "rods").colors) EXPECT_EQ(color, rods.colors[0]);
}

TEST(Markers, ShowTheNodesOnTheSheet) {
  Simulator simulator = makeSimulator();
  HandlePose pose;
  for (int k = 0; k <= 200; ++k) {
    pose.stamp_ns = 1000000 * k + 1;
    pose.position = {0.01, 0.01, simulator.brush().tip_length + 0.001 - 2e-5 * k};
    simulator.addPose(pose);
  }
  simulator.advance();
  const auto contacts = findMarker(simulator, "contacts");
  EXPECT_EQ(contacts.type, visualization_msgs::Marker::POINTS);
  EXPECT_EQ(contacts.action, visualization_msgs::Marker::ADD);
  ASSERT_GT(simulator.report().touching_nodes, 0);
  EXPECT_EQ(contacts.points.size(), static_cast<std::size_t>(simulator.report().touching_nodes));
  for (const auto& point : contacts.points) EXPECT_NEAR(point.z, 0.0, 1e-4);
}

TEST(Markers, TheForceIsAnArrowAtTheEndOfTheShaft) {
  Simulator simulator = makeSimulator();
  HandlePose pose;
  pose.orientation = Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX());
  int pulls = 0, pushes = 0;
  // In the air the tuft's weight pulls it down; then it is pressed.
  for (int k = 0; k < 100; ++k) {
    pose.stamp_ns = 1 + k * 5'000'000LL;
    pose.position = {0.01, 0.01, 0.06 - 0.0004 * k};
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
    const Eigen::Vector3d force = simulator.handleWrench().force_P;
    const auto markers = toMarkers(simulator, true, makeHeader()).markers;
    const auto arrow =
        std::find_if(markers.begin(), markers.end(), [](const auto& m) { return m.ns == "force"; });
    ASSERT_NE(arrow, markers.end());
    if (4.0 * force.norm() < 0.0005) continue;
    ASSERT_EQ(arrow->points.size(), 2U);
    const auto toVector = [](const geometry_msgs::Point& p) { return Eigen::Vector3d(p.x, p.y, p.z); };
    const Eigen::Vector3d from = toVector(arrow->points[0]), to = toVector(arrow->points[1]);
    EXPECT_NEAR((to - from).norm(), std::min(0.15, 4.0 * force.norm()), 1e-12);
    EXPECT_NEAR((to - from).normalized().dot(force.normalized()), 1.0, 1e-12);
    const bool is_pull = force.dot(pose.orientation * Eigen::Vector3d::UnitZ()) >= 0.0;
    const Eigen::Vector3d end_H = pose.orientation.conjugate() * ((is_pull ? from : to) - pose.position);
    EXPECT_NEAR((end_H - Eigen::Vector3d(0, 0, 0.2)).norm(), 0.0, 1e-12);
    ++(is_pull ? pulls : pushes);
  }
  EXPECT_GT(pulls, 0);
  EXPECT_GT(pushes, 0);
}

TEST(Markers, WithoutAPoseOnlyTheSheetIsThere) {
  for (const auto& marker : toMarkers(makeSimulator(), false, makeHeader()).markers)
    EXPECT_EQ(marker.action, marker.ns == "paper" ? visualization_msgs::Marker::ADD
                                                  : visualization_msgs::Marker::DELETE);
}

}  // namespace
}  // namespace calligraphy_brush
