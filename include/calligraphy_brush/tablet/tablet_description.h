#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>

namespace calligraphy_brush {

/// One event of the kernel's input layer (linux/input.h). Codes are those of linux/input-event-codes.h.
struct InputEvent {
  std::int64_t stamp_ns = 0;
  std::uint16_t type = 0;
  std::uint16_t code = 0;
  std::int32_t value = 0;
};

/// An absolute axis, in units of the device.
struct TabletAxis {
  int minimum = 0;
  int maximum = 0;
  int fuzz = 0;
  int flat = 0;
  int resolution = 0;  ///< units per mm, per rad for tilt; 0 where the device does not say

  /// 0 at minimum, 1 at maximum; clamped. 0 for an axis without extent.
  double part(int value) const;
};

/// What a device says about itself.
struct TabletDescription {
  std::string name;
  std::uint16_t bus = 0;
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::uint16_t version = 0;
  std::set<std::uint16_t> properties;                      ///< INPUT_PROP_...
  std::map<std::uint16_t, std::set<std::uint16_t>> codes;  ///< event codes by event type
  std::map<std::uint16_t, TabletAxis> axes;                ///< by ABS_... code

  bool has(std::uint16_t type, std::uint16_t code) const;
};

/// Whether it is a pen tablet: x, y and a pen, its button, or a touch with pressure; not a touchscreen
/// (multitouch axes), a touchpad (fingers only) or the pad of buttons beside a tablet.
bool isPenTablet(const TabletDescription& description);

}  // namespace calligraphy_brush
