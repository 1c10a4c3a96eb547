#include <calligraphy_brush/BrushEvent.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <functional>
#include <iostream>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/files/svg.h"
#include "calligraphy_brush/sim/simulator.h"
#include "command_line.h"
#include "pose_bag.h"

// A bag of handle poses in, the picture that they write out: what brush_simulator_node does, as fast as
// it goes and without a ROS master.

namespace {

namespace po = boost::program_options;
using namespace calligraphy_brush;

struct Arguments {
  std::string bag, picture;
  std::string brush, paper, topic;
  bool quiet = false, state_hash = false;
  std::string format = "grey", strokes, outline;
  int undo = 0;
  std::optional<double> px_per_mm;  // as the paper has
};

/// "out.png" and "_01" to "out_01.png".
std::string withSuffix(const std::string& path, const std::string& suffix) {
  const auto dot = path.rfind('.');
  const auto slash = path.rfind('/');
  const bool has_ending = dot != std::string::npos && (slash == std::string::npos || dot > slash);
  return has_ending ? path.substr(0, dot) + suffix + path.substr(dot) : path + suffix;
}

void writePicture(const std::string& path, const std::string& format, const Paper& paper) {
  const int width = paper.width_px(), height = paper.height_px();
  const double px_per_mm = paper.parameters().px_per_mm;
  std::vector<std::uint8_t> values;
  if (format == "grey") {
    paper.render(values);
    writePng(path, width, height, values, px_per_mm);
  } else if (format == "grey16") {
    std::vector<std::uint16_t> mono16;
    paper.render(mono16);
    writePng16(path, width, height, mono16, px_per_mm);
  } else if (format == "colour") {
    paper.renderColour(values);
    writeColourPng(path, width, height, Colours::kRgb, values, px_per_mm);
  } else {
    paper.renderTransparent(values);
    writeColourPng(path, width, height, Colours::kRgba, values, px_per_mm);
  }
}

/// The sheet at the end of each stroke, a stroke being from the first touch to the last: as many as
/// can be taken back. An old sheet goes on from there as if nothing had been written since.
class Strokes {
 public:
  Strokes(const Arguments& arguments, const Paper& blank)
      : arguments_(arguments),
        is_used_(arguments.undo > 0 || !arguments.strokes.empty() || !arguments.outline.empty()) {
    if (is_used_) ends_.push_back({blank, 0});
  }

  /// Another sheet: what was written before is not on it.
  void beginAnew(const Paper& blank) {
    ends_.clear();
    outlines_.clear();
    count_ = 0;
    touched_ = false;
    if (is_used_) ends_.push_back({blank, 0});
  }
  void look(const Simulator& simulator) {
    const bool touches = simulator.report().touching_rods > 0;
    if (is_used_ && touched_ && !touches) end(simulator);
    if (count_ == 0 && !touches && is_used_) ends_.back().time_ns = simulator.time_ns();
    touched_ = touches;
  }
  /// The sheet without the last strokes, at the time of the simulator; what the simulator has if there
  /// are none to take back.
  Paper finish(const Simulator& simulator) {
    if (is_used_ && touched_) end(simulator);
    if (arguments_.undo == 0) return simulator.picture();
    if (arguments_.undo > count_)
      throw std::runtime_error("undo = " + std::to_string(arguments_.undo) + ", but there are " +
                               std::to_string(count_) + " strokes");
    return aged(ends_[ends_.size() - 1 - static_cast<std::size_t>(arguments_.undo)],
                simulator.time_ns());
  }
  /// Name and outline of each stroke that is left.
  std::vector<std::pair<std::string, std::vector<Outline>>> outlines() const {
    auto left = outlines_;
    left.resize(left.size() - std::min(left.size(), static_cast<std::size_t>(arguments_.undo)));
    return left;
  }

 private:
  struct End {
    Paper paper;
    std::int64_t time_ns;
  };

  static Paper aged(const End& end, std::int64_t time_ns) {
    Paper paper = end.paper;
    constexpr std::int64_t kInterval_ns = 16000000;
    for (std::int64_t left = time_ns - end.time_ns; left > 0; left -= kInterval_ns)
      paper.flow(1e-9 * static_cast<double>(std::min(left, kInterval_ns)));
    return paper;
  }

  void end(const Simulator& simulator) {
    ++count_;
    const Paper& paper = simulator.picture();
    if (!arguments_.strokes.empty() || !arguments_.outline.empty()) {
      std::vector<std::uint8_t> added;
      paper.renderAdded(aged(ends_.back(), simulator.time_ns()), added);
      char suffix[16];
      std::snprintf(suffix, sizeof suffix, "_%02d", count_);
      if (!arguments_.strokes.empty())
        writePng(withSuffix(arguments_.strokes, suffix), paper.width_px(), paper.height_px(), added,
                 paper.parameters().px_per_mm);
      if (!arguments_.outline.empty())
        outlines_.emplace_back("stroke" + std::string(suffix),
                               traceOutlines(paper.width_px(), paper.height_px(), added));
    }
    ends_.push_back({paper, simulator.time_ns()});
    if (ends_.size() > static_cast<std::size_t>(arguments_.undo) + 1) ends_.pop_front();
  }

  const Arguments& arguments_;
  bool is_used_;
  bool touched_ = false;
  int count_ = 0;
  std::deque<End> ends_;
  std::vector<std::pair<std::string, std::vector<Outline>>> outlines_;
};

/// A bar on stderr that is written over; nothing if that is not a terminal.
class ProgressBar {
 public:
  ProgressBar(std::size_t count, bool quiet)
      : count_(count), shown_(!quiet && isatty(STDERR_FILENO) != 0) {}
  ~ProgressBar() {
    if (shown_ && percent_ >= 0) std::fprintf(stderr, "\r%*s\r", 48, "");
  }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void show(std::size_t done) {
    const int percent = static_cast<int>(100 * done / std::max<std::size_t>(1, count_));
    if (!shown_ || percent == percent_) return;
    percent_ = percent;
    const std::string bar(static_cast<std::size_t>(percent * 2 / 5), '#');
    std::fprintf(stderr, "\r[%-40s] %3d %%", bar.c_str(), percent);
    std::fflush(stderr);
  }

 private:
  std::size_t count_;
  bool shown_;
  int percent_ = -1;
};

void apply(std::uint8_t kind, Simulator& simulator) {
  switch (kind) {
    case BrushEvent::DIP: return simulator.dip();
    case BrushEvent::WIPE: return simulator.wipe();
    case BrushEvent::CLEAR_PAPER: return simulator.clearPaper();
    case BrushEvent::RESET: return simulator.reset();
    default:
      throw std::runtime_error("brush_events: kind = " + std::to_string(kind) + " is outside [1, 4]");
  }
}

/// change: puts what the command line says over recorded parameters.
void replay(const Arguments& arguments, const PoseBag& bag, const BrushSimulatorParameters& parameters,
            const std::function<void(BrushSimulatorParameters&)>& change) {
  std::map<std::string, std::uint64_t> refused = bag.unreachable;
  Simulator simulator(parameters.simulator);
  const auto redraw = [&] {
    const std::optional<double>& given = arguments.px_per_mm;
    if (given && *given != simulator.parameters().paper.px_per_mm) simulator.drawAlsoAt(*given);
  };
  redraw();
  // A picture that cannot be written shall not cost a simulation first.
  { const AtomicFile probe(arguments.picture); }
  for (const std::string& path : {arguments.strokes, arguments.outline})
    if (!path.empty()) const AtomicFile probe(path);
  Strokes strokes(arguments, simulator.picture());

  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  std::int64_t steps = 0;
  std::uint64_t accepted = 0;
  {
    ProgressBar progress(bag.poses.size(), arguments.quiet);
    auto event = bag.events.begin();
    const auto applyEvent = [&] {
      const auto later = bag.later_parameters.find(static_cast<std::size_t>(event - bag.events.begin()));
      if (later != bag.later_parameters.end()) {
        BrushSimulatorParameters changed;
        changed.simulator = later->second;
        change(changed);
        simulator = Simulator(changed.simulator);
        redraw();
        strokes.beginAnew(simulator.picture());
      } else {
        apply(event->kind, simulator);
      }
    };
    for (std::size_t k = 0; k < bag.poses.size(); ++k) {
      for (; event != bag.events.end() && event->stamp_ns == 0; ++event) applyEvent();
      const PoseVerdict verdict = simulator.addPose(bag.poses[k]);
      if (verdict == PoseVerdict::kAccepted) {
        ++accepted;
        steps += simulator.advance();
        strokes.look(simulator);
      } else {
        ++refused[toString(verdict)];
      }
      for (; event != bag.events.end() && event->stamp_ns == bag.poses[k].stamp_ns; ++event)
        applyEvent();
      progress.show(k + 1);
    }
    for (; event != bag.events.end() && event->stamp_ns == 0; ++event) applyEvent();
    if (event != bag.events.end())
      std::cerr << "stroke_replay: warning: " << bag.events.end() - event
                << " events left out: the bag has no pose that they come after\n";
  }
  const double wall = std::chrono::duration<double>(Clock::now() - begin).count();

  std::string why;
  for (const auto& [reason, count] : refused)
    why += (why.empty() ? "" : "; ") + std::to_string(count) + " refused: " + reason;
  if (accepted == 0)
    throw std::runtime_error(arguments.bag + ": no pose to simulate" +
                             (why.empty() ? "" : " (" + why + ")"));
  if (!why.empty()) std::cerr << "stroke_replay: warning: " << why << "\n";

  const Paper paper = strokes.finish(simulator);
  if (!arguments.quiet && paper.inkVolume() <= 0.0)
    std::cerr << "stroke_replay: warning: nothing was written: no hair met the sheet. Were the poses "
                 "made for brush "
              << (arguments.brush.empty() ? "as recorded" : arguments.brush) << "?\n";
  if (!arguments.outline.empty())
    writeSvg(arguments.outline, paper.width_px(), paper.height_px(), paper.parameters().px_per_mm,
             strokes.outlines());
  writePicture(arguments.picture, arguments.format, paper);
  if (arguments.state_hash) std::printf("%016" PRIx64 "\n", simulator.stateHash());
  if (arguments.quiet) return;
  const double simulated = static_cast<double>(steps) * parameters.simulator.rods.time_step;
  std::printf("%s: %llu poses, simulated %.3f s in %.3f s: %.1f x real time\n",
              arguments.picture.c_str(), static_cast<unsigned long long>(accepted), simulated, wall,
              wall > 0 ? simulated / wall : 0.0);
  std::printf("percent of the simulated time:");
  for (int stage = 0; stage < static_cast<int>(Stage::kCount); ++stage)
    std::printf(" %s %.1f", toString(static_cast<Stage>(stage)),
                100.0 * simulator.report().stage_seconds[static_cast<std::size_t>(stage)] / simulated);
  std::printf("\n");
}

void run(const std::vector<std::string>& words) {
  Arguments arguments;
  int threads = 0;
  po::options_description options("Options");
  options.add_options()("help", "show this and exit");
  options.add_options()("brush", po::value(&arguments.brush)->value_name("NAME|FILE"),
                        "preset in config/brushes, or a YAML file; default: as recorded, else medium");
  options.add_options()("paper", po::value(&arguments.paper)->value_name("NAME|FILE"),
                        "preset in config/papers, or a YAML file; default: as recorded, else plain");
  options.add_options()("px-per-mm", po::value<double>()->value_name("N"),
                        "resolution of what is written; the brush moves as on the paper as recorded");
  options.add_options()("format",
                        po::value(&arguments.format)->default_value("grey")->value_name("KIND"),
                        "grey, grey16, colour, or transparent: ink without paper");
  options.add_options()("undo", po::value(&arguments.undo)->default_value(0)->value_name("N"),
                        "leave out the last N strokes; a stroke is from first to last touch");
  options.add_options()("strokes", po::value(&arguments.strokes)->value_name("FILE.png"),
                        "write what each stroke added, as FILE_01.png and so on");
  options.add_options()("outline", po::value(&arguments.outline)->value_name("FILE.svg"),
                        "write the outline of each stroke's ink");
  options.add_options()("threads", po::value(&threads)->value_name("N"),
                        "threads that solve rods; the picture does not depend on it");
  options.add_options()("topic",
                        po::value(&arguments.topic)->default_value("handle_pose")->value_name("NAME"),
                        "topic of the poses in the bag");
  options.add_options()("quiet", po::bool_switch(&arguments.quiet), "no progress bar and no last line");
  options.add_options()("hash", po::bool_switch(&arguments.state_hash),
                        "print the hash of rods, ink and sheet at the end, as ~state_hash does");
  po::options_description hidden;
  hidden.add_options()("bag", po::value(&arguments.bag));
  hidden.add_options()("picture", po::value(&arguments.picture));
  po::options_description all;
  all.add(options).add(hidden);
  po::positional_options_description positional;
  positional.add("bag", 1).add("picture", 1);
  const po::variables_map values = parseCommandLine(words, all, positional);

  if (values.count("help") > 0) {
    std::cout << "Usage: stroke_replay in.bag out.png [options]\n"
                 "Simulates the brush along the handle poses of a bag and writes the picture.\n\n"
              << options;
    return;
  }
  if (values.count("bag") == 0 || values.count("picture") == 0)
    throw std::runtime_error(
        "needs a bag and a picture to write: stroke_replay in.bag out.png (see --help)");
  if (arguments.format != "grey" && arguments.format != "grey16" && arguments.format != "colour" &&
      arguments.format != "transparent")
    throw std::runtime_error("--format = " + arguments.format +
                             " is not one of grey, grey16, colour, transparent");
  if (arguments.undo < 0)
    throw std::runtime_error("--undo = " + std::to_string(arguments.undo) + " is below 0");
  if (values.count("px-per-mm") > 0) arguments.px_per_mm = values["px-per-mm"].as<double>();
  BrushSimulatorParameters parameters;
  const PoseBag bag = readPoseBag(arguments.bag, arguments.topic, parameters.ros.paper_frame);
  if (bag.parameters) {
    parameters.simulator = *bag.parameters;
    if (bag.parameters_changed)
      std::cerr
          << "stroke_replay: warning: the parameters changed during the recording; the first hold\n";
  } else {
    if (arguments.brush.empty()) arguments.brush = "medium";
    if (arguments.paper.empty()) arguments.paper = "plain";
    parameters = loadPresets(arguments.brush, arguments.paper);
  }
  const auto change = [&](BrushSimulatorParameters& recorded) {
    if (!arguments.brush.empty()) loadYamlParameters(findPreset("brushes", arguments.brush), recorded);
    if (!arguments.paper.empty()) loadYamlParameters(findPreset("papers", arguments.paper), recorded);
    if (values.count("threads") > 0) recorded.simulator.rods.threads = threads;
    checkParameters(recorded);
  };
  change(parameters);
  replay(arguments, bag, parameters, change);
}

}  // namespace

int main(int argc, char** argv) {
  return runTool("stroke_replay", [&] { run({argv + 1, argv + argc}); });
}
