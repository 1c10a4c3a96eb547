#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/common_places.h"
#include "calligraphy_brush/common/lanes.h"

/// kLanes rods with equally many nodes, side by side: lane k of every array is rod k of the batch.
///
/// Arrays are [node][lane] or [node][component][lane]. Lanes without a rod hold a copy of the last
/// one, so that they are finite and finish when it does.
namespace calligraphy_brush {

/// What stays the same: constant after construction.
template <class Real>
struct RodBatchModel {
  int node_count = 0;
  int rod_count = 0;                ///< lanes that hold a rod, 1 .. kLanes
  AlignedVector<Real> edge_length;  ///< l [m], [lane]
  AlignedVector<Real> spring;     ///< EI/(l̄ l²) of the joint at node 0 .. n − 2 [N/m], [node][lane]
  AlignedVector<Real> mass;       ///< [kg], [node][lane]
  AlignedVector<Real> stiffness;  ///< EI/l³ near the node: what holds it in place [N/m], [node][lane]
};

/// All that a snapshot of the rods needs.
template <class Real>
struct RodBatchState {
  AlignedVector<Real> edge;               ///< x_{i+1} − x_i, of length l [m], [edge][3][lane]
  AlignedVector<Real> position;           ///< x_i in the paper frame [m], [node][3][lane]
  AlignedVector<Real> displacement;       ///< x_i − its value a step before [m], [node][3][lane]
  AlignedVector<Real> velocity;           ///< [m/s], [node][3][lane]
  AlignedVector<Real> previous_velocity;  ///< velocity a step before [m/s], [node][3][lane]

  AlignedVector<Real> lowest;  ///< height of the lowest node [m], [lane]

  /// Edges from which the next solve begins, as `edge`; empty: it extrapolates the motion.
  AlignedVector<Real> guess;
};

/// What the handle asks of the clamps in a step, [component][lane].
template <class Real>
struct RodBatchRoots {
  AlignedVector<Real> position;      ///< node 0 at the end of the step [m]
  AlignedVector<Real> displacement;  ///< way of node 0 in the step [m]; finer than position can tell
  AlignedVector<Real> clamp;         ///< clamp direction times l [m]
};

/// Rows of an edge in RodBatchWorkspace::factor: its basis P (6 numbers), the gain U of the turn of the
/// edge before it (4), the step k (2), the gain X of the shift of its first node (6).
constexpr int kRodFactorBasis = 0, kRodFactorCoupling = 6, kRodFactorStep = 10, kRodFactorGain = 12,
              kRodFactorRows = 18;

/// What the rods of a batch are together at places that they have in common, rows of a place: the
/// gradient of the step's potential by a shift of it, as far as rods can follow (3 numbers, [N]), the
/// edge that ends there (3, [m]), the stiffness of the joint before that edge against turns of its end
/// (1, [N/m]), that of what is touched there along x, y and z (3, [N/m]), that of inertia (1, [N/m]),
/// and that of what pulls the rods taut, and of ties between them, against turns of the edge's end (1,
/// [N/m]).
constexpr int kCommonGradient = 0, kCommonEdge = 3, kCommonBend = 6, kCommonContact = 7,
              kCommonMass = 10, kCommonTurn = 11, kCommonRows = 12;

/// Scratch of the solver; its content means nothing between steps. Lanes are those of a kernel's
/// registers, side by side: the turns that narrow ones take at a batch use the same, little memory.
template <class Real>
struct RodBatchWorkspace {
  AlignedVector<Real> target;      ///< where inertia alone would take a node [m], [node][3][lane]
  AlignedVector<Real> gradient;    ///< of the step's potential by node position [N], [node][3][lane]
  AlignedVector<Real> trial_edge;  ///< the shape so far, [edge][3][lane]
  AlignedVector<Real> next_edge;   ///< the shape after an update, [edge][3][lane]
  AlignedVector<Real> factor;  ///< basis and gains of the Riccati sweep, [edge][kRodFactorRows][lane]
};

/// What rods with material frames have besides. Quaternions as w, x, y, z.
template <class Real>
struct FramedRods {
  AlignedVector<Real> joint;  ///< EI₁/l̄, EI₂/l̄, GJ/l̄ [N m], κ̄₁, κ̄₂, m̄ [1], [joint][6][lane]
  AlignedVector<Real> frame;         ///< material frame of an edge in the paper frame, [edge][4][lane]
  AlignedVector<Real> clamp_frame;   ///< what the handle asks of it at the root, [4][lane]
  AlignedVector<Real> end_frame;     ///< and the far clamp, if there is one, [4][lane]
  AlignedVector<Real> end_position;  ///< [m], [3][lane]
  AlignedVector<Real> tether_stiffness;   ///< of what holds the far end in place; 0: free [N/m], [lane]
  AlignedVector<Real> tether_multiplier;  ///< force of the rod on the far clamp [N], [3][lane]

  // Scratch of a step.
  AlignedVector<Real> trial_frame, next_frame;  ///< [edge][4][lane]
  AlignedVector<Real> factor;                   ///< [edge][27][lane]
};

/// Length of rod that each joint stands for, where its strain is taken to be the same. In the middle it
/// is an edge's length l. At a clamp, where a rod bends most:
///
///   kHalf       l/2 at the clamp: the trapezoidal rule. A clamp by a fixed first edge, the usual way,
///               lets the rod begin at l/2, an error of first order in l; this one is of second
///   kCorrected  5/12 l at the clamp and 13/12 l at the joint beside it: the trapezoidal rule with
///               Gregory's end correction, which takes away most of what is left
enum class ClampRule { kHalf, kCorrected };

/// Rods of a brush by their indices, at most kLanes. All have equally many nodes.
template <class Real>
RodBatchModel<Real> makeRodBatchModel(const std::vector<RodModel>& rods, const std::vector<int>& indices,
                                      ClampRule clamp);
template <class Real>
FramedRods<Real> makeFramedRods(const std::vector<RodModel>& rods, const std::vector<int>& indices,
                                ClampRule clamp);

/// Sizes every array for a model, with zeros.
template <class Real>
RodBatchState<Real> makeRodBatchState(const RodBatchModel<Real>& model);
template <class Real>
RodBatchRoots<Real> makeRodBatchRoots();
template <class Real>
RodBatchWorkspace<Real> makeRodBatchWorkspace(int node_count);

/// Puts the rods, straight and at rest, onto the clamps. `framed` may be null.
template <class Real>
void placeAtRest(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
                 RodBatchState<Real>& state, FramedRods<Real>* framed);

/// Moves the rods as a rigid body, to where their roots are now, and leaves them at rest there.
template <class Real>
void carryShape(const Eigen::Isometry3d& motion, const RodBatchModel<Real>& model,
                const RodBatchRoots<Real>& roots, RodBatchState<Real>& state, FramedRods<Real>* framed);

}  // namespace calligraphy_brush
