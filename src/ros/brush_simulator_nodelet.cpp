#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

#include "calligraphy_brush/ros/brush_simulator.h"

namespace calligraphy_brush {

class BrushSimulatorNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      simulator_ = std::make_unique<BrushSimulator>(getNodeHandle(), getPrivateNodeHandle(), getName());
    } catch (const std::exception& error) {
      NODELET_FATAL_STREAM(getName() << " cannot start:\n" << error.what());
      throw;  // The manager catches it, and refuses to load this nodelet.
    }
  }

  std::unique_ptr<BrushSimulator> simulator_;
};

}  // namespace calligraphy_brush

PLUGINLIB_EXPORT_CLASS(calligraphy_brush::BrushSimulatorNodelet, nodelet::Nodelet)
