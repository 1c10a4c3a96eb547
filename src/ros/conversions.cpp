#include "calligraphy_brush/ros/conversions.h"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iomanip>
#include <limits>
#include <map>
#include <sstream>
#include <vector>

#include "calligraphy_brush/files/yaml_parameters.h"

namespace calligraphy_brush {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1000000000;

// Sizes of what is only looked at [m].
constexpr double kLineWidth = 0.0003;
constexpr double kEdgeWidth = 0.0006;
constexpr double kContactSize = 0.0006;
constexpr double kFerruleLength = 0.02;
constexpr double kShaftLength = 0.18;
constexpr double kForceScale = 4.0;        // of the arrow [m/N]
constexpr double kLongestForce = 0.15;     // arrows end there
constexpr double kShortestForce = 0.0005;  // arrows begin there
constexpr double kForceWidth = 0.003;

geometry_msgs::Point toPoint(const Eigen::Vector3d& p) {
  geometry_msgs::Point point;
  point.x = p.x();
  point.y = p.y();
  point.z = p.z();
  return point;
}

geometry_msgs::Quaternion toQuaternion(const Eigen::Quaterniond& q) {
  geometry_msgs::Quaternion quaternion;
  quaternion.x = q.x();
  quaternion.y = q.y();
  quaternion.z = q.z();
  quaternion.w = q.w();
  return quaternion;
}

std_msgs::ColorRGBA makeColor(double red, double green, double blue) {
  std_msgs::ColorRGBA color;
  color.r = static_cast<float>(red);
  color.g = static_cast<float>(green);
  color.b = static_cast<float>(blue);
  color.a = 1.0F;
  return color;
}

visualization_msgs::Marker makeMarker(const std_msgs::Header& header, const std::string& name,
                                      int type) {
  visualization_msgs::Marker marker;
  marker.header = header;
  marker.ns = name;
  marker.type = type;
  marker.action = visualization_msgs::Marker::ADD;
  marker.pose.orientation.w = 1.0;
  return marker;
}

visualization_msgs::Marker makeSheetMarker(const Paper& paper, const std_msgs::Header& header) {
  auto marker = makeMarker(header, "paper", visualization_msgs::Marker::LINE_STRIP);
  const double width = paper.width_px() * paper.pixelSize();
  const double height = paper.height_px() * paper.pixelSize();
  for (const Eigen::Vector3d& corner :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(width, 0, 0), Eigen::Vector3d(width, height, 0),
        Eigen::Vector3d(0, height, 0), Eigen::Vector3d(0, 0, 0)})
    marker.points.push_back(toPoint(corner));
  marker.scale.x = kEdgeWidth;
  marker.color = makeColor(0.35, 0.3, 0.25);
  return marker;
}

visualization_msgs::Marker makeRodsMarker(const Simulator& simulator, const std_msgs::Header& header) {
  auto marker = makeMarker(header, "rods", visualization_msgs::Marker::LINE_LIST);
  const int rods = simulator.rodCount();
  const int nodes = simulator.nodeCount();
  const auto ends = 2 * static_cast<std::size_t>(rods) * static_cast<std::size_t>(nodes - 1);
  marker.points.reserve(ends);
  marker.colors.reserve(ends);
  for (int rod = 0; rod < rods; ++rod)
    for (int node = 0; node < nodes; ++node) {
      const geometry_msgs::Point point = toPoint(simulator.nodePosition(rod, node));
      const double dry = 1.0 - std::clamp(simulator.nodeInk(rod, node), 0.0, 1.0);
      const auto color = makeColor(0.04 + 0.76 * dry, 0.04 + 0.61 * dry, 0.06 + 0.39 * dry);
      // An inner node ends a line and begins the next.
      for (int line = 0; line < (node == 0 || node == nodes - 1 ? 1 : 2); ++line) {
        marker.points.push_back(point);
        marker.colors.push_back(color);
      }
    }
  marker.scale.x = kLineWidth;
  return marker;
}

/// Deleted where there are none: rviz takes points without a point for a mistake.
visualization_msgs::Marker makeContactsMarker(const Simulator& simulator,
                                              const std_msgs::Header& header) {
  auto marker = makeMarker(header, "contacts", visualization_msgs::Marker::POINTS);
  if (simulator.report().touching_nodes > 0)
    for (int rod = 0; rod < simulator.rodCount(); ++rod)
      for (int node = 0; node < simulator.nodeCount(); ++node)
        if (simulator.nodeTouches(rod, node))
          marker.points.push_back(toPoint(simulator.nodePosition(rod, node)));
  // Else the sheet hides half of each.
  marker.pose.position.z = 0.5 * kContactSize;
  if (marker.points.empty()) marker.action = visualization_msgs::Marker::DELETE;
  marker.scale.x = marker.scale.y = kContactSize;
  marker.color = makeColor(0.9, 0.15, 0.1);
  return marker;
}

/// A cylinder on the axis of the handle, from `bottom` to `bottom + length` above its origin [m].
visualization_msgs::Marker makeShaftMarker(const HandlePose& handle, double bottom, double length,
                                           double diameter, const std::string& name,
                                           const std_msgs::Header& header) {
  auto marker = makeMarker(header, name, visualization_msgs::Marker::CYLINDER);
  const Eigen::Vector3d middle_H(0.0, 0.0, bottom + 0.5 * length);
  marker.pose.position = toPoint(handle.position + handle.orientation * middle_H);
  marker.pose.orientation = toQuaternion(handle.orientation);
  marker.scale.x = marker.scale.y = diameter;
  marker.scale.z = length;
  return marker;
}

/// Force of the sheet on the handle, from the upper end of the shaft: at the tuft the brush would hide
/// it.
visualization_msgs::Marker makeForceMarker(const HandlePose& handle, const Eigen::Vector3d& force_P,
                                           const std_msgs::Header& header) {
  auto marker = makeMarker(header, "force", visualization_msgs::Marker::ARROW);
  const double length = std::min(kForceScale * force_P.norm(), kLongestForce);
  if (!(length >= kShortestForce)) {
    marker.action = visualization_msgs::Marker::DELETE;
    return marker;
  }
  const Eigen::Vector3d end_H(0.0, 0.0, kFerruleLength + kShaftLength);
  const Eigen::Vector3d end = handle.position + handle.orientation * end_H;
  const Eigen::Vector3d way = length * force_P.normalized();
  const bool pulls = way.dot(handle.orientation * Eigen::Vector3d::UnitZ()) >= 0.0;
  marker.points = {toPoint(pulls ? end : end - way), toPoint(pulls ? end + way : end)};
  marker.scale.x = kForceWidth;
  marker.scale.y = 3.0 * kForceWidth;
  marker.scale.z = std::min(6.0 * kForceWidth, 0.5 * length);
  marker.color = makeColor(0.8, 0.15, 0.1);
  return marker;
}

double rootDiameter(const BrushModel& brush) {
  double radius = 0.0;
  for (const RodModel& rod : brush.rods)
    radius = std::max(radius, std::hypot(rod.root_H.x(), rod.root_H.y()) + rod.node_radius.front());
  return 2.0 * std::max(radius, 0.001);
}

}  // namespace

std::int64_t toNanoseconds(const ros::Time& time) {
  return static_cast<std::int64_t>(time.sec) * kNanosecondsPerSecond +
         static_cast<std::int64_t>(time.nsec);
}

ros::Time toRosTime(std::int64_t stamp_ns) {
  constexpr std::int64_t last_second = std::numeric_limits<std::uint32_t>::max();
  const std::int64_t clamped = std::clamp<std::int64_t>(
      stamp_ns, 0, last_second * kNanosecondsPerSecond + kNanosecondsPerSecond - 1);
  return ros::Time(static_cast<std::uint32_t>(clamped / kNanosecondsPerSecond),
                   static_cast<std::uint32_t>(clamped % kNanosecondsPerSecond));
}

HandlePose toHandlePose(const geometry_msgs::PoseStamped& message) {
  HandlePose pose;
  pose.stamp_ns = toNanoseconds(message.header.stamp);
  const auto& p = message.pose.position;
  const auto& q = message.pose.orientation;
  pose.position = {p.x, p.y, p.z};
  pose.orientation = Eigen::Quaterniond(q.w, q.x, q.y, q.z);
  return pose;
}

geometry_msgs::PoseStamped toPoseStamped(const HandlePose& pose, const std::string& frame) {
  geometry_msgs::PoseStamped message;
  message.header.stamp = toRosTime(pose.stamp_ns);
  message.header.frame_id = frame;
  message.pose.position = toPoint(pose.position);
  message.pose.orientation = toQuaternion(pose.orientation);
  return message;
}

HandlePose transformed(const geometry_msgs::TransformStamped& X_PF, const HandlePose& pose_F) {
  const HandlePose frame = toHandlePose(X_PF);
  HandlePose pose = pose_F;
  pose.position = frame.orientation * pose_F.position + frame.position;
  pose.orientation = frame.orientation * pose_F.orientation;
  return pose;
}

HandlePose toHandlePose(const geometry_msgs::TransformStamped& X_PH) {
  HandlePose pose;
  pose.stamp_ns = toNanoseconds(X_PH.header.stamp);
  const auto& p = X_PH.transform.translation;
  const auto& q = X_PH.transform.rotation;
  pose.position = {p.x, p.y, p.z};
  pose.orientation = Eigen::Quaterniond(q.w, q.x, q.y, q.z);
  return pose;
}

geometry_msgs::TransformStamped toTransformStamped(const HandlePose& pose,
                                                   const std::string& paper_frame,
                                                   const std::string& handle_frame) {
  geometry_msgs::TransformStamped message;
  message.header.stamp = toRosTime(pose.stamp_ns);
  message.header.frame_id = paper_frame;
  message.child_frame_id = handle_frame;
  message.transform.translation.x = pose.position.x();
  message.transform.translation.y = pose.position.y();
  message.transform.translation.z = pose.position.z();
  message.transform.rotation = toQuaternion(pose.orientation);
  return message;
}

ParameterValues toParameterValues(const SimulatorParameters& parameters) {
  ParameterValues message;
  visitParameters(parameters, [&](const std::string& name, const auto& field, const auto&, const char*,
                                  const char*) {
    std::ostringstream text;
    text << std::boolalpha << std::setprecision(std::numeric_limits<double>::max_digits10) << field;
    message.names.push_back(name);
    message.values.push_back(text.str());
  });
  return message;
}

SimulatorParameters toSimulatorParameters(const ParameterValues& message) {
  std::vector<std::string> problems;
  if (message.names.size() != message.values.size())
    throw ParameterError({std::to_string(message.names.size()) + " names of parameters and " +
                          std::to_string(message.values.size()) + " values"});
  std::map<std::string, std::string> texts;
  for (std::size_t k = 0; k < message.names.size(); ++k) texts[message.names[k]] = message.values[k];
  SimulatorParameters parameters;
  visitParameters(parameters, [&](const std::string& name, auto& field, const auto& legal, const char*,
                                  const char*) {
    const auto text = texts.find(name);
    if (text == texts.end()) return;
    if (!parseYaml(text->second, field))
      problems.push_back(name + " = " + text->second + " is not a value, legal are " +
                         parameters_detail::rangeText(legal));
    texts.erase(text);
  });
  for (const auto& [name, text] : texts)
    problems.push_back(name + " = " + text + " is not a known parameter");
  const auto out_of_range = findParameterProblems(parameters);
  problems.insert(problems.end(), out_of_range.begin(), out_of_range.end());
  if (!problems.empty()) throw ParameterError(problems);
  return parameters;
}

geometry_msgs::WrenchStamped toWrenchStamped(const HandleWrench& wrench,
                                             const std_msgs::Header& header) {
  geometry_msgs::WrenchStamped message;
  message.header = header;
  message.wrench.force.x = wrench.force_P.x();
  message.wrench.force.y = wrench.force_P.y();
  message.wrench.force.z = wrench.force_P.z();
  message.wrench.torque.x = wrench.torque_P.x();
  message.wrench.torque.y = wrench.torque_P.y();
  message.wrench.torque.z = wrench.torque_P.z();
  return message;
}

sensor_msgs::Image toImage(const Paper& paper, const std_msgs::Header& header) {
  sensor_msgs::Image image;
  image.header = header;
  image.width = static_cast<std::uint32_t>(paper.width_px());
  image.height = static_cast<std::uint32_t>(paper.height_px());
  image.encoding = sensor_msgs::image_encodings::MONO8;
  image.step = image.width;
  paper.render(image.data);
  return image;
}

nav_msgs::OccupancyGrid toOccupancyGrid(const sensor_msgs::Image& picture, double pixel_size) {
  nav_msgs::OccupancyGrid map;
  map.header = picture.header;
  map.info.map_load_time = picture.header.stamp;
  map.info.resolution = static_cast<float>(pixel_size);
  map.info.width = picture.width;
  map.info.height = picture.height;
  map.info.origin.orientation.w = 1.0;
  map.data.resize(static_cast<std::size_t>(picture.width) * picture.height);
  auto cell = map.data.begin();
  for (std::size_t row = picture.height; row-- > 0;) {
    const std::uint8_t* grey = picture.data.data() + row * picture.step;
    // 255 greys divide into 100 with rounding: (100 d + 127) / 255.
    cell = std::transform(grey, grey + picture.width, cell, [](std::uint8_t value) {
      return static_cast<std::int8_t>((100 * (255 - value) + 127) / 255);
    });
  }
  return map;
}

visualization_msgs::MarkerArray toMarkers(const Simulator& simulator, bool with_brush,
                                          const std_msgs::Header& header) {
  visualization_msgs::MarkerArray message;
  message.markers.push_back(makeSheetMarker(simulator.paper(), header));
  if (!with_brush) {
    for (const char* name : {"rods", "contacts", "ferrule", "shaft", "force"}) {
      message.markers.push_back(makeMarker(header, name, visualization_msgs::Marker::CYLINDER));
      message.markers.back().action = visualization_msgs::Marker::DELETE;
    }
    return message;
  }
  message.markers.push_back(makeRodsMarker(simulator, header));
  message.markers.push_back(makeContactsMarker(simulator, header));
  const HandlePose handle = simulator.handlePose();
  const double diameter = 1.1 * rootDiameter(simulator.brush());
  message.markers.push_back(makeShaftMarker(handle, 0.0, kFerruleLength, diameter, "ferrule", header));
  message.markers.back().color = makeColor(0.25, 0.2, 0.18);
  message.markers.push_back(
      makeShaftMarker(handle, kFerruleLength, kShaftLength, 0.8 * diameter, "shaft", header));
  message.markers.back().color = makeColor(0.72, 0.58, 0.36);
  message.markers.push_back(makeForceMarker(handle, simulator.handleWrench().force_P, header));
  return message;
}

}  // namespace calligraphy_brush
