#include "calligraphy_brush/files/yaml_parameters.h"

#include <dlfcn.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;

class Flattener {
 public:
  Flattener(const std::string& file, std::vector<YamlEntry>& entries, std::vector<std::string>& problems)
      : file_(file), entries_(entries), problems_(problems) {}

  void flatten(const YAML::Node& map, const std::string& prefix) {
    for (const auto& pair : map) {
      if (!pair.first.IsScalar()) {
        report(pair.first, prefix + "?", "a key must be a name");
        continue;
      }
      const std::string key = prefix + pair.first.Scalar();
      if (pair.second.IsMap() && std::count(key.begin(), key.end(), '/') > 8) {
        report(pair.first, key, "is nested too deeply");  // as an alias of its own parent is
        return;
      }
      if (pair.second.IsMap()) {
        flatten(pair.second, key + "/");
      } else if (!pair.second.IsScalar()) {
        report(pair.first, key, pair.second.IsNull() ? "has no value" : "must be one value, not a list");
      } else if (!seen_.insert(key).second) {
        report(pair.first, key, "is given twice");
      } else {
        entries_.push_back({key, pair.second.Scalar(), pair.first.Mark().line + 1});
      }
    }
  }

 private:
  void report(const YAML::Node& at, const std::string& key, const std::string& what) {
    problems_.push_back(file_ + ":" + std::to_string(at.Mark().line + 1) + ": " + key + " " + what);
  }

  const std::string& file_;
  std::vector<YamlEntry>& entries_;
  std::vector<std::string>& problems_;
  std::set<std::string> seen_;
};

template <class Value>
bool convert(const std::string& text, Value& value) {
  return YAML::convert<Value>::decode(YAML::Node(text), value);
}

bool endsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// Folders named config that may hold presets, best first.
std::vector<fs::path> configFolders() {
  std::vector<fs::path> folders;
  if (const char* override_folder = std::getenv("CALLIGRAPHY_BRUSH_CONFIG"))
    folders.emplace_back(override_folder);

  std::vector<fs::path> programs;
  // In a nodelet the running program is the manager, somewhere else; the library with this code is
  // ours. For code in the program itself, dladdr knows only argv[0], which may be a bare name.
  Dl_info here{};
  if (dladdr(reinterpret_cast<const void*>(&findPreset), &here) != 0 && here.dli_fname != nullptr)
    programs.emplace_back(here.dli_fname);
  programs.emplace_back("/proc/self/exe");
  for (const fs::path& program : programs) {
    std::error_code error;
    fs::path folder = fs::canonical(program, error);
    if (error) continue;
    while (folder.has_relative_path()) {
      folder = folder.parent_path();
      folders.push_back(folder / "share" / "calligraphy_brush" / "config");
    }
  }
  return folders;
}

}  // namespace

std::vector<YamlEntry> readYamlEntries(const std::string& file, std::vector<std::string>& problems) {
  std::vector<YamlEntry> entries;
  try {
    const YAML::Node root = YAML::LoadFile(file);
    if (root.IsMap())
      Flattener(file, entries, problems).flatten(root, "");
    else if (!root.IsNull())
      problems.push_back(file + ":1: must be a map of parameters");
  } catch (const YAML::BadFile&) {
    throw ParameterError({file + ": cannot be read"});
  } catch (const YAML::Exception& error) {
    throw ParameterError({file + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg});
  }
  return entries;
}

bool parseYaml(const std::string& text, double& value) {
  return convert(text, value);
}
bool parseYaml(const std::string& text, int& value) {
  return convert(text, value);
}
bool parseYaml(const std::string& text, bool& value) {
  return convert(text, value);
}
bool parseYaml(const std::string& text, std::string& value) {
  value = text;
  return true;
}

std::map<std::string, std::string> findPresets(const std::string& kind) {
  std::map<std::string, std::string> presets;
  for (const fs::path& config : configFolders()) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(config / kind, error))
      if (entry.path().extension() == ".yaml" && entry.is_regular_file(error))
        presets.emplace(entry.path().stem().string(), entry.path().string());
  }
  return presets;
}

std::string findPreset(const std::string& kind, const std::string& name_or_file) {
  const bool is_file = name_or_file.find('/') != std::string::npos || endsWith(name_or_file, ".yaml") ||
                       endsWith(name_or_file, ".bag");
  if (is_file) {
    if (!fs::is_regular_file(name_or_file)) throw std::runtime_error(name_or_file + ": no such file");
    return name_or_file;
  }

  const auto known = findPresets(kind);
  if (const auto preset = known.find(name_or_file); preset != known.end()) return preset->second;
  std::string names;
  for (const auto& [name, file] : known) names += (names.empty() ? "" : ", ") + name;
  throw std::runtime_error(
      "no preset \"" + name_or_file + "\" in config/" + kind + "; known: " +
      (names.empty() ? "none (set CALLIGRAPHY_BRUSH_CONFIG to the folder config)" : names));
}

}  // namespace calligraphy_brush
