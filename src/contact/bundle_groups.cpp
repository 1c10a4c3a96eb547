#include <algorithm>
#include <limits>
#include <numeric>

#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {
namespace {

/// Gap of rods that touch, but for what the solver leaves, over the distance of their axes.
constexpr double kTouching = 0.05;

/// Distance of a point to the segment from `root` to root + along.
double distanceToSegment(const Eigen::Vector3d& x, const Eigen::Vector3d& root,
                         const Eigen::Vector3d& along) {
  const double t = std::clamp((x - root).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (x - root - t * along).norm();
}

/// Of straight rods at rest, at a part of the first one's length.
template <class Real>
double restingDistance(const BundleBatch<Real>& a, std::size_t lane_a, const BundleBatch<Real>& b,
                       std::size_t lane_b, double part) {
  const auto vectorOf = [](const AlignedVector<Real>& field, std::size_t lane) {
    return Vec3<double>{double(field[lane]), double(field[kLanes + lane]),
                        double(field[2 * kLanes + lane])};
  };
  const double ratio = double(a.length[lane_a]) / double(b.length[lane_b]);
  return distanceAtRest<double>(vectorOf(b.rest, lane_b) - vectorOf(a.rest, lane_a),
                                vectorOf(a.along, lane_a), ratio * vectorOf(b.along, lane_b), part);
}

}  // namespace

template <class Real>
int findGroups(const BundleContact<Real>& contact, int first_node,
               const std::function<Eigen::Vector3d(int rod, int node)>& position,
               std::vector<int>& group_of_rod) {
  std::vector<int> parent(static_cast<std::size_t>(contact.rod_count));
  std::iota(parent.begin(), parent.end(), 0);
  const auto find = [&](int rod) {
    while (parent[static_cast<std::size_t>(rod)] != rod) {
      int& up = parent[static_cast<std::size_t>(rod)];
      up = parent[static_cast<std::size_t>(up)];
      rod = up;
    }
    return rod;
  };
  const int n = contact.node_count, top = static_cast<int>(contact.levels.size()) - 1;
  for (std::size_t slot = 0; slot < contact.pairs.size(); ++slot)
    for (const BundlePair& pair : contact.pairs[slot]) {
      const auto lane = slot % kLanes, other = static_cast<std::size_t>(pair.b) % kLanes;
      const BundleBatch<Real>&ours = contact.batches[slot / kLanes],
            &others = contact.batches[static_cast<std::size_t>(pair.b) / kLanes];
      const int rod_a = ours.rod[lane], rod_b = others.rod[other];
      const double spacing = double(ours.places.spacing(lane));
      const auto at = [&](int level) {
        return contact.levels[static_cast<std::size_t>(level)] / spacing;
      };
      const int lowest = __builtin_ctz(pair.near), highest = 31 - __builtin_clz(pair.near);
      const int first = lowest == 0 ? 1 : static_cast<int>(at(lowest - 1)) + 1;
      const int last = highest == top ? n - 1 : std::min(n - 1, static_cast<int>(at(highest + 1)));
      for (int node = std::max(first_node, first); node <= last; ++node) {
        const auto row = static_cast<std::size_t>(node * kLanes);
        const Eigen::Vector3d x = position(rod_a, node);
        // The nearest edge of the other.
        double between = std::numeric_limits<double>::max();
        int nearest = 0;
        Eigen::Vector3d from = position(rod_b, 0);
        for (int next = 1; next < n; ++next) {
          const Eigen::Vector3d to = position(rod_b, next);
          const double away = distanceToSegment(x, from, to - from);
          if (away < between) between = away, nearest = next;
          from = to;
        }
        const double distance =
            std::min(double(ours.radius[row + lane] +
                            others.radius[static_cast<std::size_t>(nearest * kLanes) + other]),
                     restingDistance(ours, lane, others, other, static_cast<double>(node) / (n - 1)));
        // What is dry hangs together where it touches.
        const double range = double(ours.bridge[row + lane] +
                                    others.bridge[static_cast<std::size_t>(nearest * kLanes) + other]);
        const double near = range > 0.0 ? 0.5 * range : kTouching * distance;
        if (!(between - distance < near)) continue;
        const int a = find(rod_a), b = find(rod_b);
        if (a != b) parent[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
        break;
      }
    }
  group_of_rod.assign(parent.size(), -1);
  int groups = 0;
  for (int rod = 0; rod < contact.rod_count; ++rod) {
    const int head = find(rod);
    group_of_rod[static_cast<std::size_t>(rod)] =
        head == rod ? groups++ : group_of_rod[static_cast<std::size_t>(head)];
  }
  return groups;
}

template int findGroups(const BundleContact<float>&, int,
                        const std::function<Eigen::Vector3d(int, int)>&, std::vector<int>&);
template int findGroups(const BundleContact<double>&, int,
                        const std::function<Eigen::Vector3d(int, int)>&, std::vector<int>&);

}  // namespace calligraphy_brush
