#include <time.h>

#include <algorithm>
#include <cmath>
#include <ostream>

#include "../benchmark/standard_stroke.h"
#include "calligraphy_brush/sim/tuft.h"
#include "work_precision.h"

namespace calligraphy_brush {
namespace work_precision {
namespace {

constexpr int kRods = 128;
constexpr double kStep = 1e-3;              // [s]
constexpr double kBegin = 0.3, kEnd = 1.2;  // of what is compared: pressed, dragged, lifted [s]

double processorSeconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Where the rods' ends are on average after every step.
struct Stroke {
  std::vector<Eigen::Vector3d> tips;
  double rounds = 0.0, us_per_rod_step = 0.0;
};

/// The standard stroke of benchmarks by a tuft that is full of ink, the handle shifted by so much [m].
Stroke write(int rounds, double tolerance, double shift) {
  BrushParameters brush;
  brush.rod_count = kRods;
  brush.hair_taper = 0.85;
  const BrushModel model = makeBrush(brush);
  RodParameters rods;
  rods.time_step = kStep;
  rods.threads = 1;
  ContactParameters contact;
  contact.bundles = true;
  contact.coupling_rounds = rounds;
  contact.coupling_tolerance = tolerance;
  const auto tuft = makeTuft(model, rods, contact);
  const auto poseAt = [&](double t) {
    Eigen::Isometry3d X = StandardStroke::pose(t);
    X.translation().x() += shift;
    return X;
  };
  const int last_node = model.rods.front().nodeCount() - 1;
  tuft->place(poseAt(0.0));
  tuft->setInk(std::vector<double>(model.rods.size() * static_cast<std::size_t>(last_node + 1), 1.0));
  Stroke stroke;
  const int steps = static_cast<int>(std::lround(kEnd / kStep));
  const double begin = processorSeconds();
  for (int step = 1; step <= steps; ++step) {
    const double t = step * kStep;
    stroke.rounds += static_cast<double>(tuft->step(poseAt(t)).coupling_rounds) / steps;
    Eigen::Vector3d tip(-shift, 0.0, 0.0);
    for (int rod = 0; rod < kRods; ++rod) tip += tuft->nodePosition(rod, last_node) / kRods;
    if (t >= kBegin) stroke.tips.push_back(tip);
  }
  stroke.us_per_rod_step = 1e6 * (processorSeconds() - begin) / (steps * kRods);
  return stroke;
}

}  // namespace

std::vector<Coupled> runCoupled(std::ostream& log) {
  log << "coupled: reference, 80 rounds\n";
  const Stroke reference = write(80, 3e-7, 0.0);
  const auto compare = [&](int rounds, double tolerance, double shift) {
    log << "coupled: " << rounds << " rounds\n";
    const Stroke stroke = write(rounds, tolerance, shift);
    Coupled row{rounds, tolerance, shift, stroke.rounds, stroke.us_per_rod_step, 0.0, 0.0};
    for (std::size_t i = 0; i < stroke.tips.size(); ++i) {
      const double error = (stroke.tips[i] - reference.tips[i]).norm();
      row.rms_error += error * error / static_cast<double>(stroke.tips.size());
      row.max_error = std::max(row.max_error, error);
    }
    row.rms_error = std::sqrt(row.rms_error);
    return row;
  };
  const ContactParameters defaults;
  const double none = 1e-12;  // all rounds that are allowed
  return {compare(80, 3e-7, 1e-6),
          compare(1, none, 0.0),
          compare(2, none, 0.0),
          compare(4, none, 0.0),
          compare(8, none, 0.0),
          compare(16, none, 0.0),
          compare(8, defaults.coupling_tolerance, 0.0)};
}

}  // namespace work_precision
}  // namespace calligraphy_brush
