#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "calligraphy_brush/motion/pose_track.h"

namespace calligraphy_brush {

/// Writes poses as geometry_msgs/PoseStamped in `frame` on the topic handle_pose, the time of each
/// message being its stamp: equal poses give equal bytes. Whole or not at all. Throws std::runtime_error
/// with path and reason.
void writePoseBag(const std::string& path, const std::vector<HandlePose>& poses,
                  const std::string& frame);

/// Poses of a bag in the order of recording.
struct PoseBag {
  std::vector<HandlePose> poses;                     ///< in the paper frame
  std::map<std::string, std::uint64_t> unreachable;  ///< poses left out, by why their frame is not known
};

/// Reads the poses of a topic ("x" and "/x" are the same) and brings them to the paper frame with the
/// transforms on /tf and /tf_static of the same bag, as brush_simulator_node does live. Throws
/// std::runtime_error of one line: not a bag, no such topic (and which there are), another type.
PoseBag readPoseBag(const std::string& path, const std::string& topic, const std::string& paper_frame);

}  // namespace calligraphy_brush
