#include "calligraphy_brush/sim/projection_tuft.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;

/// The first two nodes are held by the handle.
constexpr int kHeldNodes = 2;
constexpr int kRootRows = 3 * kHeldNodes;

auto node(VectorXd& field, int i) {
  return field.segment<3>(3 * i);
}
auto node(const VectorXd& field, int i) {
  return field.segment<3>(3 * i);
}

/// The constraints of a rod in one order of rows: the held nodes, then from the root to the tip the
/// edge to each node and, where the sheet takes part, the node's height. In this order the Schur
/// complement J M⁻¹ Jᵀ is a band, which its factorisation does not fill.
class Constraints {
 public:
  Constraints(int node_count, double edge_length, const Eigen::Matrix<double, kRootRows, 1>& held)
      : node_count_(node_count),
        edge_length_(edge_length),
        held_(held),
        on_sheet_(static_cast<std::size_t>(node_count), false) {}

  bool onSheet(int i) const { return on_sheet_[static_cast<std::size_t>(i)]; }
  void setOnSheet(int i, bool value) { on_sheet_[static_cast<std::size_t>(i)] = value; }

  /// C [m]: how far held nodes are off their place; (|e|² − l²)/(2l) of every other edge; z of the
  /// nodes on the sheet.
  VectorXd values(const VectorXd& x) const {
    VectorXd c(rowCount());
    c.head<kRootRows>() = x.head<kRootRows>() - held_;
    int row = kRootRows;
    for (int i = kHeldNodes; i < node_count_; ++i) {
      const Vector3d edge = node(x, i) - node(x, i - 1);
      c[row++] = (edge.squaredNorm() - edge_length_ * edge_length_) / (2.0 * edge_length_);
      if (onSheet(i)) c[row++] = x[3 * i + 2];
    }
    return c;
  }

  /// J = ∂C/∂x [1].
  SparseMatrix jacobian(const VectorXd& x) const {
    std::vector<Eigen::Triplet<double>> entries;
    for (int row = 0; row < kRootRows; ++row) entries.emplace_back(row, row, 1.0);
    int row = kRootRows;
    for (int i = kHeldNodes; i < node_count_; ++i) {
      const Vector3d direction = (node(x, i) - node(x, i - 1)) / edge_length_;
      for (int k = 0; k < 3; ++k) {
        entries.emplace_back(row, 3 * (i - 1) + k, -direction[k]);
        entries.emplace_back(row, 3 * i + k, direction[k]);
      }
      ++row;
      if (onSheet(i)) entries.emplace_back(row++, 3 * i + 2, 1.0);
    }
    SparseMatrix jacobian(row, x.size());
    jacobian.setFromTriplets(entries.begin(), entries.end());
    return jacobian;
  }

 private:
  int rowCount() const {
    return kRootRows + node_count_ - kHeldNodes +
           static_cast<int>(std::count(on_sheet_.begin(), on_sheet_.end(), true));
  }

  int node_count_;
  double edge_length_;
  Eigen::Matrix<double, kRootRows, 1> held_;
  std::vector<bool> on_sheet_;
};

}  // namespace

ProjectionTuft::ProjectionTuft(const BrushModel& brush, const RodParameters& rods,
                               const ContactParameters& contact)
    : parameters_(rods),
      has_paper_(contact.paper),
      friction_(contact.paper_friction),
      pool_(rods.threads) {
  for (const RodModel& model : brush.rods) {
    if (model.needsFrames())
      throw std::invalid_argument(
          "scheme = projection has straight, isotropic rods with a free end only");
    Rod rod;
    rod.model = model;
    rod.edge_length = model.length / (model.nodeCount() - 1);
    rod.inverse_mass.resize(3 * model.nodeCount());
    for (int i = 0; i < model.nodeCount(); ++i)
      node(rod.inverse_mass, i).setConstant(1.0 / model.node_mass[static_cast<std::size_t>(i)]);
    rods_.push_back(std::move(rod));
  }
  solve_ = [this](int rod, int) { stepRod(rods_[static_cast<std::size_t>(rod)], X_PH_); };
  place(X_PH_);
}

void ProjectionTuft::place(const Eigen::Isometry3d& X_PH) {
  for (Rod& rod : rods_) {
    rod.position.resize(3 * rod.nodeCount());
    for (int i = 0; i < rod.nodeCount(); ++i)
      node(rod.position, i) = X_PH * (rod.model.root_H + i * rod.edge_length * rod.model.direction_H);
    rod.velocity = rod.contact_force = rod.load = VectorXd::Zero(rod.position.size());
    rod.root_force.setZero();
    rod.wrench.setZero();
  }
}

TuftReport ProjectionTuft::step(const Eigen::Isometry3d& X_PH) {
  X_PH_ = X_PH;
  pool_.run(static_cast<int>(rods_.size()), solve_);
  TuftReport report;
  report.solved_rods = static_cast<int>(rods_.size());
  for (const Rod& rod : rods_) {
    report.iterations += rod.iterations;
    report.most_iterations = std::max(report.most_iterations, rod.iterations);
    report.unconverged += !rod.converged;
  }
  return report;
}

void ProjectionTuft::stepRod(Rod& rod, const Eigen::Isometry3d& X_PH) const {
  const double h = parameters_.time_step;
  rod.velocity += h * rod.inverse_mass.cwiseProduct(force(rod));
  VectorXd x = rod.position + h * rod.velocity;
  project(rod, X_PH, x);
  rod.velocity = (x - rod.position) / h;
  rod.position = x;
  applyFriction(rod);

  rod.wrench.setZero();
  for (int i = 0; i < kHeldNodes; ++i) {
    const Vector3d on_handle = -rod.root_force.segment<3>(3 * i);
    rod.wrench.head<3>() += on_handle;
    rod.wrench.tail<3>() += (node(x, i) - X_PH.translation()).cross(on_handle);
  }
}

VectorXd ProjectionTuft::force(const Rod& rod) const {
  const VectorXd& x = rod.position;
  VectorXd f = rod.load;
  for (int i = 0; i < rod.nodeCount(); ++i) {
    const double mass = rod.model.node_mass[static_cast<std::size_t>(i)];
    node(f, i) -= parameters_.damping * mass * node(rod.velocity, i);
    f[3 * i + 2] -= parameters_.gravity * mass;
  }
  for (int i = 1; i + 1 < rod.nodeCount(); ++i) {
    const Vector3d e = node(x, i) - node(x, i - 1), g = node(x, i + 1) - node(x, i);
    const double denominator = rod.edge_length * rod.edge_length + e.dot(g);
    const Vector3d curvature = 2.0 * e.cross(g) / denominator;
    // −(EI/l) (∇κb)ᵀ κb by the node before and the node after; the node between takes what is left.
    const double stiffness =
        rod.model.bending_stiffness[static_cast<std::size_t>(i)] / (rod.edge_length * denominator);
    const Vector3d before = stiffness * (2.0 * g.cross(curvature) - curvature.squaredNorm() * g);
    const Vector3d after = stiffness * (2.0 * e.cross(curvature) + curvature.squaredNorm() * e);
    node(f, i - 1) += before;
    node(f, i) -= before + after;
    node(f, i + 1) += after;
  }
  return f;
}

void ProjectionTuft::project(Rod& rod, const Eigen::Isometry3d& X_PH, VectorXd& x) const {
  const int n = rod.nodeCount();
  const double tolerance = parameters_.tolerance * rod.edge_length;
  const VectorXd unconstrained = x;

  Eigen::Matrix<double, kRootRows, 1> held;
  for (int i = 0; i < kHeldNodes; ++i)
    held.segment<3>(3 * i) = X_PH * (rod.model.root_H + i * rod.edge_length * rod.model.direction_H);
  Constraints constraints(n, rod.edge_length, held);
  std::vector<bool> let_go(static_cast<std::size_t>(n), false);

  // Sum of the multipliers over the iterations [kg m], by the coordinate that they hold.
  VectorXd impulse = VectorXd::Zero(x.size());
  Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower, Eigen::NaturalOrdering<int>> schur;
  bool rows_changed = true;
  rod.converged = false;
  for (rod.iterations = 0; rod.iterations < parameters_.max_iterations; ++rod.iterations) {
    VectorXd c = constraints.values(x);
    const bool solved = c.lpNorm<Eigen::Infinity>() <= tolerance;
    bool added = false;
    for (int i = kHeldNodes; has_paper_ && i < n; ++i) {
      if (constraints.onSheet(i) || x[3 * i + 2] >= -tolerance) continue;
      // Where it would pull, the sheet takes part again only if the node sinks without it.
      if (let_go[static_cast<std::size_t>(i)] && !solved) continue;
      constraints.setOnSheet(i, true);
      added = true;
    }
    if (added) {
      c = constraints.values(x);
      rows_changed = true;
    } else if (solved) {
      // A node is let go once at most, so this comes to an end.
      bool pulls = false;
      for (int i = kHeldNodes; i < n; ++i) {
        if (!constraints.onSheet(i) || impulse[3 * i + 2] >= 0.0 || let_go[static_cast<std::size_t>(i)])
          continue;
        constraints.setOnSheet(i, false);
        let_go[static_cast<std::size_t>(i)] = pulls = true;
      }
      if (!pulls) {
        rod.converged = true;
        break;
      }
      x = unconstrained;
      impulse.setZero();
      rows_changed = true;
      continue;
    }

    const SparseMatrix jacobian = constraints.jacobian(x);
    const SparseMatrix by_mass = jacobian * rod.inverse_mass.asDiagonal();
    const SparseMatrix product = by_mass * jacobian.transpose();
    if (rows_changed) schur.analyzePattern(product);
    rows_changed = false;
    schur.factorize(product);
    if (schur.info() != Eigen::Success) break;
    const VectorXd change = schur.solve(c);
    x -= by_mass.transpose() * change;

    impulse.head<kRootRows>() -= change.head<kRootRows>();
    int row = kRootRows;
    for (int i = kHeldNodes; i < n; ++i) {
      ++row;
      if (constraints.onSheet(i)) impulse[3 * i + 2] -= change[row++];
    }
  }

  const double per_step_squared = 1.0 / (parameters_.time_step * parameters_.time_step);
  rod.root_force = per_step_squared * impulse.head<kRootRows>();
  rod.contact_force = per_step_squared * impulse;
  rod.contact_force.head<kRootRows>().setZero();
}

void ProjectionTuft::applyFriction(Rod& rod) const {
  const double h = parameters_.time_step;
  for (int i = kHeldNodes; i < rod.nodeCount(); ++i) {
    const double push = rod.contact_force[3 * i + 2];
    if (push <= 0.0) continue;
    const double normal_change = h * push * rod.inverse_mass[3 * i];
    auto tangential = rod.velocity.segment<2>(3 * i);
    const double speed = tangential.norm();
    if (speed == 0.0) continue;
    const Eigen::Vector2d change = -std::min(1.0, friction_ * normal_change / speed) * tangential;
    tangential += change;
    rod.contact_force.segment<2>(3 * i) = change / (h * rod.inverse_mass[3 * i]);
  }
}

void ProjectionTuft::setNodeForce(int rod, int i, const Vector3d& force) {
  node(rods_[static_cast<std::size_t>(rod)].load, i) = force;
}

void ProjectionTuft::readRod(int rod, std::vector<Vector3d>& nodes) const {
  nodes.resize(static_cast<std::size_t>(at(rod).nodeCount()));
  for (int i = 0; i < at(rod).nodeCount(); ++i)
    nodes[static_cast<std::size_t>(i)] = nodePosition(rod, i);
}
Vector3d ProjectionTuft::nodePosition(int rod, int i) const {
  return node(at(rod).position, i);
}
Vector3d ProjectionTuft::contactForce(int rod, int i) const {
  return node(at(rod).contact_force, i);
}
Eigen::Matrix<double, 6, 1> ProjectionTuft::rodWrench(int rod) const {
  return at(rod).wrench;
}

RodOnPaper ProjectionTuft::rodOnPaper(int rod) const {
  RodOnPaper result{at(rod).position[2], 0};
  for (int i = 0; i < at(rod).nodeCount(); ++i) {
    result.lowest = std::min(result.lowest, at(rod).position[3 * i + 2]);
    result.touching += at(rod).contact_force[3 * i + 2] > 0.0;
  }
  return result;
}

std::uint64_t ProjectionTuft::hash(std::uint64_t seed) const {
  for (const Rod& rod : rods_)
    for (const VectorXd* field : {&rod.position, &rod.velocity})
      seed = hashBytes(field->data(), static_cast<std::size_t>(field->size()) * sizeof(double), seed);
  return seed;
}

}  // namespace calligraphy_brush
