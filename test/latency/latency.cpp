#include <calligraphy_brush/BrushState.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <unistd.h>
#include <visualization_msgs/MarkerArray.h>
#include <xmlrpcpp/XmlRpcClient.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <algorithm>
#include <atomic>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <fstream>
#include <iostream>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "calligraphy_brush/ros/conversions.h"

// Sends poses to a running brush_simulator at a fixed rate and measures how long after the stamp of a
// pose what it caused comes back, what gets lost, and what the simulator's process uses.

namespace {

namespace po = boost::program_options;
using namespace calligraphy_brush;

struct Arguments {
  double rate = 125.0;    // [Hz]
  double seconds = 20.0;  // [s]
  double tip_length = 0.045;
  bool markers = false, wrench = false, pictures = false;
  std::string simulator = "/brush_simulator", process;
};

/// Process of a node; of the manager, for a nodelet.
int findProcess(const std::string& node) {
  XmlRpc::XmlRpcValue request, answer, payload;
  request[0] = ros::this_node::getName();
  request[1] = node;
  std::string host;
  std::uint32_t port = 0;
  if (!ros::master::execute("lookupNode", request, answer, payload, false) ||
      !ros::network::splitURI(static_cast<std::string&>(payload), host, port))
    throw std::runtime_error("no node " + node);
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  request.clear();
  request[0] = ros::this_node::getName();
  if (!client.execute("getPid", request, answer) || answer.size() < 3)
    throw std::runtime_error("no answer from " + node);
  return static_cast<int>(answer[2]);
}

/// Processor time used so far [s].
double processorSeconds(int process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/stat");
  std::string text((std::istreambuf_iterator<char>(file)), {});
  std::istringstream fields(text.substr(text.rfind(')') + 2));
  std::string field;
  double ticks = 0.0;
  for (int k = 3; fields >> field && k <= 15; ++k)
    if (k == 14 || k == 15) ticks += std::stod(field);
  return ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
}

/// Memory that the process holds [MB].
double residentMegabytes(int process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/statm");
  double size = 0.0, resident = 0.0;
  file >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

/// A circle of 40 mm diameter that is drawn for 3 s, then 1 s above the sheet.
HandlePose poseAt(double time, double tip_length) {
  constexpr double kTurn = 2.0 * 3.14159265358979;
  const double phase = std::fmod(time, 4.0);
  const double s = std::min(phase / 3.0, 1.0);
  HandlePose pose;
  const double lift = phase > 3.0 ? std::sin(0.5 * kTurn * (phase - 3.0)) : 0.0;
  pose.position = {0.15 + 0.02 * std::cos(kTurn * s), 0.15 + 0.02 * std::sin(kTurn * s),
                   tip_length - 0.005 * std::sin(0.5 * kTurn * s) + 0.003 * lift * lift};
  return pose;
}

/// Stamps that were sent and are not answered yet, and the delays of the answers.
class Delays {
 public:
  void sent(std::int64_t stamp_ns) {
    const std::lock_guard<std::mutex> lock(mutex_);
    stamps_.push_back(stamp_ns);
  }
  /// A result of simulated time: caused by the first pose that is not before it.
  void received(const ros::Time& simulated) {
    const std::int64_t now_ns = toNanoseconds(ros::Time::now());
    const std::int64_t simulated_ns = toNanoseconds(simulated);
    const std::lock_guard<std::mutex> lock(mutex_);
    while (!stamps_.empty() && stamps_.front() < simulated_ns) stamps_.pop_front();
    if (stamps_.empty() || simulated_ns <= last_ns_) return;
    last_ns_ = simulated_ns;
    milliseconds_.push_back(1e-6 * static_cast<double>(now_ns - stamps_.front()));
  }
  void stop() {
    const std::lock_guard<std::mutex> lock(mutex_);
    stamps_.clear();
  }
  void print(const char* name) {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::sort(milliseconds_.begin(), milliseconds_.end());
    if (milliseconds_.empty()) return void(std::printf("  %-12s nothing came back\n", name));
    const auto part = [&](double p) {
      return milliseconds_[static_cast<std::size_t>(p * static_cast<double>(milliseconds_.size() - 1))];
    };
    std::printf("  %-12s p50 %.2f  p99 %.2f  max %.2f ms  (%zu)\n", name, part(0.5), part(0.99),
                milliseconds_.back(), milliseconds_.size());
  }

 private:
  std::mutex mutex_;
  std::deque<std::int64_t> stamps_;
  std::vector<double> milliseconds_;
  std::int64_t last_ns_ = 0;
};

void measure(const Arguments& arguments) {
  ros::NodeHandle node;
  Delays to_markers, to_wrench;
  std::mutex state_mutex;
  BrushState state;
  std::atomic<int> states{0};
  const auto no_delay = ros::TransportHints().tcpNoDelay();
  ros::Subscriber markers, wrench;
  if (arguments.markers)
    markers = node.subscribe<visualization_msgs::MarkerArray>(
        "tip_markers", 10,
        [&](const visualization_msgs::MarkerArrayConstPtr& message) {
          to_markers.received(message->markers.front().header.stamp);
        },
        ros::VoidConstPtr(), no_delay);
  if (arguments.wrench)
    wrench = node.subscribe<geometry_msgs::WrenchStamped>(
        "handle_wrench", 1000,
        [&](const geometry_msgs::WrenchStampedConstPtr& message) {
          to_wrench.received(message->header.stamp);
        },
        ros::VoidConstPtr(), no_delay);
  ros::Subscriber image, map;
  if (arguments.pictures) {
    const boost::function<void(const sensor_msgs::ImageConstPtr&)> see = [](const auto&) {};
    const boost::function<void(const nav_msgs::OccupancyGridConstPtr&)> see_map = [](const auto&) {};
    image = node.subscribe<sensor_msgs::Image>("stroke_image", 1, see);
    map = node.subscribe<nav_msgs::OccupancyGrid>("paper_map", 1, see_map);
  }
  const auto states_subscriber =
      node.subscribe<BrushState>("brush_state", 10, [&](const BrushStateConstPtr& message) {
        const std::lock_guard<std::mutex> lock(state_mutex);
        state = *message;
        ++states;
      });
  ros::Publisher publisher = node.advertise<geometry_msgs::PoseStamped>("handle_pose", 10000);
  ros::AsyncSpinner spinner(1);
  spinner.start();
  while (ros::ok() && (publisher.getNumSubscribers() == 0 || states < 2))
    ros::WallDuration(0.01).sleep();
  const auto stateNow = [&] {
    const int seen = states;
    while (ros::ok() && states < seen + 2) ros::WallDuration(0.01).sleep();
    const std::lock_guard<std::mutex> lock(state_mutex);
    return state;
  };
  const int process = findProcess(arguments.process.empty() ? arguments.simulator : arguments.process);
  const BrushState before = stateNow();

  const auto count = static_cast<std::int64_t>(arguments.seconds * arguments.rate);
  const std::int64_t warm =
      std::min<std::int64_t>(count / 10, static_cast<std::int64_t>(arguments.rate * 5));
  double processor = 0.0, memory = 0.0, own_processor = 0.0;
  std::int64_t late = 0;
  const ros::SteadyTime begin = ros::SteadyTime::now();
  ros::SteadyTime measured_from = begin;
  for (std::int64_t k = 0; k < count && ros::ok(); ++k) {
    const double time = static_cast<double>(k) / arguments.rate;
    const double left = time - (ros::SteadyTime::now() - begin).toSec();
    if (left > 0.0) ros::WallDuration(left).sleep();
    if (left < -0.004) ++late;
    if (k == warm) {
      processor = processorSeconds(process);
      own_processor = processorSeconds(getpid());
      memory = residentMegabytes(process);
      measured_from = ros::SteadyTime::now();
    }
    // Where the hand is at the stamp, however late this turn of the loop is.
    HandlePose pose = poseAt((ros::SteadyTime::now() - begin).toSec(), arguments.tip_length);
    pose.stamp_ns = toNanoseconds(ros::Time::now());
    if (k >= warm) {
      to_markers.sent(pose.stamp_ns);
      to_wrench.sent(pose.stamp_ns);
    }
    publisher.publish(toPoseStamped(pose, "paper"));
  }
  const double wall = (ros::SteadyTime::now() - measured_from).toSec();
  to_markers.stop();  // what is shown last, after the last pose, waits for its turn at marker_rate
  processor = processorSeconds(process) - processor;
  own_processor = processorSeconds(getpid()) - own_processor;
  const double memory_after = residentMegabytes(process);
  ros::WallDuration(0.5).sleep();
  const BrushState after = stateNow();
  spinner.stop();
  const auto taken = static_cast<std::int64_t>(after.poses_accepted - before.poses_accepted);
  const auto refused = static_cast<std::int64_t>(after.poses_refused - before.poses_refused);
  std::printf("%.0f Hz, %.0f s: sent %lld, accepted %lld, refused %lld, lost %lld; sender late %lld\n",
              arguments.rate, arguments.seconds, static_cast<long long>(count),
              static_cast<long long>(taken), static_cast<long long>(refused),
              static_cast<long long>(count - taken - refused), static_cast<long long>(late));
  if (arguments.markers) to_markers.print("tip_markers");
  if (arguments.wrench) to_wrench.print("handle_wrench");
  std::printf(
      "  simulator    %.1f %% of a core, %.1f MB, %+.2f MB since the first tenth; this tool %.1f %%\n",
      100.0 * processor / wall, memory_after, memory_after - memory, 100.0 * own_processor / wall);
}

}  // namespace

int main(int argc, char** argv) try {
  Arguments arguments;
  ros::init(argc, argv, "latency", ros::init_options::AnonymousName);
  po::options_description options("Options");
  options.add_options()("help", "this text")("rate", po::value(&arguments.rate), "poses a second [Hz]")(
      "seconds", po::value(&arguments.seconds), "how long [s]")(
      "markers", po::bool_switch(&arguments.markers), "watch tip_markers")(
      "wrench", po::bool_switch(&arguments.wrench), "watch handle_wrench")(
      "pictures", po::bool_switch(&arguments.pictures), "watch stroke_image and paper_map")(
      "process", po::value(&arguments.process), "node whose process is measured: a nodelet's manager")(
      "tip-length", po::value(&arguments.tip_length), "of the brush [m]");
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, options), values);
  po::notify(values);
  if (values.count("help") != 0) {
    std::cout << "usage: latency [options]\n\nMeasures a running brush_simulator.\n\n" << options;
    return 0;
  }
  if (!(arguments.rate >= 1.0 && arguments.rate <= 10000.0) ||
      !(arguments.seconds >= 1.0 && arguments.seconds <= 1e6))
    throw std::runtime_error("--rate must be in [1, 10000] Hz and --seconds in [1, 1e6] s");
  measure(arguments);
} catch (const std::exception& error) {
  std::cerr << "latency: " << error.what() << "\n";
  return 1;
}
