#include "dynamics.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "chain_reference.h"
#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

/// The tip's way through equal time steps, and where it was between them.
class TipTrack {
 public:
  TipTrack(double dt, const Eigen::Vector3d& start) : dt_(dt), points_{start} {}
  void add(const Eigen::Vector3d& tip) { points_.push_back(tip); }

  /// By the cubic through the four nearest points, so that the error stays that of the scheme.
  TipAt at(double time) const {
    const int count = static_cast<int>(points_.size());
    const int used = std::min(4, count);
    const int first =
        std::max(0, std::min(static_cast<int>(std::floor(time / dt_ + 1e-9)) - 1, count - used));
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (int i = first; i < first + used; ++i) {
      double weight = 1;
      for (int j = first; j < first + used; ++j)
        if (j != i) weight *= (time / dt_ - j) / (i - j);
      sum += weight * points_[static_cast<std::size_t>(i)];
    }
    return {time, sum.x(), sum.z()};
  }

 private:
  double dt_;
  std::vector<Eigen::Vector3d> points_;
};

int stepCount(double duration, double dt) {
  return static_cast<int>(std::ceil(duration / dt - 1e-9));
}

}  // namespace

ModesResult modes(const ModesParameters& p) {
  // With L = B = 1 and unit density; rod j carries its load at node j + 1.
  const int free_nodes = p.nodes - 1;
  const RodModel rod = makeUniformRod(1.0, 1.0, 1.0, p.nodes);
  RodModel light = rod;  // so light that a time step all but minimises the energy
  for (double& mass : light.node_mass) mass *= 1e-6;
  BrushModel brush;
  brush.tip_length = 1.0;
  brush.rods.assign(static_cast<std::size_t>(free_nodes), light);
  const auto tuft = makeTuft(brush, exactRods(0.1, "backward_euler", p.precision), noPaper());
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, 0);
  tuft->place(X);
  // Turns of 1e-6: what is not linear in them is 1e-12 of what is.
  const double size = p.precision == "float" ? 1e-3 : 1e-6;
  Eigen::VectorXd load(free_nodes);
  for (int j = 0; j < free_nodes; ++j) {
    const double s = (j + 1.0) / free_nodes;
    load[j] = size / (s * s);
    tuft->setNodeForce(j, j + 1, {load[j], 0, 0});
  }

  ModesResult result;
  Eigen::MatrixXd way = Eigen::MatrixXd::Zero(free_nodes, free_nodes);
  const double rest = size * (p.precision == "float" ? 1e-4 : 1e-10);
  for (int step = 0; step < 1000 && !result.converged; ++step) {
    const TuftReport report = tuft->step(X);
    result.iterations += report.iterations;
    double moved = 0;
    for (int j = 0; j < free_nodes; ++j)
      for (int i = 0; i < free_nodes; ++i) {
        const double x = tuft->nodePosition(j, i + 1).x();
        moved = std::max(moved, std::abs(x - way(i, j)));
        way(i, j) = x;
      }
    result.converged = moved <= rest && report.unconverged == 0;
  }

  // Vibrations: x = −ω⁻² ... of flexibility times mass, made symmetric.
  Eigen::MatrixXd flexibility = way * load.cwiseInverse().asDiagonal();
  flexibility = (0.5 * (flexibility + flexibility.transpose())).eval();
  Eigen::VectorXd root_mass(free_nodes);
  for (int i = 0; i < free_nodes; ++i)
    root_mass[i] = std::sqrt(rod.node_mass[static_cast<std::size_t>(i + 1)]);
  const Eigen::MatrixXd dynamic = root_mass.asDiagonal() * flexibility * root_mass.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(dynamic, Eigen::EigenvaluesOnly);
  const double unit = std::sqrt(p.bending / p.line_density) / (p.length * p.length) / (2 * kPi);
  for (int mode = 0; mode < std::min(4, free_nodes); ++mode)
    result.frequencies_hz.push_back(unit / std::sqrt(solver.eigenvalues()[free_nodes - 1 - mode]));
  return result;
}

ReleaseResult release(const ReleaseParameters& p) {
  RodParameters rods = exactRods(p.dt, p.scheme, p.precision);
  rods.gravity = kStandardGravity;
  rods.damping = p.damping;
  const RodModel model = makeUniformRod(p.length, p.bending, p.line_density, p.nodes);
  SingleRod rod(model, rods, noPaper());
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, kPi / 2);
  rod.place(X);
  TipTrack track(p.dt, rod.tip());
  for (int step = stepCount(p.duration, p.dt); step > 0; --step) {
    rod.step(X);
    track.add(rod.tip());
  }

  std::vector<double> times;
  for (const double time :
       {0.005, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0})
    if (time < p.duration) times.push_back(time);
  times.push_back(p.duration);

  PlanarChain exact;
  exact.link = p.length / (p.nodes - 1);
  exact.mass = model.node_mass;
  exact.joint.assign(static_cast<std::size_t>(p.nodes - 1), p.bending / exact.link);
  exact.joint[0] *= 2;  // half a Voronoi length at the clamp
  double held = 0;
  if (p.scheme == "projection") {  // which holds the first edge
    held = exact.link;
    exact.mass.erase(exact.mass.begin());
    exact.joint.erase(exact.joint.begin());
  }
  exact.gravity = kStandardGravity;
  exact.damping = p.damping;

  ReleaseResult result;
  for (const double time : times) result.tip.push_back(track.at(time));
  const std::vector<TipAt> reference = solvePlanarChain(exact, times);
  if (reference.empty()) result.max_error = kNone;
  for (std::size_t i = 0; i < reference.size(); ++i)
    result.max_error = std::max(result.max_error, std::hypot(result.tip[i].x - reference[i].x - held,
                                                             result.tip[i].z - reference[i].z));
  result.converged = rod.allSolved();
  result.iterations = rod.iterations();
  return result;
}

ChainResult chain(const ChainParameters& p) {
  const double length = 1.0, node_mass = 1.0 / (p.nodes - 1);
  RodParameters rods = exactRods(p.dt, p.scheme, p.precision);
  rods.gravity = kStandardGravity;
  RodModel model = makeUniformRod(length, 0.0, 1.0, p.nodes);
  std::fill(model.node_mass.begin(), model.node_mass.end(), node_mass);
  SingleRod rod(model, rods, noPaper());
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, kPi / 2);
  rod.place(X);
  TipTrack track(p.dt, rod.tip());
  const auto shape = [&] {
    std::vector<Eigen::Vector3d> nodes;
    for (int node = 1; node < p.nodes; ++node) nodes.push_back(rod.node(node));
    return nodes;
  };
  std::vector<Eigen::Vector3d> before = shape(), before_that = before, now = before;
  for (int step = stepCount(1.0, p.dt); step > 0; --step) {
    rod.step(X);
    track.add(rod.tip());
    before_that.swap(before);
    before.swap(now);
    now = shape();
  }
  ChainResult result;
  for (const double time : {0.1, 0.5, 1.0}) result.tip.push_back(track.at(time));
  // Velocities as the scheme defines them. At the start there was neither height nor speed.
  for (std::size_t i = 0; i < now.size(); ++i) {
    const Eigen::Vector3d velocity =
        p.scheme == "bdf2"
            ? Eigen::Vector3d((1.5 * now[i] - 2 * before[i] + 0.5 * before_that[i]) / p.dt)
            : Eigen::Vector3d((now[i] - before[i]) / p.dt);
    result.energy_drift +=
        node_mass * (0.5 * velocity.squaredNorm() / kStandardGravity + now[i].z()) / length;
  }
  result.converged = rod.allSolved();
  result.iterations = rod.iterations();
  return result;
}

SlamResult slam(const SlamParameters& p) {
  RodParameters rods;
  rods.time_step = p.dt;
  rods.scheme = p.scheme;
  rods.precision = p.precision;
  ContactParameters contact;
  contact.bundles = p.bundles;
  BrushModel brush;
  if (p.bundles) {
    BrushParameters parameters;
    parameters.tip_length = kReferenceLength;
    parameters.rod_count = 30;
    parameters.node_count = p.nodes;
    brush = makeBrush(parameters);
    for (RodModel& rod : brush.rods)
      for (double& stiffness : rod.bending_stiffness) stiffness *= p.stiffness_scale;
  } else {
    brush.tip_length = kReferenceLength;
    brush.rods = {makeUniformRod(kReferenceLength, kReferenceBending * p.stiffness_scale,
                                 kReferenceDensity, p.nodes)};
  }
  const auto tuft = makeTuft(brush, rods, contact);
  const auto pose = [](double time) {
    const double down = std::min(1.0, time / 0.02);
    const double along = std::max(0.0, std::min(1.0, (time - 0.02) / 0.1));
    return handleAt({0.1 * along, 0, kReferenceLength + 0.001 - 0.02 * down},
                    (-5 + 75 * along) * kPi / 180);
  };

  SlamResult result;
  result.converged = true;
  tuft->place(pose(0));
  tuft->setInk(std::vector<double>(brush.rods.size() * static_cast<std::size_t>(p.nodes), p.ink));
  std::vector<std::vector<Eigen::Vector3d>> before(brush.rods.size()), now = before;
  for (std::size_t rod = 0; rod < before.size(); ++rod)
    tuft->readRod(static_cast<int>(rod), before[rod]);
  const int steps = std::max(1, stepCount(0.17, p.dt));
  for (int step = 1; step <= steps; ++step) {
    const Eigen::Isometry3d X = pose(step * p.dt);
    const TuftReport report = tuft->step(X);
    result.iterations += report.iterations;
    result.converged = result.converged && report.unconverged == 0;
    for (std::size_t rod = 0; rod < now.size(); ++rod) {
      tuft->readRod(static_cast<int>(rod), now[rod]);
      const double edge = brush.rods[rod].length / (p.nodes - 1);
      Eigen::Vector3d direction = Eigen::Vector3d::Zero();
      for (std::size_t node = 0; node < now[rod].size(); ++node) {
        const Eigen::Vector3d& at = now[rod][node];
        result.finite = result.finite && at.allFinite();
        result.max_speed = std::max(result.max_speed, (at - before[rod][node]).norm() / p.dt);
        result.max_penetration = std::max(result.max_penetration, -at.z());
        if (node == 0) continue;
        direction = at - now[rod][node - 1];
        result.max_stretch = std::max(result.max_stretch, std::abs(direction.norm() / edge - 1));
      }
      const Eigen::Vector3d clamp = X.linear() * brush.rods[rod].direction_H;
      result.max_bend_deg =
          std::max(result.max_bend_deg,
                   std::atan2(clamp.cross(direction).norm(), clamp.dot(direction)) * 180 / kPi);
    }
    before.swap(now);
  }
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
