#pragma once

#include <Eigen/Core>
#include <vector>

#include "calligraphy_brush/brush/brush_parameters.h"

namespace calligraphy_brush {

/// One bundle of hairs as a straight isotropic elastic rod with n nodes, clamped at node 0.
///
/// Edges all have length length/(n − 1). The end is free. Hairs slide on each other, so a bundle's
/// stiffness is the sum of its hairs'.
struct RodModel {
  double length = 0.0;                                       ///< [m]
  Eigen::Vector3d root_H = Eigen::Vector3d::Zero();          ///< node 0 in the handle frame [m]
  Eigen::Vector3d direction_H = -Eigen::Vector3d::UnitZ();   ///< clamp direction, unit, handle frame
  std::vector<double> bending_stiffness;  ///< EI at nodes 0 .. n − 2 [N m²], n − 1 values
  std::vector<double> node_mass;          ///< [kg], n values
  std::vector<double> node_radius;        ///< radius of the bundle there [m], n values
  double ink_capacity = 0.0;              ///< volume between the hairs [m³]

  int nodeCount() const { return static_cast<int>(node_mass.size()); }
};

/// The tuft: all rods, each with the same number of nodes. Constant after construction.
struct BrushModel {
  std::vector<RodModel> rods;
  double tip_length = 0.0;  ///< distance from the handle's origin to the deepest node at rest [m]
};

/// Bundles hairs into rods: roots fill a disc on a sunflower spiral (Vogel 1979), core hairs are
/// longest, the bundles lean towards the axis, and the hairs of each end one after another.
/// Equal parameters give equal brushes. Throws ParameterError.
BrushModel makeBrush(const BrushParameters& parameters);

/// A rod of constant cross-section, for tests and reference scenes.
///
/// length [m], bending_stiffness EI [N m²], line_density [kg/m]; nodes ≥ 3. End nodes carry half a
/// node's mass. Root at the handle's origin, pointing down the handle.
RodModel makeUniformRod(double length, double bending_stiffness, double line_density, int nodes);

}  // namespace calligraphy_brush
