#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <sstream>
#include <string>
#include <vector>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/sim/rod_step.h"
#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/sim/tuft.h"
#include "standard_stroke.h"

/// Times of one kernel iteration, of the rods' step and of the whole simulator's, and of the baseline.
///
/// Counters of every benchmark:
///   us_per_rod_step          time over rods and steps [µs]
///   iterations_per_rod_step  Newton iterations of a rod in a step; of the baseline: projections
///   real_time_factor         simulated over elapsed time, for all rods together
///   ratio_to_baseline        time of the baseline over ours, per rod and simulated time, each at its
///                            own step; the baseline is timed in the same process
///   unconverged              part of the rod-steps that ended at max_iterations
/// Of rods that are coupled: rounds of a step, and `late`, the part of the steps
/// that ended before all beliefs were within the tolerance.
/// The simulator's have each stage's time over rods and steps as well [µs].
///
/// With one thread all times are processor time, which other programs disturb least; with more they
/// are those of a clock on the wall.
namespace calligraphy_brush {
namespace {

double secondsOf(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

class StopWatch {
 public:
  explicit StopWatch(int threads)
      : clock_(threads == 1 ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC), begin_(secondsOf(clock_)) {}
  double seconds() const { return secondsOf(clock_) - begin_; }

 private:
  clockid_t clock_;
  double begin_;
};

/// What one or more runs of a scene took.
struct Cost {
  double seconds = 0.0;
  double simulated = 0.0;  // [s]
  double rod_steps = 0.0;
  double iterations = 0.0;
  double unconverged = 0.0;
};

/// A brush and the poses of its handle at any time.
struct Scene {
  BrushModel brush;
  ContactParameters contact;
  double duration = 0.0;
  double explicit_step = 0.0;  // of the baseline [s]
  Eigen::Isometry3d (*pose)(double t) = nullptr;
};

/// The step that the baseline goes at: nine tenths of 2/ω_max of a long uniform rod with edges l. On the
/// stroke, where rods bend and touch, 16 nodes are stable at 0.95 and not at 1.
double explicitStep(const RodModel& rod) {
  const double l = rod.length / (rod.nodeCount() - 1);
  return 0.9 * 0.5 * l * std::sqrt(rod.node_mass[1] * l / rod.bending_stiffness[1]);
}

Scene standardStroke(int rods, int nodes) {
  Scene scene;
  scene.brush = StandardStroke::brush(rods, nodes);
  scene.duration = StandardStroke::kDuration;
  scene.explicit_step = explicitStep(scene.brush.rods.front());
  scene.pose = [](double t) { return StandardStroke::pose(t); };
  return scene;
}

/// Rods of weight 20 EI/L² fall from straight and horizontal; no sheet.
Scene freeRelease(int rods) {
  Scene scene;
  const double bending =
      StandardStroke::kLineDensity * 9.81 * std::pow(StandardStroke::kLength, 3) / 20.0;
  const RodModel rod =
      makeUniformRod(StandardStroke::kLength, bending, StandardStroke::kLineDensity, 10);
  scene.brush.tip_length = rod.length;
  scene.brush.rods.assign(static_cast<std::size_t>(rods), rod);
  scene.contact.paper = false;
  scene.duration = 1.0;
  scene.explicit_step = explicitStep(rod);
  scene.pose = [](double) {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    X.linear() = Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()).toRotationMatrix();
    return X;
  };
  return scene;
}

/// Runs the rods of a scene once and adds what it took.
void run(const Scene& scene, const RodParameters& rods, Tuft& tuft, Cost& cost) {
  const int steps = static_cast<int>(scene.duration / rods.time_step);
  std::vector<Eigen::Isometry3d> poses;
  for (int step = 0; step <= steps; ++step) poses.push_back(scene.pose(step * rods.time_step));
  tuft.place(poses.front());
  const StopWatch watch(rods.threads);
  for (int step = 1; step <= steps; ++step) {
    const TuftReport report = tuft.step(poses[static_cast<std::size_t>(step)]);
    cost.rod_steps += report.solved_rods;
    cost.iterations += report.iterations;
    cost.unconverged += report.unconverged;
  }
  cost.seconds += watch.seconds();
  cost.simulated += steps * rods.time_step;
}

RodParameters baselineParameters(const Scene& scene) {
  RodParameters rods;
  rods.scheme = "projection";
  rods.bending_law = "tangent";
  rods.time_step = scene.explicit_step;
  return rods;
}

/// Time of the baseline for one rod and one simulated second [s]: the median of three runs, done at
/// the first call for a scene.
double baselineCost(const std::string& name, const Scene& scene) {
  static std::map<std::string, double> known;
  const auto found = known.find(name);
  if (found != known.end()) return found->second;
  const RodParameters rods = baselineParameters(scene);
  const auto tuft = makeTuft(scene.brush, rods, scene.contact);
  std::vector<double> costs;
  for (int repetition = 0; repetition < 3; ++repetition) {
    Cost cost;
    run(scene, rods, *tuft, cost);
    costs.push_back(cost.seconds / cost.simulated / static_cast<double>(scene.brush.rods.size()));
  }
  std::sort(costs.begin(), costs.end());
  return known[name] = costs[1];
}

// Rods do not see each other, so the baseline takes as long a rod for three as for a thousand.
constexpr int kBaselineRods = 3;

double strokeBaseline(int nodes) {
  return baselineCost("stroke/" + std::to_string(nodes), standardStroke(kBaselineRods, nodes));
}
double releaseBaseline() {
  return baselineCost("release", freeRelease(kBaselineRods));
}

void writeCounters(benchmark::State& state, const Cost& cost, int rods, double baseline) {
  state.counters["us_per_rod_step"] = 1e6 * cost.seconds / cost.rod_steps;
  state.counters["iterations_per_rod_step"] = cost.iterations / cost.rod_steps;
  state.counters["real_time_factor"] = cost.simulated / cost.seconds;
  state.counters["ratio_to_baseline"] = baseline / (cost.seconds / cost.simulated / rods);
  state.counters["unconverged"] = cost.unconverged / cost.rod_steps;
}

/// How the rods are computed.
struct Method {
  std::string precision, instruction_set;
  int threads = 1;
  double time_step = 0.002;  // [s]

  RodParameters parameters() const {
    RodParameters rods;
    rods.precision = precision;
    rods.instruction_set = instruction_set;
    rods.threads = threads;
    rods.time_step = time_step;
    return rods;
  }
  std::string name() const {
    std::ostringstream text;
    text << precision << "/" << instruction_set << "/threads:" << threads
         << "/step_ms:" << 1e3 * time_step;
    return text.str();
  }
};

void timeTuft(benchmark::State& state, const Scene& scene, const RodParameters& rods, double baseline) {
  const auto tuft = makeTuft(scene.brush, rods, scene.contact);
  Cost cost;
  for (auto _ : state) {
    const double before = cost.seconds;
    run(scene, rods, *tuft, cost);
    state.SetIterationTime(cost.seconds - before);
  }
  writeCounters(state, cost, static_cast<int>(scene.brush.rods.size()), baseline);
}

/// The whole simulator with its ink, driven as by a tablet at 125 Hz.
void timeSimulator(benchmark::State& state, int rods, int nodes, const Method& method) {
  constexpr std::int64_t kPoseInterval_ns = 8000000;
  SimulatorParameters parameters;
  parameters.rods = method.parameters();
  Simulator simulator(parameters, StandardStroke::brush(rods, nodes));
  constexpr int kStages = static_cast<int>(Stage::kCount);
  Cost cost;
  double stages[kStages] = {};
  for (auto _ : state) {
    simulator.reset();
    const StopWatch watch(method.threads);
    for (int k = 0; 1e-9 * static_cast<double>(k * kPoseInterval_ns) <= StandardStroke::kDuration; ++k) {
      HandlePose pose;
      pose.stamp_ns = k * kPoseInterval_ns;
      pose.position = StandardStroke::position(1e-9 * static_cast<double>(pose.stamp_ns));
      pose.orientation = StandardStroke::orientation();
      simulator.addPose(pose);
      simulator.advance();
    }
    const double seconds = watch.seconds();
    state.SetIterationTime(seconds);
    const SimulatorReport& report = simulator.report();
    cost.seconds += seconds;
    cost.simulated += 1e-9 * static_cast<double>(simulator.time_ns());
    cost.rod_steps += static_cast<double>(report.rod_step_count);
    cost.iterations += static_cast<double>(report.iteration_count);
    cost.unconverged += static_cast<double>(report.unconverged_count);
    for (int stage = 0; stage < kStages; ++stage)
      stages[stage] += report.stage_seconds[static_cast<std::size_t>(stage)];
  }
  writeCounters(state, cost, rods, strokeBaseline(nodes));
  for (int stage = 0; stage < kStages; ++stage)
    state.counters[std::string(toString(static_cast<Stage>(stage))) + "_us"] =
        1e6 * stages[stage] / cost.rod_steps;
}

/// One batch of rods in the air on a handle that goes round: kernels alone. us_per_rod_step is a step of
/// one Newton iteration with all that goes before and after it; us_per_rod_iteration is what another
/// iteration adds.
template <class Real>
void timeKernel(benchmark::State& state, int nodes, const std::string& instruction_set) {
  const RodStepKernel& kernel = findRodStepKernel(instruction_set);
  const double h = 0.002;
  const BrushModel brush = StandardStroke::brush(kLanes, nodes);
  std::vector<int> all(kLanes);
  std::iota(all.begin(), all.end(), 0);
  const RodBatchModel<Real> model = makeRodBatchModel<Real>(brush.rods, all, ClampRule::kHalf);
  const StepCoefficients coefficients = bdf2(h, RodParameters{}.damping);
  const double pivot[3] = {};
  AlignedVector<Real> wrench(6 * kLanes);
  RodBatchWorkspace<Real> workspace = makeRodBatchWorkspace<Real>(nodes);

  // A round of 10 Hz, closed so that it can go on for ever.
  constexpr int kPeriod = 50;
  std::vector<RodBatchRoots<Real>> roots;
  const auto root = [&](int step, int lane, int i) {
    const double angle = 2.0 * M_PI * step / kPeriod;
    const Eigen::Vector3d shift(0.003 * std::cos(angle), 0.003 * std::sin(angle), 0.1);
    return (shift + brush.rods[static_cast<std::size_t>(lane)].root_H)[i];
  };
  for (int step = 0; step < kPeriod; ++step) {
    roots.push_back(makeRodBatchRoots<Real>());
    for (int lane = 0; lane < kLanes; ++lane)
      for (int i = 0; i < 3; ++i) {
        const auto at = static_cast<std::size_t>(i * kLanes + lane);
        const RodModel& rod = brush.rods[static_cast<std::size_t>(lane)];
        roots.back().position[at] = static_cast<Real>(root(step, lane, i));
        roots.back().displacement[at] = static_cast<Real>(root(step, lane, i) - root(step - 1, lane, i));
        roots.back().clamp[at] = static_cast<Real>(rod.direction_H[i] * rod.length / (nodes - 1));
      }
  }

  constexpr int kManyIterations = 5;
  double seconds[2] = {}, iterations[2] = {};
  Cost cost;
  for (auto _ : state) {
    const double before = seconds[0] + seconds[1];
    for (const int many : {0, 1}) {
      // Without a tolerance rods go on to where the processor's numbers end.
      const SolverSettings settings{0.0, many ? kManyIterations : 1, 1.0, 1};
      RodBatchState<Real> rods = makeRodBatchState(model);
      placeAtRest<Real>(model, roots.front(), rods, nullptr);
      const StopWatch watch(1);
      SolveReport report;
      for (int step = 0; step < 10 * kPeriod; ++step) {
        report = kernel(RodStep<Real>{model, roots[static_cast<std::size_t>(step % kPeriod)],
                                      coefficients, settings, kTangentLaw, 9.81, pivot, nullptr, nullptr,
                                      rods, workspace, wrench.data()});
        iterations[many] += report.iterations;
      }
      seconds[many] += watch.seconds();
      if (!many) {
        cost.rod_steps += 10.0 * kPeriod * kLanes;
        cost.simulated += 10.0 * kPeriod * h;
      }
    }
    state.SetIterationTime(seconds[0] + seconds[1] - before);
    cost.seconds = seconds[0];
    cost.iterations = iterations[0];
  }
  writeCounters(state, cost, kLanes, strokeBaseline(nodes));
  state.counters["us_per_rod_iteration"] =
      1e6 * (seconds[1] - seconds[0]) / (iterations[1] - iterations[0]);
}

/// A sheet of 0.3 m × 0.3 m at 8 px/mm that is wet all over, unevenly. percent_of_core is the time that
/// takes over that which goes by, tile_steps_per_s how many steps of its 5625 tiles it is.
void timeWetSheet(benchmark::State& state, double diffusivity) {
  PaperParameters parameters;
  parameters.px_per_mm = 8.0;
  parameters.diffusivity = diffusivity;
  Paper paper(parameters);
  for (int row = 0; row < paper.height_px(); ++row)
    for (int column = 0; column < paper.width_px(); ++column)
      paper.setInk(column, row, 2e-5 * (1.0 + 0.3 * std::sin(0.05 * column) * std::cos(0.04 * row)),
                   1e-5);
  constexpr double kCall = 0.016;
  constexpr int kCalls = 125;
  double seconds = 0.0, simulated = 0.0;
  const std::uint64_t before = paper.flowCount();
  for (auto _ : state) {
    const StopWatch watch(1);
    for (int call = 0; call < kCalls; ++call) paper.flow(kCall);
    const double took = watch.seconds();
    state.SetIterationTime(took);
    seconds += took;
    simulated += kCalls * kCall;
  }
  state.counters["percent_of_core"] = 100.0 * seconds / simulated;
  state.counters["tile_steps_per_s"] = static_cast<double>(paper.flowCount() - before) / simulated;
}

/// Rods of the medium brush, that touch and cling, and what their coupling takes besides. They are as
/// thick as there whatever their number: with more of them the tuft is wider.
void timeCoupled(benchmark::State& state, int rod_count, double ink, const RodParameters& rods) {
  Scene scene = standardStroke(rod_count, 16);
  SimulatorParameters medium;
  loadYamlParameters(findPreset("brushes", "medium"), medium);
  BrushParameters brush = medium.brush;
  const double more = static_cast<double>(rod_count) / brush.rod_count;
  brush.rod_count = rod_count;
  brush.hair_count = static_cast<int>(brush.hair_count * more);
  brush.root_diameter *= std::sqrt(more);
  scene.brush = makeBrush(brush);
  scene.contact = medium.contact;
  const auto tuft = makeTuft(scene.brush, rods, scene.contact);
  tuft->setInk(std::vector<double>(scene.brush.rods.size() * 16, ink));
  const int steps = static_cast<int>(scene.duration / rods.time_step);
  double seconds = 0.0, rounds = 0.0, late = 0.0, total = 0.0;
  for (auto _ : state) {
    (void)_;
    tuft->place(scene.pose(0.0));
    const StopWatch watch(rods.threads);
    for (int step = 1; step <= steps; ++step) {
      const TuftReport report = tuft->step(scene.pose(step * rods.time_step));
      rounds += report.coupling_rounds;
      late += report.coupling_error >= scene.contact.coupling_tolerance;
    }
    const double elapsed = watch.seconds();
    state.SetIterationTime(elapsed);
    seconds += elapsed;
    total += steps;
  }
  state.counters["us_per_rod_step"] = 1e6 * seconds / total / rod_count;
  state.counters["real_time_factor"] = total * rods.time_step / seconds;
  state.counters["rounds"] = rounds / total;
  state.counters["late"] = late / total;
}

bool processorHas(const std::string& instruction_set) {
  try {
    findRodStepKernel(instruction_set);
    return true;
  } catch (const std::invalid_argument&) {
    return false;
  }
}

template <class Function>
void add(const std::string& name, Function function) {
  benchmark::RegisterBenchmark(name.c_str(), function)->UseManualTime()->Unit(benchmark::kMillisecond);
}

void addBenchmarks() {
  const std::string best = findRodStepKernel("best").name;
  std::vector<std::string> sets;
  for (const char* set : {"avx512", "avx2", "baseline"})
    if (processorHas(set)) sets.push_back(set);

  for (const int nodes : {8, 10, 16, 32}) {
    const Scene scene = standardStroke(kBaselineRods, nodes);
    const RodParameters rods = baselineParameters(scene);
    std::ostringstream name;
    name << "projection/stroke/nodes:" << nodes << "/rods:" << kBaselineRods
         << "/step_ms:" << 1e3 * rods.time_step;
    add(name.str(),
        [=](benchmark::State& state) { timeTuft(state, scene, rods, strokeBaseline(nodes)); });
  }
  for (const char* diffusivity : {"1e-9", "1e-8", "1e-7", "6e-7"})
    add(std::string("sheet/wet/diffusivity:") + diffusivity,
        [=](benchmark::State& state) { timeWetSheet(state, std::stod(diffusivity)); });
  const Scene few = freeRelease(kBaselineRods);
  add("projection/release/nodes:10/rods:" + std::to_string(kBaselineRods), [=](benchmark::State& state) {
    timeTuft(state, few, baselineParameters(few), releaseBaseline());
  });

  for (const int nodes : {8, 16, 32})
    for (const std::string& set : sets) {
      const std::string name = "kernel/nodes:" + std::to_string(nodes) + "/";
      add(name + "float/" + set, [=](benchmark::State& state) { timeKernel<float>(state, nodes, set); });
      add(name + "double/" + set,
          [=](benchmark::State& state) { timeKernel<double>(state, nodes, set); });
    }

  std::vector<Method> methods;
  for (const std::string& set : sets)
    for (const char* precision : {"float", "double"}) methods.push_back({precision, set});
  for (const char* precision : {"float", "double"}) {
    methods.push_back({precision, best, 2});
    methods.push_back({precision, best, 1, 0.001});
  }
  for (const int nodes : {8, 16, 32})
    for (const int rods : {3, 64, 256, 1024})
      for (const Method& method : methods) {
        const std::string name = "stroke/nodes:" + std::to_string(nodes) +
                                 "/rods:" + std::to_string(rods) + "/" + method.name();
        add("tuft/" + name, [=](benchmark::State& state) {
          timeTuft(state, standardStroke(rods, nodes), method.parameters(), strokeBaseline(nodes));
        });
        add("simulator/" + name,
            [=](benchmark::State& state) { timeSimulator(state, rods, nodes, method); });
      }
  for (const int rods : {64, 256, 1024})
    for (const double ink : {0.0, 1.0})
      for (const std::string& set : sets) {
        const Method method{"float", set, 1, 0.001};
        add("coupled/stroke/nodes:16/rods:" + std::to_string(rods) +
                "/ink:" + (ink > 0.0 ? "1/" : "0/") + method.name(),
            [=](benchmark::State& state) { timeCoupled(state, rods, ink, method.parameters()); });
      }
  for (Method method : methods) {
    if (method.time_step != 0.002) continue;
    method.time_step = 0.001;
    add("tuft/release/nodes:10/rods:256/" + method.name(), [=](benchmark::State& state) {
      timeTuft(state, freeRelease(256), method.parameters(), releaseBaseline());
    });
  }
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  calligraphy_brush::addBenchmarks();
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
