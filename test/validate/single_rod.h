#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <memory>
#include <utility>

#include "calligraphy_brush/sim/tuft.h"
#include "scene.h"

namespace calligraphy_brush {
namespace validate {

constexpr double kPi = 3.14159265358979323846;

/// The rod of the tables: 30 hairs of radius 40 µm, E = 3 GPa, 1300 kg/m³.
constexpr double kReferenceLength = 0.045;             ///< [m]
constexpr double kReferenceBending = 1.8095573685e-7;  ///< B [N m²]
constexpr double kReferenceDensity = 1.960353816e-4;   ///< [kg/m]
constexpr double kStandardGravity = 9.81;              ///< [m/s²]

/// A handle at `position`, turned by `angle` [rad] so that an upright brush's hair points towards +x:
/// at π/2 it is horizontal, at π it stands.
inline Eigen::Isometry3d handleAt(const Eigen::Vector3d& position, double angle) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.translation() = position;
  X.linear() = Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return X;
}

/// Settings for accuracy: solved to rounding.
inline RodParameters exactRods(double time_step, const std::string& scheme,
                               const std::string& precision) {
  RodParameters rods;
  rods.time_step = time_step;
  rods.scheme = scheme;
  rods.precision = precision;
  rods.bending_law = "tangent";  // those of the reference tables
  rods.clamp = "half";
  rods.tolerance = 1e-13;
  rods.max_iterations = precision == "float" ? 20 : 500;  // in float the last digits never settle
  rods.damping = 0;
  rods.sleep = 0;
  rods.gravity = 0;
  return rods;
}

inline ContactParameters noPaper() {
  ContactParameters contact;
  contact.paper = false;
  return contact;
}

/// A tuft of one rod that keeps count.
class SingleRod {
 public:
  SingleRod(RodModel rod, const RodParameters& rods, const ContactParameters& contact)
      : single_(rods.precision == "float"),
        nodes_(rod.nodeCount()),
        watched_(rod.end_clamped ? nodes_ / 3 : nodes_ - 1),
        length_(rod.length),
        rounding_((single_ ? 1e-4 : 1e-11) * std::max(1.0, 1e-4 * nodes_ * nodes_)) {
    BrushModel brush;
    brush.tip_length = rod.length;
    brush.rods = {std::move(rod)};
    tuft_ = makeTuft(brush, rods, contact);
  }

  void place(const Eigen::Isometry3d& X_PH) { tuft_->place(X_PH); }

  void step(const Eigen::Isometry3d& X_PH) {
    const TuftReport report = tuft_->step(X_PH);
    iterations_ += report.iterations;
    solved_ = report.unconverged == 0;
    all_solved_ = all_solved_ && solved_;
  }

  /// Steps with the handle held still until the tip, or of a rod that is clamped there the node at a
  /// third, has moved less than rounding in each of 20 steps, in double solved ones, at most `most`.
  /// Returns whether it came to rest.
  bool rest(const Eigen::Isometry3d& X_PH, int most) {
    Eigen::Vector3d before = node(watched_);
    for (int count = 0, still = 0; count < most; ++count) {
      step(X_PH);
      const Eigen::Vector3d now = node(watched_);
      still = (solved_ || single_) && (now - before).norm() <= rounding_ * length_ ? still + 1 : 0;
      if (still == 20) return true;
      before = now;
    }
    return false;
  }

  Eigen::Vector3d node(int index) const { return tuft_->nodePosition(0, index); }
  Eigen::Vector3d tip() const { return node(nodes_ - 1); }
  Eigen::Vector3d contactForce(int index) const { return tuft_->contactForce(0, index); }
  Eigen::Vector3d contactForce() const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (int index = 0; index < nodes_; ++index) sum += contactForce(index);
    return sum;
  }
  void setForce(int index, const Eigen::Vector3d& force) { tuft_->setNodeForce(0, index, force); }
  void setTipForce(const Eigen::Vector3d& force) { setForce(nodes_ - 1, force); }
  void moveEnd(const Eigen::Isometry3d& X_PE) { tuft_->moveEnd(0, X_PE); }
  /// Force and torque about the handle's origin that the rod puts on it.
  Eigen::Matrix<double, 6, 1> wrench() const { return tuft_->rodWrench(0); }

  int iterations() const { return iterations_; }
  bool solved() const { return solved_; }         ///< the last step
  bool allSolved() const { return all_solved_; }  ///< every step

 private:
  std::unique_ptr<Tuft> tuft_;
  bool single_;
  int nodes_, watched_;
  double length_, rounding_;
  int iterations_ = 0;
  bool solved_ = true, all_solved_ = true;
};

}  // namespace validate
}  // namespace calligraphy_brush
