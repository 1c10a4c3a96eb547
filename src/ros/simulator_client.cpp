#include "calligraphy_brush/ros/simulator_client.h"

#include <ros/names.h>
#include <ros/param.h>
#include <ros/service.h>
#include <std_srvs/Trigger.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <exception>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "calligraphy_brush/files/yaml_parameters.h"

namespace calligraphy_brush {
namespace {

constexpr double kServiceTimeout = 2.0;  // [s]

/// Full names of the parameters that a file names.
std::set<std::string> namesIn(const std::string& file) {
  std::vector<std::string> problems;
  std::set<std::string> names;
  for (const YamlEntry& entry : readYamlEntries(file, problems)) names.insert(entry.key);
  return names;
}

std::set<std::string> namesIn(const std::map<std::string, std::string>& presets) {
  std::set<std::string> all;
  for (const auto& [name, file] : presets) all.merge(namesIn(file));
  return all;
}

/// Sets below `ns` what the preset names and deletes what only others of its kind do.
void sendPreset(const std::string& ns, const std::string& kind, const std::string& preset) {
  const std::string file = findPreset(kind, preset);
  SimulatorParameters parameters;
  loadYamlParameters(file, parameters);
  const auto own = namesIn(file);
  const auto any = namesIn(findPresets(kind));
  visitParameters(parameters, [&](const std::string& name, const auto& field, const auto&, const char*,
                                  const char*) {
    if (own.count(name) != 0)
      ros::param::set(ns + "/" + name, field);
    else if (any.count(name) != 0)
      ros::param::del(ns + "/" + name);
  });
}

}  // namespace

// ---------------------------------------------------------------- tasks

TaskThread::TaskThread() : thread_([this] { work(); }) {}

TaskThread::~TaskThread() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_closing_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void TaskThread::post(std::function<void()> task) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    waiting_.push_back(std::move(task));
  }
  wake_.notify_all();
}

void TaskThread::work() {
  for (;;) {
    std::function<void()> task;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [this] { return is_closing_ || !waiting_.empty(); });
      if (is_closing_) return;
      task = std::move(waiting_.front());
      waiting_.pop_front();
    }
    task();
  }
}

// ---------------------------------------------------------------- services

ServiceOutcome callTrigger(const std::string& service) {
  std_srvs::Trigger trigger;
  if (!ros::service::waitForService(service, ros::Duration(kServiceTimeout)))
    return {false, "nobody offers " + service};
  if (!ros::service::call(service, trigger)) return {false, service + " gave no answer"};
  if (trigger.response.success == 0) return {false, service + " failed: " + trigger.response.message};
  return {true, trigger.response.message};
}

ServiceOutcome applyPresets(const std::string& simulator, const std::string& brush,
                            const std::string& paper) {
  XmlRpc::XmlRpcValue before;
  const std::string ns = ros::names::resolve(simulator);
  const bool had_any = ros::param::get(ns, before);
  const auto putBack = [&] {
    if (had_any)
      ros::param::set(ns, before);
    else
      ros::param::del(ns);
  };
  try {
    if (!brush.empty()) sendPreset(ns, "brushes", brush);
    if (!paper.empty()) sendPreset(ns, "papers", paper);
  } catch (const std::exception& error) {
    putBack();
    return {false, error.what()};
  }
  ServiceOutcome outcome = callTrigger(ns + "/reset");
  if (!outcome.success) putBack();
  return outcome;
}

std::string matchPreset(const std::string& kind, const SimulatorParameters& parameters) {
  const auto presets = findPresets(kind);
  const auto names = namesIn(presets);
  const auto rows = listParameters(parameters);
  for (const auto& [preset, file] : presets) {
    SimulatorParameters other;
    loadYamlParameters(file, other);
    const auto other_rows = listParameters(other);
    bool is_equal = true;
    for (std::size_t k = 0; k < rows.size(); ++k)
      is_equal = is_equal && (names.count(rows[k].name) == 0 || rows[k].value == other_rows[k].value);
    if (is_equal) return preset;
  }
  return "";
}

}  // namespace calligraphy_brush
