#pragma once

#include <iosfwd>
#include <string>
#include <vector>

namespace calligraphy_brush {
namespace work_precision {

/// How far a run goes.
struct Grid {
  std::vector<std::string> scenes, schemes, precisions;
  std::vector<int> nodes;
  std::vector<double> time_steps;           ///< of the implicit schemes [s]
  std::vector<double> explicit_time_steps;  ///< of the projection [s]
  double least_seconds;                     ///< that each cell is timed for [s]
  double reference_step;                    ///< of the solutions made here as a reference [s]
};

Grid defaultGrid();
Grid longGrid();  ///< finer and coarser steps, more nodes

/// One run of a rod.
struct Cell {
  std::string scene, scheme, precision;
  int nodes = 0;
  double time_step = 0;        ///< [s]
  double us_per_rod_step = 0;  ///< processor time over rods and steps [µs]
  double us_per_rod_ms = 0;    ///< over rods and simulated time [µs/ms]
  double error = 0;            ///< of the tip [m]; infinite: not finite
  double force_error = 0;      ///< of the normal force, relative; NaN: not of this scene
  double unconverged = 0;      ///< part of the steps that ended at max_iterations
  std::string reference;       ///< what the error is against
};

/// Runs every cell; progress goes to `log`.
std::vector<Cell> run(const Grid& grid, std::ostream& log);

void writeCsv(const std::vector<Cell>& cells, std::ostream& out);

/// The scene that other simulators were measured on: a rod of weight 20 B/L³ with 10 nodes, let go
/// horizontally, at 1 ms, with the settings that the node has by default.
struct Peers {
  std::string scheme, precision;
  double us_per_rod_step = 0;  ///< 256 rods, one thread [µs]
  double settled_error = 0;    ///< of the tip at rest against the exact elastica [m]
  double rms_error = 0;        ///< of the tip over the first second, damping as by default [m]
  double undamped_error = 0;   ///< the same without damping [m]
  double reference_error = 0;  ///< of the reference of rms_error, by another one half as fine [m]
};
std::vector<Peers> runPeers(std::ostream& log);

/// The standard stroke by 128 rods full of ink at 1 ms, with so many rounds of coupling: error of the
/// mean of the rods' ends while it is pressed, dragged and lifted, against 80 rounds to 0.3 µm.
struct Coupled {
  int rounds;                   ///< at most
  double tolerance;             ///< [m]
  double shift;                 ///< of the handle [m]: how much an error hangs on the last bits
  double mean_rounds;           ///< that were taken
  double us_per_rod_step;       ///< of the processor, on one thread
  double rms_error, max_error;  ///< [m]
};
std::vector<Coupled> runCoupled(std::ostream& log);

}  // namespace work_precision
}  // namespace calligraphy_brush
