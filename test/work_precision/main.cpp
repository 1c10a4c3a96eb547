// Time against error of every integrator. `work_precision --help` says more.
#include <cstdio>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>

#include "work_precision.h"

using namespace calligraphy_brush::work_precision;

namespace {

constexpr const char* kHelp =
    "usage: work_precision [FILE.csv] [--long]\n"
    "       work_precision --peers\n"
    "       work_precision --coupled\n\n"
    "Runs a rod let go under gravity, pressed, dragged and slammed with every scheme, time step,\n"
    "number of nodes and precision, and writes time and error of each to FILE.csv (default:\n"
    "work_precision.csv), of which test/work_precision/plot.py makes a picture. Some minutes; with\n"
    "--long, finer steps and more nodes, an hour or so. --peers prints the figures of the scene that\n"
    "other simulators were measured on, --coupled those of a wet tip by rounds of coupling.\n";

}  // namespace

int main(int count, char** values) try {
  std::string path = "work_precision.csv";
  bool all = false, peers = false, coupled = false;
  for (int i = 1; i < count; ++i) {
    const std::string argument = values[i];
    if (argument == "--help") {
      std::cout << kHelp;
      return 0;
    }
    if (argument == "--long")
      all = true;
    else if (argument == "--peers")
      peers = true;
    else if (argument == "--coupled")
      coupled = true;
    else if (argument.rfind("-", 0) == 0)
      throw std::invalid_argument("unknown argument " + argument);
    else
      path = argument;
  }
  if (peers) {
    std::printf("%-15s %-7s %12s %14s %10s %14s %16s\n", "scheme", "numbers", "us/rod-step",
                "settled mm", "rms mm", "undamped mm", "reference mm");
    for (const Peers& row : runPeers(std::cerr))
      std::printf("%-15s %-7s %12.3f %14.4f %10.4f %14.4f %16.4f\n", row.scheme.c_str(),
                  row.precision.c_str(), row.us_per_rod_step, 1e3 * row.settled_error,
                  1e3 * row.rms_error, 1e3 * row.undamped_error, 1e3 * row.reference_error);
    return 0;
  }
  if (coupled) {
    std::printf("%6s %12s %8s %6s %12s %8s %8s\n", "rounds", "tolerance um", "shift um", "taken",
                "us/rod-step", "rms mm", "max mm");
    for (const Coupled& row : runCoupled(std::cerr))
      std::printf("%6d %12.2g %8.2g %6.2f %12.2f %8.3f %8.3f\n", row.rounds, 1e6 * row.tolerance,
                  1e6 * row.shift, row.mean_rounds, row.us_per_rod_step, 1e3 * row.rms_error,
                  1e3 * row.max_error);
    return 0;
  }
  std::ofstream file(path);
  if (!file) throw std::runtime_error("cannot write " + path);
  writeCsv(run(all ? longGrid() : defaultGrid(), std::cerr), file);
  if (!file.flush()) throw std::runtime_error("cannot write " + path);
  return 0;
} catch (const std::exception& problem) {
  std::cerr << "work_precision: " << problem.what() << "\n";
  return 1;
}
