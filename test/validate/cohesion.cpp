#include "cohesion.h"

#include <algorithm>
#include <array>

#include "calligraphy_brush/contact/bundle_contact.h"
#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

/// Parallel rods in the plane y = 0, in units in which they are 1 long.
///
/// A shape at rest only depends on B/w. So the liquid is the brush's own: of the default surface
/// tension γ, rods that are full of it, w = 2 (π − 2) γ r by cohesionEnergy(), and of such a stiffness
/// that w/B is what is asked for. The medium is viscous: nothing overshoots.
class RowOfRods {
 public:
  RowOfRods(const CohesionParameters& p, int count)
      : p_(p), count_(count), nodes_(p.nodes), spacing_(p.spacing / p.length), radius_(0.5 * spacing_) {
    const ContactParameters defaults;
    energy_ = defaults.surface_tension * cohesionEnergy(1.0) * radius_;
    bending_ = energy_ * p.bending / (p.energy * p.length * p.length);
    // The zone in which rods pull before they touch is about 0.84 L_dry √(range/spacing) long: some
    // edges.
    const double dry = std::min(1.0, dryLength()), edges = 7.0 / (nodes_ - 1);
    range_ = p.range > 0.0 ? p.range : std::clamp(std::pow(edges / (0.84 * dry), 2.0), 1e-3, 0.2);

    BrushModel brush;
    brush.tip_length = 1.0;
    for (int rod = 0; rod < count; ++rod) {
      RodModel model = makeUniformRod(1.0, bending_, bending_, nodes_);
      model.node_radius.assign(static_cast<std::size_t>(nodes_), radius_);
      model.root_H.x() = (rod - 0.5 * (count - 1)) * (spacing_ + 2.0 * radius_);
      brush.rods.push_back(std::move(model));
    }
    RodParameters rods = exactRods(0.1, "backward_euler", p.precision);
    rods.damping = 10.0;
    rods.max_iterations = 50;
    rods.wet_stiffness = 1.0;
    rods.wet_memory = 0.0;
    ContactParameters contact = noPaper();
    contact.bundles = true;
    // The pull of the liquid dents the contact, which then holds by as much more: by a hundredth.
    contact.bundle_stiffness = 0.01;
    contact.bundle_modulus = 200.0 * energy_ / std::pow(range_ * spacing_, 2.0);
    contact.bundle_friction = 0.0;
    contact.cohesion_range = range_ * spacing_ / (2.0 * radius_);
    contact.coupling_rounds = 60;
    contact.coupling_tolerance = 1e-7 * spacing_;
    tuft_ = makeTuft(brush, rods, contact);
  }

  /// L_dry of two rods for small slopes.
  double dryLength() const { return std::pow(9.0 * bending_ * spacing_ * spacing_ / energy_, 0.25); }

  /// Presses the rods together in groups of `size` along the row, the last the rest, lets go of them
  /// and lets them come to rest. Returns whether they did.
  bool gather(int size) {
    tuft_->place(Eigen::Isometry3d::Identity());
    tuft_->setInk(std::vector<double>(static_cast<std::size_t>(count_ * nodes_), 1.0));
    // Under a load q a clamped rod touches a wall at the distance δ from (72 B δ/q)^¼ on.
    // More, and the pair falls over to one side.
    const double touching = 0.8;
    const double edge = 1.0 / (nodes_ - 1);
    const auto press = [&](double part) {
      for (int rod = 0; rod < count_; ++rod) {
        const int first = rod / size * size, last = std::min(first + size, count_) - 1;
        const double way = (0.5 * (first + last) - rod) * spacing_;
        const double load = part * 72.0 * bending_ * way / std::pow(touching, 4.0);
        for (int node = 1; node < nodes_; ++node)
          tuft_->setNodeForce(rod, node, {load * edge * (node == nodes_ - 1 ? 0.5 : 1.0), 0, 0});
      }
    };
    const int pressing = 200, letting_go = 200;
    for (int step = 1; step <= pressing; ++step) {
      press(static_cast<double>(step) / pressing);
      this->step();
    }
    for (int step = 1; step <= letting_go; ++step) {
      press(std::pow(1.0 - static_cast<double>(step) / letting_go, 4.0));
      this->step();
    }
    return rest(4000);
  }

  /// How many rods hang together, group by group along the row.
  std::vector<int> groups() const {
    std::vector<int> label(static_cast<std::size_t>(count_)), sizes;
    sizes.assign(static_cast<std::size_t>(tuft_->groups(1.0, label)), 0);
    for (const int group : label) ++sizes[static_cast<std::size_t>(group)];
    return sizes;
  }

  std::vector<Eigen::Vector3d> shape(int rod) const {
    std::vector<Eigen::Vector3d> nodes;
    tuft_->readRod(rod, nodes);
    return nodes;
  }

  /// Curvature at the nodes of a rod but the last; at the clamp, half an edge long, as the solver has
  /// it.
  static std::vector<double> curvature(const std::vector<Eigen::Vector3d>& nodes) {
    std::vector<double> curvature;
    Eigen::Vector3d before = -Eigen::Vector3d::UnitZ();
    for (std::size_t node = 0; node + 1 < nodes.size(); ++node) {
      const Eigen::Vector3d edge = nodes[node + 1] - nodes[node], along = edge.normalized();
      const double tangent = before.cross(along).y() / (1.0 + before.dot(along));  // of half the turn
      curvature.push_back(2.0 * tangent / (edge.norm() * (node == 0 ? 0.5 : 1.0)));
      before = along;
    }
    return curvature;
  }

  int iterations() const { return iterations_; }
  double spacing() const { return spacing_; }
  double radius() const { return radius_; }
  double range() const { return range_ * spacing_; }
  double energy() const { return energy_; }
  double bending() const { return bending_; }

 private:
  void step() { iterations_ += tuft_->step(Eigen::Isometry3d::Identity()).iterations; }

  /// Until no node moves by rounding for 20 steps.
  bool rest(int most) {
    const double rounding = (p_.precision == "float" ? 1e-4 : 1e-9) * spacing_;
    std::vector<Eigen::Vector3d> before(static_cast<std::size_t>(count_ * nodes_));
    for (int count = 0, still = 0; count < most; ++count) {
      step();
      double moved = 0.0;
      for (int rod = 0; rod < count_; ++rod)
        for (int node = 1; node < nodes_; ++node) {
          const Eigen::Vector3d now = tuft_->nodePosition(rod, node);
          Eigen::Vector3d& then = before[static_cast<std::size_t>(rod * nodes_ + node)];
          moved = std::max(moved, (now - then).norm());
          then = now;
        }
      still = moved <= rounding ? still + 1 : 0;
      if (still == 20) return true;
    }
    return false;
  }

  CohesionParameters p_;
  int count_, nodes_;
  double spacing_, radius_, range_ = 0, energy_ = 0, bending_ = 0;
  std::unique_ptr<Tuft> tuft_;
  int iterations_ = 0;
};

/// Length up to where a line through values at the nodes, 1/n_edges apart, first falls to `level`.
double firstBelow(const std::vector<double>& values, double level) {
  for (std::size_t node = 1; node < values.size(); ++node)
    if (values[node] <= level)
      return (static_cast<double>(node) - (level - values[node]) / (values[node - 1] - values[node])) /
             static_cast<double>(values.size() - 1);
  return kNone;
}

/// A rod up to where it runs along its neighbour.
struct FreePart {
  double curvature;  ///< at the clamp
  double length;
  double energy;  ///< of bending, B = 1
};

/// A free part feels one force, so that its curvature is κ₀ − q z at the depth z below the clamp. From
/// d(sin φ) = (κ₀ − q z) dz it has turned back into the direction of its clamp at z = 2 κ₀/q; there
/// the length is ∫ dz/cos φ and the energy ½ ∫ (κ₀ − q z)² dz/cos φ.
FreePart integrateFreePart(double curvature, double slope) {
  const double depth = 2.0 * curvature / slope;
  const int steps = 400;
  FreePart free{curvature, 0.0, 0.0};
  for (int i = 0; i < steps; ++i) {
    const double z = depth * (i + 0.5) / steps;
    const double sine = curvature * z - 0.5 * slope * z * z, here = curvature - slope * z;
    const double length = depth / steps / std::sqrt(1.0 - sine * sine);
    free.length += length;
    free.energy += 0.5 * here * here * length;
  }
  return free;
}

}  // namespace

CohesionPairResult cohesionPair(const CohesionPairParameters& p) {
  RowOfRods pair(p, 2);
  CohesionPairResult result;
  result.converged = pair.gather(2);
  result.iterations = pair.iterations();
  result.holds = pair.groups().size() == 1;
  if (!result.holds) return result;

  const auto left = pair.shape(0), right = pair.shape(1);
  std::vector<double> gap;
  for (std::size_t node = 0; node < left.size(); ++node)
    gap.push_back((left[node] - right[node]).norm() - 2.0 * pair.radius());
  result.pulled_from = p.length * firstBelow(gap, pair.range());
  result.first_contact = p.length * firstBelow(gap, 1e-3 * pair.range());

  // Both bend towards each other; from the first pulled node on their force changes.
  const auto of_left = RowOfRods::curvature(left), of_right = RowOfRods::curvature(right);
  double count = 0, z1 = 0, k1 = 0, zz = 0, zk = 0;
  for (std::size_t node = 0; node < of_left.size() && gap[node] >= pair.range(); ++node) {
    const double z = -0.5 * (left[node].z() + right[node].z());
    const double k = 0.5 * (of_right[node] - of_left[node]);
    count += 1;
    z1 += z;
    k1 += k;
    zz += z * z;
    zk += z * k;
  }
  const double slope = (z1 * k1 - count * zk) / (count * zz - z1 * z1);
  const FreePart free = integrateFreePart((k1 + slope * z1) / count, slope);
  // In units of the parameters.
  result.dry_length = p.length * free.length;
  result.root_moment = p.bending / p.length * free.curvature;
  result.energy = p.bending / p.length * 2.0 * free.energy - p.energy * (p.length - result.dry_length);
  result.stuck = result.energy < 0;
  return result;
}

CohesionRowResult cohesionRow(const CohesionRowParameters& p) {
  RowOfRods row(p, p.count);
  CohesionRowResult result;
  result.predicted = 2.0 * std::pow(1.0 / row.dryLength(), 4.0 / 3.0);
  result.converged = true;
  // Whether groups of a size hold; larger ones part sooner.
  const auto hold = [&](int size) {
    result.converged = row.gather(size) && result.converged;
    std::vector<int> sizes = row.groups();
    const int largest = *std::max_element(sizes.begin(), sizes.end());
    const bool held = static_cast<int>(sizes.size()) == (p.count + size - 1) / size && largest == size;
    if (held) result.group_sizes = std::move(sizes);
    return held;
  };
  int holds = 1, parts = p.count + 1;
  result.group_sizes.assign(static_cast<std::size_t>(p.count), 1);
  while (parts - holds > 1) {
    const int middle = (holds + parts) / 2;
    (hold(middle) ? holds : parts) = middle;
  }
  result.largest = holds;
  result.iterations = row.iterations();
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
