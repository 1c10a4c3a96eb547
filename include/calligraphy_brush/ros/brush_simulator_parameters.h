#pragma once

#include <string>

#include "calligraphy_brush/common/parameters.h"
#include "calligraphy_brush/sim/simulator_parameters.h"

namespace calligraphy_brush {

/// How the simulator meets the rest of a robot. Nothing here changes a stroke.
struct RosParameters {
  std::string paper_frame = "paper";
  std::string handle_source = "topic";
  std::string handle_frame = "brush_handle";
  double tf_timeout = 0.5;
  double max_ahead = 10.0;
  double clock_tolerance = 0.5;
  double image_rate = 15.0;
  double marker_rate = 30.0;
  double state_rate = 10.0;
  double wrench_rate = 0.0;
  std::string image_path = "stroke.png";

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("paper_frame", self.paper_frame, Choices{}, "1",
          "Frame of the sheet: poses are brought to it, results are given in it.");
    visit("handle_source", self.handle_source, Choices{"topic", "frame"}, "1",
          "Where the poses come from: the topic handle_pose, or tf's handle_frame.");
    visit("handle_frame", self.handle_frame, Choices{}, "1",
          "Frame of the handle: with handle_source topic it is broadcast at marker_rate, with "
          "handle_source frame it is what moves the brush.");
    visit("tf_timeout", self.tf_timeout, Range{0.0, 60.0}, "s",
          "How long a pose in another frame waits for its transform before it is refused.");
    visit("max_ahead", self.max_ahead, Range{0.1, 1e9}, "s",
          "A pose whose stamp is further ahead is refused: of this host's clock for the first one, "
          "then of the pose before plus the time since that came.");
    visit("clock_tolerance", self.clock_tolerance, Range{1e-3, 1e9}, "s",
          "A larger difference between arrival and stamp of the poses is warned of.");
    visit("image_rate", self.image_rate, Range{0.1, 1000.0}, "Hz",
          "At most so often are stroke_image and paper_map published.");
    visit("marker_rate", self.marker_rate, Range{0.1, 1000.0}, "Hz",
          "At most so often are tip_markers and the handle's frame published.");
    visit("state_rate", self.state_rate, Range{0.1, 1000.0}, "Hz",
          "How often brush_state is published.");
    visit("wrench_rate", self.wrench_rate, Range{0.0, 2000.0}, "Hz",
          "0 publishes one handle_wrench for each pose; else they come evenly at this rate, those of "
          "the steps between two poses spread over the time to the next, and go on during a hold.");
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
