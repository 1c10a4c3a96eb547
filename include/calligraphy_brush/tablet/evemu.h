#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "calligraphy_brush/tablet/tablet_description.h"

/// Recordings in the format of evemu (www.freedesktop.org/wiki/Evemu): lines N, I, P, B, A describe the
/// device, lines E are its events, what follows a # is a comment.
namespace calligraphy_brush {

struct TabletRecording {
  bool has_description = false;  ///< whether there is a line N
  TabletDescription description;
  std::vector<InputEvent> events;
};

/// Reads description, events, or both. Axes without a resolution, as old files have, get 0. Throws
/// std::runtime_error "path:line: ..." at the first line that is not in the format, and if the file
/// cannot be read.
TabletRecording readEvemu(const std::string& path);

/// Writes lines N to A.
void writeEvemuDescription(std::ostream& file, const TabletDescription& description);

/// Writes a line E, with microseconds: what the kernel gives.
void writeEvemuEvent(std::ostream& file, const InputEvent& event);

}  // namespace calligraphy_brush
