#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/rods/rod_batch.h"
#include "calligraphy_brush/rods/rod_parameters.h"

namespace calligraphy_brush {

/// What ink does to the hair of one batch of rods: it softens it, and lets it take on its bend.
///
/// Softening: a joint at whose node the part S of the room for ink is filled has the stiffness
///
///   B = B_dry (1 − (1 − w) S)                              w: wet_stiffness
///
/// Memory: a Zener solid (standard linear solid) whose dashpot only yields where it is wet. With σ the
/// strain of a joint and σ₀ the natural one, beside that which the rod is made with,
///
///   dσ₀/dt = S/τ (p σ − σ₀)                                p: wet_memory, τ: wet_memory_time
///
/// in backward Euler. Held in a shape for long it keeps the part p of it; let go, it loses that with
/// the time constant τ/((1 − p) S), and dry not at all. |σ₀| ≤ p, a turn of p rad in a joint.
///
/// A framed rod's natural strain is its own. A plain rod has none: there σ₀ is two components in the
/// frame that is carried along it from the clamp without twist (Bishop 1975, There is more than one way
/// to frame a curve), and acts as a torque B σ₀/l̄ on the edge after the joint, its opposite on the edge
/// before: a couple of forces on the nodes of each. They make no force, and the torque that they make
/// is not the handle's to hold. Their direction is that of the shape at the last call of relax(), so
/// out of the plane of its bend a rod feels them late; what a rod bent in two planes would feel by its
/// twist is left out.
template <class Real>
struct WetHair {
  double stiffness = 1.0;    ///< wet_stiffness
  double memory = 0.0;       ///< wet_memory
  double memory_time = 1.0;  ///< wet_memory_time [s]
  double interval = 0.0;     ///< from one call of relax() to the next [s]

  AlignedVector<Real> dry;  ///< `spring` of the model or `joint` of framed rods, when dry
  AlignedVector<Real> wet;  ///< S in whole steps of kSaturationStep, [joint][lane]; empty: no effect

  // Empty without memory; `couple` and what follows for framed rods too.
  AlignedVector<Real> part;    ///< of its way that σ₀ goes in relax(), by `wet`, [joint][lane]
  AlignedVector<Real> strain;  ///< σ₀ [1], plain: [joint][2][lane], framed: [joint][3][lane]
  AlignedVector<Real>
      couple;                ///< force on the far end of an edge, against the near [N], [edge][3][lane]
  AlignedVector<Real> push;  ///< what they make of a node's acceleration [m/s²], [node][3][lane]
  AlignedVector<Real> inverse_mass;  ///< [1/kg], [node][lane]
  bool is_bent = false;              ///< whether any σ₀ was not zero
};

/// S is known to this, so that stiffness is a function of the ink and not of how it came.
constexpr double kSaturationStep = 1.0 / 128.0;

/// Dry and straight. framed: null for plain rods.
template <class Real>
WetHair<Real> makeWetHair(const RodBatchModel<Real>& model, const FramedRods<Real>* framed,
                          const RodParameters& parameters, double interval);

/// Takes the ink of the rods in the lanes, `saturation` being [rod][node] of the whole brush, and
/// changes the stiffness by it. Returns whether anything changed.
template <class Real>
bool soak(const std::vector<int>& rods, const std::vector<double>& saturation, WetHair<Real>& hair,
          RodBatchModel<Real>& model, FramedRods<Real>* framed);

/// Lets the interval go by: natural strains relax, and act from the present shape on. Returns whether
/// strains are still on their way, by more than kStrainAtRest.
///
/// director: a unit vector perpendicular to the clamp direction that turns with the handle, in the paper
/// frame, [3][lane], of plain rods. law: p of bendingTerms.
template <class Real>
bool relax(double law, const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
           const Real* director, const RodBatchState<Real>& state, FramedRods<Real>* framed,
           WetHair<Real>& hair);

/// How far natural strains are from where they go when they are left where they are [1].
constexpr double kStrainAtRest = 2e-4;

/// Straight, or as made, once more.
template <class Real>
void forgetBends(FramedRods<Real>* framed, WetHair<Real>& hair);

/// What acts in directions of the paper frame turns with the rods.
template <class Real>
void turnBends(const Eigen::Matrix3d& turn, WetHair<Real>& hair);

/// Torque that the couples of a plain rod put on it and on nothing else [N m]: in the rod each has its
/// opposite, so the handle does not feel it.
template <class Real>
Eigen::Vector3d torqueOfCouples(const RodBatchState<Real>& state, const WetHair<Real>& hair, int lane);

}  // namespace calligraphy_brush
