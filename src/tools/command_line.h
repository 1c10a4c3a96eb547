#pragma once

#include <boost/program_options.hpp>
#include <exception>
#include <filesystem>
#include <iostream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "calligraphy_brush/common/parameters.h"
#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/ros/brush_simulator_parameters.h"

/// What the command-line tools share.
namespace calligraphy_brush {

/// Parses arguments without the program's name. Short options are off, so that "-0.1" is a number.
inline boost::program_options::variables_map parseCommandLine(
    const std::vector<std::string>& arguments, const boost::program_options::options_description& all,
    const boost::program_options::positional_options_description& positional) {
  namespace po = boost::program_options;
  po::variables_map values;
  po::store(po::command_line_parser(arguments)
                .options(all)
                .positional(positional)
                .style(po::command_line_style::allow_long | po::command_line_style::long_allow_adjacent |
                       po::command_line_style::long_allow_next)
                .run(),
            values);
  po::notify(values);
  return values;
}

/// Throws std::runtime_error for a folder where a file is wanted.
inline void refuseFolder(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error))
    throw std::runtime_error(path + ": cannot be read: it is a folder");
}

/// Parameters of the simulator as brush_simulator_node has them with these presets.
inline BrushSimulatorParameters loadPresets(const std::string& brush, const std::string& paper) {
  BrushSimulatorParameters parameters;
  loadYamlParameters(findPreset("brushes", brush), parameters);
  loadYamlParameters(findPreset("papers", paper), parameters);
  return parameters;
}

/// Runs a tool: 0 if it returns, 1 with one line for each problem on stderr if it throws.
template <class Tool>
int runTool(const char* name, Tool&& tool) {
  try {
    tool();
    return 0;
  } catch (const ParameterError& error) {
    for (const std::string& problem : error.problems()) std::cerr << name << ": " << problem << "\n";
  } catch (const std::exception& error) {
    std::cerr << name << ": " << error.what() << "\n";
  }
  return 1;
}

}  // namespace calligraphy_brush
