#include "calligraphy_brush/contact/bundle_contact.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
/// Rods around a node that liquid bridges, of those that come after it: as many as lie around a rod.
constexpr std::size_t kNearest = 6;
/// Neighbours move by this part of the motion of clusters relative to all, which is smooth.
constexpr double kSmoothness = 0.25;
/// Gap of rods that touch, but for what the solver leaves, over the distance of their axes.
constexpr double kTouching = 0.05;
/// Gap below which rods may soon touch, in margins.
constexpr double kSoon = 0.3;

/// Saturated neighbours whose hulls together are a rod's perimeter: π/(π/2 − 1).
constexpr double kMostNeighbours = 2.0 * kPi / (kPi - 2.0);

double cohesionAtAngle(double alpha, double& liquid) {
  const double radius = 1.0 / std::cos(alpha) - 1.0, rest = 0.5 * kPi - alpha;
  liquid = 2.0 * (std::tan(alpha) - alpha - radius * radius * rest);
  return 4.0 * alpha - 4.0 * radius * rest;
}

template <class Real>
Eigen::Vector3d quad(const AlignedVector<Real>& field, int node) {
  const Real* at = field.data() + 4 * node;
  return {double(at[0]), double(at[1]), double(at[2])};
}

/// Distance of a point to the segment from `root` to root + along.
double distanceToSegment(const Eigen::Vector3d& x, const Eigen::Vector3d& root,
                         const Eigen::Vector3d& along) {
  const double t = std::clamp((x - root).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (x - root - t * along).norm();
}

template <class Real>
void makeClusters(const BrushModel& brush, BundleContact<Real>& contact) {
  BundleClusters<Real>& clusters = contact.clusters;
  std::vector<int> rods(static_cast<std::size_t>(contact.rod_count));
  std::iota(rods.begin(), rods.end(), 0);
  groupNeighbours(brush, kLanes, rods.begin(), rods.end());
  clusters.count = (contact.rod_count + kLanes - 1) / kLanes;
  const int n = contact.node_count;
  rods.resize(static_cast<std::size_t>(clusters.count * kLanes), contact.rod_count);
  for (const int rod : rods) clusters.first_node.push_back(rod * n);
  const auto places = static_cast<std::size_t>(clusters.count * n);
  clusters.place.resize(places * 3 * kLanes);
  clusters.reach.resize(places * kLanes);
  clusters.radius.resize(places * kLanes);
  clusters.whole.resize(static_cast<std::size_t>(clusters.count));
  clusters.nodes.resize(places);
  clusters.edges.resize(places);
  clusters.cones.resize(places);
}

template <class Real>
void clearPairs(BundlePairs<Real>& pairs) {
  pairs.count = 0;
  for (auto* index : {&pairs.a, &pairs.b}) index->clear();
  for (auto* field : {&pairs.distance, &pairs.range, &pairs.stiffness, &pairs.reach}) field->clear();
}

template <class Real>
void addPair(const BundleContact<Real>& contact, BundlePairs<Real>& pairs, int a, int b, double s,
             double t) {
  const int n = contact.node_count;
  const auto between = [](const AlignedVector<Real>& field, int node, double part) {
    const auto i = static_cast<std::size_t>(node);
    return (1.0 - part) * double(field[i]) + part * double(field[i + (part > 0.0 ? 1 : 0)]);
  };
  const double radius_a = between(contact.radius, a, s), radius_b = between(contact.radius, b, t);
  const auto rod_a = static_cast<std::size_t>(a / n), rod_b = static_cast<std::size_t>(b / n);
  // Where they would be on straight rods at rest.
  const Eigen::Vector3d rest = contact.root_H[rod_a] + (a % n + s) / (n - 1) * contact.along_H[rod_a];
  const double apart = distanceToSegment(rest, contact.root_H[rod_b], contact.along_H[rod_b]);
  const double distance = std::min(radius_a + radius_b, apart);
  if (!(distance > 0.0)) return;
  const double hold = std::min(between(contact.hold, a, s), between(contact.hold, b, t));
  pairs.a.push_back(a);
  pairs.b.push_back(b);
  pairs.distance.push_back(static_cast<Real>(distance));
  pairs.range.push_back(
      static_cast<Real>(double(contact.bridge[rod_a]) + double(contact.bridge[rod_b])));
  const double least = contact.modulus * double(contact.voronoi[static_cast<std::size_t>(a)]);
  pairs.stiffness.push_back(static_cast<Real>(std::max(contact.stiffness * hold, least)));
  pairs.reach.push_back(static_cast<Real>(b % n == n - 2 ? kReachBeyondEnd : 0.0));
  ++pairs.count;
}

/// Up to a multiple of kLanes with pairs that do nothing.
template <class Real>
void fillUp(BundlePairs<Real>& pairs) {
  while (pairs.a.size() % kLanes != 0) {
    pairs.a.push_back(pairs.a.back());
    pairs.b.push_back(pairs.b.back());
    pairs.distance.push_back(pairs.distance.back());
    pairs.range.push_back(pairs.range.back());
    pairs.stiffness.push_back(Real(0));
    pairs.reach.push_back(Real(0));
  }
  for (auto* field : {&pairs.well, &pairs.force, &pairs.gap}) field->assign(pairs.a.size(), Real(0));
}

}  // namespace

double cohesionEnergy(double saturation) {
  const double wanted = std::clamp(saturation, 0.0, 1.0) * (4.0 - kPi);
  if (!(wanted > 0.0)) return 0.0;
  if (wanted >= 4.0 - kPi) return 2.0 * (kPi - 2.0);
  double low = 0.0, high = 0.5 * kPi - 1e-9, liquid = 0.0;
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    cohesionAtAngle(middle, liquid);
    (liquid < wanted ? low : high) = middle;
  }
  return cohesionAtAngle(0.5 * (low + high), liquid);
}

double pairEnergy(double gap, double distance, double stiffness, double cohesion, double range) {
  if (gap >= range) return 0.0;
  const double ratio = gap / range, bridge = 1.0 - ratio * ratio;
  if (gap >= 0.0) return -cohesion * bridge * bridge;
  const double k = stiffness + 4.0 * cohesion / (range * range);
  return -cohesion + 0.5 * k * gap * gap / (1.0 + gap / distance);
}

template <class Real>
BundleContact<Real> makeBundleContact(const BrushModel& brush, const ContactParameters& parameters) {
  BundleContact<Real> contact;
  contact.rod_count = static_cast<int>(brush.rods.size());
  contact.node_count = brush.rods.front().nodeCount();
  const auto count = static_cast<std::size_t>(contact.rod_count * contact.node_count);
  contact.friction = parameters.bundle_friction;
  contact.stiffness = parameters.bundle_stiffness;
  contact.modulus = parameters.bundle_modulus;
  contact.cohesion_range = parameters.cohesion_range;
  contact.surface_tension = parameters.surface_tension;
  double sum_radius = 0.0;
  for (const RodModel& rod : brush.rods) {
    contact.root_H.push_back(rod.root_H);
    contact.along_H.push_back(rod.length * rod.direction_H);
    const double edge = rod.length / (contact.node_count - 1);
    contact.bridge.push_back(static_cast<Real>(
        contact.cohesion_range * *std::max_element(rod.node_radius.begin(), rod.node_radius.end())));
    for (int node = 0; node < contact.node_count; ++node) {
      const bool is_end = node == 0 || node == contact.node_count - 1;
      contact.radius.push_back(static_cast<Real>(rod.node_radius[static_cast<std::size_t>(node)]));
      contact.voronoi.push_back(static_cast<Real>(is_end ? 0.5 * edge : edge));
      sum_radius += rod.node_radius[static_cast<std::size_t>(node)];
    }
  }
  // Long enough for few searches, short enough for few pairs that feel nothing.
  contact.margin = 0.75 * sum_radius / static_cast<double>(count);
  makeClusters(brush, contact);
  contact.hold.assign(count, Real(0));
  contact.saturation.assign(count, Real(0));
  contact.crowd.assign(count, Real(0));
  for (auto* quads : {&contact.point, &contact.way, &contact.gradient, &contact.move, &contact.answer})
    quads->assign(4 * (count + static_cast<std::size_t>(contact.node_count)), Real(0));
  return contact;
}

template <class Real>
double motionSinceSearch(const BundleContact<Real>& contact) {
  if (contact.found_at.size() != contact.point.size()) return std::numeric_limits<double>::max();
  const BundleClusters<Real>& clusters = contact.clusters;
  using Quad = Eigen::Array<Real, 4, 1>;
  const int n = contact.node_count;
  const auto moved = [&](int node) -> Quad {
    return Eigen::Map<const Quad>(contact.point.data() + 4 * node) -
           Eigen::Map<const Quad>(contact.found_at.data() + 4 * node);
  };
  Real own_square = 0, shared_square = 0;
  for (int node = n - 1; node > 0; --node) {
    Quad mean = Quad::Zero();
    for (int rod = 0; rod < contact.rod_count; ++rod) mean += moved(rod * n + node);
    mean /= static_cast<Real>(contact.rod_count);
    for (int cluster = 0; cluster < clusters.count; ++cluster) {
      const std::int32_t* first = clusters.first_node.data() + cluster * kLanes;
      const int rods = std::min(kLanes, contact.rod_count - cluster * kLanes);
      Quad own = Quad::Zero();
      for (int lane = 0; lane < rods; ++lane) own += moved(first[lane] + node);
      own /= static_cast<Real>(rods);
      shared_square = std::max(shared_square, (own - mean).matrix().squaredNorm());
      for (int lane = 0; lane < rods; ++lane)
        own_square = std::max(own_square, (moved(first[lane] + node) - own).matrix().squaredNorm());
    }
  }
  return std::max(std::sqrt(double(own_square)), kSmoothness * std::sqrt(double(shared_square)));
}

/// Of the rods around a node only the nearest are bridged by liquid, for what is further off lies behind
/// them; and what touches or may soon touch counts in any case. Pairs come in the order of their rank,
/// so that those next to each other in the lists belong to different nodes.
template <class Real>
void takeBeside(BundleContact<Real>& contact) {
  using Hit = typename BundleClusters<Real>::Hit;
  BundleClusters<Real>& clusters = contact.clusters;
  const auto nodes = contact.radius.size();
  clusters.begin.assign(nodes + 1, 0);
  for (const Hit& hit : clusters.beside) ++clusters.begin[static_cast<std::size_t>(hit.a) + 1];
  std::partial_sum(clusters.begin.begin(), clusters.begin.end(), clusters.begin.begin());
  clusters.sorted.resize(clusters.beside.size());
  clusters.next.assign(clusters.begin.begin(), clusters.begin.end() - 1);
  for (const Hit& hit : clusters.beside)
    clusters.sorted[static_cast<std::size_t>(clusters.next[static_cast<std::size_t>(hit.a)]++)] = hit;
  std::size_t most = 0;
  for (std::size_t node = 0; node < nodes; ++node) {
    const auto first = clusters.sorted.begin() + clusters.begin[node];
    auto last = clusters.sorted.begin() + clusters.begin[node + 1];
    std::sort(first, last, [](const Hit& a, const Hit& b) {
      return a.squared < b.squared || (a.squared == b.squared && a.b < b.b);
    });
    if (last - first > static_cast<std::ptrdiff_t>(kNearest))
      last = std::remove_if(first + static_cast<std::ptrdiff_t>(kNearest), last, [&](const Hit& hit) {
        const double near = double(contact.radius[node]) +
                            double(contact.radius[static_cast<std::size_t>(hit.b)]) +
                            kSoon * contact.margin;
        return double(hit.squared) > near * near;
      });
    clusters.next[node] = static_cast<int>(last - first);
    most = std::max(most, static_cast<std::size_t>(last - first));
  }
  for (std::size_t rank = 0; rank < most; ++rank)
    for (std::size_t node = 0; node < nodes; ++node)
      if (static_cast<int>(rank) < clusters.next[node]) {
        const Hit& hit = clusters.sorted[static_cast<std::size_t>(clusters.begin[node]) + rank];
        addPair(contact, contact.beside, hit.a, hit.b, 0.0, double(hit.t));
      }
}

template <class Real>
void takePairs(BundleContact<Real>& contact) {
  ++contact.search_count;
  contact.found_at = contact.point;
  clearPairs(contact.beside);
  clearPairs(contact.crossing);
  takeBeside(contact);
  for (const auto& hit : contact.clusters.crossing)
    addPair(contact, contact.crossing, hit.a, hit.b, 0.5, 0.5);

  for (auto* pairs : {&contact.beside, &contact.crossing})
    if (pairs->count > 0) fillUp(*pairs);

  // How many neighbours share what a rod can wet.
  contact.crowd.assign(contact.radius.size(), Real(0));
  for (int i = 0; i < contact.beside.count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const int a = contact.beside.a[at], b = contact.beside.b[at];
    const double gap = distanceToSegment(quad(contact.point, a), quad(contact.point, b),
                                         quad(contact.point, b + 1) - quad(contact.point, b)) -
                       double(contact.beside.distance[at]);
    if (gap > 0.5 * double(contact.beside.range[at])) continue;
    contact.crowd[static_cast<std::size_t>(a)] += Real(1);
    for (const int node : {b, b + 1}) contact.crowd[static_cast<std::size_t>(node)] += Real(0.5);
  }
  updateCohesion(contact);
}

template <class Real>
void updateCohesion(BundleContact<Real>& contact) {
  // The law in a table over the fourth root of the ink, in which it is smooth.
  constexpr int kSteps = 64;
  static const std::array<Real, kSteps + 1> table = [] {
    std::array<Real, kSteps + 1> values{};
    for (int i = 0; i <= kSteps; ++i)
      values[static_cast<std::size_t>(i)] =
          static_cast<Real>(cohesionEnergy(std::pow(double(i) / kSteps, 4.0)));
    return values;
  }();
  const auto mean = [](const AlignedVector<Real>& field, std::int32_t a, std::int32_t b) {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    return Real(0.5) * field[i] + Real(0.25) * (field[j] + field[j + 1]);
  };
  BundlePairs<Real>& pairs = contact.beside;
  for (int i = 0; i < pairs.count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const std::int32_t a = pairs.a[at], b = pairs.b[at];
    const Real ink = std::min(std::max(mean(contact.saturation, a, b), Real(0)), Real(1));
    const Real place = std::sqrt(std::sqrt(ink)) * Real(kSteps);
    const int step = std::min(static_cast<int>(place), kSteps - 1);
    const Real part = place - static_cast<Real>(step);
    const Real law = (Real(1) - part) * table[static_cast<std::size_t>(step)] +
                     part * table[static_cast<std::size_t>(step) + 1];
    const auto share = [&](std::int32_t node) {
      return std::min(
          Real(1), static_cast<Real>(kMostNeighbours) / contact.crowd[static_cast<std::size_t>(node)]);
    };
    const Real energy = static_cast<Real>(contact.surface_tension) * law * mean(contact.radius, a, b) *
                        contact.voronoi[static_cast<std::size_t>(a)] *
                        std::min(share(a), std::min(share(b), share(b + 1)));
    const Real range = pairs.range[at];
    pairs.well[at] = range > Real(0) ? Real(4) * energy / (range * range) : Real(0);
  }
}

template <class Real>
int findGroups(const BundleContact<Real>& contact, int first_node, std::vector<int>& group_of_rod) {
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
  const int n = contact.node_count;
  for (const auto* pairs : {&contact.beside, &contact.crossing})
    for (int i = 0; i < pairs->count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (pairs->a[at] % n < first_node) continue;
      // What is dry hangs together where it touches.
      const Real near = pairs->well[at] > Real(0) ? Real(0.5) * pairs->range[at]
                                                  : static_cast<Real>(kTouching) * pairs->distance[at];
      if (!(pairs->gap[at] < near)) continue;
      const int a = find(pairs->a[at] / n), b = find(pairs->b[at] / n);
      if (a != b) parent[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
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

#define CALLIGRAPHY_INSTANTIATE(Real)                                                          \
  template BundleContact<Real> makeBundleContact(const BrushModel&, const ContactParameters&); \
  template double motionSinceSearch(const BundleContact<Real>&);                               \
  template void takePairs(BundleContact<Real>&);                                               \
  template void updateCohesion(BundleContact<Real>&);                                          \
  template int findGroups(const BundleContact<Real>&, int, std::vector<int>&);
CALLIGRAPHY_INSTANTIATE(float)
CALLIGRAPHY_INSTANTIATE(double)
#undef CALLIGRAPHY_INSTANTIATE

}  // namespace calligraphy_brush
