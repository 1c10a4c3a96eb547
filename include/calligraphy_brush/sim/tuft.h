#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/contact/contact_parameters.h"
#include "calligraphy_brush/rods/rod_parameters.h"

namespace calligraphy_brush {

/// What one step of the tuft did.
struct TuftReport {
  int solved_rods = 0;
  int iterations = 0;           ///< Newton iterations, summed over rods
  int most_iterations = 0;      ///< of one rod
  int unconverged = 0;          ///< rods that ended at max_iterations
  int coupling_rounds = 0;      ///< solutions in which rods learnt what their neighbours did
  double coupling_error = 0.0;  ///< largest error of what they believed in the last one [m]
};

/// Where a rod is to the sheet after a step.
struct RodOnPaper {
  double lowest = 0.0;  ///< height of its lowest node [m]
  int touching = 0;     ///< nodes that the sheet pushes
};

/// All rods of a brush and their contact with the sheet, in one precision, in batches over threads.
class Tuft {
 public:
  virtual ~Tuft() = default;

  /// Puts the rods, straight and at rest, onto a handle at X_PH.
  virtual void place(const Eigen::Isometry3d& X_PH) = 0;
  /// Takes the rods there at rest and in the shape that they have, to the handle, as if nothing had
  /// touched them on the way. Returns whether the scheme can; if not, nothing has changed.
  virtual bool carry(const Eigen::Isometry3d& X_PH);

  /// Where the far clamp of a rod with end_clamped is from the next step on: its place, with the
  /// third axis along the rod and the first its first director. Throws std::invalid_argument for
  /// another rod. place() puts it at the end of the straight rod.
  virtual void moveEnd(int rod, const Eigen::Isometry3d& X_PE);
  /// Force of a rod on its far clamp after the last step [N]; zero where it has none.
  virtual Eigen::Vector3d endForce(int rod) const;

  /// One time step, at the end of which the handle is at X_PH. A scheme that needs it in between takes
  /// it on the straight way from where it was.
  virtual TuftReport step(const Eigen::Isometry3d& X_PH) = 0;
  /// One time step in which the handle is at X_PH(c) after the part c of it, 0 < c ≤ 1.
  virtual TuftReport stepAlong(const std::function<Eigen::Isometry3d(double)>& X_PH) {
    return step(X_PH(1.0));
  }

  /// A load on a node [N] from the next step on, until it is set anew; place() takes all loads away.
  /// Throws std::invalid_argument where the scheme takes none.
  virtual void setNodeForce(int rod, int node, const Eigen::Vector3d& force);

  /// Ink at the nodes as a part of what there is room for, [rod · node count + node], from the next step
  /// on. It is what touching rods cling by.
  virtual void setInk(const std::vector<double>& saturation);
  /// Rods that hang together, in the last `part` of their length, after the last step: a label for each
  /// rod in `group_of_rod`, which has the length of the rods, 0 .. groups − 1. Returns the number of
  /// groups.
  virtual int groups(double part, std::vector<int>& group_of_rod) const;

  /// Positions of all nodes of a rod in the paper frame [m].
  virtual void readRod(int rod, std::vector<Eigen::Vector3d>& nodes) const = 0;
  /// Position of a node in the paper frame [m].
  virtual Eigen::Vector3d nodePosition(int rod, int node) const = 0;
  /// Force of the sheet on a node in the last step [N].
  virtual Eigen::Vector3d contactForce(int rod, int node) const = 0;
  /// Force [N] and torque about the handle's origin [N m] that a rod put on it in the last step.
  virtual Eigen::Matrix<double, 6, 1> rodWrench(int rod) const = 0;
  virtual RodOnPaper rodOnPaper(int rod) const = 0;

  virtual const char* kernelName() const = 0;
  /// FNV-1a hash of the state, continued from `seed`.
  virtual std::uint64_t hash(std::uint64_t seed) const = 0;
};

/// In the precision that the parameters name. Throws ParameterError or std::invalid_argument.
std::unique_ptr<Tuft> makeTuft(const BrushModel& brush, const RodParameters& rods,
                               const ContactParameters& contact);

/// FNV-1a over bytes.
std::uint64_t hashBytes(const void* data, std::size_t size, std::uint64_t seed);

}  // namespace calligraphy_brush
