#include "calligraphy_brush/tablet/tablet_description.h"

#include <linux/input-event-codes.h>

#include <algorithm>

namespace calligraphy_brush {

double TabletAxis::part(int value) const {
  if (maximum <= minimum) return 0.0;
  const double extent = static_cast<double>(maximum) - minimum;
  return std::clamp((static_cast<double>(value) - minimum) / extent, 0.0, 1.0);
}

bool TabletDescription::has(std::uint16_t type, std::uint16_t code) const {
  const auto found = codes.find(type);
  return found != codes.end() && found->second.count(code) != 0;
}

bool isPenTablet(const TabletDescription& d) {
  for (const std::uint16_t axis : {std::uint16_t{ABS_X}, std::uint16_t{ABS_Y}}) {
    const auto found = d.axes.find(axis);
    if (found == d.axes.end() || found->second.maximum <= found->second.minimum) return false;
  }
  if (d.has(EV_KEY, BTN_TOOL_PEN) || d.has(EV_KEY, BTN_STYLUS)) return true;
  // Some pens have no tool: then only pressure tells them from a mouse or a finger.
  return d.has(EV_KEY, BTN_TOUCH) && d.axes.count(ABS_PRESSURE) != 0 &&
         d.axes.count(ABS_MT_POSITION_X) == 0 && !d.has(EV_KEY, BTN_TOOL_FINGER);
}

}  // namespace calligraphy_brush
