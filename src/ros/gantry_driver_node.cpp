#include <geometry_msgs/PoseStamped.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>

#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/ros/gantry.h"

// Stands for the controller of an arm: moves the joints of config/robots/gantry.urdf so that the brush
// goes through the poses on wanted_pose (paper frame).

int main(int argc, char** argv) {
  using namespace calligraphy_brush;
  ros::init(argc, argv, "gantry_driver");
  ros::NodeHandle node;
  constexpr std::uint32_t queue = 10000;
  ros::Publisher publisher = node.advertise<sensor_msgs::JointState>("joint_states", queue);
  const ros::Subscriber subscriber = node.subscribe<geometry_msgs::PoseStamped>(
      "wanted_pose", queue,
      [&](const geometry_msgs::PoseStampedConstPtr& message) {
        HandlePose pose = toHandlePose(*message);
        const double length = pose.orientation.norm();
        if (!pose.position.allFinite() || !std::isfinite(length) || length < 1e-3) {
          ROS_WARN_STREAM_THROTTLE(1.0,
                                   "gantry_driver: refused a pose that is not finite or has no "
                                   "orientation, stamp "
                                       << message->header.stamp);
          return;
        }
        pose.orientation.normalize();
        sensor_msgs::JointState joints;
        joints.header.stamp = message->header.stamp;
        joints.name.assign(kGantryJoints.begin(), kGantryJoints.end());
        const auto positions = gantryJoints(pose);
        joints.position.assign(positions.begin(), positions.end());
        publisher.publish(joints);
      },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  ros::spin();
}
