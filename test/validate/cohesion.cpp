#include "cohesion.h"

#include <algorithm>
#include <array>

#include "calligraphy_brush/contact/bundle_contact.h"
#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

/// The first rod of a group, of `groups` along a row of `count` rods, as equal as may be.
int firstRod(int group, int groups, int count) {
  return (group * count + groups - 1) / groups;
}

/// Parallel rods in the plane y = 0, in units in which they are 1 long.
///
/// A shape at rest only depends on B/w. So the liquid is the brush's own: of the default surface
/// tension γ, rods that are full of it, w = 2 (π − 2) γ r by cohesionEnergy(), and of such a stiffness
/// that w/B is what is asked for. The medium is viscous: nothing overshoots.
class RowOfRods {
 public:
  /// hardness: of the contact. The pull of the liquid dents it by 2/hardness of the range, and it holds
  /// by the part 2/hardness of w more.
  RowOfRods(const CohesionParameters& p, int count, double hardness)
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
    // Where groups move as one, a step in which their inertia counts for little gets no further by being
    // longer; nor do more rounds a step, but that one alone may rest too early in groups of sixteen.
    RodParameters rods = exactRods(0.01, "backward_euler", p.precision);
    rods.damping = 7.0;
    rods.max_iterations = 50;
    rods.wet_stiffness = 1.0;
    rods.wet_memory = 0.0;
    ContactParameters contact = noPaper();
    contact.bundles = true;
    contact.bundle_stiffness = 0.01;
    contact.bundle_modulus = hardness * energy_ / std::pow(range_ * spacing_, 2.0);
    contact.bundle_friction = 0.0;
    contact.cohesion_range = range_ * spacing_ / (2.0 * radius_);
    contact.coupling_rounds = 2;
    contact.coupling_tolerance = 1e-7;
    tuft_ = makeTuft(brush, rods, contact);
  }

  /// L_dry of two rods for small slopes.
  double dryLength() const { return std::pow(9.0 * bending_ * spacing_ * spacing_ / energy_, 0.25); }

  /// Presses the dry rods together in groups along the row, as equal as may be, wets them, lets go of
  /// them and lets them come to rest: to where nodes move against their neighbours by less than the part
  /// `still` of the spacing in a step. Returns whether they did.
  bool gather(int groups, double still) {
    groups_ = groups;
    tuft_->place(Eigen::Isometry3d::Identity());
    setInk(0.0);
    // Under a load q a clamped rod touches a wall at the distance δ from (72 B δ/q)^¼ on.
    // More, and the pair falls over to one side.
    const double touching = 0.8;
    const double edge = 1.0 / (nodes_ - 1);
    const auto press = [&](double part) {
      for (int rod = 0; rod < count_; ++rod) {
        const double way = (0.5 * (firstOf(rod) + lastOf(rod)) - rod) * spacing_;
        const double load = part * 72.0 * bending_ * way / std::pow(touching, 4.0);
        for (int node = 1; node < nodes_; ++node)
          tuft_->setNodeForce(rod, node, {load * edge * (node == nodes_ - 1 ? 0.5 : 1.0), 0, 0});
      }
    };
    const int portions = 20, steps = 20;  // in each
    for (int portion = 1; portion <= portions; ++portion) {
      press(static_cast<double>(portion) / portions);
      for (int i = 0; i < steps; ++i) step();
    }
    setInk(1.0);
    for (int portion = 1; portion <= portions; ++portion) {
      press(std::pow(1.0 - static_cast<double>(portion) / portions, 4.0));
      for (int i = 0; i < steps; ++i) step();
    }
    return rest((p_.precision == "float" ? 1e-4 : still) * spacing_);
  }

  /// The first and the last rod of a rod's group.
  int firstOf(int rod) const { return firstRod(rod * groups_ / count_, groups_, count_); }
  int lastOf(int rod) const { return firstRod(rod * groups_ / count_ + 1, groups_, count_) - 1; }

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

  void setInk(double saturation) {
    tuft_->setInk(std::vector<double>(static_cast<std::size_t>(count_ * nodes_), saturation));
  }

  /// Until no node moves against its neighbours by more than `still` for 20 steps.
  bool rest(double still) {
    std::vector<std::vector<Eigen::Vector3d>> before(static_cast<std::size_t>(count_)), now = before;
    for (auto& rod : before) rod.assign(static_cast<std::size_t>(nodes_), Eigen::Vector3d::Zero());
    const int most = 10000;
    for (int count = 0, still_steps = 0; count < most; ++count) {
      step();
      double moved = 0.0;
      for (int rod = 0; rod < count_; ++rod) {
        const auto at = static_cast<std::size_t>(rod);
        tuft_->readRod(rod, now[at]);
        if (rod == firstOf(rod)) continue;
        for (std::size_t node = 1; node < now[at].size(); ++node)
          moved = std::max(
              moved,
              ((now[at][node] - now[at - 1][node]) - (before[at][node] - before[at - 1][node])).norm());
      }
      before.swap(now);
      still_steps = moved <= still ? still_steps + 1 : 0;
      if (still_steps == 20) return true;
    }
    return false;
  }

  CohesionParameters p_;
  int count_, nodes_, groups_ = 1;
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

/// Taken for the dry length of a seam whose rods do not touch, over their length: what it is where they
/// touch at their very ends, with no moment there.
constexpr double kApart = 2.0;

/// What is between two neighbours of a group, all rods on one side of it against all on the other.
struct Seam {
  double pulled_from = kNone, first_contact = kNone;  ///< parts of the length
  FreePart free{kNone, kNone, kNone};                 ///< its dry length; none if they do not touch
};

/// Rods that only feel each other bend, added up, as one that feels the force at the seam alone. So up
/// to where the liquid in the seam pulls the mean curvatures are straight lines in the depth, and so is
/// half of their difference, by which the two sides approach.
Seam seamAfter(const RowOfRods& row, int rod) {
  Seam seam;
  const auto left = row.shape(rod), right = row.shape(rod + 1);
  std::vector<double> gap;
  for (std::size_t node = 0; node < left.size(); ++node)
    gap.push_back((left[node] - right[node]).norm() - 2.0 * row.radius());
  seam.pulled_from = firstBelow(gap, row.range());
  seam.first_contact = firstBelow(gap, 1e-3 * row.range());
  if (!(*std::min_element(gap.begin(), gap.end()) < 0.5 * row.range())) return seam;

  std::vector<double> depth(gap.size(), 0.0), curvature(gap.size() - 1, 0.0);
  const int first = row.firstOf(rod), last = row.lastOf(rod);
  for (int i = first; i <= last; ++i) {
    const auto shape = row.shape(i);
    const auto of_rod = RowOfRods::curvature(shape);
    const double share = i <= rod ? -0.5 / (rod - first + 1) : 0.5 / (last - rod);
    for (std::size_t node = 0; node < of_rod.size(); ++node) {
      curvature[node] += share * of_rod[node];
      depth[node] -= std::abs(share) * shape[node].z();
    }
  }
  double count = 0, z1 = 0, k1 = 0, zz = 0, zk = 0;
  for (std::size_t node = 0; node < curvature.size() && gap[node] >= row.range(); ++node) {
    const double z = depth[node], k = curvature[node];
    count += 1;
    z1 += z;
    k1 += k;
    zz += z * z;
    zk += z * k;
  }
  // Closed from the clamp on, as far as nodes tell.
  if (count < 2) {
    seam.free.length = 0.0;
    return seam;
  }
  const double slope = (z1 * k1 - count * zk) / (count * zz - z1 * z1);
  seam.free = integrateFreePart((k1 + slope * z1) / count, slope);
  return seam;
}

}  // namespace

CohesionPairResult cohesionPair(const CohesionPairParameters& p) {
  RowOfRods pair(p, 2, 200.0);
  CohesionPairResult result;
  result.converged = pair.gather(1, 1e-9);
  result.iterations = pair.iterations();
  const Seam seam = seamAfter(pair, 0);
  result.holds = std::isfinite(seam.free.length);
  if (!result.holds) return result;
  // In units of the parameters.
  result.pulled_from = p.length * seam.pulled_from;
  result.first_contact = p.length * seam.first_contact;
  result.dry_length = p.length * seam.free.length;
  result.root_moment = p.bending / p.length * seam.free.curvature;
  result.energy =
      p.bending / p.length * 2.0 * seam.free.energy - p.energy * (p.length - result.dry_length);
  result.stuck = result.energy < 0;
  return result;
}

CohesionRowResult cohesionRow(const CohesionRowParameters& p) {
  RowOfRods row(p, p.count, 20.0);
  CohesionRowResult result;
  result.predicted = 2.0 * std::pow(1.0 / row.dryLength(), 4.0 / 3.0);
  result.converged = true;
  // Of the widest seams of the groups, the mean dry length; larger groups have wider ones.
  const auto dryLength = [&](int groups) {
    result.converged = row.gather(groups, 1e-5) && result.converged;
    double sum = 0.0, widest = 0.0;
    for (int rod = 0; rod < p.count; ++rod) {
      if (rod < row.lastOf(rod)) {
        const double length = seamAfter(row, rod).free.length;
        widest = std::max(widest, std::isnan(length) ? kApart : length);
      } else {
        sum += widest;
        widest = 0.0;
      }
    }
    return sum / groups;
  };
  int close = p.count, open = 0;
  double of_close = 0.0, of_open = INFINITY;
  while (close - open > 1) {
    const int middle = (close + open) / 2;
    const double length = dryLength(middle);
    (length <= 1.0 ? close : open) = middle;
    (length <= 1.0 ? of_close : of_open) = length;
  }
  const int groups = of_open - 1.0 < 1.0 - of_close ? open : close;
  for (int group = 0; group < groups; ++group)
    result.group_sizes.push_back(firstRod(group + 1, groups, p.count) -
                                 firstRod(group, groups, p.count));
  result.largest = *std::max_element(result.group_sizes.begin(), result.group_sizes.end());
  result.iterations = row.iterations();
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
