#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "calligraphy_brush/brush/brush_parameters.h"

namespace calligraphy_brush {

/// One bundle of hairs as an elastic rod with n nodes, clamped at node 0.
///
/// Edges all have length length/(n − 1). Hairs slide on each other, so a bundle's stiffness is the
/// sum of its hairs'. The rod is straight and isotropic and its end is free, unless the fields
/// below say otherwise; only then does its twist matter.
struct RodModel {
  double length = 0.0;                                      ///< [m]
  Eigen::Vector3d root_H = Eigen::Vector3d::Zero();         ///< node 0 in the handle frame [m]
  Eigen::Vector3d direction_H = -Eigen::Vector3d::UnitZ();  ///< clamp direction, unit, handle frame
  std::vector<double> bending_stiffness;  ///< EI at nodes 0 .. n − 2 [N m²], n − 1 values
  std::vector<double> node_mass;          ///< [kg], n values
  std::vector<double> node_radius;        ///< radius of the bundle there [m], n values
  double ink_capacity = 0.0;              ///< volume between the hairs [m³]

  /// First director at the clamp, unit and perpendicular to direction_H, handle frame: the axis about
  /// which bending_stiffness counts.
  Eigen::Vector3d director_H = Eigen::Vector3d::UnitX();
  std::vector<double> bending_stiffness_2;  ///< EI about the second director [N m²]; empty: the same
  std::vector<double> twisting_stiffness;   ///< GJ [N m²]; empty: twist is free
  /// Curvature about the first and the second director and twist at rest [1/m]; empty: straight.
  std::vector<Eigen::Vector3d> natural_strain;
  bool end_clamped = false;  ///< the far end is held in place and direction by Tuft::moveEnd

  /// Whether material frames are needed: where everything about the axis is alike and nothing holds
  /// the far end, twist is at rest.
  bool needsFrames() const {
    return end_clamped || !natural_strain.empty() || !bending_stiffness_2.empty();
  }

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

/// Puts rods in an order in which each `size` of them, from the first on, have their roots near one
/// another: halves them along the longer side of the box of their roots, and so on.
void groupNeighbours(const BrushModel& brush, std::ptrdiff_t size, std::vector<int>::iterator begin,
                     std::vector<int>::iterator end);

}  // namespace calligraphy_brush
