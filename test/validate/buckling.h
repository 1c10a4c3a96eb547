#pragma once

#include "scene.h"

namespace calligraphy_brush {
namespace validate {

struct LateralBucklingParameters : SceneParameters {
  double stiffness_ratio = 0.01;
  double tau = 1.53846153846;
  LateralBucklingParameters() { nodes = 60; }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("stiffness_ratio", self.stiffness_ratio, Range{1e-5, 1.0}, "1",
          "EI2/EI1, stiffness sideways over that against the weight.");
    visit("tau", self.tau, Range{0.1, 10.0}, "1",
          "GJ/EI2, twisting stiffness over that sideways; of a thin strip 2/(1 + nu).");
    SceneParameters::describe(self, visit);
  }
};

struct LateralBucklingResult : SceneResult {
  double critical_load = kNone;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("critical_load", self.critical_load, "1",
          "w L^3/sqrt(EI2 GJ) for the least weight w by length at which the strip tips over; null: none "
          "below\n      300.");
    SceneResult::describe(self, visit);
  }
};

LateralBucklingResult lateralBuckling(const LateralBucklingParameters& parameters);

struct BendTwistParameters : SceneParameters {
  double natural_curvature = 6.0;
  double tau = 2.0 / 3.0;
  double gamma = 20.0;
  BendTwistParameters() { nodes = 120; }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("natural_curvature", self.natural_curvature, Range{0.0, 20.0}, "1/L",
          "Curvature K of the rod at rest.");
    visit("tau", self.tau, Range{0.1, 10.0}, "1", "Twisting over bending stiffness, C/B.");
    visit("gamma", self.gamma, Range{0.0, 1000.0}, "1", "Weight rho A g L^3 / B.");
    SceneParameters::describe(self, visit);
  }
};

struct BendTwistResult : SceneResult {
  bool planar_stable = false;
  double stiffness = 0;
  Eigen::Vector3d tip = Eigen::Vector3d::Zero();

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("planar_stable", self.planar_stable, "", "Whether the rod stays in its plane.");
    visit("stiffness", self.stiffness, "B/(rho A L^4)",
          "Square of the frequency of the slowest vibration out of the plane; negative: it grows.");
    visit("tip", self.tip, "L",
          "Tip from the clamp where the rod comes to rest after a small blow out of its plane.");
    SceneResult::describe(self, visit);
  }
};

BendTwistResult bendTwist(const BendTwistParameters& parameters);

/// In float the rounding of the closed ends hides the modes.
struct RingParameters : SceneParameters {
  double stiffness_ratio = 0.75;
  static Choices precisions() { return {"double"}; }
  RingParameters() { nodes = 60; }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("stiffness_ratio", self.stiffness_ratio, Range{0.1, 10.0}, "1",
          "Twisting over bending stiffness, C/B.");
    SceneParameters::describe(self, visit);
  }
};

struct RingResult : SceneResult {
  double critical_twist = kNone;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("critical_twist", self.critical_twist, "rad",
          "Twist between the joined ends at which the ring leaves its plane.");
    SceneResult::describe(self, visit);
  }
};

/// Throws std::invalid_argument where the nodes are too few for the twist.
RingResult ring(const RingParameters& parameters);

struct HelixParameters : SceneParameters {
  double length = 100.0;
  double bending = 1.345;
  double twisting = 0.789;
  double slack = 3.0;
  double turns = 27.0;
  static Choices precisions() { return {"double"}; }
  HelixParameters() { nodes = 200; }

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("length", self.length, Range{1e-3, 1e4}, "m", "Length of the rod.");
    visit("bending", self.bending, Range{1e-12, 1e6}, "N m^2", "Its bending stiffness B.");
    visit("twisting", self.twisting, Range{1e-12, 1e6}, "N m^2", "Its twisting stiffness C.");
    visit("slack", self.slack, Range{1e-9, 1e4}, "m",
          "How much nearer to each other than its length its ends are.");
    visit("turns", self.turns, Range{0.0, 100.0}, "1", "Turns of one end against the other.");
    SceneParameters::describe(self, visit);
  }
};

struct HelixResult : SceneResult {
  double max_angle = 0, moment = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("max_angle", self.max_angle, "rad", "Largest angle between the rod and the axis.");
    visit("moment", self.moment, "N m", "Moment about the axis at the clamp.");
    SceneResult::describe(self, visit);
  }
};

/// Throws std::invalid_argument where the slack is too much, or the nodes are too few for the twist.
HelixResult helix(const HelixParameters& parameters);

}  // namespace validate
}  // namespace calligraphy_brush
