#pragma once

#include <cmath>
#include <memory>

#include "calligraphy_brush/sim/tuft.h"

namespace calligraphy_brush {

/// A handle held still at `position`, rotated by `angle` [rad] about +y: at π/2 a brush that points
/// down its handle points along −x.
inline Eigen::Isometry3d handleAt(const Eigen::Vector3d& position, double angle = 0.0) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.translation() = position;
  X.linear() = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return X;
}

/// Parameters for accuracy: double precision, solved to rounding.
inline RodParameters exactRods(double time_step) {
  RodParameters rods;
  rods.time_step = time_step;
  rods.precision = "double";
  rods.bending_law = "tangent";  // those of the references
  rods.clamp = "half";
  rods.tolerance = 1e-13;
  rods.max_iterations = 200;
  rods.sleep = 0;
  return rods;
}

inline BrushModel oneRod(RodModel rod) {
  BrushModel brush;
  brush.tip_length = rod.length;
  brush.rods = {std::move(rod)};
  return brush;
}

/// The rod that the reference tables are made for: 30 hairs of radius 40 µm.
constexpr double kReferenceLength = 0.045;             // [m]
constexpr double kReferenceBending = 1.8095573685e-7;  // [N m²]
constexpr double kReferenceDensity = 1.9603538e-4;     // [kg/m]

inline BrushModel referenceRod(int nodes) {
  return oneRod(makeUniformRod(kReferenceLength, kReferenceBending, kReferenceDensity, nodes));
}

/// Steps with the handle held still until no node moves more than `rest` [m] in a step.
/// Returns the steps taken, or −1 if `most` were not enough.
inline int settle(Tuft& tuft, const Eigen::Isometry3d& X_PH, int node_count, double rest, int most) {
  Eigen::Vector3d before = tuft.nodePosition(0, node_count - 1);
  for (int step = 0; step < most; ++step) {
    tuft.step(X_PH);
    const Eigen::Vector3d now = tuft.nodePosition(0, node_count - 1);
    if ((now - before).norm() < rest && step > 10) return step;
    before = now;
  }
  return -1;
}

}  // namespace calligraphy_brush
