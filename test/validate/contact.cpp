#include "contact.h"

#include <algorithm>

#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

/// A rod with L = B = rho A = 1 on a handle that comes down onto the sheet; all lengths in L.
///
/// The medium is so viscous that the rod never overshoots: a tip that slides past its rest would
/// stick there. A step of 0.1 is a small part of the time that the rod takes to relax, so that a jump
/// from a stuck shape to a slipping one is followed through.
class PressedRod {
 public:
  PressedRod(const PressParameters& p)
      : p_(p),
        tilt_(p.tilt_deg * kPi / 180),
        // What a vertical rod needs to know to which side to buckle.
        lean_(std::max(0.0, 1e-3 - tilt_)),
        rod_(makeUniformRod(1.0, 1.0, 1.0, p.nodes), rods(p), paper(p)) {
    // The shapes in the air, with and without the lean: its foot shall stand where it would without.
    const auto high = [this](double lean) { return handleAt({0, 0, 2}, tilt_ + lean); };
    rod_.place(high(0));
    rod_.rest(high(0), 20000);
    const double foot = rod_.tip().x();
    if (lean_ > 0) {
      rod_.rest(high(lean_), 20000);
      shift_ = foot - rod_.tip().x();
    }
    lowest_ = 2 - rod_.tip().z();
    start_ = std::cos(tilt_) - lowest_ - kClearance;
    rod_.place(pose(start_, 1));
    rod_.rest(pose(start_, 1), 20000);
  }

  /// Depth that the handle starts from, just above touching.
  double start() const { return start_; }

  /// Handle at a depth; `fading`: what is left of the imperfections, 1 .. 0.
  Eigen::Isometry3d pose(double depth, double fading, double way = 0) const {
    const double aside = p_.plane ? 0.0 : 1e-5 * fading;
    return handleAt({way + shift_ * fading, aside, std::cos(tilt_) - depth}, tilt_ + lean_ * fading);
  }

  /// Goes to `depth` in `steps`, of which `law` gives the part that is done at s in 0 .. 1; calls
  /// after(depth) after every step until it returns false.
  template <class Law, class After>
  void lower(double depth, int steps, Law&& law, After&& after) {
    for (int step = 1; step <= steps; ++step) {
      const double s = static_cast<double>(step) / steps;
      const double at = start_ + (depth - start_) * law(s);
      // Gone once the rod has been bent more than by them.
      const double fading = std::exp(-std::max(0.0, at - start_ - kClearance) / 3e-4);
      rod_.step(pose(at, s < 1 ? fading : 0.0));
      if (!after(at)) return;
    }
  }

  /// Part of a way that is done at s in 0 .. 1. Starts at rest, and comes to rest exponentially, slower
  /// than the rod relaxes: so a tip that slides does so to the end, and what the medium holds back
  /// fades while it does.
  static double part(double s) { return s < 1 ? 1 - std::exp(-30 * s * s) : 1.0; }

  PressResult result(bool converged, const char* slipping) const {
    PressResult result;
    result.converged = converged;
    result.iterations = rod_.iterations();
    const Eigen::Vector3d force = rod_.contactForce();
    result.normal_force = force.z();
    result.tangential_force = force.x();
    result.tip_offset = rod_.tip().x() - rod_.node(0).x();
    for (int node = 0; node < p_.nodes; ++node)
      result.out_of_plane = std::max(result.out_of_plane, std::abs(rod_.node(node).y()));
    if (force.z() > 0) result.flat_length = flatLength();
    const double on_the_cone = p_.precision == "float" ? 0.995 : 1 - 1e-6;
    const bool slips = std::hypot(force.x(), force.y()) >= on_the_cone * p_.mu * force.z();
    result.state = force.z() <= 0 ? "free" : slips ? slipping : "stick";
    return result;
  }

  SingleRod& rod() { return rod_; }

 private:
  static constexpr double kClearance = 1e-5;

  static RodParameters rods(const PressParameters& p) {
    RodParameters rods = exactRods(0.1, "backward_euler", p.precision);
    rods.gravity = p.gamma;
    rods.damping = 10.0;
    return rods;
  }
  static ContactParameters paper(const PressParameters& p) {
    ContactParameters contact;
    contact.paper_friction = p.mu;
    contact.multiplier_updates = 200;
    contact.tolerance = p.precision == "float" ? 1e-7 : 1e-15;
    return contact;
  }

  /// A flat part only carries its own weight, and the rest of the force acts where it begins: between
  /// two nodes, which share it so that its centre is there.
  double flatLength() const {
    double sum = 0, moment = 0;
    for (int node = 1; node < p_.nodes; ++node) {
      const double normal = rod_.contactForce(node).z();
      if (normal <= 0) continue;
      const double weight = p_.gamma / (p_.nodes - 1) * (node == p_.nodes - 1 ? 0.5 : 1.0);
      sum += normal - weight;
      moment += (normal - weight) * node / (p_.nodes - 1);
    }
    return sum > 0 ? std::max(0.0, 1 - moment / sum) : 1.0;
  }

  PressParameters p_;
  double tilt_, lean_;
  double shift_ = 0, lowest_ = 0, start_ = 0;
  SingleRod rod_;
};

constexpr int kLoweringSteps = 8000;

}  // namespace

PressResult press(const PressParameters& p) {
  PressedRod pressed(p);
  pressed.lower(p.depth, kLoweringSteps, PressedRod::part, [](double) { return true; });
  return pressed.result(pressed.rod().rest(pressed.pose(p.depth, 0), 20000), "slip");
}

PressResult drag(const DragParameters& p) {
  if (p.direction == 0) throw std::invalid_argument("--direction = 0 is outside {-1, 1}");
  PressedRod pressed(p);
  pressed.lower(p.depth, kLoweringSteps, PressedRod::part, [](double) { return true; });
  pressed.rod().rest(pressed.pose(p.depth, 0), 20000);
  const auto pose = [&](double s) {
    return pressed.pose(p.depth, 0, p.direction * p.distance * PressedRod::part(s));
  };
  for (int step = 1; step <= kLoweringSteps; ++step)
    pressed.rod().step(pose(static_cast<double>(step) / kLoweringSteps));
  return pressed.result(pressed.rod().rest(pose(1), 20000), p.direction < 0 ? "drag-x" : "drag+x");
}

StickSlipResult stickSlip(const StickSlipParameters& p) {
  PressParameters pressing;
  static_cast<SceneParameters&>(pressing) = p;
  pressing.tilt_deg = 0;
  pressing.mu = p.mu;
  pressing.gamma = p.gamma;
  pressing.plane = true;
  PressedRod pressed(pressing);

  StickSlipResult result;
  struct {
    double depth = 0, ratio = 0, normal = 0;
  } now, before;
  // A buckled rod bulges with the root of the depth: so it does at a constant speed.
  const auto law = [](double s) { return s * s; };
  pressed.lower(0.4, 2 * kLoweringSteps, law, [&](double depth) {
    const Eigen::Vector3d force = pressed.rod().contactForce();
    if (force.z() <= 0) return true;
    const double ratio = std::abs(force.x()) / force.z();
    // Before the rod buckles it stands on the sheet with next to no force.
    const bool buckled = depth > 0.0015;
    if (buckled && ratio >= (1 - 1e-9) * p.mu) {
      const double rate = (now.depth - before.depth) / (now.ratio - before.ratio);
      result.slip_depth = std::min(now.depth + rate * (p.mu - now.ratio), depth);
      result.normal_force_before = now.normal + (now.normal - before.normal) *
                                                    (result.slip_depth - now.depth) /
                                                    (now.depth - before.depth);
      return false;
    }
    before = now;
    now = {depth, ratio, force.z()};
    if (buckled) result.largest_ratio = std::max(result.largest_ratio, ratio);
    return true;
  });
  result.converged = pressed.rod().solved();
  result.iterations = pressed.rod().iterations();
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
