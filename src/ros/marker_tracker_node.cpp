#include <geometry_msgs/PoseStamped.h>
#include <image_transport/image_transport.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/image_encodings.h>

#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/ros/ros_parameters.h"
#include "calligraphy_brush/vision/board_tracker.h"

// Pictures of a brush with markers on its shaft in, handle_pose out, in the camera's frame: tf knows
// where the camera is over the sheet.

namespace {

using namespace calligraphy_brush;

/// Grey bytes of a picture; nothing is copied if they are grey already.
const std::uint8_t* toGrey(const sensor_msgs::Image& image, std::vector<std::uint8_t>& buffer,
                           std::size_t& stride) {
  namespace encodings = sensor_msgs::image_encodings;
  const bool is_grey = image.encoding == encodings::MONO8;
  const bool is_bgr = image.encoding == encodings::BGR8 || image.encoding == encodings::BGRA8;
  const bool is_rgb = image.encoding == encodings::RGB8 || image.encoding == encodings::RGBA8;
  if (!is_grey && !is_bgr && !is_rgb)
    throw std::runtime_error("encoding " + image.encoding + " is not mono8, bgr8, rgb8, bgra8 or rgba8");
  const auto channels = static_cast<std::size_t>(encodings::numChannels(image.encoding));
  if (image.width == 0 || image.step < image.width * channels ||
      image.data.size() < static_cast<std::size_t>(image.step) * image.height)
    throw std::runtime_error("the picture has less bytes than its size needs");
  stride = image.step;
  if (is_grey) return image.data.data();
  stride = image.width;
  buffer.resize(stride * image.height);
  for (std::size_t row = 0; row < image.height; ++row)
    for (std::size_t column = 0; column < image.width; ++column) {
      const std::uint8_t* pixel = &image.data[row * image.step + channels * column];
      // Luma of ITU-R BT.601 in 1/1024.
      buffer[row * stride + column] = static_cast<std::uint8_t>(
          (306 * pixel[is_rgb ? 0 : 2] + 601 * pixel[1] + 117 * pixel[is_rgb ? 2 : 0] + 512) >> 10);
    }
  return buffer.data();
}

CameraModel toCameraModel(const sensor_msgs::CameraInfo& info) {
  CameraModel camera;
  camera.fx = info.K[0];
  camera.fy = info.K[4];
  camera.cx = info.K[2];
  camera.cy = info.K[5];
  camera.distortion = info.D;
  return camera;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "marker_tracker");
  ros::NodeHandle node;
  try {
    const ros::NodeHandle private_node("~");
    const auto parameters = readParameters<TrackerParameters>(private_node);
    const BoardTracker tracker(parameters);
    ros::Publisher publisher = node.advertise<geometry_msgs::PoseStamped>("handle_pose", 100);
    image_transport::ImageTransport transport(node);
    std::vector<std::uint8_t> buffer;
    const auto subscriber = transport.subscribeCamera(
        "image", 2,
        [&](const sensor_msgs::ImageConstPtr& image, const sensor_msgs::CameraInfoConstPtr& info) {
          try {
            if (info->width != image->width || info->height != image->height)
              throw std::runtime_error("camera_info is for another size of picture");
            std::size_t stride = 0;
            const std::uint8_t* grey = toGrey(*image, buffer, stride);
            std::string problem;
            const auto sighting =
                tracker.find(grey, static_cast<int>(image->width), static_cast<int>(image->height),
                             stride, toCameraModel(*info), problem);
            if (!sighting) {
              ROS_INFO_STREAM_THROTTLE(5.0, "marker_tracker: no pose: " << problem);
              return;
            }
            HandlePose pose;
            pose.stamp_ns = toNanoseconds(image->header.stamp);
            pose.position = sighting->X_CH.translation();
            pose.orientation = Eigen::Quaterniond(sighting->X_CH.linear()).normalized();
            publisher.publish(toPoseStamped(pose, image->header.frame_id));
          } catch (const std::exception& error) {
            ROS_WARN_STREAM_THROTTLE(1.0, "marker_tracker: refused a picture: " << error.what());
          }
        });
    ROS_INFO_STREAM("marker_tracker: " << makeBoard(parameters.board).size()
                                       << " markers, waiting for pictures on " << subscriber.getTopic());
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("marker_tracker cannot start:\n" << error.what());
    return 1;
  }
}
