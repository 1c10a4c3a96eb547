#include "calligraphy_brush/brush/brush_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kGoldenAngle = kPi * (3.0 - 2.2360679774997896964);

/// Standard normal number. std::normal_distribution differs between libraries; this does not.
double standardNormal(std::mt19937_64& random) {
  const auto uniform = [&random] {
    return (static_cast<double>(random() >> 11) + 0.5) * (1.0 / 9007199254740992.0);
  };
  const double radius = std::sqrt(-2.0 * std::log(uniform()));
  return radius * std::cos(2.0 * kPi * uniform());
}

}  // namespace

BrushModel makeBrush(const BrushParameters& p) {
  checkParameters(p);
  std::mt19937_64 random(static_cast<std::uint64_t>(p.seed));

  const double hairs_per_rod = static_cast<double>(p.hair_count) / p.rod_count;
  const double hair_area = kPi * p.hair_radius * p.hair_radius;
  const double hair_inertia = hair_area * p.hair_radius * p.hair_radius / 4.0;
  const double rim = 0.5 * p.root_diameter;

  BrushModel brush;
  for (int rod_index = 0; rod_index < p.rod_count; ++rod_index) {
    RodModel rod;
    const double fraction = std::sqrt((rod_index + 0.5) / p.rod_count);
    const double angle = kGoldenAngle * rod_index;
    const double root_radius = rim * fraction;
    rod.root_H = {root_radius * std::cos(angle), root_radius * std::sin(angle), 0.0};

    // The scatter only shortens: tip_length stays the length of the longest hair. The innermost
    // bundle keeps it exactly.
    const double scatter = rod_index == 0 ? 0.0 : std::abs(standardNormal(random));
    const double core_fraction = rod_index == 0 ? 0.0 : fraction;
    rod.length = p.tip_length *
                 std::max(0.1, (1.0 - p.cone * core_fraction) * (1.0 - p.length_scatter * scatter));
    const Eigen::Vector3d inward = -p.convergence * rod.root_H;
    const double lean_squared = std::min(inward.squaredNorm(), 0.75 * rod.length * rod.length);
    rod.direction_H = inward;
    if (inward.squaredNorm() > 0) rod.direction_H *= std::sqrt(lean_squared / inward.squaredNorm());
    rod.direction_H.z() = -std::sqrt(rod.length * rod.length - lean_squared);
    rod.direction_H.normalize();

    const int n = p.node_count;
    const double edge = rod.length / (n - 1);
    double hair_volume = 0.0;
    for (int node = 0; node < n; ++node) {
      const double s = static_cast<double>(node) / (n - 1);
      const double taper = 1.0 - (1.0 - p.hair_taper) * s;
      const double beyond = p.point > 0 ? std::max(0.0, s - (1.0 - p.point)) / p.point : 0.0;
      const double present = 1.0 - (1.0 - p.point_hairs) * beyond;
      const double hairs = hairs_per_rod * present;
      const double area = hairs * hair_area * taper * taper;
      const double voronoi = (node == 0 || node == n - 1) ? 0.5 * edge : edge;
      if (node < n - 1)
        rod.bending_stiffness.push_back(hairs * p.youngs_modulus * hair_inertia * std::pow(taper, 4));
      rod.node_mass.push_back(p.density * area * voronoi);
      rod.node_radius.push_back(std::sqrt(area / (p.packing * kPi)));
      hair_volume += area * voronoi;
    }
    rod.ink_capacity = hair_volume * (1.0 / p.packing - 1.0);
    brush.tip_length = std::max(brush.tip_length, -rod.direction_H.z() * rod.length);
    brush.rods.push_back(std::move(rod));
  }
  return brush;
}

RodModel makeUniformRod(double length, double bending_stiffness, double line_density, int nodes) {
  RodModel rod;
  rod.length = length;
  const double edge = length / (nodes - 1);
  rod.bending_stiffness.assign(static_cast<std::size_t>(nodes - 1), bending_stiffness);
  rod.node_mass.assign(static_cast<std::size_t>(nodes), line_density * edge);
  rod.node_mass.front() = rod.node_mass.back() = 0.5 * line_density * edge;
  rod.node_radius.assign(static_cast<std::size_t>(nodes), 0.0);
  return rod;
}

void groupNeighbours(const BrushModel& brush, std::ptrdiff_t size, std::vector<int>::iterator begin,
                     std::vector<int>::iterator end) {
  const auto group_count = (end - begin + size - 1) / size;
  if (group_count < 2) return;
  const auto root = [&](int rod) -> const Eigen::Vector3d& {
    return brush.rods[static_cast<std::size_t>(rod)].root_H;
  };
  Eigen::AlignedBox3d box;
  for (auto rod = begin; rod != end; ++rod) box.extend(root(*rod));
  Eigen::Index axis = 0;
  box.sizes().maxCoeff(&axis);
  const auto middle = begin + group_count / 2 * size;
  std::nth_element(begin, middle, end, [&](int a, int b) {
    return std::make_pair(root(a)[axis], a) < std::make_pair(root(b)[axis], b);
  });
  groupNeighbours(brush, size, begin, middle);
  groupNeighbours(brush, size, middle, end);
}

}  // namespace calligraphy_brush
