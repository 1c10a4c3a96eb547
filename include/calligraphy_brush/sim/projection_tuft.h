#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "calligraphy_brush/common/thread_pool.h"
#include "calligraphy_brush/sim/tuft.h"

namespace calligraphy_brush {

/// The baseline: rods by symplectic Euler and fast projection, as the method was published.
///
/// A step of a rod with nodes x_i, masses m_i and straight isotropic joints at nodes 1 .. n − 2:
///
///   v ← v + h (F(x)/m − c v),   x̃ = x + h v                    bending, gravity, damping
///   x⁺ = the projection of x̃ onto C(x) = 0 in the metric of M   root, inextensibility, sheet
///   v⁺ = (x⁺ − x)/h, then friction on v⁺ of the nodes on the sheet
///
/// The force of bending is minus the gradient of Σ_i ½ (EI/l) |κb_i|², κb = 2 e×f/(l² + e·f), as in
/// section 7 of Bergou et al. 2008; it is stable for h < 2/ω_max only, ω_max = 4 √(EI/(m l³)), m: mass
/// of a node. The root and the direction there fix the first two nodes, so the rod is clamped in effect
/// at half an edge from the root: an error of first order in l that the other schemes do not have. The
/// projection takes the direction of the constraints' forces on its way, not at its end, so a rod at
/// rest is off its static shape by an amount of second order in h.
///
/// The sheet lets nodes 2 .. n − 1 not below z = 0, and takes part in the projection for the nodes that
/// would be: they are found as it goes on, and it starts again without those that the sheet would pull.
///
/// Friction changes velocities only: |v_t| falls by µ Δv_n at most, Δv_n being the normal velocity
/// that the sheet gave the node in the step. The projection has moved the node before friction is
/// asked, so nothing ever truly sticks: a pressed tip slides as far for µ = 10 as for µ = 0.
///
/// Always in double precision, rod by rod, with sparse matrices by Eigen. RodParameters::tolerance is
/// the residual of a constraint over the length of an edge; clamp and instruction_set have no effect.
///
/// Sources: Bergou et al. 2008, Discrete Elastic Rods (forces, boundary conditions); Goldenthal et al.
/// 2007, Efficient Simulation of Inextensible Cloth, algorithm 1 (fast projection); Bridson et al.
/// 2002, Robust Treatment of Collisions, Contact and Friction for Cloth Animation (its friction).
class ProjectionTuft : public Tuft {
 public:
  /// Throws ParameterError for a bending law other than that of the paper, std::invalid_argument for
  /// rods that need material frames.
  ProjectionTuft(const BrushModel& brush, const RodParameters& rods, const ContactParameters& contact);

  void place(const Eigen::Isometry3d& X_PH) override;
  TuftReport step(const Eigen::Isometry3d& X_PH) override;
  void setNodeForce(int rod, int node, const Eigen::Vector3d& force) override;

  void readRod(int rod, std::vector<Eigen::Vector3d>& nodes) const override;
  Eigen::Vector3d nodePosition(int rod, int node) const override;
  Eigen::Vector3d contactForce(int rod, int node) const override;
  Eigen::Matrix<double, 6, 1> rodWrench(int rod) const override;
  RodOnPaper rodOnPaper(int rod) const override;

  const char* kernelName() const override { return "projection"; }
  std::uint64_t hash(std::uint64_t seed) const override;

 private:
  struct Rod {
    RodModel model;
    double edge_length = 0.0;                ///< l [m]
    Eigen::VectorXd inverse_mass;            ///< 1/m of every coordinate [1/kg], 3n
    Eigen::VectorXd position, velocity;      ///< [m], [m/s], 3n
    Eigen::VectorXd load;                    ///< [N], 3n
    Eigen::VectorXd contact_force;           ///< of the sheet on the nodes in the last step [N], 3n
    Eigen::Matrix<double, 6, 1> root_force;  ///< of the handle on nodes 0 and 1 in the last step [N]
    Eigen::Matrix<double, 6, 1> wrench;      ///< on the handle
    int iterations = 0;
    bool converged = true;

    int nodeCount() const { return model.nodeCount(); }
  };

  void stepRod(Rod& rod, const Eigen::Isometry3d& X_PH) const;
  /// Bending, gravity, damping and load [N].
  Eigen::VectorXd force(const Rod& rod) const;
  /// Moves `x` onto the constraints; says in the rod with which forces, and how it went.
  void project(Rod& rod, const Eigen::Isometry3d& X_PH, Eigen::VectorXd& x) const;
  void applyFriction(Rod& rod) const;

  const Rod& at(int rod) const { return rods_[static_cast<std::size_t>(rod)]; }

  RodParameters parameters_;
  bool has_paper_;
  double friction_;
  std::vector<Rod> rods_;
  ThreadPool pool_;
  Eigen::Isometry3d X_PH_ = Eigen::Isometry3d::Identity();  // of the step that runs
  std::function<void(int, int)> solve_;
};

}  // namespace calligraphy_brush
