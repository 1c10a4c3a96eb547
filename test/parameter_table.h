#pragma once

#include <string>

#include "calligraphy_brush/ros/brush_simulator_parameters.h"
#include "calligraphy_brush/ros/tablet_driver.h"

namespace calligraphy_brush {

/// A table of parameters, from the code.
template <class Parameters>
std::string makeTable() {
  std::string table = "| parameter | default | range | unit | meaning |\n|---|---|---|---|---|\n";
  for (const auto& row : listParameters(Parameters())) {
    std::string range = row.range;
    for (std::size_t bar = range.find(" | "); bar != std::string::npos; bar = range.find(" | "))
      range.replace(bar, 3, ", ");
    table += "| `~" + row.name + "` | " + row.value + " | " + range + " | " + row.unit + " | " +
             row.description + " |\n";
  }
  return table;
}

/// The README's table of parameters of brush_simulator_node.
inline std::string makeParameterTable() {
  return makeTable<BrushSimulatorParameters>();
}

/// The README's table of parameters of tablet_driver_node.
inline std::string makeTabletParameterTable() {
  return makeTable<TabletDriverOwnParameters>();
}

}  // namespace calligraphy_brush
