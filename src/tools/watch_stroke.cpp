#include <calligraphy_brush/BrushState.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <std_srvs/Trigger.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "command_line.h"

// Watches a brush_simulator that is fed from a bag: shows how far it is, and when every pose of the
// bag has been simulated has the picture saved and prints its path. Exit 1 if it stops on the way.

namespace {

namespace po = boost::program_options;

struct Arguments {
  std::string bag;
  std::string topic = "/handle_pose";
  std::string simulator = "brush_simulator";
  double patience = 60.0;  // [s]
};

// A bag made without a master may name its topics without the slash.
std::uint64_t countPoses(const Arguments& arguments) {
  const std::string bare = arguments.topic.substr(arguments.topic.rfind('/', 0) == 0 ? 1 : 0);
  const rosbag::Bag bag(arguments.bag, rosbag::bagmode::Read);
  rosbag::View poses(bag, rosbag::TopicQuery(std::vector<std::string>{bare, "/" + bare}));
  if (poses.size() == 0)
    throw std::runtime_error(arguments.bag + " has no messages on " + arguments.topic);
  return poses.size();
}

/// One line that is written over, or on something other than a terminal a line for each tenth.
class ProgressBar {
 public:
  void show(std::uint64_t done, std::uint64_t count, const calligraphy_brush::BrushState& state) {
    const auto percent = static_cast<int>(100 * std::min(done, count) / count);
    const bool terminal = isatty(STDOUT_FILENO) != 0;
    if (terminal ? percent == last_percent_ : percent / 10 == last_percent_ / 10) return;
    last_percent_ = percent;
    const std::string bar(static_cast<std::size_t>(percent * 3 / 10), '#');
    std::printf("%s[%-30s] %3d %%  ink %3.0f %%  %5.1f x real time", terminal ? "\r" : "", bar.c_str(),
                percent, 100.0 * state.ink_left, state.real_time_factor);
    if (!terminal || percent == 100) std::printf("\n");
    std::fflush(stdout);
  }

 private:
  int last_percent_ = -10;
};

/// Returns once all poses have been simulated or refused. Throws if there is no progress.
void watch(const Arguments& arguments, std::uint64_t pose_count) {
  ros::NodeHandle node;
  std::uint64_t done = 0;
  ros::SteadyTime progress_at = ros::SteadyTime::now();
  ProgressBar bar;
  const auto subscriber = node.subscribe<calligraphy_brush::BrushState>(
      "brush_state", 10, [&](const calligraphy_brush::BrushStateConstPtr& state) {
        const std::uint64_t now_done = state->poses_accepted + state->poses_refused;
        if (now_done == done) return;
        done = now_done;
        progress_at = ros::SteadyTime::now();
        bar.show(done, pose_count, *state);
      });
  while (done < pose_count) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
    if (!ros::ok()) throw std::runtime_error("interrupted");
    if ((ros::SteadyTime::now() - progress_at).toSec() > arguments.patience)
      throw std::runtime_error(
          "no progress for " + std::to_string(static_cast<int>(arguments.patience)) +
          " s: " + std::to_string(done) + " of " + std::to_string(pose_count) + " poses");
  }
}

std::string saveImage(const Arguments& arguments) {
  std_srvs::Trigger save;
  if (!ros::service::call(arguments.simulator + "/save_image", save))
    throw std::runtime_error("no answer from " + arguments.simulator + "/save_image");
  if (!save.response.success) throw std::runtime_error(save.response.message);
  return save.response.message;
}

void run(int argc, char** argv) {
  // Takes the arguments meant for ROS, such as remappings, from the rest.
  ros::init(argc, argv, "watch_stroke", ros::init_options::AnonymousName);
  Arguments arguments;
  po::options_description options("Options");
  options.add_options()("help", "show this and exit");
  options.add_options()("topic",
                        po::value(&arguments.topic)->default_value(arguments.topic)->value_name("NAME"),
                        "name of the poses in the bag");
  options.add_options()(
      "simulator",
      po::value(&arguments.simulator)->default_value(arguments.simulator)->value_name("NODE"),
      "node to save from");
  options.add_options()(
      "patience", po::value(&arguments.patience)->default_value(arguments.patience)->value_name("S"),
      "give up after so long without progress [s]");
  po::options_description hidden;
  hidden.add_options()("bag", po::value(&arguments.bag));
  po::options_description all;
  all.add(options).add(hidden);
  po::positional_options_description positional;
  positional.add("bag", 1);
  const po::variables_map values =
      calligraphy_brush::parseCommandLine({argv + 1, argv + argc}, all, positional);
  if (values.count("help") > 0) {
    std::cout
        << "Usage: watch_stroke in.bag [options]\n"
           "Shows how far a brush_simulator is that is fed from a bag, then has its picture saved.\n\n"
        << options;
    return;
  }
  if (arguments.bag.empty()) throw std::runtime_error("needs the bag that is being played (see --help)");

  const std::uint64_t pose_count = countPoses(arguments);
  const ros::SteadyTime start = ros::SteadyTime::now();
  while (ros::ok() && !ros::master::check()) {
    if ((ros::SteadyTime::now() - start).toSec() > arguments.patience)
      throw std::runtime_error("no ROS master");
    ros::WallDuration(0.05).sleep();
  }
  watch(arguments, pose_count);
  std::cout << saveImage(arguments) << "\n";
}

}  // namespace

int main(int argc, char** argv) {
  return calligraphy_brush::runTool("watch_stroke", [&] { run(argc, argv); });
}
