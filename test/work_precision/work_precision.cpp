#include "work_precision.h"

#include <time.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <ostream>
#include <sstream>
#include <stdexcept>

#include "calligraphy_brush/common/lanes.h"
#include "calligraphy_brush/sim/tuft.h"

namespace calligraphy_brush {
namespace work_precision {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// The rod of the tables: 30 hairs of radius 40 µm, E = 3 GPa, 1300 kg/m³.
constexpr double kLength = 0.045;             // [m]
constexpr double kBending = 1.8095573685e-7;  // [N m²]
constexpr double kDensity = 1.960353816e-4;   // [kg/m]

constexpr double kSample = 0.005;  // times at which tips are compared are multiples of it [s]

using Row = std::map<std::string, double>;

/// All rows of test/reference/NAME.csv.
std::vector<Row> readTable(const std::string& name) {
  const std::string path =
      std::string(CALLIGRAPHY_BRUSH_SOURCE_DIR) + "/test/reference/" + name + ".csv";
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read " + path);
  std::vector<std::string> columns;
  std::vector<Row> rows;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream cells(line);
    std::vector<std::string> values;
    for (std::string cell; std::getline(cells, cell, ',');) values.push_back(cell);
    if (columns.empty()) {
      columns = values;
      continue;
    }
    Row row;
    for (std::size_t i = 0; i < values.size(); ++i) row[columns[i]] = std::stod(values[i]);
    rows.push_back(row);
  }
  return rows;
}

Row findRow(const std::string& table, const Row& wanted) {
  for (const Row& row : readTable(table))
    if (std::all_of(wanted.begin(), wanted.end(), [&row](const auto& field) {
          return std::abs(row.at(field.first) - field.second) < 1e-12;
        }))
      return row;
  throw std::runtime_error("no such row in " + table);
}

/// A handle at `position` that leans by `angle` [rad]: at π/2 an upright brush's hair points along +x.
Eigen::Isometry3d handleAt(const Eigen::Vector3d& position, double angle) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.translation() = position;
  X.linear() = Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return X;
}

double processorSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// What is simulated.
struct Scene {
  double duration = 0;  // [s]
  std::function<Eigen::Isometry3d(double)> pose;
  double bending = kBending;
  RodParameters rods;  // all but scheme, precision, time_step
  ContactParameters contact;
};

/// What came of it.
struct Motion {
  double seconds = 0;  // of processor time, for one rod
  int steps = 0;
  double unconverged = 0;
  std::vector<Eigen::Vector3d> tips;  // at kSample, 2 kSample, ...
  Eigen::Vector3d force = Eigen::Vector3d::Zero(), root = Eigen::Vector3d::Zero();
};

/// `rods` equal rods, so that all lanes have work; repeated until `least_seconds` have been measured.
Motion simulate(const Scene& scene, const std::string& scheme, const std::string& precision, int nodes,
                double time_step, int rods, double least_seconds) {
  RodParameters parameters = scene.rods;
  parameters.scheme = scheme;
  parameters.precision = precision;
  parameters.time_step = time_step;
  if (scheme == "projection") parameters.bending_law = "tangent";
  // As the node does it in float; in double solved so well that what is left is the scheme's.
  parameters.sleep = 0;  // nothing is skipped that is timed
  if (precision == "double") parameters.tolerance = 1e-13;
  BrushModel brush;
  brush.tip_length = kLength;
  brush.rods.assign(static_cast<std::size_t>(rods),
                    makeUniformRod(kLength, scene.bending, kDensity, nodes));
  const auto tuft = makeTuft(brush, parameters, scene.contact);

  Motion motion;
  const int every = std::max(1, static_cast<int>(std::lround(kSample / time_step)));
  motion.steps = static_cast<int>(std::lround(scene.duration / time_step));
  std::vector<Eigen::Isometry3d> poses;
  for (int step = 0; step <= motion.steps; ++step) poses.push_back(scene.pose(step * time_step));
  motion.seconds = std::numeric_limits<double>::max();
  double spent = 0;
  do {
    motion.tips.clear();
    double unconverged = 0;
    tuft->place(poses.front());
    double seconds = 0;
    for (int step = 1; step <= motion.steps;) {
      const double begin = processorSeconds();
      for (int last = std::min(motion.steps, step + every - 1); step <= last; ++step)
        unconverged += tuft->step(poses[static_cast<std::size_t>(step)]).unconverged;
      seconds += processorSeconds() - begin;
      motion.tips.push_back(tuft->nodePosition(0, nodes - 1));
      if (!motion.tips.back().allFinite()) break;
    }
    spent += seconds;
    motion.seconds = std::min(motion.seconds, seconds / rods);
    motion.unconverged = unconverged / motion.steps / rods;
  } while (spent < least_seconds);
  for (int node = 0; node < nodes; ++node) motion.force += tuft->contactForce(0, node);
  motion.root = tuft->nodePosition(0, 0);
  return motion;
}

/// Starts at rest, slows down exponentially: 0 .. 1 for s in 0 .. 1.
double part(double s) {
  return s <= 0 ? 0.0 : s < 1 ? 1 - std::exp(-30 * s * s) : 1.0;
}

constexpr double kTilt = kPi / 6, kDepth = 0.4;  // of press and drag, depth in L

Scene makeScene(const std::string& name) {
  Scene scene;
  if (name == "release") {
    // Of which the tables have the discrete rod's own motion: so the error is that in time alone.
    scene.duration = 0.5;
    scene.pose = [](double) { return handleAt({0, 0, 0}, kPi / 2); };
    scene.contact.paper = false;
    scene.rods.bending_law = "tangent";
    scene.rods.clamp = "half";
    scene.rods.damping = 20;
  } else if (name == "press" || name == "drag") {
    // Weightless and in a viscous medium, as the tables are of rods at rest.
    const bool drag = name == "drag";
    scene.duration = drag ? 1.2 : 0.6;
    scene.pose = [drag](double t) {
      const double down = part(t / 0.5), along = drag ? part((t - 0.5) / 0.5) : 0.0;
      return handleAt(
          {-0.2 * kLength * along, 0, kLength * (std::cos(kTilt) + 0.002 - (kDepth + 0.002) * down)},
          kTilt);
    };
    scene.contact.paper_friction = drag ? 0.2 : 0.0;
    scene.rods.gravity = 0;
    scene.rods.damping = 200;
  } else if (name == "slam") {
    // 20 mm into the sheet in 20 ms and 100 mm along it in 0.1 s. Leaning, and with the hair trailing:
    // an upright rod, or one that is pushed, buckles to a side that hangs on the last digit.
    scene.duration = 0.15;
    scene.pose = [](double t) {
      const double down = std::min(1.0, t / 0.02), along = std::clamp((t - 0.02) / 0.1, 0.0, 1.0);
      return handleAt({-0.1 * along, 0, kLength * std::cos(kTilt) + 0.001 - 0.021 * down}, kTilt);
    };
  } else {
    throw std::invalid_argument("unknown scene " + name);
  }
  return scene;
}

/// Root of the mean square distance of two ways of a tip, over the shorter one.
double rmsDistance(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  double sum = 0;
  const std::size_t count = std::min(a.size(), b.size());
  for (std::size_t i = 0; i < count; ++i) sum += (a[i] - b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(count));
}

/// The implicit second-order scheme that is not the one given: references are never made by the scheme
/// that they are for.
std::string otherScheme(const std::string& scheme) {
  return scheme == "sdirk2" ? "bdf2" : "sdirk2";
}

/// Sets error, force_error and reference of a cell.
class Judge {
 public:
  Judge(std::string scene, double reference_step) : name_(std::move(scene)), step_(reference_step) {}

  void operator()(const Motion& motion, Cell& cell, std::ostream& log) {
    cell.force_error = kNone;
    const bool finite = std::all_of(motion.tips.begin(), motion.tips.end(), [](const auto& tip) {
      return tip.allFinite() && tip.norm() < 10 * kLength + 1;
    });
    if (!finite) {
      cell.error = std::numeric_limits<double>::infinity();
      return;
    }
    if (name_ == "release") {
      const bool projection = cell.scheme == "projection";
      const std::string table = projection ? "release_first_edge" : "release";
      cell.reference = "table";
      for (const Row& row : readTable(table)) {
        if (row.at("nodes") != cell.nodes || row.at("damping") != 20 || row.at("t") > 0.5) continue;
        const auto at = static_cast<std::size_t>(std::lround(row.at("t") / kSample)) - 1;
        const Eigen::Vector3d tip = motion.tips.at(at);
        cell.error = std::max(cell.error,
                              std::hypot(tip.x() - row.at("tip_x"), tip.y(), tip.z() - row.at("tip_z")));
      }
    } else if (name_ == "press" || name_ == "drag") {
      const bool drag = name_ == "drag";
      Row wanted{{"tilt_deg", 30}, {"mu", drag ? 0.2 : 0.0}, {"gamma", 0}, {"depth", kDepth}};
      if (drag) wanted["direction"] = -1;
      const Row row = findRow(name_, wanted);
      cell.reference = "table";
      const Eigen::Vector3d tip = motion.tips.back() - motion.root;
      cell.error = std::hypot(tip.x() - row.at("tip_offset") * kLength, tip.y());
      cell.force_error =
          std::abs(motion.force.z() * kLength * kLength / kBending / row.at("normal_force") - 1);
    } else {
      // After a blow BDF2 bounces on; the two others come near each other.
      const std::string scheme = cell.scheme == "backward_euler" ? "sdirk2" : "backward_euler";
      cell.reference = scheme;
      if (!references_.count(scheme)) {
        log << name_ << ": reference by " << scheme << "\n";
        references_[scheme] =
            simulate(makeScene(name_), scheme, "double", kReferenceNodes, step_, 1, 0).tips;
        if (references_.size() == 2)
          log << name_ << ": the two references are "
              << 1e3 * rmsDistance(references_.begin()->second, references_.rbegin()->second)
              << " mm from each other\n";
      }
      cell.error = rmsDistance(motion.tips, references_[scheme]);
    }
  }

 private:
  static constexpr int kReferenceNodes = 64;
  std::string name_;
  double step_;
  std::map<std::string, std::vector<Eigen::Vector3d>> references_;
};

/// The stable limit of the explicit scheme [s]: 2/ω_max of a long uniform rod.
double explicitLimit(int nodes) {
  const double l = kLength / (nodes - 1);
  return 0.5 * l * l * std::sqrt(kDensity / kBending);
}

}  // namespace

Grid defaultGrid() {
  Grid grid;
  grid.scenes = {"release", "press", "drag", "slam"};
  grid.schemes = {"backward_euler", "bdf2", "sdirk2", "projection"};
  grid.precisions = {"float", "double"};
  grid.nodes = {10, 20, 32};
  grid.time_steps = {5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4};
  grid.explicit_time_steps = {5e-4, 2.5e-4, 1e-4, 5e-5, 2.5e-5};
  grid.least_seconds = 0.02;
  grid.reference_step = 2e-5;
  return grid;
}

Grid longGrid() {
  Grid grid = defaultGrid();
  grid.nodes = {8, 10, 16, 20, 32, 64};
  grid.time_steps = {5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 5e-5, 2e-5, 1e-5};
  grid.explicit_time_steps = {5e-4, 2.5e-4, 1e-4, 5e-5, 2.5e-5, 1e-5};
  grid.least_seconds = 0.1;
  grid.reference_step = 1e-5;
  return grid;
}

std::vector<Cell> run(const Grid& grid, std::ostream& log) {
  std::vector<Cell> cells;
  for (const std::string& name : grid.scenes) {
    const Scene scene = makeScene(name);
    Judge judge(name, grid.reference_step);
    for (const std::string& scheme : grid.schemes)
      for (const std::string& precision : grid.precisions)
        for (const int nodes : grid.nodes) {
          if (name == "release" && nodes != 10 && nodes != 20) continue;  // those of the table
          const bool projection = scheme == "projection";
          if (projection && precision == "float") continue;  // it has but one
          for (const double h : projection ? grid.explicit_time_steps : grid.time_steps) {
            if (projection && h > explicitLimit(nodes)) continue;
            Cell cell{name, scheme, precision, nodes, h, 0, 0, 0, 0, 0, ""};
            const Motion motion = simulate(scene, scheme, precision, nodes, h, projection ? 1 : kLanes,
                                           grid.least_seconds);
            cell.us_per_rod_step = 1e6 * motion.seconds / motion.steps;
            cell.us_per_rod_ms = 1e3 * motion.seconds / scene.duration;
            cell.unconverged = motion.unconverged;
            judge(motion, cell, log);
            cells.push_back(cell);
          }
        }
    log << name << ": done\n";
  }
  return cells;
}

void writeCsv(const std::vector<Cell>& cells, std::ostream& out) {
  out << "scene,scheme,precision,nodes,dt_ms,us_per_rod_step,us_per_rod_ms,error_mm,force_error,"
         "unconverged,reference\n";
  for (const Cell& cell : cells) {
    out << cell.scene << "," << cell.scheme << "," << cell.precision << "," << cell.nodes << ","
        << 1e3 * cell.time_step << "," << cell.us_per_rod_step << "," << cell.us_per_rod_ms << ",";
    // Empty: the run left all bounds; or the scene has no such number.
    if (std::isfinite(cell.error)) out << 1e3 * cell.error;
    out << ",";
    if (std::isfinite(cell.force_error)) out << cell.force_error;
    out << "," << cell.unconverged << "," << cell.reference << "\n";
  }
}

std::vector<Peers> runPeers(std::ostream& log) {
  Scene scene;
  scene.duration = 1.0;
  scene.pose = [](double) { return handleAt({0, 0, 0}, kPi / 2); };
  scene.contact.paper = false;
  scene.bending = kDensity * scene.rods.gravity * std::pow(kLength, 3) / 20;
  Scene undamped = scene;
  undamped.rods.damping = 0;
  Scene settling = scene;
  settling.duration = 3.0;
  settling.rods.damping = 40;
  const Row exact = findRow("heavy_cantilever", {{"clamp_angle_deg", 90}, {"gamma", 20}});

  // Fine in time and along the rod.
  const auto reference = [](const Scene& of, const std::string& scheme, int nodes, double h) {
    return simulate(of, scheme, "double", nodes, h, 1, 0).tips;
  };
  constexpr int kNodes = 10, kRods = 256, kFineNodes = 160;
  constexpr double kStep = 1e-3, kFineStep = 5e-5;
  std::map<std::string, std::vector<Eigen::Vector3d>> damped_tips, undamped_tips;
  std::vector<Peers> result;
  for (const std::string scheme : {"backward_euler", "bdf2", "sdirk2"})
    for (const std::string precision : {"float", "double"}) {
      Peers peers;
      peers.scheme = scheme;
      peers.precision = precision;
      const std::string other = otherScheme(scheme);
      if (!damped_tips.count(other)) {
        log << "peers: reference by " << other << "\n";
        damped_tips[other] = reference(scene, other, kFineNodes, kFineStep);
        undamped_tips[other] = reference(undamped, other, kFineNodes, kFineStep);
      }
      peers.reference_error =
          rmsDistance(damped_tips[other], reference(scene, other, kFineNodes / 2, 2 * kFineStep));
      const Motion motion = simulate(scene, scheme, precision, kNodes, kStep, kRods, 1.0);
      peers.us_per_rod_step = 1e6 * motion.seconds / motion.steps;
      peers.rms_error = rmsDistance(motion.tips, damped_tips[other]);
      peers.undamped_error = rmsDistance(simulate(undamped, scheme, precision, kNodes, kStep, 1, 0).tips,
                                         undamped_tips[other]);
      const Eigen::Vector3d tip = simulate(settling, scheme, precision, kNodes, kStep, 1, 0).tips.back();
      peers.settled_error = std::hypot(tip.x() - exact.at("tip_x") * kLength, tip.y(),
                                       tip.z() - exact.at("tip_z") * kLength);
      result.push_back(peers);
    }
  return result;
}

}  // namespace work_precision
}  // namespace calligraphy_brush
