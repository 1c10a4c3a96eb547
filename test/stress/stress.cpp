// Stress of the rods' step: a cell a line, over time steps, stiffness, nodes, friction, schemes and
// motions.
//   stress          a selection, a minute or two
//   stress --long   all of them, far longer
// Prints every cell that fails, a table of counts, and exits with their number (at most 100).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "../core/rod_scene.h"

using namespace calligraphy_brush;

namespace {

struct Cell {
  std::string motion, scheme, precision;
  double time_step, stiffness_scale, friction;
  int nodes;
};

struct Result {
  bool finite = true;
  double max_speed = 0.0;        // of a node [m/s]
  double max_penetration = 0.0;  // [m]
  double max_stretch = 0.0;      // of an edge over its length [1]
  long unconverged = 0, rod_steps = 0;
  double unconverged_part() const { return rod_steps ? double(unconverged) / double(rod_steps) : 0.0; }
};

double ramp(double t, double begin, double length) {
  return std::clamp((t - begin) / length, 0.0, 1.0);
}

/// Handle poses over time [s], for a tip of kReferenceLength.
const std::map<std::string, std::function<Eigen::Isometry3d(double, double)>>& motions() {
  static const double L = kReferenceLength;
  static const std::map<std::string, std::function<Eigen::Isometry3d(double, double)>> all{
      // 20 mm into the sheet in 20 ms, then 100 mm in 0.1 s.
      {"slam",
       [](double t, double) {
         return handleAt({0.1 * ramp(t, 0.04, 0.1), 0, L + 0.002 - 0.022 * ramp(t, 0, 0.02)}, 0.2);
       }},
      // Pressed flat and folded, then dragged backwards over itself.
      {"fold",
       [](double t, double) {
         return handleAt(
             {0.06 * ramp(t, 0.1, 0.05) - 0.12 * ramp(t, 0.15, 0.05), 0, L - 0.042 * ramp(t, 0, 0.08)},
             0.3);
       }},
      // Shaken at the highest frequency that the steps can show.
      {"shake",
       [](double t, double h) {
         return handleAt({0.001 * (std::llround(t / h) % 2 ? 1 : -1), 0, L - 0.008}, 0.2);
       }},
      {"spin",
       [](double t, double) {
         Eigen::Isometry3d X = handleAt({0, 0, L - 0.01}, 0.4);
         X.linear() =
             Eigen::AngleAxisd(40 * t, Eigen::Vector3d::UnitZ()).toRotationMatrix() * X.linear();
         return X;
       }},
      // Thrown about: 50 mm and half a turn from one step to the next.
      {"jump",
       [](double t, double) {
         return handleAt({t > 0.05 ? 0.05 : 0, 0, L - 0.01 + (t > 0.1 ? 0.03 : 0)},
                         t > 0.15 ? 3.0 : 0.1);
       }},
  };
  return all;
}

Result run(const Cell& cell) {
  RodParameters rods;
  rods.time_step = cell.time_step;
  rods.scheme = cell.scheme;
  rods.precision = cell.precision;
  ContactParameters contact;
  contact.paper_friction = cell.friction;
  BrushModel brush;
  // A stiff thick and a soft thin rod in one batch, and the reference rod between them.
  for (const double thick : {1.0, 100.0, 0.01}) {
    RodModel rod = makeUniformRod(kReferenceLength, cell.stiffness_scale * kReferenceBending * thick,
                                  kReferenceDensity * std::sqrt(thick), cell.nodes);
    rod.root_H = {0.001 * std::log10(thick), 0, 0};
    brush.rods.push_back(rod);
  }
  const auto tuft = makeTuft(brush, rods, contact);
  const auto& motion = motions().at(cell.motion);
  const double h = cell.time_step, edge = kReferenceLength / (cell.nodes - 1);
  Result result;
  tuft->place(motion(0, h));
  std::vector<std::vector<Eigen::Vector3d>> before(brush.rods.size()), now(brush.rods.size());
  for (int rod = 0; rod < static_cast<int>(now.size()); ++rod)
    tuft->readRod(rod, before[static_cast<std::size_t>(rod)]);
  for (int step = 1; step * h <= 0.25; ++step) {
    const TuftReport report = tuft->step(motion(step * h, h));
    result.unconverged += report.unconverged;
    result.rod_steps += report.solved_rods;
    for (std::size_t rod = 0; rod < now.size(); ++rod) {
      tuft->readRod(static_cast<int>(rod), now[rod]);
      for (std::size_t node = 0; node < now[rod].size(); ++node) {
        const Eigen::Vector3d& x = now[rod][node];
        result.finite = result.finite && x.allFinite();
        result.max_speed = std::max(result.max_speed, (x - before[rod][node]).norm() / h);
        if (node > 0) {
          result.max_penetration = std::max(result.max_penetration, -x.z());
          result.max_stretch =
              std::max(result.max_stretch, std::abs((x - now[rod][node - 1]).norm() / edge - 1));
        }
      }
      before[rod].swap(now[rod]);
    }
    if (!result.finite) break;
  }
  return result;
}

/// What every cell must keep. A handle that is thrown 50 mm in a step takes its tip along.
std::string verdict(const Cell& cell, const Result& r) {
  if (!r.finite) return "not finite";
  const double fastest = cell.motion == "jump" ? 4 * (0.05 + kReferenceLength) / cell.time_step
                                               : 60.0 + 0.01 / cell.time_step;
  if (r.max_speed > fastest) return "too fast";
  if (r.max_stretch > (cell.precision == "float" ? 1e-4 : 1e-10)) return "stretched";
  if (cell.motion != "jump" && r.max_penetration > 0.005) return "through the sheet";
  return "";
}

}  // namespace

int main(int argc, char** argv) {
  const bool all = argc > 1 && std::string(argv[1]) == "--long";
  if (argc > 1 && !all) {
    std::fprintf(stderr, "usage: stress [--long]\n");
    return 1;
  }
  const std::vector<double> steps = all ? std::vector<double>{5e-5, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2}
                                        : std::vector<double>{2e-4, 1e-3, 1e-2};
  const std::vector<double> scales =
      all ? std::vector<double>{1e-3, 1e-2, 0.1, 1, 10, 100, 1e3} : std::vector<double>{1e-3, 1, 1e3};
  const std::vector<double> frictions =
      all ? std::vector<double>{0, 0.3, 1, 5} : std::vector<double>{0, 0.3, 5};
  const std::vector<int> nodes = all ? std::vector<int>{3, 8, 16, 64, 200} : std::vector<int>{3, 16, 64};
  int cells = 0, failed = 0;
  std::printf("%-8s %-16s %-7s %6s %7s %6s %11s %10s %9s %s\n", "motion", "scheme", "", "cells",
              "failed", "", "unconverged", "penetr. mm", "speed m/s", "");
  for (const auto& [motion, _] : motions())
    for (const char* scheme : {"bdf2", "backward_euler", "sdirk2"})
      for (const char* precision : {"float", "double"}) {
        int here = 0, bad = 0;
        long unconverged = 0, rod_steps = 0;
        double deepest = 0, fastest = 0;
        for (const double time_step : steps)
          for (const double scale : scales)
            for (const double friction : frictions)
              for (const int node_count : nodes) {
                if (precision == std::string("float") && time_step < 5e-4) continue;  // double's ground
                const Cell cell{motion, scheme, precision, time_step, scale, friction, node_count};
                const Result r = run(cell);
                const std::string problem = verdict(cell, r);
                ++here;
                unconverged += r.unconverged;
                rod_steps += r.rod_steps;
                deepest = std::max(deepest, r.max_penetration);
                fastest = std::max(fastest, r.max_speed);
                if (problem.empty()) continue;
                ++bad;
                std::printf(
                    "FAILED %s: %s %s %s h=%g stiffness x%g mu=%g n=%d: speed %.3g m/s, penetration "
                    "%.3g m, stretch %.2g, unconverged %.2g\n",
                    problem.c_str(), motion.c_str(), scheme, precision, time_step, scale, friction,
                    node_count, r.max_speed, r.max_penetration, r.max_stretch, r.unconverged_part());
              }
        std::printf("%-8s %-16s %-7s %6d %7d %6s %10.4f%% %10.3f %9.1f\n", motion.c_str(), scheme,
                    precision, here, bad, "",
                    100.0 * double(unconverged) / double(std::max(1L, rod_steps)), 1e3 * deepest,
                    fastest);
        cells += here;
        failed += bad;
      }
  std::printf("%d cells, %d failed\n", cells, failed);
  return std::min(failed, 100);
}
