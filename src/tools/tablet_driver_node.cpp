#include <ros/ros.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/ros/ros_parameters.h"
#include "calligraphy_brush/ros/tablet_driver.h"
#include "calligraphy_brush/tablet/evemu.h"
#include "calligraphy_brush/tablet/tablet_device.h"
#include "command_line.h"

// A pen tablet, or a recording of one, as the handle of the brush.

namespace {

namespace po = boost::program_options;
using namespace calligraphy_brush;

struct Arguments {
  bool list = false;
  std::string device, recording, description, bag, record;
  std::string tablet, brush, paper;
  double speed = 1.0;
};

volatile std::sig_atomic_t is_interrupted = 0;

void listTablets() {
  const TabletSearch search = findTablets();
  for (const FoundTablet& tablet : search.tablets) {
    const TabletSize size = findTabletSize(tablet.description, TabletDeviceParameters());
    std::printf("%s: %s", tablet.path.c_str(), tablet.description.name.c_str());
    if (size.is_known) std::printf(", %.0f x %.0f mm", 1e3 * size.width, 1e3 * size.height);
    std::printf("\n");
  }
  if (search.tablets.empty()) std::printf("no pen tablet\n");
  if (!search.unreadable.empty())
    std::printf(
        "%zu devices may not be read, %s for one; sudo usermod -aG input $USER gives the right from the "
        "next login on\n",
        search.unreadable.size(), search.unreadable.front().c_str());
}

TabletRecording readRecording(const Arguments& arguments) {
  TabletRecording recording = readEvemu(arguments.recording);
  if (!arguments.description.empty()) {
    const TabletRecording other = readEvemu(arguments.description);
    if (!other.has_description)
      throw std::runtime_error(arguments.description + ": describes no device (line N)");
    recording.description = other.description;
  } else if (!recording.has_description) {
    throw std::runtime_error(arguments.recording +
                             ": describes no device (line N); give a file that does with --description");
  }
  if (recording.events.empty()) throw std::runtime_error(arguments.recording + ": no events (line E)");
  return recording;
}

/// Writes what a tablet sends until ctrl-C or until it is gone.
void record(const Arguments& arguments, const TabletDeviceParameters& wanted) {
  const TabletSearch search = findTablets();
  const auto path = chooseTablet(search, wanted.name);
  if (!path)
    throw std::runtime_error(wanted.name.empty() ? "no pen tablet (see --list)"
                                                 : "no pen tablet \"" + wanted.name + "\" (see --list)");
  TabletDevice device(*path, wanted.grab);
  AtomicFile output(arguments.record);
  std::ofstream file(output.temporaryPath());
  writeEvemuDescription(file, device.description());
  std::signal(SIGINT, [](int) { is_interrupted = 1; });
  std::signal(SIGTERM, [](int) { is_interrupted = 1; });
  std::fprintf(stderr, "recording %s (%s) until ctrl-C\n", path->c_str(),
               device.description().name.c_str());
  std::vector<InputEvent> events;
  std::size_t count = 0;
  for (bool is_there = true; is_there && is_interrupted == 0;) {
    events.clear();
    is_there = device.read(events, 100);
    for (const InputEvent& event : events) writeEvemuEvent(file, event);
    count += events.size();
  }
  file.close();
  if (!file) throw std::runtime_error("cannot write " + arguments.record);
  output.commit();
  std::printf("%s: %zu events\n", arguments.record.c_str(), count);
}

TabletDriverParameters loadParameters(const Arguments& arguments) {
  TabletDriverParameters parameters;
  loadYamlParameters(findPreset("tablets", arguments.tablet), parameters);
  const BrushSimulatorParameters presets = loadPresets(arguments.brush, arguments.paper);
  parameters.simulator = presets.simulator;
  if (!arguments.device.empty()) parameters.tablet.device.name = arguments.device;
  return parameters;
}

void drive(const Arguments& arguments, int argc, char** argv) {
  ros::init(argc, argv, "tablet_driver");
  const ros::NodeHandle node;
  try {
    auto parameters = readParameters<TabletDriverParameters>(ros::NodeHandle("~"));
    if (!arguments.device.empty()) parameters.tablet.device.name = arguments.device;
    TabletDriver driver(node, parameters);
    if (arguments.recording.empty())
      driver.runDevice();
    else
      driver.runRecording(readRecording(arguments), arguments.speed);
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(ros::this_node::getName() << " ends:\n" << error.what());
    throw;
  }
}

void run(int argc, char** argv) {
  Arguments arguments;
  po::options_description options("Options");
  const auto text = [](std::string* place, const char* name) {
    return po::value(place)->value_name(name);
  };
  options.add_options()("help", "show this and exit");
  options.add_options()("list", po::bool_switch(&arguments.list), "show the pen tablets and exit");
  options.add_options()("device", text(&arguments.device, "NAME|PATH"),
                        "tablet to read, instead of ~device/name");
  options.add_options()("record", text(&arguments.record, "FILE"),
                        "write what the tablet sends to an evemu file until ctrl-C; no master");
  options.add_options()("recording", text(&arguments.recording, "FILE"),
                        "play an evemu file instead of a tablet");
  options.add_options()("description", text(&arguments.description, "FILE"),
                        "evemu file with the tablet's description, for recordings of events only");
  options.add_options()("speed", po::value(&arguments.speed)->default_value(1.0)->value_name("N"),
                        "of the recording over its own; 0: at once");
  options.add_options()("bag", text(&arguments.bag, "FILE"),
                        "write what the recording gives to a bag, at once; no master");
  po::options_description presets("With --bag and --record, which ask no parameter server");
  presets.add_options()("tablet",
                        po::value(&arguments.tablet)->default_value("default")->value_name("NAME|FILE"),
                        "preset in config/tablets, or a YAML file");
  presets.add_options()("brush",
                        po::value(&arguments.brush)->default_value("medium")->value_name("NAME|FILE"),
                        "preset in config/brushes, or a YAML file");
  presets.add_options()("paper",
                        po::value(&arguments.paper)->default_value("plain")->value_name("NAME|FILE"),
                        "preset in config/papers, or a YAML file");
  po::options_description all;
  all.add(options).add(presets);

  // What is for ROS (name:=value) is not for us.
  std::vector<std::string> words;
  ros::removeROSArgs(argc, argv, words);
  words.erase(words.begin());
  parseCommandLine(words, all, po::positional_options_description());
  if (std::find(words.begin(), words.end(), "--help") != words.end()) {
    std::cout << "Usage: tablet_driver_node [options]\n"
                 "A pen tablet, or a recording of one, as the handle of the brush.\n\n"
              << all;
    return;
  }
  const auto needs = [](bool is_so, const char* what) {
    if (!is_so) throw std::runtime_error(std::string(what) + " (see --help)");
  };
  needs(arguments.bag.empty() || !arguments.recording.empty(), "--bag needs --recording");
  needs(arguments.record.empty() || arguments.recording.empty(), "either --record or --recording");
  needs(arguments.description.empty() || !arguments.recording.empty(),
        "--description needs --recording");
  needs(arguments.speed >= 0.0 && arguments.speed <= 1000.0, "--speed must be in [0, 1000]");

  if (arguments.list) return listTablets();
  if (!arguments.record.empty()) return record(arguments, loadParameters(arguments).tablet.device);
  if (!arguments.bag.empty()) {
    const std::size_t count =
        writeTabletBag(arguments.bag, readRecording(arguments), loadParameters(arguments));
    std::printf("%s: %zu poses\n", arguments.bag.c_str(), count);
    return;
  }
  drive(arguments, argc, argv);
}

}  // namespace

int main(int argc, char** argv) {
  return runTool("tablet_driver_node", [&] { run(argc, argv); });
}
