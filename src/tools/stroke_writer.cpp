#include <geometry_msgs/PoseStamped.h>
#include <ros/ros.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/files/glyph.h"
#include "calligraphy_brush/files/stroke_file.h"
#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/writing/brush_curve.h"
#include "calligraphy_brush/writing/correction.h"
#include "calligraphy_brush/writing/trajectory.h"
#include "command_line.h"
#include "pose_bag.h"

// Strokes in, timed poses of the brush handle out: into a bag, or to a robot on the topic handle_pose.

namespace {

namespace po = boost::program_options;
using namespace calligraphy_brush;

struct Arguments {
  std::string strokes, glyph, bag;
  std::string brush, paper;
  double size = 0.06;
  std::vector<double> origin;
  StrokePoint defaults;
  WritingParameters writing;
  int passes = 1;
  bool publish = false, no_lag_compensation = false, quiet = false;
};

Eigen::Vector2d originOf(const Arguments& arguments, const PaperParameters& paper) {
  if (!arguments.origin.empty()) return {arguments.origin[0], arguments.origin[1]};
  return {0.5 * (paper.width - arguments.size), 0.5 * (paper.height - arguments.size)};
}

std::vector<Stroke> readStrokes(const Arguments& arguments, const PaperParameters& paper) {
  if (arguments.glyph.empty()) return readStrokeFile(arguments.strokes);
  return strokesOfGlyph(readGlyph(arguments.glyph), arguments.size, originOf(arguments, paper),
                        arguments.defaults);
}

/// A character's strokes after practice.
std::vector<Stroke> practise(const Arguments& arguments, const std::vector<Stroke>& strokes,
                             const SimulatorParameters& parameters, const BrushCurve& curve) {
  if (!arguments.quiet) std::cerr << "practising " << strokes.size() << " strokes ...\n";
  CorrectionOptions options;
  options.passes = arguments.passes;
  const auto outlines =
      outlinesOfGlyph(readGlyph(arguments.glyph), arguments.size, originOf(arguments, parameters.paper));
  std::vector<Stroke> practised;
  for (const CorrectedStroke& corrected :
       correctStrokes(strokes, outlines, parameters, arguments.writing, curve, options))
    practised.push_back(corrected.stroke);
  return practised;
}

/// The brush's curve if a stroke is given by width; says if it cannot write that wide.
std::optional<BrushCurve> measureIfNeeded(const std::vector<Stroke>& strokes,
                                          const SimulatorParameters& parameters, double tilt,
                                          bool quiet) {
  bool needed = false;
  double widest = 0.0;
  for (const Stroke& stroke : strokes)
    for (const StrokePoint& point : stroke.points) {
      needed = needed || point.width.has_value();
      widest = std::max(widest, point.width.value_or(0.0));
    }
  if (!needed) return std::nullopt;
  if (!quiet) std::cerr << "measuring the brush's line width over its depth ...\n";
  BrushCurve curve = measureBrushCurve(parameters, tilt);
  if (widest > curve.maxWidth())
    std::cerr << "stroke_writer: warning: lines up to " << 1e3 * widest
              << " mm wide are asked for; this brush's are " << 1e3 * curve.maxWidth()
              << " mm at most\n";
  return curve;
}

/// Sends the poses in real time, once somebody listens, with the first stamp now.
void publish(const std::vector<HandlePose>& poses, const std::string& frame,
             std::vector<std::string> words) {
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  int argc = static_cast<int>(words.size());
  ros::init(argc, argv.data(), "stroke_writer", ros::init_options::AnonymousName);
  if (!ros::master::check()) throw std::runtime_error("no ROS master at " + ros::master::getURI());
  ros::NodeHandle node;
  ros::Publisher publisher = node.advertise<geometry_msgs::PoseStamped>("handle_pose", 1000);
  std::cerr << "waiting for a subscriber of " << publisher.getTopic() << " ...\n";
  while (ros::ok() && publisher.getNumSubscribers() == 0) ros::WallDuration(0.02).sleep();

  const std::int64_t shift_ns = toNanoseconds(ros::Time::now()) - poses.front().stamp_ns;
  for (HandlePose pose : poses) {
    pose.stamp_ns += shift_ns;
    const geometry_msgs::PoseStamped message = toPoseStamped(pose, frame);
    ros::Time::sleepUntil(message.header.stamp);
    if (!ros::ok()) throw std::runtime_error("stopped before the last pose");
    publisher.publish(message);
    ros::spinOnce();
  }
  // What is in the queue goes out before the connection is closed.
  ros::WallDuration(0.5).sleep();
}

po::options_description describeOptions(Arguments& a) {
  po::options_description options("Options");
  options.add_options()("help", "show this and exit");
  options.add_options()("bag", po::value(&a.bag)->value_name("FILE"), "write the poses to this bag");
  options.add_options()("publish", po::bool_switch(&a.publish),
                        "send the poses on the topic handle_pose in real time (needs a ROS master)");
  options.add_options()("glyph", po::value(&a.glyph)->value_name("FILE"),
                        "write this character of hanzi-writer-data instead of a stroke file");
  options.add_options()("size", po::value(&a.size)->default_value(a.size, "0.06")->value_name("M"),
                        "side of the character's em square [m]");
  options.add_options()("origin", po::value(&a.origin)->multitoken()->value_name("X Y"),
                        "lower left corner of the em square [m]; default: in the middle of the paper");
  options.add_options()("speed",
                        po::value(&a.defaults.speed)->default_value(0.04, "0.04")->value_name("M/S"),
                        "speed of the handle along a character's strokes");
  options.add_options()("tilt", po::value(&a.defaults.tilt)->default_value(0.0, "0")->value_name("RAD"),
                        "tilt of the shaft for a character");
  options.add_options()("azimuth",
                        po::value(&a.defaults.azimuth)->default_value(0.0, "0")->value_name("RAD"),
                        "direction in which the shaft leans");
  options.add_options()("brush", po::value(&a.brush)->default_value("medium")->value_name("NAME|FILE"),
                        "preset in config/brushes, or a YAML file");
  options.add_options()("paper", po::value(&a.paper)->default_value("plain")->value_name("NAME|FILE"),
                        "preset in config/papers, or a YAML file");
  options.add_options()("rate",
                        po::value(&a.writing.rate)->default_value(a.writing.rate)->value_name("HZ"),
                        "poses per second");
  options.add_options()("acceleration",
                        po::value(&a.writing.acceleration)
                            ->default_value(a.writing.acceleration, "0.6")
                            ->value_name("M/S2"),
                        "largest acceleration");
  options.add_options()(
      "air-speed",
      po::value(&a.writing.air_speed)->default_value(a.writing.air_speed, "0.15")->value_name("M/S"),
      "speed between strokes");
  options.add_options()(
      "clearance",
      po::value(&a.writing.clearance)->default_value(a.writing.clearance, "0.012")->value_name("M"),
      "height of the tip over the sheet between strokes");
  options.add_options()(
      "lean", po::value(&a.writing.lean)->default_value(a.writing.lean, "0.2")->value_name("RAD"),
      "tilt the way the stroke goes, for strokes given by line width without a tilt");
  options.add_options()("passes", po::value(&a.passes)->default_value(1)->value_name("N"),
                        "practise each stroke of a character so often in the simulator and correct it "
                        "against its outline; 1: as planned");
  options.add_options()(
      "lead", po::value(&a.writing.lead)->default_value(a.writing.lead, "0.5")->value_name("PART"),
      "lead of the handle over the lag of the footprint, for strokes given by line width");
  options.add_options()(
      "no-lag-compensation", po::bool_switch(&a.no_lag_compensation),
      "lead the handle along the mark itself, not ahead of it by how far the tip trails");
  options.add_options()("quiet", po::bool_switch(&a.quiet), "say nothing but warnings and errors");
  return options;
}

void check(const Arguments& a) {
  if (a.strokes.empty() == a.glyph.empty())
    throw std::runtime_error("needs a stroke file or --glyph FILE (see --help)");
  refuseFolder(a.strokes.empty() ? a.glyph : a.strokes);
  if (a.bag.empty() && !a.publish)
    throw std::runtime_error("needs --bag FILE or --publish (see --help)");
  if (!a.origin.empty() && a.origin.size() != 2)
    throw std::runtime_error("--origin needs two numbers, x and y");
  const auto inRange = [](const char* name, double value, double low, double high, const char* unit) {
    if (!(value >= low && value <= high))
      throw std::runtime_error(std::string(name) + " = " + parameters_detail::toText(value) +
                               " is outside " + parameters_detail::rangeText(Range{low, high}) + " " +
                               unit);
  };
  if (a.passes > 1 && a.glyph.empty())
    throw std::runtime_error("--passes needs the outlines of a --glyph");
  inRange("--passes", a.passes, 1, 100, "");
  inRange("--size", a.size, 1e-3, 2.0, "m");
  for (const double coordinate : a.origin) inRange("--origin", coordinate, -10.0, 10.0, "m");
  inRange("--speed", a.defaults.speed, 1e-4, 5.0, "m/s");
  inRange("--tilt", a.defaults.tilt, 0.0, 1.5, "rad");
  inRange("--azimuth", a.defaults.azimuth, -7.0, 7.0, "rad");
  checkParameters(a.writing);
}

void run(int argc, char** argv) {
  // Names may be remapped as for any node: handle_pose:=/robot/handle_pose.
  std::vector<std::string> words;
  ros::removeROSArgs(argc, argv, words);
  if (!words.empty()) words.erase(words.begin());

  Arguments arguments;
  const po::options_description options = describeOptions(arguments);
  po::options_description hidden;
  hidden.add_options()("strokes", po::value(&arguments.strokes));
  po::options_description all;
  all.add(options).add(hidden);
  po::positional_options_description positional;
  positional.add("strokes", 1);
  const po::variables_map values = parseCommandLine(words, all, positional);
  if (values.count("help") > 0) {
    std::cout << "Usage: stroke_writer strokes.yaml --bag out.bag [options]\n"
                 "       stroke_writer --glyph u06c38.json --size 0.06 --bag out.bag [options]\n"
                 "Turns strokes into timed poses of the brush handle.\n\n"
              << options;
    return;
  }
  check(arguments);
  arguments.writing.lag_compensation = !arguments.no_lag_compensation;

  const BrushSimulatorParameters parameters = loadPresets(arguments.brush, arguments.paper);
  std::vector<Stroke> strokes = readStrokes(arguments, parameters.simulator.paper);
  if (!arguments.bag.empty()) const AtomicFile probe(arguments.bag);
  const auto curve =
      measureIfNeeded(strokes, parameters.simulator, arguments.writing.lean, arguments.quiet);
  if (arguments.passes > 1 && curve)
    strokes = practise(arguments, strokes, parameters.simulator, *curve);
  const double tip_length = makeBrush(parameters.simulator.brush).tip_length;
  const auto poses = planHandlePoses(strokes, arguments.writing, tip_length, curve ? &*curve : nullptr);
  if (!arguments.bag.empty()) {
    writePoseBag(arguments.bag, poses, parameters.ros.paper_frame);
    if (!arguments.quiet)
      std::printf("%s: %zu strokes, %zu poses, %.3f s\n", arguments.bag.c_str(), strokes.size(),
                  poses.size(),
                  1e-9 * static_cast<double>(poses.back().stamp_ns - poses.front().stamp_ns));
  }
  if (arguments.publish) publish(poses, parameters.ros.paper_frame, {argv, argv + argc});
}

}  // namespace

int main(int argc, char** argv) {
  return calligraphy_brush::runTool("stroke_writer", [&] { run(argc, argv); });
}
