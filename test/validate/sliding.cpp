#include "sliding.h"

#include <algorithm>

#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

constexpr double kBlockMass = 1.0;  // [kg]

/// The tip node of a limp, nearly weightless, slack rod that stands on the sheet.
class Block {
 public:
  /// `speed`: the largest that a push gives it in one step.
  Block(const DynamicParameters& p, double friction, double gravity, double speed)
      // Slack enough for what the block does in a step, and no longer: the solver works with the
      // directions of the edges, so ways that are tiny beside them are lost.
      : length_(20 * p.dt * (speed + 5 * kStandardGravity * p.dt)),
        rod_(limpRod(p.nodes, length_), rods(p, gravity), paper(p, friction)) {
    rod_.place(handle(0));
    position_ = before_ = rod_.tip().x();
    const int steps = 100;
    for (int step = 1; step <= steps; ++step) advance(static_cast<double>(step) / steps);
    for (int step = 0; step < steps; ++step) advance(1);
  }
  void push(double force) { rod_.setTipForce({force, 0, 0}); }
  void step() { advance(1); }
  double position() const { return position_; }
  const SingleRod& rod() const { return rod_; }

 private:
  static RodModel limpRod(int nodes, double length) {
    const double bending = 1e-10 * kBlockMass * kStandardGravity * length * length;
    RodModel rod = makeUniformRod(length, bending, 1e-9 * kBlockMass / length, nodes);
    rod.node_mass.back() = kBlockMass;
    return rod;
  }
  static RodParameters rods(const DynamicParameters& p, double gravity) {
    RodParameters rods = exactRods(p.dt, p.scheme, p.precision);
    rods.tolerance = 1e-15;
    rods.max_iterations = 2000;  // Newton creeps where a rod is as limp as this
    rods.gravity = gravity;
    return rods;
  }
  static ContactParameters paper(const DynamicParameters& p, double friction) {
    ContactParameters contact;
    contact.paper_friction = friction;
    contact.multiplier_updates = 200;
    contact.tolerance = p.precision == "float" ? 1e-9 : 1e-15;
    return contact;
  }
  void advance(double slack) {
    rod_.step(handle(slack));
    before_ = position_;
    position_ = rod_.tip().x();
  }
  /// Beside and above where the block goes if it goes on so: from taut (0) to slack by a tenth (1), and
  /// inclined, so that the rod gives way to a side.
  Eigen::Isometry3d handle(double slack) const {
    const double aside = (0.5 - 0.1 * slack) * length_,
                 height = (std::sqrt(0.75) - 0.06 * slack) * length_;
    return handleAt({2 * position_ - before_ - aside, 0, height}, kPi / 6);
  }

  double length_, position_ = 0, before_ = 0;
  SingleRod rod_;
};

}  // namespace

SlideResult slide(const SlideParameters& p) {
  Block block(p, p.mu, kStandardGravity, p.speed);
  const double start = block.position();
  block.push(kBlockMass * p.speed / p.dt);
  block.step();
  block.push(0);

  SlideResult result;
  const double expected = p.speed / (p.mu * kStandardGravity);
  const double still = p.precision == "float" ? 1e-6 : 1e-9;
  bool stands = false;
  const auto most = static_cast<long>(3 * expected / p.dt) + 100;
  double before = block.position();
  for (long step = 1; step < most && !stands; ++step) {
    block.step();
    stands = std::abs(block.position() - before) <= still * p.speed * p.dt;
    if (!stands) result.time = static_cast<double>(step + 1) * p.dt;
    before = block.position();
  }
  result.distance = block.position() - start;
  result.converged = stands && block.rod().allSolved();
  result.iterations = block.rod().iterations();
  return result;
}

InclineResult incline(const InclineParameters& p) {
  const double angle = p.angle_deg * kPi / 180;
  Block block(p, p.mu, kStandardGravity * std::cos(angle), 0);
  const double start = block.position();
  block.push(kBlockMass * kStandardGravity * std::sin(angle));
  const int steps = std::max(2, static_cast<int>(std::lround(1.0 / p.dt)));
  double half_way = 0;
  for (int step = 1; step <= steps; ++step) {
    block.step();
    if (step == steps / 2) half_way = block.position();
  }
  InclineResult result;
  result.distance = block.position() - start;
  // What is left of an inclination a millionth above the threshold moves the block by 1e-7 m.
  result.slides = block.position() - half_way > (p.precision == "float" ? 1e-5 : 1e-9);
  result.converged = block.rod().allSolved();
  result.iterations = block.rod().iterations();
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
