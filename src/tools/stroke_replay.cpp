#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/files/png.h"
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
  bool quiet = false;
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

void replay(const Arguments& arguments, const BrushSimulatorParameters& parameters) {
  const PoseBag bag = readPoseBag(arguments.bag, arguments.topic, parameters.ros.paper_frame);
  std::map<std::string, std::uint64_t> refused = bag.unreachable;
  Simulator simulator(parameters.simulator);
  // A picture that cannot be written shall not cost a simulation first.
  { const AtomicFile probe(arguments.picture); }

  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  std::int64_t steps = 0;
  std::uint64_t accepted = 0;
  {
    ProgressBar progress(bag.poses.size(), arguments.quiet);
    for (std::size_t k = 0; k < bag.poses.size(); ++k) {
      const PoseVerdict verdict = simulator.addPose(bag.poses[k]);
      if (verdict == PoseVerdict::kAccepted) {
        ++accepted;
        steps += simulator.advance();
      } else {
        ++refused[toString(verdict)];
      }
      progress.show(k + 1);
    }
  }
  const double wall = std::chrono::duration<double>(Clock::now() - begin).count();

  std::string why;
  for (const auto& [reason, count] : refused)
    why += (why.empty() ? "" : "; ") + std::to_string(count) + " refused: " + reason;
  if (accepted == 0)
    throw std::runtime_error(arguments.bag + ": no pose to simulate" +
                             (why.empty() ? "" : " (" + why + ")"));
  if (!why.empty()) std::cerr << "stroke_replay: warning: " << why << "\n";

  const Paper& paper = simulator.paper();
  if (!arguments.quiet && paper.inkVolume() <= 0.0)
    std::cerr << "stroke_replay: warning: nothing was written: no hair met the sheet. Were the poses "
                 "made for brush "
              << arguments.brush << "?\n";
  std::vector<std::uint8_t> picture;
  paper.render(picture);
  writePng(arguments.picture, paper.width_px(), paper.height_px(), picture,
           parameters.simulator.paper.px_per_mm);
  if (arguments.quiet) return;
  const double simulated = static_cast<double>(steps) * parameters.simulator.rods.time_step;
  std::printf("%s: %llu poses, simulated %.3f s in %.3f s: %.1f x real time\n",
              arguments.picture.c_str(), static_cast<unsigned long long>(accepted), simulated, wall,
              wall > 0 ? simulated / wall : 0.0);
}

void run(const std::vector<std::string>& words) {
  Arguments arguments;
  double px_per_mm = 0.0;
  int threads = 0;
  po::options_description options("Options");
  options.add_options()("help", "show this and exit");
  options.add_options()("brush",
                        po::value(&arguments.brush)->default_value("medium")->value_name("NAME|FILE"),
                        "preset in config/brushes, or a YAML file");
  options.add_options()("paper",
                        po::value(&arguments.paper)->default_value("plain")->value_name("NAME|FILE"),
                        "preset in config/papers, or a YAML file");
  options.add_options()("px-per-mm", po::value(&px_per_mm)->value_name("N"),
                        "resolution, instead of the paper's");
  options.add_options()("threads", po::value(&threads)->value_name("N"),
                        "threads that solve rods; the picture does not depend on it");
  options.add_options()("topic",
                        po::value(&arguments.topic)->default_value("handle_pose")->value_name("NAME"),
                        "topic of the poses in the bag");
  options.add_options()("quiet", po::bool_switch(&arguments.quiet), "no progress bar and no last line");
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
  BrushSimulatorParameters parameters = loadPresets(arguments.brush, arguments.paper);
  if (values.count("px-per-mm") > 0) parameters.simulator.paper.px_per_mm = px_per_mm;
  if (values.count("threads") > 0) parameters.simulator.rods.threads = threads;
  checkParameters(parameters);
  replay(arguments, parameters);
}

}  // namespace

int main(int argc, char** argv) {
  return runTool("stroke_replay", [&] { run({argv + 1, argv + argc}); });
}
