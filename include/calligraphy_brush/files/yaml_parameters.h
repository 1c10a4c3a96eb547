#pragma once

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// One scalar of a YAML file: groups joined to its key by '/', its text, and the line it is on.
struct YamlEntry {
  std::string key;
  std::string text;
  int line = 0;  ///< from 1
};

/// All scalars of a file, in its order; `problems` has a line for everything that is not a scalar
/// under a map (lists, empty values) and for keys given twice. Throws ParameterError if the file
/// cannot be read or is not YAML.
std::vector<YamlEntry> readYamlEntries(const std::string& file, std::vector<std::string>& problems);

/// Text to value as YAML 1.2 has it. Returns false, and leaves the value, if the text is something else.
bool parseYaml(const std::string& text, double& value);
bool parseYaml(const std::string& text, int& value);
bool parseYaml(const std::string& text, bool& value);
bool parseYaml(const std::string& text, std::string& value);

/// Sets the fields of a parameter struct that a YAML file names and leaves the others.
///
/// A key is a field's full name; groups are nested maps or are joined by '/': `brush: {seed: 2}` is
/// `brush/seed: 2`. Throws one ParameterError that lists all problems, each with file, line and full
/// key: unknown keys, values of the wrong type, values out of range (with range and unit). Then
/// `parameters` is as it was.
template <class Parameters>
void loadYamlParameters(const std::string& file, Parameters& parameters) {
  using namespace parameters_detail;
  std::vector<std::string> problems;
  std::vector<YamlEntry> entries = readYamlEntries(file, problems);
  const auto report = [&](const YamlEntry& entry, const std::string& what) {
    problems.push_back(file + ":" + std::to_string(entry.line) + ": " + entry.key + what);
  };

  Parameters loaded = parameters;
  visitParameters(loaded, [&](const std::string& name, auto& field, const auto& legal, const char* unit,
                              const char*) {
    const auto entry =
        std::find_if(entries.begin(), entries.end(), [&](const YamlEntry& e) { return e.key == name; });
    if (entry == entries.end()) return;
    using Field = std::decay_t<decltype(field)>;
    const std::string unit_text = std::string(unit) == "1" ? "" : " " + std::string(unit);
    if (!parseYaml(entry->text, field)) {
      const std::string type = std::is_same_v<Field, double> ? "a number in "
                               : std::is_same_v<Field, int>  ? "a whole number in "
                                                             : "one of ";
      report(*entry, " = " + entry->text + " is not " + type + rangeText(legal) + unit_text);
    } else if constexpr (!std::is_same_v<Field, bool>) {
      if (!isLegal(field, legal))
        report(*entry, " = " + entry->text + " is outside " + rangeText(legal) + unit_text);
    }
    entries.erase(entry);
  });
  for (const YamlEntry& entry : entries) report(entry, " is not a parameter");

  if (!problems.empty()) throw ParameterError(problems);
  parameters = std::move(loaded);
}

/// Files of all presets of a kind, by name. They are looked for where findPreset does; of a name that is
/// in several folders the first counts. Empty if there are none.
std::map<std::string, std::string> findPresets(const std::string& kind);

/// Path of a preset. `kind` is a folder of presets: "brushes", "papers", "tablets", "strokes".
///
/// Text with a '/' or that ends in ".yaml" or ".bag" is a file and returned as it is. Any other text
/// is the NAME of config/<kind>/<NAME>.yaml. The folder `config` is looked for in
/// $CALLIGRAPHY_BRUSH_CONFIG, then as share/calligraphy_brush/config in the folders above this
/// library and above the running program: that finds an installed package as well as catkin's devel
/// space, wherever they were moved, and asks no ROS master.
/// Throws std::runtime_error that lists the known names if there is no such preset or file.
std::string findPreset(const std::string& kind, const std::string& name_or_file);

}  // namespace calligraphy_brush
