#pragma once

#include <string>

#include "calligraphy_brush/common/parameters.h"
#include "calligraphy_brush/sim/simulator_parameters.h"

namespace calligraphy_brush {

/// How the simulator meets the rest of a robot. Nothing here changes a stroke.
struct RosParameters {
  std::string paper_frame = "paper";
  std::string handle_frame = "brush_handle";
  double tf_timeout = 0.5;
  double image_rate = 15.0;
  double marker_rate = 30.0;
  double state_rate = 10.0;
  std::string image_path = "stroke.png";

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("paper_frame", self.paper_frame, Choices{}, "1",
          "Frame of the sheet: poses are brought to it, results are given in it.");
    visit("handle_frame", self.handle_frame, Choices{}, "1",
          "Frame of the handle, broadcast on tf at marker_rate.");
    visit("tf_timeout", self.tf_timeout, Range{0.0, 60.0}, "s",
          "How long a pose in another frame waits for its transform before it is refused.");
    visit("image_rate", self.image_rate, Range{0.1, 1000.0}, "Hz",
          "At most so often are stroke_image and paper_map published.");
    visit("marker_rate", self.marker_rate, Range{0.1, 1000.0}, "Hz",
          "At most so often are tip_markers and the handle's frame published.");
    visit("state_rate", self.state_rate, Range{0.1, 1000.0}, "Hz",
          "How often brush_state is published.");
    visit("image_path", self.image_path, Choices{}, "1",
          "Where ~save_image puts the PNG; relative to the node's working directory.");
  }
};

/// All parameters of brush_simulator_node and its nodelet.
struct BrushSimulatorParameters {
  SimulatorParameters simulator;
  RosParameters ros;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    SimulatorParameters::describe(self.simulator, visit);
    visit.group("ros", self.ros);
  }
};

}  // namespace calligraphy_brush
