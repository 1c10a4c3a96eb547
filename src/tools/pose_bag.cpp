#include "pose_bag.h"

#include <calligraphy_brush/BrushEvent.h>
#include <calligraphy_brush/ParameterValues.h>
#include <geometry_msgs/PoseStamped.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sys/stat.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <cerrno>
#include <cstring>
#include <set>
#include <stdexcept>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/ros/conversions.h"

namespace calligraphy_brush {
namespace {

std::string withoutSlash(const std::string& name) {
  return !name.empty() && name.front() == '/' ? name.substr(1) : name;
}

/// First line of a message: what rosbag throws can have several.
std::string firstLine(const std::string& text) {
  return text.substr(0, text.find('\n'));
}

/// Name of the topic as the bag has it.
std::string findTopic(const std::string& path, const rosbag::Bag& bag, const std::string& topic) {
  rosbag::View everything(bag);
  std::map<std::string, std::string> types;
  for (const rosbag::ConnectionInfo* connection : everything.getConnections())
    types[connection->topic] = connection->datatype;
  std::string known;
  for (const auto& [name, type] : types) {
    if (withoutSlash(name) == withoutSlash(topic)) {
      if (type != ros::message_traits::datatype<geometry_msgs::PoseStamped>())
        throw std::runtime_error(path + ": topic " + name + " is of type " + type +
                                 ", not geometry_msgs/PoseStamped");
      return name;
    }
    known += (known.empty() ? "" : ", ") + name;
  }
  throw std::runtime_error(path + ": no topic " + topic + "; there is " +
                           (known.empty() ? "none" : known));
}

void readTransforms(const rosbag::Bag& bag, tf2::BufferCore& transforms) {
  rosbag::View view(bag, rosbag::TopicQuery(std::vector<std::string>{"/tf", "/tf_static"}));
  for (const rosbag::MessageInstance& message : view) {
    const auto tree = message.instantiate<tf2_msgs::TFMessage>();
    if (!tree) continue;
    for (const auto& transform : tree->transforms)
      transforms.setTransform(transform, "bag", message.getTopic() == "/tf_static");
  }
}

/// Events and parameters recorded beside the poses: same namespace, with or without a slash before.
void readEvents(const rosbag::Bag& bag, const std::string& pose_topic, PoseBag& read) {
  const std::string bare = withoutSlash(pose_topic);
  const std::string ns = bare.substr(0, bare.rfind('/') == std::string::npos ? 0 : bare.rfind('/') + 1);
  const auto topics = [&](const char* name) {
    return rosbag::TopicQuery(std::vector<std::string>{ns + name, "/" + ns + name});
  };
  rosbag::View poses(bag, rosbag::TopicQuery(pose_topic));
  for (const rosbag::MessageInstance& instance : rosbag::View(bag, topics("brush_events"))) {
    const auto event = instance.instantiate<BrushEvent>();
    if (!event) continue;
    read.events.push_back({toNanoseconds(event->header.stamp), event->kind});
    // The newest before the recording is told as well. A reset then comes after a pose that is not here.
    if (read.events.size() > 1 || event->kind != BrushEvent::RESET || poses.size() == 0) continue;
    const auto first = poses.begin();  // It owns what it points to.
    const auto first_pose = first->instantiate<geometry_msgs::PoseStamped>();
    if (first_pose && instance.getTime() < first->getTime() &&
        event->header.stamp != first_pose->header.stamp)
      read.events.front().stamp_ns = 0;
  }
  std::vector<ParameterValues> told;
  for (const rosbag::MessageInstance& instance : rosbag::View(bag, topics("brush_parameters")))
    if (const auto message = instance.instantiate<ParameterValues>()) told.push_back(*message);
  if (told.empty()) return;
  read.parameters = toSimulatorParameters(told.front());
  const auto is_other = [&](const ParameterValues& one, const ParameterValues& other) {
    return one.names != other.names || one.values != other.values;
  };

  // They are told at the start and again with each reset: from the last one backwards, the n-th message
  // belongs to the n-th reset.
  std::vector<std::size_t> resets;
  for (std::size_t k = 0; k < read.events.size(); ++k)
    if (read.events[k].kind == BrushEvent::RESET) resets.push_back(k);
  for (std::size_t back = 1; back < told.size(); ++back) {
    const ParameterValues& now = told[told.size() - back];
    if (!is_other(now, told[told.size() - back - 1])) continue;
    if (back > resets.size())
      read.parameters_changed = true;
    else
      read.later_parameters.emplace(resets[resets.size() - back], toSimulatorParameters(now));
  }
}

}  // namespace

void writePoseBag(const std::string& path, const std::vector<HandlePose>& poses,
                  const std::string& frame) {
  AtomicFile output(path);
  try {
    rosbag::Bag bag(output.temporaryPath(), rosbag::bagmode::Write);
    bag.setCompression(rosbag::compression::BZ2);
    std::uint32_t sequence = 0;
    for (const HandlePose& pose : poses) {
      geometry_msgs::PoseStamped message = toPoseStamped(pose, frame);
      message.header.seq = sequence++;
      bag.write("handle_pose", message.header.stamp, message);
    }
    bag.close();
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error("cannot write " + path + ": " + firstLine(error.what()));
  }
  output.commit();
}

PoseBag readPoseBag(const std::string& path, const std::string& topic, const std::string& paper_frame) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0)
    throw std::runtime_error("cannot read " + path + ": " + std::strerror(errno));
  if (!S_ISREG(status.st_mode)) throw std::runtime_error("cannot read " + path + ": not a regular file");
  PoseBag read;
  try {
    const rosbag::Bag bag(path, rosbag::bagmode::Read);
    const std::string pose_topic = findTopic(path, bag, topic);
    rosbag::View view(bag, rosbag::TopicQuery(pose_topic));
    readEvents(bag, pose_topic, read);
    tf2::BufferCore transforms(ros::Duration(1e9));
    readTransforms(bag, transforms);
    for (const rosbag::MessageInstance& instance : view) {
      const auto message = instance.instantiate<geometry_msgs::PoseStamped>();
      HandlePose pose = toHandlePose(*message);
      if (message->header.frame_id != paper_frame) {
        try {
          if (message->header.frame_id.empty()) throw tf2::LookupException("the pose names no frame");
          const auto X_PF =
              transforms.lookupTransform(paper_frame, message->header.frame_id, message->header.stamp);
          pose = transformed(X_PF, pose);
        } catch (const tf2::TransformException&) {
          ++read.unreachable["frame \"" + message->header.frame_id + "\" is not connected to \"" +
                             paper_frame + "\""];
          continue;
        }
      }
      read.poses.push_back(pose);
    }
  } catch (const ParameterError& error) {
    auto problems = error.problems();
    for (auto& problem : problems) problem.insert(0, path + ": ");
    throw ParameterError(problems);
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error(path + ": not a readable bag: " + firstLine(error.what()));
  }
  return read;
}

}  // namespace calligraphy_brush
