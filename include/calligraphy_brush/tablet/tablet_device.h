#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calligraphy_brush/tablet/tablet_description.h"

struct libevdev;

namespace calligraphy_brush {

/// A pen tablet of this machine, read through libevdev.
class TabletDevice {
 public:
  /// Opens it for reading. Its events are stamped by the kernel with CLOCK_REALTIME, which is ROS time.
  /// Throws std::runtime_error with path and reason; for missing rights, what gives them.
  TabletDevice(const std::string& path, bool grab);
  ~TabletDevice();
  TabletDevice(const TabletDevice&) = delete;
  TabletDevice& operator=(const TabletDevice&) = delete;

  const std::string& path() const { return path_; }
  const TabletDescription& description() const { return description_; }

  /// Waits up to timeout_ms for events and appends those that are there, in order. First of all come
  /// events that tell the state in which the tablet was opened. When the kernel had to drop events
  /// (SYN_DROPPED), libevdev asks for the state and what changed is appended as one report. False when
  /// the tablet is gone.
  bool read(std::vector<InputEvent>& events, int timeout_ms);

  /// How often the kernel dropped events because nobody read them in time.
  std::int64_t dropCount() const { return drop_count_; }

 private:
  void appendState(std::vector<InputEvent>& events) const;

  std::string path_;
  int file_ = -1;
  libevdev* device_ = nullptr;
  TabletDescription description_;
  bool told_state_ = false;
  bool is_syncing_ = false;
  std::int64_t drop_count_ = 0;
};

/// An input device that is a pen tablet.
struct FoundTablet {
  std::string path;
  TabletDescription description;
};

struct TabletSearch {
  std::vector<FoundTablet> tablets;     ///< in the order of their paths
  std::vector<std::string> unreadable;  ///< paths of input devices that may not be opened
};

/// All pen tablets in a folder of event devices, by what they can do.
TabletSearch findTablets(const std::string& folder = "/dev/input");

/// Path of the tablet meant: `wanted` is empty (the first), a path, a name, or a part of a name in any
/// case; a whole name comes before a part. Nothing if there is none (yet).
std::optional<std::string> chooseTablet(const TabletSearch& search, const std::string& wanted);

}  // namespace calligraphy_brush
