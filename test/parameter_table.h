#pragma once

#include <string>

#include "calligraphy_brush/ros/brush_simulator_parameters.h"

namespace calligraphy_brush {

/// The README's table of parameters, from the code.
inline std::string makeParameterTable() {
  std::string table = "| parameter | default | range | unit | meaning |\n|---|---|---|---|---|\n";
  for (const auto& row : listParameters(BrushSimulatorParameters())) {
    std::string range = row.range;
    for (std::size_t bar = range.find(" | "); bar != std::string::npos; bar = range.find(" | "))
      range.replace(bar, 3, ", ");
    table += "| `~" + row.name + "` | " + row.value + " | " + range + " | " + row.unit + " | " +
             row.description + " |\n";
  }
  return table;
}

}  // namespace calligraphy_brush
