#include "buckling.h"

#include <algorithm>

#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

using Shape = std::vector<Eigen::Vector3d>;

constexpr double kTimeStep = 0.1;  ///< of all these scenes [s]

/// As exactRods, but with a law that comes nearer to the continuous rod, which is what these scenes are
/// compared with.
RodParameters quasiStatic(double damping, const std::string& precision, const char* law = "arc") {
  RodParameters rods = exactRods(kTimeStep, "backward_euler", precision);
  rods.bending_law = law;
  rods.damping = damping;
  return rods;
}

Shape shapeOf(const SingleRod& rod, int nodes) {
  Shape shape;
  for (int node = 0; node < nodes; ++node) shape.push_back(rod.node(node));
  return shape;
}

struct Stiffness {
  double least = 0;  ///< λ [1/s²]
  bool converged = false;
};

/// The least λ of H u = λ M u of a rod at rest that has just been disturbed, H the Hessian of its
/// energy, M its masses; among the disturbances that `part` keeps of all.
///
/// A step of backward Euler with damping c takes a small disturbance u to
///
///   M (v₊ − v)/h + c M v₊ = −H u₊,   v = (u − u₋)/h
///
/// so that each mode shrinks by about σ/(σ + λ), σ = (1/h + c)/h: steps are inverse iterations shifted
/// by −σ, made by the solver itself. The mode of the least λ outlives all others, and Rayleigh's
/// quotient, uᵀHu/uᵀMu with Hu from the equation above, tends to its λ with the square of the error
/// of u. Where λ < 0 the mode grows: the rod is not stable.
template <class Part>
Stiffness leastStiffness(SingleRod& rod, const Eigen::Isometry3d& X, const std::vector<double>& mass,
                         double damping, const Shape& rest, double most, Part part) {
  const int nodes = static_cast<int>(mass.size());
  const auto disturbance = [&] {
    Shape u = shapeOf(rod, nodes);
    for (std::size_t i = 0; i < u.size(); ++i) u[i] -= rest[i];
    return part(u);
  };
  const double shift = (1 / kTimeStep + damping) / kTimeStep;
  Stiffness stiffness;
  Shape before_that = disturbance();
  rod.step(X);
  Shape before = disturbance();
  for (int step = 0, settled = 0; step < 2000; ++step) {
    rod.step(X);
    const Shape now = disturbance();
    double work = 0, square = 0, size = 0;
    for (std::size_t i = 0; i < now.size(); ++i) {
      const Eigen::Vector3d v = (now[i] - before[i]) / kTimeStep;
      const Eigen::Vector3d v_before = (before[i] - before_that[i]) / kTimeStep;
      work -= mass[i] * now[i].dot((v - v_before) / kTimeStep + damping * v);
      square += mass[i] * now[i].squaredNorm();
      size = std::max(size, now[i].norm());
    }
    const double least = work / square;
    const double change = std::abs(least - stiffness.least);
    stiffness.least = least;
    settled = change < 1e-4 * (std::abs(least) + 1e-2 * shift) ? settled + 1 : 0;
    stiffness.converged = settled == 3;
    if (stiffness.converged) return stiffness;
    if (size > most) {  // no longer small, and it has grown to that
      stiffness.least = std::min(stiffness.least, 0.0);
      return stiffness;
    }
    before_that = before;
    before = now;
  }
  return stiffness;
}

/// What of a disturbance leaves the plane y = 0.
Shape sideways(Shape u) {
  for (Eigen::Vector3d& x : u) x = {0, x.y(), 0};
  return u;
}

/// The first zero of `function`, positive at `from`, on the way from there to `to` in steps by `factor`;
/// NaN if there is none. To 1e-6 of its place.
template <class Function>
double firstZero(double from, double to, double factor, Function function) {
  double a = from, f_a = function(a);
  if (f_a <= 0) return from;
  while (a < to) {
    double b = std::min(to, a * factor), f_b = function(b);
    if (f_b > 0) {
      a = b;
      f_a = f_b;
      continue;
    }
    // Regula falsi with bisection where it creeps.
    for (int i = 0; i < 60 && b - a > 1e-6 * b; ++i) {
      const double part = i % 3 == 2 ? 0.5 : std::clamp(f_a / (f_a - f_b), 0.01, 0.99);
      const double c = a + part * (b - a), f_c = function(c);
      if (f_c > 0) {
        a = c;
        f_a = f_c;
      } else {
        b = c;
        f_b = f_c;
      }
    }
    return f_a > f_b ? a + (b - a) * f_a / (f_a - f_b) : b;
  }
  return kNone;
}

/// A rod of length 0.01 m with (T/s)² = ρ A L⁴/B = 0.01: under the gravity g [m/s²] its weight is
/// g B/L³.
constexpr double kLength = 0.01;
constexpr double kBending = 1.0;

RodModel heavyRod(int nodes) {
  return makeUniformRod(kLength, kBending, 0.01 * kBending / std::pow(kLength, 4), nodes);
}

}  // namespace

// Their gravity is at most 1000.
constexpr double kMostLoad = 300;

LateralBucklingResult lateralBuckling(const LateralBucklingParameters& p) {
  LateralBucklingResult result;
  result.converged = true;
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, kPi / 2);
  const double damping = 100;
  const auto stiffnessAt = [&](double load) {
    RodModel model = heavyRod(p.nodes);
    const auto joints = model.bending_stiffness.size();
    model.bending_stiffness_2.assign(joints, kBending / p.stiffness_ratio);
    model.twisting_stiffness.assign(joints, kBending * p.tau);
    RodParameters rods = quasiStatic(damping, p.precision);
    rods.gravity = load * std::sqrt(p.tau);
    SingleRod rod(model, rods, noPaper());
    rod.place(X);
    const bool resting = rod.rest(X, 5000);
    const Shape rest = shapeOf(rod, p.nodes);
    rod.setTipForce({0, 1e-9 * kBending / (kLength * kLength), 0});
    rod.step(X);
    rod.setTipForce({0, 0, 0});
    const Stiffness stiffness =
        leastStiffness(rod, X, model.node_mass, damping, rest, 1e-4 * kLength, sideways);
    result.converged = result.converged && resting && (stiffness.converged || stiffness.least < 0);
    result.iterations += rod.iterations();
    return stiffness.least;
  };
  result.critical_load = firstZero(5, kMostLoad, 1.15, stiffnessAt);
  return result;
}

BendTwistResult bendTwist(const BendTwistParameters& p) {
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, 0);
  RodModel model = heavyRod(p.nodes);
  const auto joints = model.bending_stiffness.size();
  model.bending_stiffness_2 = model.bending_stiffness;
  model.twisting_stiffness.assign(joints, kBending * p.tau);
  model.natural_strain.assign(joints, Eigen::Vector3d(0, p.natural_curvature / kLength, 0));
  const double damping = 20;
  RodParameters rods = quasiStatic(damping, p.precision);
  rods.gravity = p.gamma;
  SingleRod rod(model, rods, noPaper());
  rod.place(X);
  // From the curl: the weight is held at first.
  const auto hold = [&](double part) {
    for (int node = 0; node < p.nodes; ++node)
      rod.setForce(node, {0, 0, part * p.gamma * model.node_mass[static_cast<std::size_t>(node)]});
  };
  const int curling = 100, falling = 150;
  for (int step = 0; step <= curling + falling; ++step) {
    hold(std::clamp(1 - static_cast<double>(step - curling) / falling, 0.0, 1.0));
    rod.step(X);
  }
  hold(0);
  BendTwistResult result;
  const bool resting = rod.rest(X, 20000);
  const Shape rest = shapeOf(rod, p.nodes);
  // The step takes a rod off a ridge by itself where it stands on one.
  const bool is_planar = std::all_of(rest.begin(), rest.end(), [](const Eigen::Vector3d& x) {
    return std::abs(x.y()) < 1e-6 * kLength;
  });
  Stiffness stiffness;
  if (is_planar) {
    rod.setTipForce({0, 1e-9 * kBending / (kLength * kLength), 0});
    rod.step(X);
    rod.setTipForce({0, 0, 0});
    stiffness = leastStiffness(rod, X, model.node_mass, damping, rest, 1e-4 * kLength, sideways);
  }
  result.stiffness = is_planar ? stiffness.least * 0.01 : kNone;
  result.planar_stable = is_planar && stiffness.least > 0;
  if (!result.planar_stable) {
    rod.setTipForce({0, 1e-3 * kBending / (kLength * kLength), 0});
    for (int i = 0; i < 10; ++i) rod.step(X);
    rod.setTipForce({0, 0, 0});
  }
  result.converged = rod.rest(X, 20000) && resting && (stiffness.converged || !result.planar_stable);
  result.tip = rod.tip() / kLength;
  result.iterations = rod.iterations();
  return result;
}

namespace {

/// The frame of an edge that starts as the handle's clamp, along +x, and has been turned in the plane
/// y = 0 by `angle` towards +z and about itself by `twist`.
Eigen::Matrix3d endFrame(const Eigen::Isometry3d& X, double angle, double twist) {
  Eigen::Matrix3d down;  // of a clamp that points down the handle
  down << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  return Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()) * X.linear() * down *
         Eigen::AngleAxisd(twist, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

/// Throws std::invalid_argument where a joint would be turned by so much that it cannot be told from the
/// other way round.
void checkTwist(double twist, int nodes) {
  if (twist <= 2.5 * (nodes - 1)) return;
  throw std::invalid_argument("--nodes = " + std::to_string(nodes) + " are too few for the twist: " +
                              std::to_string(static_cast<int>(std::ceil(twist / 2.5)) + 1) +
                              " at least");
}

ContactParameters clampsTo(double tolerance) {
  ContactParameters contact = noPaper();
  contact.multiplier_updates = 100;
  contact.tolerance = tolerance;
  return contact;
}

}  // namespace

RingResult ring(const RingParameters& p) {
  const double guess = 2 * kPi * std::sqrt(3.0) / p.stiffness_ratio;
  checkTwist(1.1 * guess, p.nodes);
  RingResult result;
  result.converged = true;
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, kPi / 2);
  const int edges = p.nodes - 1;
  const double damping = 100;
  const auto end = [&](double turn, double twist) {
    Eigen::Isometry3d E = Eigen::Isometry3d::Identity();
    for (int edge = 0; edge < edges; ++edge) {
      const double angle = turn * (edge + 0.5) / edges;
      E.translation() += Eigen::Vector3d(std::cos(angle), 0, std::sin(angle)) / edges;
    }
    E.linear() = endFrame(X, turn, twist);
    return E;
  };
  RodModel model = makeUniformRod(1.0, 1.0, 1.0, p.nodes);
  model.bending_stiffness_2 = model.bending_stiffness;
  model.twisting_stiffness.assign(model.bending_stiffness.size(), p.stiffness_ratio);
  model.end_clamped = true;
  SingleRod rod(model, quasiStatic(damping, p.precision), clampsTo(1e-13));
  rod.place(X);
  const int rolling = 200;
  for (int step = 1; step <= rolling; ++step) {
    rod.moveEnd(end(2 * kPi * step / rolling, 0));
    rod.step(X);
  }
  double twist = 0;
  const auto twistTo = [&](double next) {
    const double from = twist;
    const int steps = 20 + static_cast<int>(4 * std::abs(next - from));
    for (int step = 1; step <= steps; ++step) {
      twist = from + (next - from) * step / steps;
      rod.moveEnd(end(2 * kPi, twist));
      rod.step(X);
    }
  };

  const auto blow = [&](double size) {
    const int quarter = edges / 4;
    const double force = size * (1 / kTimeStep + damping) / kTimeStep / edges;
    for (const double part : {1.0, 0.0}) {
      rod.setForce(quarter, {0, part * force, 0});
      rod.setForce(edges - quarter, {0, -part * force, 0});
      if (part > 0) rod.step(X);
    }
  };
  const auto stiffness = [&] {
    result.converged = rod.rest(X, 1000) && result.converged;
    const Shape rest = shapeOf(rod, p.nodes);
    // The ring turns about the clamp's direction for nothing, whatever its twist. Other modes are at
    // right angles to that one in the sense of uᵀMu: it is taken out.
    const auto withoutTurn = [&](Shape u) {
      double along = 0, square = 0;
      for (std::size_t i = 0; i < u.size(); ++i) {
        const Eigen::Vector3d turn = Eigen::Vector3d::UnitX().cross(rest[i]);
        along += model.node_mass[i] * turn.dot(u[i]);
        square += model.node_mass[i] * turn.squaredNorm();
      }
      for (std::size_t i = 0; i < u.size(); ++i)
        u[i] -= along / square * Eigen::Vector3d::UnitX().cross(rest[i]);
      return u;
    };
    blow(1e-4);
    const Stiffness found = leastStiffness(rod, X, model.node_mass, damping, rest, 1e-2, withoutTurn);
    result.converged = result.converged && found.converged;
    return found.least;
  };
  // Beyond the critical twist the ring would jump, so it is approached from below: the stiffness falls
  // nearly linearly with the square of the twist.
  twistTo(0.45 * guess);
  double before = twist * twist, stiffness_before = stiffness();
  const double first = stiffness_before;
  twistTo(0.65 * guess);
  double critical = kNone;
  for (int i = 0; i < 20; ++i) {
    const double now = stiffness(), square = twist * twist;
    critical = square + now * (square - before) / (stiffness_before - now);
    if (now < 0.05 * first) break;
    before = square;
    stiffness_before = now;
    twistTo(std::sqrt(square + 0.8 * (critical - square)));
  }
  result.critical_twist = std::sqrt(critical);

  // Above, it does leave that state. It may pass through itself and come back with two turns less.
  twistTo(1.02 * result.critical_twist);
  const Shape above = shapeOf(rod, p.nodes);
  blow(1e-3);
  bool left = false;
  for (int step = 0; step < 2000 && !left; ++step) {
    rod.step(X);
    for (int node = 0; node < p.nodes; ++node)
      left = left || (rod.node(node) - above[static_cast<std::size_t>(node)]).norm() > 0.01;
  }
  result.converged = result.converged && left;
  result.iterations = rod.iterations();
  return result;
}

HelixResult helix(const HelixParameters& p) {
  const double slack = p.slack / p.length;
  if (!(slack <= 0.5)) throw std::invalid_argument("--slack is more than half of --length");
  checkTwist(2 * kPi * p.turns, p.nodes);
  // With L = B = 1. Of a helix an edge is a chord, and so points more along the axis than the curve
  // does; with 2 sin(phi/2) this and what the law bends too easily all but cancel.
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, kPi / 2);
  RodModel model = makeUniformRod(1.0, 1.0, 1.0, p.nodes);
  model.bending_stiffness_2 = model.bending_stiffness;
  model.twisting_stiffness.assign(model.bending_stiffness.size(), p.twisting / p.bending);
  model.end_clamped = true;
  SingleRod rod(model, quasiStatic(10, p.precision, "sine"), clampsTo(1e-11));
  rod.place(X);
  const auto moveEnd = [&](double part, double turns, double aside) {
    Eigen::Isometry3d E = Eigen::Isometry3d::Identity();
    E.translation() = Eigen::Vector3d(1 - slack * part, aside, 0);
    E.linear() = endFrame(X, 0, 2 * kPi * turns);
    rod.moveEnd(E);
    rod.step(X);
  };
  // Aside at first, so that the rod knows where to buckle to.
  for (int step = 1; step <= 200; ++step) {
    const double part = step / 200.0;
    moveEnd(part, 0, 0.1 * std::sqrt(slack) * (1 - part));
  }
  const int twisting = static_cast<int>(std::ceil(100 * p.turns));
  for (int step = 1; step <= twisting; ++step) moveEnd(1, p.turns * step / twisting, 0);

  HelixResult result;
  result.converged = rod.rest(X, 20000);
  result.iterations = rod.iterations();
  for (int node = 1; node < p.nodes; ++node) {
    const Eigen::Vector3d edge = rod.node(node) - rod.node(node - 1);
    result.max_angle = std::max(result.max_angle, std::atan2(std::hypot(edge.y(), edge.z()), edge.x()));
  }
  result.moment = rod.wrench()(3) * p.bending / p.length;
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
