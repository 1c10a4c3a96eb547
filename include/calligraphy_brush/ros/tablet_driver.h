#pragma once

#include <calligraphy_brush/TabletSample.h>
#include <ros/ros.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calligraphy_brush/common/parameters.h"
#include "calligraphy_brush/ros/simulator_client.h"
#include "calligraphy_brush/sim/simulator_parameters.h"
#include "calligraphy_brush/tablet/evemu.h"
#include "calligraphy_brush/tablet/pen_mapping.h"
#include "calligraphy_brush/tablet/tablet_decoder.h"
#include "calligraphy_brush/tablet/tablet_parameters.h"

namespace calligraphy_brush {

/// How the tablet driver meets the rest of a robot.
struct TabletRosParameters {
  std::string paper_frame = "paper";
  double search_period = 0.5;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("paper_frame", self.paper_frame, Choices{}, "1",
          "Frame of the sheet, in which poses are given.");
    visit("search_period", self.search_period, Range{0.05, 60.0}, "s",
          "How often it looks for the tablet while there is none.");
  }
};

/// All parameters of tablet_driver_node: its own, and those of brush and sheet, as brush_simulator_node
/// has them and with the same presets.
struct TabletDriverParameters {
  TabletParameters tablet;
  TabletRosParameters ros;
  SimulatorParameters simulator;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    TabletParameters::describe(self.tablet, visit);
    visit.group("ros", self.ros);
    SimulatorParameters::describe(self.simulator, visit);
  }
};

/// Those of its own, as the README lists them.
struct TabletDriverOwnParameters {
  TabletParameters tablet;
  TabletRosParameters ros;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    TabletParameters::describe(self.tablet, visit);
    visit.group("ros", self.ros);
  }
};

/// Tip and sheet of these parameters. The sag is measured: the brush is held in the air, leaning by 45°,
/// for a second of simulated time, and what its lowest node sinks by is s L sin²(45°).
BrushOnSheet measureBrush(const SimulatorParameters& parameters);

/// The sample as a message; the frame is empty, what is missing NaN.
TabletSample toTabletSample(const PenSample& sample, std::int64_t stamp_ns);

/// What one event gave.
struct TabletReport {
  PenSample sample;
  PenActions actions;
};

/// Events of a tablet to poses: decoder and mapping in a row, for a device as for a recording.
class TabletReader {
 public:
  TabletReader(const TabletDescription& description, const TabletParameters& parameters,
               const BrushOnSheet& brush)
      : decoder_(description, parameters), mapping_(parameters, decoder_.size(), brush) {}

  /// Something for each report of the tablet.
  std::optional<TabletReport> take(const InputEvent& event) {
    const auto sample = decoder_.take(event);
    if (!sample) return std::nullopt;
    return TabletReport{*sample, mapping_.take(*sample)};
  }
  PenActions rest(std::int64_t now_ns) { return mapping_.rest(now_ns); }
  PenActions leave(std::int64_t stamp_ns) { return mapping_.leave(stamp_ns); }
  const TabletDecoder& decoder() const { return decoder_; }

 private:
  TabletDecoder decoder_;
  PenMapping mapping_;
};

/// Writes what a recording gives: handle_pose and tablet_sample. The messages are recorded at their
/// stamps; those of a recording whose clock begins at 0 are 1 s later, since a bag knows no time 0.
/// Returns the number of poses. Whole or not at all; throws std::runtime_error.
std::size_t writeTabletBag(const std::string& path, const TabletRecording& recording,
                           const TabletDriverParameters& parameters);

/// Publishes what a tablet or a recording gives.
class TabletDriver {
 public:
  /// Advertises; parameters must be legal.
  TabletDriver(ros::NodeHandle node, const TabletDriverParameters& parameters);

  /// Reads the tablet of the parameters until ROS ends: waits for it, and again whenever it is
  /// unplugged.
  void runDevice();

  /// Plays a recording, its first event being now, at `speed` times its own; 0: as fast as it goes.
  /// Waits for someone who listens to handle_pose. Stamps keep the recording's own intervals.
  void runRecording(const TabletRecording& recording, double speed);

 private:
  void publish(const PenActions& actions);
  void publish(const TabletReport& report);

  ros::NodeHandle node_;
  TabletDriverParameters parameters_;
  BrushOnSheet brush_;
  ros::Publisher pose_publisher_;
  ros::Publisher sample_publisher_;
  TaskThread services_;  // so that no pose waits for an answer
};

}  // namespace calligraphy_brush
