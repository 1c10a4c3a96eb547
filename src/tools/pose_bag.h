#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/sim/simulator_parameters.h"

namespace calligraphy_brush {

/// Writes poses as geometry_msgs/PoseStamped in `frame` on the topic handle_pose, the time of each
/// message being its stamp: equal poses give equal bytes. Whole or not at all. Throws std::runtime_error
/// with path and reason.
void writePoseBag(const std::string& path, const std::vector<HandlePose>& poses,
                  const std::string& frame);

/// Something done to brush or sheet: a kind of calligraphy_brush/BrushEvent, after the pose with the
/// stamp, or for 0 before the first one since the start or a reset.
struct RecordedEvent {
  std::int64_t stamp_ns = 0;
  std::uint8_t kind = 0;
};

/// Poses of a bag in the order of recording, and what record.launch records beside them.
struct PoseBag {
  std::vector<HandlePose> poses;                     ///< in the paper frame
  std::map<std::string, std::uint64_t> unreachable;  ///< poses left out, by why their frame is not known
  std::vector<RecordedEvent> events;                 ///< in their order; empty if none were recorded
  std::optional<SimulatorParameters> parameters;     ///< of the simulator that was recorded, at first
  /// Those that hold from an event on, by its place in `events`: a reset that took other ones.
  std::map<std::size_t, SimulatorParameters> later_parameters;
  bool parameters_changed = false;  ///< otherwise than by a reset: `parameters` are the first
};

/// Reads the poses of a topic ("x" and "/x" are the same) and brings them to the paper frame with the
/// transforms on /tf and /tf_static of the same bag, as brush_simulator_node does live. Events and
/// parameters are those of brush_events and brush_parameters beside the topic. Throws
/// std::runtime_error of one line: not a bag, no such topic (and which there are), another type.
PoseBag readPoseBag(const std::string& path, const std::string& topic, const std::string& paper_frame);

}  // namespace calligraphy_brush
