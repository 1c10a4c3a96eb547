#include "statics.h"

#include <algorithm>

#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {

HeavyCantileverResult heavyCantilever(const HeavyCantileverParameters& p) {
  // Gamma = (T/s)² g/L · s²/m with T² = ρA L⁴/B: a short rod in a strong field is so fast that one time
  // step of backward Euler all but minimises the energy, even where a rod is about to buckle.
  const double length = 0.01;
  RodParameters rods = exactRods(0.1, "backward_euler", p.precision);
  rods.gravity = 1000.0;
  const double bending = length * length;
  const double density = p.gamma * bending / (rods.gravity * length * length * length);
  SingleRod rod(makeUniformRod(length, bending, density, p.nodes), rods, noPaper());

  const double angle = p.clamp_angle_deg * kPi / 180;
  const auto pose = [](double turn) { return handleAt({0, 0, 0}, turn); };
  rod.place(pose(0));
  // Ever more slowly: a rod that is about to buckle must not swing past the upright.
  const int steps = 10 + static_cast<int>(std::ceil(4 * p.clamp_angle_deg));
  for (int step = 1; step <= steps; ++step)
    rod.step(pose(angle * (1 - std::pow(1 - static_cast<double>(step) / steps, 4))));

  HeavyCantileverResult result;
  result.converged = rod.rest(pose(angle), 20000);
  result.iterations = rod.iterations();
  result.tip_x = rod.tip().x() / length;
  result.tip_z = rod.tip().z() / length;
  // Straight down or up, the width is rounding.
  result.height_over_width =
      std::abs(result.tip_x) > 1e-9 ? std::abs(result.tip_z) / result.tip_x : kNone;
  return result;
}

TipLoadResult tipLoad(const TipLoadParameters& p) {
  // L = B = 1. Under a dead load the rod is so light that a step minimises its energy. A following load
  // has none: there the rod creeps in a viscous medium.
  RodParameters rods = exactRods(0.1, "backward_euler", p.precision);
  if (p.follower) rods.damping = 20.0;
  SingleRod rod(makeUniformRod(1.0, 1.0, p.follower ? 1.0 : 1e-3, p.nodes), rods, noPaper());
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, kPi / 2);
  const auto tangent = [&rod, &p]() -> Eigen::Vector3d {
    return (rod.tip() - rod.node(p.nodes - 2)).normalized();
  };
  const auto load = [&](double size) {
    Eigen::Vector3d direction(0, 0, -1);
    if (p.follower) direction = tangent().cross(Eigen::Vector3d::UnitY()) * -1.0;
    rod.setTipForce(size * direction);
  };

  rod.place(X);
  const int steps = p.follower ? 2000 : 100;
  for (int step = 1; step <= steps; ++step) {
    load(p.beta * step / steps);
    rod.step(X);
  }
  TipLoadResult result;
  for (int count = 0; count < 200 && !result.converged; ++count) {
    if (p.follower)
      for (int step = 0; step < 50; ++step) {
        load(p.beta);
        rod.step(X);
      }
    load(p.beta);
    const Eigen::Vector3d before = rod.tip();
    const bool resting = rod.rest(X, p.follower ? 20 : 1000);
    result.converged = resting && (rod.tip() - before).norm() < 1e-9;
  }
  result.iterations = rod.iterations();
  result.tip_x = rod.tip().x();
  result.drop = -rod.tip().z();
  Eigen::Vector3d before = Eigen::Vector3d::UnitX();
  for (int edge = 0; edge + 1 < p.nodes; ++edge) {  // turn by turn, as it may pass 180 degrees
    const Eigen::Vector3d now = rod.node(edge + 1) - rod.node(edge);
    result.tip_angle_deg += std::atan2(before.cross(now).y(), before.dot(now)) * 180 / kPi;
    before = now;
  }
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
