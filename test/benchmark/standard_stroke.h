#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "calligraphy_brush/brush/brush_model.h"

namespace calligraphy_brush {

/// The stroke that speed is measured on: a tuft of reference rods hovers, is pressed, dragged, lifted.
///
/// Rod: L = 45 mm, 30 hairs of radius 40 µm, E = 3 GPa, 1300 kg/m³. Roots fill a disc of 8 mm, the
/// bundles lean a fifth of the way to the axis. The handle leans 0.35 rad and the tips trail.
struct StandardStroke {
  static constexpr double kLength = 0.045;              ///< of a rod [m]
  static constexpr double kBending = 1.8095573685e-7;   ///< EI [N m²]
  static constexpr double kLineDensity = 1.9603538e-4;  ///< [kg/m]
  static constexpr double kRootDiameter = 0.008;        ///< [m]
  static constexpr double kConvergence = 0.2;           ///< of the bundles to the axis [1]
  static constexpr double kTilt = 0.35;                 ///< of the handle [rad]

  static constexpr double kClearance = 0.004;  ///< of the tip over the sheet in the air [m]
  static constexpr double kDepth = 0.012;      ///< of the handle below first touch [m]
  static constexpr double kDistance = 0.06;    ///< of the drag [m]
  static constexpr double kSway = 0.005;       ///< sideways, to either side [m]

  static constexpr double kHoverEnd = 0.2;  ///< [s]
  static constexpr double kPressEnd = 0.4;  ///< [s]
  static constexpr double kDragEnd = 1.0;   ///< [s]
  static constexpr double kLiftEnd = 1.2;   ///< [s]
  static constexpr double kDuration = 1.4;  ///< [s]

  /// `rods` reference rods of n nodes.
  static BrushModel brush(int rods, int n) {
    constexpr double kGoldenAngle = 2.399963229728653;
    BrushModel brush;
    brush.tip_length = kLength;
    for (int k = 0; k < rods; ++k) {
      RodModel rod = makeUniformRod(kLength, kBending, kLineDensity, n);
      const double radius = 0.5 * kRootDiameter * std::sqrt((k + 0.5) / rods);
      rod.root_H = {radius * std::cos(kGoldenAngle * k), radius * std::sin(kGoldenAngle * k), 0.0};
      rod.direction_H = (-kConvergence * rod.root_H - kLength * Eigen::Vector3d::UnitZ()).normalized();
      // As thick as its 30 hairs packed to 45 %, and as much ink as fits between them.
      rod.node_radius.assign(static_cast<std::size_t>(n), 0.00033);
      rod.ink_capacity = 8.3e-9;
      brush.rods.push_back(rod);
    }
    return brush;
  }

  /// From 0 to 1 with neither speed nor acceleration at the ends.
  static double ease(double s) {
    s = std::min(1.0, std::max(0.0, s));
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
  }

  static Eigen::Quaterniond orientation() {
    return Eigen::Quaterniond(Eigen::AngleAxisd(kTilt, Eigen::Vector3d::UnitY()));
  }

  /// Position of the handle in the paper frame [m], t in 0 .. kDuration [s]. `clearance` over the
  /// sheet in the air, `depth` below first touch on it.
  static Eigen::Vector3d position(double t, double clearance = kClearance, double depth = kDepth) {
    const double down =
        ease((t - kHoverEnd) / (kPressEnd - kHoverEnd)) - ease((t - kDragEnd) / (kLiftEnd - kDragEnd));
    const double along = ease((t - kPressEnd) / (kDragEnd - kPressEnd));
    const double hover = kSway * std::sin(2.0 * M_PI * 3.0 * t) * (1.0 - ease(t / kHoverEnd));
    const double touch = kLength * std::cos(kTilt);
    return {0.03 + kDistance * along, 0.03 + hover + kSway * std::sin(2.0 * M_PI * along),
            touch + clearance - (clearance + depth) * down};
  }

  static Eigen::Isometry3d pose(double t, double clearance = kClearance, double depth = kDepth) {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    X.linear() = orientation().toRotationMatrix();
    X.translation() = position(t, clearance, depth);
    return X;
  }
};

}  // namespace calligraphy_brush
