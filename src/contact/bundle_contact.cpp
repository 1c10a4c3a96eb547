#include "calligraphy_brush/contact/bundle_contact.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
/// Cosine of the angle between edges from which they may cross unseen by nodes.
constexpr double kCrossing = 0.94;
/// Overlap of neighbouring edges, as a part of them, so that none is missed at a kink.
constexpr double kEdgeSlack = 0.15;
/// How far beyond a rod's end its last edge is felt, in edges.
constexpr double kReachBeyondEnd = 0.25;

/// Saturated neighbours whose hulls together are a rod's perimeter: π/(π/2 − 1).
constexpr double kMostNeighbours = 2.0 * kPi / (kPi - 2.0);

/// A piece of an edge as a point, for the grid.
struct Target {
  float x, y, z;     // middle [m]
  float tx, ty, tz;  // direction
  float radius;      // larger of the edge's ends [m]
  int edge;          // rod · node count + first node

  Eigen::Vector3f place() const { return {x, y, z}; }
  Eigen::Vector3f direction() const { return {tx, ty, tz}; }
};

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
  pairs.range.push_back(static_cast<Real>(contact.cohesion_range * (radius_a + radius_b)));
  pairs.stiffness.push_back(static_cast<Real>(contact.stiffness * hold));
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
  return -cohesion + k * distance * (gap - distance * std::log1p(gap / distance));
}

template <class Real>
BundleContact<Real> makeBundleContact(const BrushModel& brush, const ContactParameters& parameters) {
  BundleContact<Real> contact;
  contact.rod_count = static_cast<int>(brush.rods.size());
  contact.node_count = brush.rods.front().nodeCount();
  const auto count = static_cast<std::size_t>(contact.rod_count * contact.node_count);
  contact.friction = parameters.bundle_friction;
  contact.stiffness = parameters.bundle_stiffness;
  contact.cohesion_range = parameters.cohesion_range;
  contact.surface_tension = parameters.surface_tension;
  double sum_radius = 0.0;
  for (const RodModel& rod : brush.rods) {
    contact.root_H.push_back(rod.root_H);
    contact.along_H.push_back(rod.length * rod.direction_H);
    const double edge = rod.length / (contact.node_count - 1);
    for (int node = 0; node < contact.node_count; ++node) {
      const bool is_end = node == 0 || node == contact.node_count - 1;
      contact.radius.push_back(static_cast<Real>(rod.node_radius[static_cast<std::size_t>(node)]));
      contact.voronoi.push_back(static_cast<Real>(is_end ? 0.5 * edge : edge));
      sum_radius += rod.node_radius[static_cast<std::size_t>(node)];
    }
  }
  // Long enough for few searches, short enough for few pairs that feel nothing.
  contact.margin = 0.75 * sum_radius / static_cast<double>(count);
  contact.hold.assign(count, Real(0));
  contact.saturation.assign(count, Real(0));
  contact.crowd.assign(count, Real(0));
  contact.point.assign(4 * count, Real(0));
  contact.way.assign(4 * count, Real(0));
  contact.pull.assign(12 * count, Real(0));
  return contact;
}

template <class Real>
bool pairsAreStale(const BundleContact<Real>& contact) {
  if (contact.found_at.size() != contact.point.size()) return true;
  const double limit = 0.5 * contact.margin;
  const auto n = static_cast<std::size_t>(contact.node_count);
  const auto rods = static_cast<std::size_t>(contact.rod_count);
  for (std::size_t node = 1; node < n; ++node) {
    Real mean[4] = {};
    for (std::size_t rod = 0; rod < rods; ++rod)
      for (std::size_t i = 0; i < 4; ++i) {
        const std::size_t at = 4 * (rod * n + node) + i;
        mean[i] += contact.point[at] - contact.found_at[at];
      }
    for (Real& value : mean) value /= static_cast<Real>(rods);
    Real largest = 0;
    for (std::size_t rod = 0; rod < rods; ++rod) {
      Real square = 0;
      for (std::size_t i = 0; i < 4; ++i) {
        const std::size_t at = 4 * (rod * n + node) + i;
        const Real off = contact.point[at] - contact.found_at[at] - mean[i];
        square += off * off;
      }
      largest = std::max(largest, square);
    }
    if (!(double(largest) < limit * limit)) return true;
  }
  return false;
}

template <class Real>
void findPairs(BundleContact<Real>& contact) {
  ++contact.search_count;
  contact.found_at = contact.point;
  clearPairs(contact.beside);
  clearPairs(contact.crossing);
  const int n = contact.node_count;
  const int edges_per_rod = n - 1;

  double widest = 0.0, longest = 0.0;
  for (const Real radius : contact.radius) widest = std::max(widest, double(radius));
  for (const Real length : contact.voronoi) longest = std::max(longest, double(length));
  if (!(widest > 0.0)) return;
  const double near = 2.0 * widest * (1.0 + contact.cohesion_range) + contact.margin;
  // Edges are cut into pieces not much longer than a cell.
  const int pieces = std::max(1, static_cast<int>(std::ceil(longest / near)));
  const double half_piece = 0.5 * longest / pieces;
  const double cell = near + half_piece;

  std::vector<Target> targets;
  targets.reserve(static_cast<std::size_t>(contact.rod_count * edges_per_rod * pieces));
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::max());
  Eigen::Array3f high = -low;
  for (int rod = 0; rod < contact.rod_count; ++rod)
    for (int edge = 0; edge < edges_per_rod; ++edge) {
      const int index = rod * n + edge;
      const Eigen::Vector3d from = quad(contact.point, index), to = quad(contact.point, index + 1);
      for (int piece = 0; piece < pieces; ++piece) {
        const double s = (piece + 0.5) / pieces;
        const Eigen::Vector3f place = (from + s * (to - from)).cast<float>();
        const Eigen::Vector3f t = (to - from).normalized().cast<float>();
        const auto at = static_cast<std::size_t>(index);
        targets.push_back({place.x(), place.y(), place.z(), t.x(), t.y(), t.z(),
                           static_cast<float>(std::max(contact.radius[at], contact.radius[at + 1])),
                           index});
        low = low.min(place.array());
        high = high.max(place.array());
      }
    }

  // Rods lie together, whatever the handle does; should they not, cells are larger.
  double size = cell;
  Eigen::Array3i cells;
  for (;; size *= 2.0) {
    cells = ((high - low) / static_cast<float>(size)).template cast<int>() + 3;
    if (cells.template cast<double>().prod() < 4.0e5 + 64.0 * double(targets.size())) break;
  }
  const auto cellOf = [&](const Eigen::Vector3f& x, int axis) {
    return static_cast<int>(std::floor((x[axis] - low[axis]) / static_cast<float>(size))) + 1;
  };
  const auto flat = [&](int x, int y, int z) { return (z * cells[1] + y) * cells[0] + x; };
  contact.cell_of.resize(targets.size());
  contact.cell_begin.assign(static_cast<std::size_t>(cells.prod()) + 1, 0);
  for (std::size_t i = 0; i < targets.size(); ++i) {
    const Eigen::Vector3f x = targets[i].place();
    contact.cell_of[i] = flat(cellOf(x, 0), cellOf(x, 1), cellOf(x, 2));
    ++contact.cell_begin[static_cast<std::size_t>(contact.cell_of[i]) + 1];
  }
  std::partial_sum(contact.cell_begin.begin(), contact.cell_begin.end(), contact.cell_begin.begin());
  std::vector<int> next(contact.cell_begin.begin(), contact.cell_begin.end() - 1);
  std::vector<Target> sorted(targets.size());
  for (std::size_t i = 0; i < targets.size(); ++i)
    sorted[static_cast<std::size_t>(next[static_cast<std::size_t>(contact.cell_of[i])]++)] = targets[i];

  // Visits the targets in the cells around a place, in runs along x.
  const auto around = [&](const Eigen::Vector3f& place, auto&& visit) {
    const int x = cellOf(place, 0), y = cellOf(place, 1), z = cellOf(place, 2);
    const int x_from = std::max(x - 1, 0), x_to = std::min(x + 1, cells[0] - 1);
    if (x_from > x_to) return;
    for (int dz = std::max(z - 1, 0); dz <= std::min(z + 1, cells[2] - 1); ++dz)
      for (int dy = std::max(y - 1, 0); dy <= std::min(y + 1, cells[1] - 1); ++dy) {
        const int end = contact.cell_begin[static_cast<std::size_t>(flat(x_to, dy, dz)) + 1];
        for (int i = contact.cell_begin[static_cast<std::size_t>(flat(x_from, dy, dz))]; i < end; ++i)
          visit(sorted[static_cast<std::size_t>(i)]);
      }
  };

  struct Candidate {
    int edge;
    double t, squared;
  };
  std::vector<Candidate> candidates;
  const auto reach_squared = static_cast<float>(cell * cell);
  for (int rod = 0; rod < contact.rod_count; ++rod)
    for (int node = 1; node < n; ++node) {
      const int index = rod * n + node;
      const Eigen::Vector3d x = quad(contact.point, index);
      const Eigen::Vector3f place = x.cast<float>();
      candidates.clear();
      const int first_other = (rod + 1) * n;
      const double own = double(contact.radius[static_cast<std::size_t>(index)]);
      const auto wider = static_cast<float>(1.0 + contact.cohesion_range);
      const auto skin = static_cast<float>(own * (1.0 + contact.cohesion_range) + contact.margin);
      const auto half = static_cast<float>((1.0 + 2.0 * kEdgeSlack) * half_piece);
      around(place, [&](const Target& target) {
        const float dx = place.x() - target.x, dy = place.y() - target.y, dz = place.z() - target.z;
        const float along = dx * target.tx + dy * target.ty + dz * target.tz;
        const float limit = skin + wider * target.radius;
        const float squared_distance = dx * dx + dy * dy + dz * dz;
        if ((target.edge < first_other) | (squared_distance - along * along > limit * limit) |
            (along > half) | (along < -half))
          return;
        const Eigen::Vector3d from = quad(contact.point, target.edge);
        const Eigen::Vector3d edge = quad(contact.point, target.edge + 1) - from;
        const double t = (x - from).dot(edge) / edge.squaredNorm();
        const bool first = target.edge % n == 0, last = target.edge % n == n - 2;
        if (t < (first ? 0.0 : -kEdgeSlack) || t > 1.0 + (last ? kReachBeyondEnd : kEdgeSlack)) return;
        const double clamped = std::clamp(t, 0.0, 1.0);
        const double squared = (x - from - clamped * edge).squaredNorm();
        if (squared > double(limit) * double(limit)) return;
        // One edge of each rod: the nearest.
        for (Candidate& known : candidates)
          if (known.edge / n == target.edge / n) {
            if (squared < known.squared) known = {target.edge, clamped, squared};
            return;
          }
        candidates.push_back({target.edge, clamped, squared});
      });
      std::sort(candidates.begin(), candidates.end(),
                [](const Candidate& a, const Candidate& b) { return a.edge < b.edge; });
      for (const Candidate& found : candidates)
        addPair(contact, contact.beside, index, found.edge, 0.0, found.t);
    }

  // Edges that cross, if any two directions differ enough.
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  for (const Target& target : targets) mean += target.direction();
  if (mean.norm() > 0) mean.normalize();
  float least = 1.0F;
  for (const Target& target : targets) least = std::min(least, mean.dot(target.direction()));
  std::vector<std::pair<int, int>> crossing;
  // All within half the angle of their mean: no two of them cross.
  if (double(least) < std::sqrt(0.5 * (1.0 + kCrossing)))
    for (const Target& target : sorted) {
      const int first_other = (target.edge / n + 1) * n;
      around(target.place(), [&](const Target& other) {
        const float cosine = target.tx * other.tx + target.ty * other.ty + target.tz * other.tz;
        if ((other.edge < first_other) | (std::abs(cosine) > static_cast<float>(kCrossing))) return;
        // Near along the common perpendicular, and each within the other's piece.
        if ((other.place() - target.place()).squaredNorm() > reach_squared) return;
        crossing.emplace_back(target.edge, other.edge);
      });
    }
  std::sort(crossing.begin(), crossing.end());
  crossing.erase(std::unique(crossing.begin(), crossing.end()), crossing.end());
  for (const auto& [a, b] : crossing) addPair(contact, contact.crossing, a, b, 0.5, 0.5);

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
  // The law in a table over the cube root of the ink, in which it is nearly straight.
  constexpr int kSteps = 64;
  static const std::array<double, kSteps + 1> table = [] {
    std::array<double, kSteps + 1> values{};
    for (int i = 0; i <= kSteps; ++i)
      values[static_cast<std::size_t>(i)] = cohesionEnergy(std::pow(double(i) / kSteps, 3.0));
    return values;
  }();
  const auto mean = [](const AlignedVector<Real>& field, std::int32_t a, std::int32_t b) {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    return 0.5 * double(field[i]) + 0.25 * (double(field[j]) + double(field[j + 1]));
  };
  for (auto* pairs : {&contact.beside, &contact.crossing})
    for (int i = 0; i < pairs->count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const std::int32_t a = pairs->a[at], b = pairs->b[at];
      const double ink = std::clamp(mean(contact.saturation, a, b), 0.0, 1.0);
      const double place = std::cbrt(ink) * kSteps;
      const int step = std::min(static_cast<int>(place), kSteps - 1);
      const double part = place - step;
      const double law = (1.0 - part) * table[static_cast<std::size_t>(step)] +
                         part * table[static_cast<std::size_t>(step) + 1];
      const double length = pairs == &contact.beside
                                ? double(contact.voronoi[static_cast<std::size_t>(a)])
                                : 2.0 * double(pairs->distance[at]);
      const auto share = [&](std::int32_t node) {
        return std::min(1.0, kMostNeighbours / double(contact.crowd[static_cast<std::size_t>(node)]));
      };
      const double energy = contact.surface_tension * law * mean(contact.radius, a, b) * length *
                            std::min(share(a), std::min(share(b), share(b + 1)));
      const double range = double(pairs->range[at]);
      pairs->well[at] = static_cast<Real>(range > 0.0 ? 4.0 * energy / (range * range) : 0.0);
    }
}

template <class Real>
void writeSprings(const BundleContact<Real>& contact, const std::vector<int>& rods, Real* springs) {
  for (int node = 0; node < contact.node_count; ++node, springs += 9 * kLanes)
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const int at = rods[std::min(lane, rods.size() - 1)] * contact.node_count + node;
      const Real* g = contact.pull.data() + 12 * at;
      // Twice the curvature by this node alone: then the sum over all nodes lies above the energy.
      Real H[3], M[3];
      for (int i = 0; i < 3; ++i) {
        H[i] = Real(2) * g[4 + i];
        M[i] = Real(2) * g[8 + i];
      }
      const Real* w = contact.way.data() + 4 * at;
      Real* out = springs + lane;
      out[0] = g[0] - (H[0] * w[0] + M[0] * w[1] + M[1] * w[2]);
      out[kLanes] = g[1] - (M[0] * w[0] + H[1] * w[1] + M[2] * w[2]);
      out[2 * kLanes] = g[2] - (M[1] * w[0] + M[2] * w[1] + H[2] * w[2]);
      out[3 * kLanes] = H[0];
      out[4 * kLanes] = M[0];
      out[5 * kLanes] = M[1];
      out[6 * kLanes] = H[1];
      out[7 * kLanes] = M[2];
      out[8 * kLanes] = H[2];
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
      if (pairs->a[at] % n < first_node || !(pairs->gap[at] < Real(0.5) * pairs->range[at])) continue;
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
  template bool pairsAreStale(const BundleContact<Real>&);                                     \
  template void findPairs(BundleContact<Real>&);                                               \
  template void updateCohesion(BundleContact<Real>&);                                          \
  template void writeSprings(const BundleContact<Real>&, const std::vector<int>&, Real*);      \
  template int findGroups(const BundleContact<Real>&, int, std::vector<int>&);
CALLIGRAPHY_INSTANTIATE(float)
CALLIGRAPHY_INSTANTIATE(double)
#undef CALLIGRAPHY_INSTANTIATE

}  // namespace calligraphy_brush
