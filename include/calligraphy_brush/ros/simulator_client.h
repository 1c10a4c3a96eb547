#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "calligraphy_brush/sim/simulator_parameters.h"

/// What drivers and panels ask of a running simulator.
namespace calligraphy_brush {

/// Runs tasks one after another in a thread of its own, so that neither a pose nor a window waits for an
/// answer. Those that have not begun when it is destroyed are dropped; one that runs is waited for.
class TaskThread {
 public:
  TaskThread();
  ~TaskThread();
  TaskThread(const TaskThread&) = delete;
  TaskThread& operator=(const TaskThread&) = delete;

  /// The task must not throw.
  void post(std::function<void()> task);

 private:
  void work();

  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::function<void()>> waiting_;
  bool is_closing_ = false;
  std::thread thread_;  // last: it uses the others
};

/// What came of asking.
struct ServiceOutcome {
  bool success = false;
  std::string message;  ///< what the service said, or why there is no answer
};

/// Calls a std_srvs/Trigger; waits up to 2 s for someone to offer it.
ServiceOutcome callTrigger(const std::string& service);

/// Gives a simulator another brush and sheet: presets, by name, go to its parameters, and ~reset makes
/// it take them. An empty name leaves that kind as it is.
///
/// Of the parameters that any preset of the kind names, those that this one does not name go back to
/// their defaults, so that nothing of the preset before is left; all others stay. When the simulator
/// refuses, the parameters are put back.
ServiceOutcome applyPresets(const std::string& simulator, const std::string& brush,
                            const std::string& paper);

/// Name of the preset of a kind ("brushes", "papers") that would give these parameters; empty if none.
std::string matchPreset(const std::string& kind, const SimulatorParameters& parameters);

}  // namespace calligraphy_brush
