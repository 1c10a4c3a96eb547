#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/paper/paper.h"
#include "calligraphy_brush/sim/simulator_parameters.h"
#include "calligraphy_brush/sim/tip_shape.h"

namespace calligraphy_brush {

/// Stages of a time step, in their order.
enum class Stage { kMoveRoots, kSolveRods, kTransferInk, kFlowInk, kFlowPaper, kCount };

/// "move_roots", "solve_rods", ...
const char* toString(Stage stage);

/// What the steps since construction or reset did.
struct SimulatorReport {
  std::int64_t step_count = 0;         ///< steps taken
  std::int64_t rod_step_count = 0;     ///< rods × steps that were solved
  std::int64_t iteration_count = 0;    ///< Newton iterations, summed over rods
  std::int64_t unconverged_count = 0;  ///< rod-steps that ended at max_iterations
  int touching_rods = 0;               ///< rods on the sheet after the last step
  int touching_nodes = 0;              ///< nodes on the sheet after the last step
  int last_iterations = 0;             ///< most iterations of a rod in the last step
  double max_penetration = 0.0;        ///< deepest node below the sheet in the last step [m]
  double ink_in_tip = 0.0;             ///< liquid [m³]
  double pigment_in_tip = 0.0;         ///< as the undiluted ink that carries as much [m³]
  double ink_capacity = 0.0;           ///< [m³]
  std::array<double, static_cast<int>(Stage::kCount)> stage_seconds{};  ///< wall time, summed
};

/// Force and torque of the tuft on the handle, about the handle's origin, in the paper frame.
struct HandleWrench {
  Eigen::Vector3d force_P = Eigen::Vector3d::Zero();   ///< [N]
  Eigen::Vector3d torque_P = Eigen::Vector3d::Zero();  ///< [N m]
};

/// A brush on a sheet, driven by handle poses. Knows no clock and no ROS: equal poses give equal
/// bits, live or replayed, whatever the number of threads. Not thread-safe.
class Simulator {
 public:
  /// Throws ParameterError naming every parameter out of range.
  explicit Simulator(const SimulatorParameters& parameters);
  /// A brush made elsewhere; parameters.brush is not read.
  Simulator(const SimulatorParameters& parameters, BrushModel brush);
  ~Simulator();
  Simulator(Simulator&&) noexcept;
  Simulator& operator=(Simulator&&) noexcept;

  /// Takes the next pose of the handle or refuses it, and then changes nothing. The first one, and one
  /// after a gap of more than motion/max_gap, or of more than motion/hold_after that is further away than
  /// motion/hold_distance, puts the brush there at rest, as nothing is known of the way: rods by
  /// themselves straight, those that touch as they hang together in the air; at first from straight rods,
  /// then from the shape that they have.
  PoseVerdict addPose(const HandlePose& pose);

  /// Runs whole time steps up to the newest pose. Returns how many.
  int advance();
  /// The same, but not beyond a time [ns] in the stamps of the poses: advancing piece by piece gives
  /// the bits of advancing at once.
  int advanceTo(std::int64_t stamp_ns);

  /// Fills the tip with ink, to ink/load of its capacity.
  void dip();
  /// Takes the ink from the tip.
  void wipe();
  /// Takes the ink from the sheet.
  void clearPaper();
  /// As after construction: clean sheet, dipped brush, no poses.
  void reset();

  /// From now on a second sheet of another resolution [px/mm] is drawn on as well. The brush does not
  /// feel it: it moves and loses ink as without, so that pictures at all resolutions show one stroke.
  /// Throws ParameterError where paper/px_per_mm would be out of range.
  void drawAlsoAt(double px_per_mm);

  const SimulatorParameters& parameters() const;
  const BrushModel& brush() const;
  const Paper& paper() const;
  const Paper& picture() const;  ///< the second sheet, if there is one, else paper()
  const SimulatorReport& report() const;

  /// Time of the last step taken [ns], in the stamps of the poses; 0 before the first pose.
  std::int64_t time_ns() const;
  /// Pose of the handle at time_ns().
  HandlePose handlePose() const;
  /// Sum over rods, after the last step.
  HandleWrench handleWrench() const;

  int rodCount() const;
  int nodeCount() const;
  /// Position of a node in the paper frame [m].
  Eigen::Vector3d nodePosition(int rod, int node) const;
  /// Whether a node is on the sheet.
  bool nodeTouches(int rod, int node) const;
  /// Force of the sheet on a node [N].
  Eigen::Vector3d nodeContactForce(int rod, int node) const;
  /// Ink at a node, as a part of what there is room for, 0..1.
  double nodeInk(int rod, int node) const;
  /// Ink in a rod, as a part of its capacity, 0..1.
  double rodInk(int rod) const;

  /// How the tip holds together now.
  TipShape tipShape() const;

  /// Hash of the whole state: rods, ink, sheet. Equal states have equal hashes.
  std::uint64_t stateHash() const;
  /// Name of the kernel that runs: "avx512", "avx2" or "baseline".
  std::string kernelName() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace calligraphy_brush
