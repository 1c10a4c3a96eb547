// Stress of the rods' step: motions that no hand makes, over time steps, stiffness, friction, nodes,
// schemes, precisions and both kernels.
//
//   stress                240 cells, spread over those of at most 40 000 nodes times steps, what
//                         lanes do to each other, 20 000 steps at rest: some seconds
//   stress --cells N      N cells, spread over the same
//   stress --wet          120 cells, spread likewise, of soaked hair that takes on half of its bend
//                         in 50 ms
//   stress --bundles [N]  100 or N cells, of at most 10 000 nodes of a rod times steps, of tufts
//                         whose rods touch, dry and full of ink
//   stress --long         all cells, and 10⁶ steps at rest: days
//   stress --projection   the original explicit method on the same motions, which it need not pass
//   stress --skips        what sleeping and the other skips save
//
// Prints every cell that fails and a table, and exits with 1 if one did that is not of a known kind.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>
#include <map>
#include <numeric>
#include <string>
#include <vector>

#include "../core/rod_scene.h"

using namespace calligraphy_brush;

namespace {

constexpr double kL = kReferenceLength;
constexpr double kDuration = 0.25;  // of a motion [s]

double ramp(double t, double begin, double length) {
  return std::clamp((t - begin) / length, 0.0, 1.0);
}

/// A handle's pose over time t [s], for a tip of kReferenceLength; h: the time step.
struct Motion {
  const char* name;
  std::function<Eigen::Isometry3d(double t, double h)> pose;
};

const std::vector<Motion>& motions() {
  static const std::vector<Motion> all{
      {"slam: 20 mm down in 20 ms, 100 mm along in 0.1 s",
       [](double t, double) {
         return handleAt({0.1 * ramp(t, 0.04, 0.1), 0, kL + 0.002 - 0.022 * ramp(t, 0, 0.02)}, 0.2);
       }},
      {"fold: pressed to 3 mm, drawn 60 mm on and 120 mm back over itself",
       [](double t, double) {
         return handleAt(
             {0.06 * ramp(t, 0.1, 0.05) - 0.12 * ramp(t, 0.15, 0.05), 0, kL - 0.042 * ramp(t, 0, 0.08)},
             0.3);
       }},
      {"flat: laid down level, turned round on the spot, lifted",
       [](double t, double) {
         Eigen::Isometry3d X =
             handleAt({0, 0, kL + 0.001 - 0.043 * ramp(t, 0, 0.05) + 0.06 * ramp(t, 0.2, 0.05)},
                      1.5 * ramp(t, 0, 0.05));
         X.linear() = Eigen::AngleAxisd(3.1 * ramp(t, 0.08, 0.1), Eigen::Vector3d::UnitZ()) * X.linear();
         return X;
       }},
      {"column: upright, pressed straight down",
       [](double t, double) {
         return handleAt({0, 0, kL + 0.002 - 0.032 * ramp(t, 0, 0.1)}, 0);
       }},
      {"shake: 2 mm from step to step, the highest frequency that there is",
       [](double t, double h) {
         return handleAt(
             {0.001 * (std::llround(t / h) % 2 ? 1 : -1), 0, kL + 0.003 - 0.011 * ramp(t, 0, 0.03)},
             0.2);
       }},
      {"spin: 40 rad/s about the vertical, leaning and pressed",
       [](double t, double) {
         Eigen::Isometry3d X = handleAt({0, 0, kL + 0.002 - 0.015 * ramp(t, 0, 0.04)}, 0.4);
         X.linear() = Eigen::AngleAxisd(40 * t, Eigen::Vector3d::UnitZ()) * X.linear();
         return X;
       }},
      {"jump: 50 mm, 30 mm and nearly half a turn, each in one step",
       [](double t, double) {
         return handleAt(
             {t > 0.05 ? 0.05 : 0, 0, kL + 0.002 - 0.012 * ramp(t, 0, 0.02) + (t > 0.1 ? 0.03 : 0)},
             t > 0.15 ? 3.0 : 0.1);
       }},
      {"buried: put down with its tip 10 mm below the sheet",
       [](double, double) {
         return handleAt({0, 0, kL - 0.01}, 0.2);
       }},
  };
  return all;
}

/// Instead of ink: rods that do not feel each other.
constexpr double kByThemselves = -1.0;

struct Cell {
  int motion;
  const char *scheme, *precision;
  bool framed;
  double time_step, stiffness_scale, friction;
  int nodes;
  double ink = kByThemselves;  // of rods that touch, 0..1
};

const std::vector<const char*> kSchemes{"bdf2", "backward_euler", "sdirk2"};
const std::vector<const char*> kPrecisions{"float", "double"};
const std::vector<double> kSteps{5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2};
const std::vector<double> kScales{1e-3, 1e-2, 0.1, 1, 10, 100, 1e3};
const std::vector<double> kFrictions{0, 0.1, 0.3, 1, 5};
const std::vector<int> kNodes{3, 4, 8, 16, 64, 200};
const std::vector<int> kNodesOfTufts{8, 16, 32};
const std::vector<double> kInks{0, 1};

/// Cell number `index`, one digit of it a choice.
Cell cellOf(long index, bool bundles) {
  const auto digit = [&index](std::size_t choices) {
    const auto here = static_cast<std::size_t>(index) % choices;
    index /= static_cast<long>(choices);
    return here;
  };
  Cell cell;
  cell.motion = static_cast<int>(digit(motions().size()));
  cell.scheme = kSchemes[digit(kSchemes.size())];
  cell.precision = kPrecisions[digit(kPrecisions.size())];
  cell.framed = digit(2) == 1;
  cell.time_step = kSteps[digit(kSteps.size())];
  cell.stiffness_scale = kScales[digit(kScales.size())];
  cell.friction = kFrictions[digit(kFrictions.size())];
  const std::vector<int>& nodes = bundles ? kNodesOfTufts : kNodes;
  cell.nodes = nodes[digit(nodes.size())];
  if (bundles) cell.ink = kInks[digit(kInks.size())];
  return cell;
}
long cellCount(bool bundles) {
  return static_cast<long>(motions().size() * kSchemes.size() * kPrecisions.size() * 2 * kSteps.size() *
                           kScales.size() * kFrictions.size() *
                           (bundles ? kNodesOfTufts.size() * kInks.size() : kNodes.size()));
}

/// A stiff thick and a soft thin rod, and the reference rod: all in one batch.
constexpr std::array<double, 3> kThickness{1.0, 100.0, 0.01};

/// Gives a rod that bends the same to all sides material frames.
void giveFrame(RodModel& rod) {
  rod.bending_stiffness_2 = rod.bending_stiffness;
  rod.twisting_stiffness = rod.bending_stiffness;
  for (double& stiffness : rod.twisting_stiffness) stiffness *= 0.7;
}

RodModel makeRod(double bending_scale, double density_scale, int nodes, bool framed,
                 double length = kL) {
  RodModel rod = makeUniformRod(length, bending_scale * kReferenceBending,
                                density_scale * kReferenceDensity, nodes);
  if (framed) giveFrame(rod);
  return rod;
}

/// The rods of a cell: three of different thickness, or a tuft in two batches.
BrushModel brushOf(const Cell& cell) {
  BrushModel brush;
  if (cell.ink == kByThemselves) {
    for (const double thick : kThickness) {
      RodModel rod = makeRod(cell.stiffness_scale * thick, std::sqrt(thick), cell.nodes, cell.framed);
      rod.root_H = {0.001 * std::log10(thick), 0, 0};
      brush.rods.push_back(rod);
    }
    return brush;
  }
  BrushParameters parameters;
  parameters.tip_length = kL;
  parameters.rod_count = 20;
  parameters.node_count = cell.nodes;
  brush = makeBrush(parameters);
  for (RodModel& rod : brush.rods) {
    for (double& stiffness : rod.bending_stiffness) stiffness *= cell.stiffness_scale;
    if (cell.framed) giveFrame(rod);
  }
  return brush;
}

/// A bend of curvature κ lets go of itself at about κ √(EI/ρA); κ = 20/L is a fold.
double elasticSpeed(const RodModel& rod) {
  // The node at the root stands for half an edge.
  const double density = 2.0 * rod.node_mass.front() / (rod.length / (rod.nodeCount() - 1));
  return 20 / kL * std::sqrt(rod.bending_stiffness.front() / density);
}

struct Result {
  bool finite = true;
  double speed_over_bound = 0.0;  // largest speed of a node over what it may be [1]
  double speed = 0.0;             // [m/s]
  double penetration = 0.0;       // [m]
  double silent = 0.0;            // penetration in a step that was reported as converged [m]
  double stretch = 0.0;           // of an edge over its length [1]
  double bend = 0.0;              // between the handle and the last edge [rad]
  long unconverged = 0, rod_steps = 0;
  double unconvergedPart() const { return rod_steps ? double(unconverged) / double(rod_steps) : 0.0; }
};

Result run(const Cell& cell, bool wet) {
  RodParameters rods;
  if (wet) {
    rods.wet_memory = 0.5;
    rods.wet_memory_time = 0.05;
  } else {
    rods.wet_memory = 0;
  }
  rods.time_step = cell.time_step;
  rods.scheme = cell.scheme;
  rods.precision = cell.precision;
  ContactParameters contact;
  contact.paper_friction = cell.friction;
  contact.bundles = cell.ink != kByThemselves;
  const BrushModel brush = brushOf(cell);
  std::vector<double> elastic_speed;
  // What a rod took on before, the other way, adds its part.
  for (const RodModel& rod : brush.rods)
    elastic_speed.push_back((1 + rods.wet_memory) * elasticSpeed(rod));
  const auto tuft = makeTuft(brush, rods, contact);
  const auto& pose = motions()[static_cast<std::size_t>(cell.motion)].pose;
  const double h = cell.time_step;
  Result result;
  Eigen::Isometry3d X_old = pose(0, h);
  tuft->place(X_old);
  tuft->setInk(std::vector<double>(brush.rods.size() * static_cast<std::size_t>(cell.nodes),
                                   wet ? 1.0 : std::max(0.0, cell.ink)));
  // What lies below the sheet is thrown out of it in a step, or in the first stage of one.
  double buried = 0.0;
  std::vector<std::vector<Eigen::Vector3d>> before(brush.rods.size()), now(brush.rods.size());
  for (std::size_t rod = 0; rod < now.size(); ++rod) {
    tuft->readRod(static_cast<int>(rod), before[rod]);
    buried = std::max(buried, -before[rod].back().z());
  }
  double handle_speed = buried / (0.29 * h);
  for (int step = 1; step * h <= kDuration * (1 + 1e-9); ++step) {
    const Eigen::Isometry3d X = pose(step * h, h);
    const double turn = Eigen::AngleAxisd(X.linear().transpose() * X_old.linear()).angle();
    handle_speed =
        std::max(handle_speed, ((X.translation() - X_old.translation()).norm() + turn * kL) / h);
    X_old = X;
    const TuftReport report = tuft->step(X);
    result.unconverged += report.unconverged;
    result.rod_steps += report.solved_rods;
    for (std::size_t rod = 0; rod < now.size(); ++rod) {
      tuft->readRod(static_cast<int>(rod), now[rod]);
      // A whip's end is several times as fast as its handle; and where a nearly straight rod takes back
      // in one step what contact/tolerance leaves along its axis, it goes sideways by √(2 δ L).
      const double bound = 10 * (handle_speed + std::sqrt(9.81 * kL)) + elastic_speed[rod] +
                           std::sqrt(2 * contact.tolerance * kL) / h;
      const double edge = brush.rods[rod].length / (cell.nodes - 1);
      double fastest = 0, lowest = 0;
      for (std::size_t node = 0; node < now[rod].size(); ++node) {
        const Eigen::Vector3d& x = now[rod][node];
        result.finite = result.finite && x.allFinite();
        fastest = std::max(fastest, (x - before[rod][node]).norm() / h);
        if (node == 0) continue;
        lowest = std::min(lowest, x.z());
        result.stretch = std::max(result.stretch, std::abs((x - now[rod][node - 1]).norm() / edge - 1));
      }
      result.speed = std::max(result.speed, fastest);
      result.speed_over_bound = std::max(result.speed_over_bound, fastest / bound);
      result.penetration = std::max(result.penetration, -lowest);
      if (report.unconverged == 0) result.silent = std::max(result.silent, -lowest);
      const Eigen::Vector3d last = (now[rod].back() - *(now[rod].end() - 2)).normalized();
      result.bend =
          std::max(result.bend, std::acos(std::clamp(-last.dot(X.linear().col(2)), -1.0, 1.0)));
      before[rod].swap(now[rod]);
    }
    if (!result.finite) break;
  }
  return result;
}

/// What a cell does not keep; empty if it keeps all.
std::string verdict(const Cell& cell, const Result& r) {
  if (!r.finite) return "not finite";
  if (r.speed_over_bound > 1) return "too fast";
  if (r.stretch > (cell.precision == std::string("float") ? 2e-5 : 1e-12) * (1 + cell.nodes / 16.0))
    return "stretched";
  if (r.penetration > 5e-4 + 0.2 * kL / (cell.nodes - 1)) return "through the sheet";
  // A step that calls itself converged is within contact/tolerance.
  if (r.silent > 3.1e-5) return "through the sheet unreported";
  return "";
}

/// Cells that are known to be too fast sometimes, in steps below what implicit schemes are for: rods of
/// few edges that wedge themselves between handle and sheet at a friction that no paper has, and break
/// loose in a step that is reported as not converged. They are shown and counted, and do not fail the
/// program.
///
/// Of tufts: at that friction, and soft ones in long steps, which go too deep or too fast in steps that
/// are reported as not converged.
bool isKnown(const Cell& cell, const std::string& problem) {
  if (cell.ink == kByThemselves)
    return problem == "too fast" && cell.time_step < 5e-4 && cell.friction >= 5 && cell.nodes <= 8;
  return (problem == "too fast" || problem == "through the sheet") &&
         (cell.friction >= 5 || (cell.stiffness_scale <= 0.1 && cell.time_step >= 5e-3));
}

/// A row of the table.
struct Row {
  int cells = 0, failed = 0;
  double penetration = 0, speed = 0, bend = 0;
  long unconverged = 0, rod_steps = 0;
  void add(const Result& r, bool bad) {
    ++cells;
    failed += bad;
    penetration = std::max(penetration, r.penetration);
    speed = std::max(speed, r.speed);
    bend = std::max(bend, r.bend);
    unconverged += r.unconverged;
    rod_steps += r.rod_steps;
  }
};

void print(const std::map<std::string, Row>& rows, const char* title) {
  std::printf(
      "| %s | cells | failed | deepest below the sheet, mm | fastest, m/s | largest bend, deg | not "
      "converged, reported |\n|---|---|---|---|---|---|---|\n",
      title);
  for (const auto& [name, row] : rows)
    std::printf("| %s | %d | %d | %.3g | %.3g | %.0f | %.3f %% |\n", name.c_str(), row.cells, row.failed,
                1e3 * row.penetration, row.speed, row.bend * 180 / 3.14159265358979,
                100.0 * double(row.unconverged) / double(std::max(1L, row.rod_steps)));
}

void printFailure(const Cell& cell, const Result& r, const std::string& problem) {
  std::printf(
      "FAILED %s: %.*s, %s %s%s%s, h = %g s, stiffness x %g, friction %g, n = %d: %.3g m/s (%.2g of "
      "the bound), %.3g m deep (%.3g m unreported), stretched by %.2g, %.3g unconverged\n",
      problem.c_str(),
      static_cast<int>(std::strcspn(motions()[static_cast<std::size_t>(cell.motion)].name, ":")),
      motions()[static_cast<std::size_t>(cell.motion)].name, cell.scheme, cell.precision,
      cell.framed ? " framed" : "",
      cell.ink == kByThemselves ? ""
      : cell.ink > 0            ? " wet"
                                : " dry",
      cell.time_step, cell.stiffness_scale, cell.friction, cell.nodes, r.speed, r.speed_over_bound,
      r.penetration, r.silent, r.stretch, r.unconvergedPart());
}

/// The number of cells that failed, of `wanted` spread over all.
int runCells(long wanted, double most_node_steps, bool wet, bool bundles) {
  const long all = cellCount(bundles);
  // A stride near the golden section, with no factor in common, visits them evenly.
  long stride = static_cast<long>(0.6180339887 * static_cast<double>(all));
  while (std::gcd(stride, all) != 1) ++stride;
  std::map<std::string, Row> by_motion, by_scheme, by_step, by_nodes, by_ink;
  int failed = 0, known = 0;
  long cells = 0;
  for (long k = 0; k < all && cells < wanted; ++k) {
    const Cell cell = cellOf(k * stride % all, bundles);
    if (kDuration / cell.time_step * cell.nodes > most_node_steps) continue;
    ++cells;
    const Result result = run(cell, wet);
    const std::string problem = verdict(cell, result);
    if (!problem.empty()) printFailure(cell, result, problem);
    const bool bad = !problem.empty(), is_known = isKnown(cell, problem);
    known += bad && is_known;
    failed += bad && !is_known;
    by_motion[motions()[static_cast<std::size_t>(cell.motion)].name].add(result, bad);
    by_scheme[std::string(cell.scheme) + ", " + cell.precision].add(result, !problem.empty());
    char label[32];
    std::snprintf(label, sizeof label, "%5.2f", 1e3 * cell.time_step);
    by_step[label].add(result, !problem.empty());
    std::snprintf(label, sizeof label, "%3d", cell.nodes);
    by_nodes[label].add(result, !problem.empty());
    if (bundles) by_ink[cell.ink > 0 ? "1" : "0"].add(result, !problem.empty());
  }
  std::printf("%ld of %ld cells, %d failed, %d more of the known kinds\n\n", cells, all, failed, known);
  print(by_motion, "motion");
  print(by_scheme, "scheme");
  print(by_step, "time step, ms");
  print(by_nodes, "nodes");
  if (bundles) print(by_ink, "ink");
  return failed;
}

/// A healthy rod alone, and the same rod in a batch with ones that no step can solve: what differs, if
/// anything does, in any bit of what it shows.
int runLanes() {
  int failed = 0, cells = 0;
  for (std::size_t motion = 0; motion < motions().size(); ++motion)
    for (const char* scheme : kSchemes)
      for (const char* precision : kPrecisions)
        for (const bool framed : {false, true}) {
          RodParameters rods;
          rods.scheme = scheme;
          rods.precision = precision;
          rods.max_iterations = 5;  // more do not help the others
          rods.sleep = 0;           // which begins when the last of a batch is at rest
          const ContactParameters contact;
          const RodModel healthy = makeRod(1, 1, 12, framed);
          BrushModel company = oneRod(healthy);
          // Far too stiff, far too soft, and far too long: that one is on the sheet when others are not.
          for (const double scale : {1e12, 1e-12}) company.rods.push_back(makeRod(scale, 1, 12, framed));
          company.rods.push_back(makeRod(1, 1, 12, framed, 1.5 * kL));
          const auto alone = makeTuft(oneRod(healthy), rods, contact),
                     together = makeTuft(company, rods, contact);
          const auto& pose = motions()[motion].pose;
          const double h = rods.time_step;
          alone->place(pose(0, h));
          together->place(pose(0, h));
          bool equal = true;
          for (int step = 1; step * h <= kDuration && equal; ++step) {
            alone->step(pose(step * h, h));
            together->step(pose(step * h, h));
            equal = alone->rodWrench(0) == together->rodWrench(0);
            for (int node = 0; node < 12; ++node)
              equal = equal && alone->nodePosition(0, node) == together->nodePosition(0, node) &&
                      alone->contactForce(0, node) == together->contactForce(0, node);
          }
          ++cells;
          failed += !equal;
          if (!equal)
            std::printf("FAILED a rod is not what it is alone: %s, %s %s%s\n", motions()[motion].name,
                        scheme, precision, framed ? " framed" : "");
        }
  std::printf("beside rods that no step can solve, a rod is what it is alone, to the bit: %d of %d\n\n",
              cells - failed, cells);
  return failed;
}

/// Pressed, leaning and stuck, and left alone for `steps` steps: how far any node strays from where it
/// had come to rest.
int runRest(long steps) {
  int failed = 0;
  for (const char* scheme : kSchemes)
    for (const char* precision : kPrecisions) {
      RodParameters rods;
      rods.scheme = scheme;
      rods.precision = precision;
      rods.sleep = 0;
      ContactParameters contact;
      contact.paper_friction = 0.5;
      const int nodes = 16;
      const auto tuft = makeTuft(referenceRod(nodes), rods, contact);
      tuft->place(handleAt({0, 0, kL}, 0.4));
      const auto pose = [](int step) {
        return handleAt({0.004 * ramp(step, 300, 300), 0, kL - 0.01 * ramp(step, 0, 300)}, 0.4);
      };
      for (int step = 1; step <= 5000; ++step) tuft->step(pose(step));
      std::vector<Eigen::Vector3d> rest, now;
      tuft->readRod(0, rest);
      double astray = 0;
      for (long step = 0; step < steps; ++step) {
        tuft->step(pose(5000));
        if (step % 1000 != 999) continue;
        tuft->readRod(0, now);
        for (int node = 0; node < nodes; ++node)
          astray = std::max(
              astray,
              (now[static_cast<std::size_t>(node)] - rest[static_cast<std::size_t>(node)]).norm());
      }
      const bool bad = !(astray < (precision == std::string("float") ? 1e-6 : 1e-12));
      failed += bad;
      std::printf("%sat rest for %ld steps, %s %s: within %.2g m\n", bad ? "FAILED " : "", steps, scheme,
                  precision, astray);
    }
  std::printf("\n");
  return failed;
}

/// Processor time of `steps` steps with the handle at X [s], the least of five.
double timeOf(const BrushModel& brush, const RodParameters& rods, const Eigen::Isometry3d& X,
              int steps) {
  const auto tuft = makeTuft(brush, rods, ContactParameters{});
  tuft->place(X);
  for (int step = 0; step < 3000; ++step) tuft->step(X);
  double least = INFINITY;
  for (int repetition = 0; repetition < 5; ++repetition) {
    const std::clock_t begin = std::clock();
    for (int step = 0; step < steps; ++step) tuft->step(X);
    least = std::min(least, double(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return least;
}

/// What is saved by what is not done: each skip beside the same scene without it.
void runSkips() {
  RodParameters awake;
  awake.sleep = 0;
  const RodParameters asleep;
  const auto sixteen = [](bool framed) {
    BrushModel brush;
    brush.rods.assign(16, makeRod(1, 1, 16, framed));
    return brush;
  };
  // One rod of sixteen is longer, and keeps the others from the kernel without contact.
  BrushModel one_touches = sixteen(false);
  one_touches.rods.back() = makeRod(1, 1, 16, false, 1.1 * kL);
  const Eigen::Isometry3d above = handleAt({0, 0, kL + 0.001}, 0.1),
                          on = handleAt({0, 0, kL - 0.005}, 0.3);
  const int steps = 20000;
  const double air = timeOf(sixteen(false), awake, above, steps),
               pressed = timeOf(sixteen(false), awake, on, steps);
  std::printf("| skipped | saves, of the step's time |\n|---|---|\n");
  const auto row = [](const char* name, double with, double without) {
    std::printf("| %s | %.1f %% |\n", name, 100 * (1 - with / without));
  };
  row("rods at rest on the sheet, asleep", timeOf(sixteen(false), asleep, on, steps), pressed);
  row("rods at rest in the air, asleep", timeOf(sixteen(false), asleep, above, steps), air);
  row("the sheet, while no rod of a batch touches it", air, timeOf(one_touches, awake, above, steps));
  row("material frames of straight, isotropic, free rods", air,
      timeOf(sixteen(true), awake, above, steps));
}

/// The original method, each rod at its own largest stable step: for the record.
void runProjection() {
  std::map<std::string, Row> by_motion;
  for (int motion = 0; motion < static_cast<int>(motions().size()); ++motion)
    for (const double friction : kFrictions)
      for (const int nodes : {8, 16}) {
        // 0.9 of the limit 2/ω_max of the stiffest of the rods in a cell.
        const double edge = kL / (nodes - 1),
                     h = 0.45 * edge * edge *
                         std::sqrt(kReferenceDensity * 10 / (kReferenceBending * 100));
        const Cell cell{motion, "projection", "double", false, h, 1, friction, nodes};
        const Result result = run(cell, false);
        const std::string problem = verdict(cell, result);
        if (!problem.empty()) printFailure(cell, result, problem);
        by_motion[motions()[static_cast<std::size_t>(motion)].name].add(result, !problem.empty());
      }
  print(by_motion, "projection");
}

}  // namespace

int main(int argc, char** argv) {
  const std::string option = argc > 1 ? argv[1] : "";
  long cells = 240, rest = 20000;
  double most_node_steps = 40000;
  if (option == "--long" && argc == 2) {
    cells = cellCount(false);
    rest = 1000000;
    most_node_steps = INFINITY;
  } else if (option == "--cells" && argc == 3) {
    cells = std::clamp(std::atol(argv[2]), 1L, cellCount(false));
  } else if (option == "--wet" && argc == 2) {
    return runCells(120, most_node_steps, true, false) > 0 ? 1 : 0;
  } else if (option == "--bundles" && argc <= 3) {
    const long wanted = argc == 3 ? std::clamp(std::atol(argv[2]), 1L, cellCount(true)) : 100;
    return runCells(wanted, 0.25 * most_node_steps, false, true) > 0 ? 1 : 0;
  } else if (option == "--projection" && argc == 2) {
    runProjection();
    return 0;
  } else if (option == "--skips" && argc == 2) {
    runSkips();
    return 0;
  } else if (argc > 1) {
    std::fprintf(
        stderr, "usage: stress [--cells N | --wet | --bundles [N] | --long | --projection | --skips]\n");
    return 2;
  }
  const int failed = runLanes() + runRest(rest) + runCells(cells, most_node_steps, false, false);

  return failed > 0 ? 1 : 0;
}
