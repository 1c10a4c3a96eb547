#include <ros/ros.h>

#include <exception>

#include "calligraphy_brush/ros/brush_simulator.h"

int main(int argc, char** argv) {
  ros::init(argc, argv, "brush_simulator");
  const ros::NodeHandle node;  // As long as one lives, the console does too.
  try {
    const calligraphy_brush::BrushSimulator simulator(node, ros::NodeHandle("~"),
                                                      ros::this_node::getName());
    ros::spin();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(ros::this_node::getName() << " cannot start:\n" << error.what());
    return 1;
  }
}
