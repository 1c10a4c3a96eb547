#pragma once

#include <cmath>
#include <limits>

#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {

/// Finds which rods are near one another.
///
/// Rods that are neighbours at the root are kept in clusters of kLanes, so that one node is compared
/// with the edges of a whole cluster at once. Boxes around what the rods of a cluster have at one place
/// along them tell which clusters to compare, and where: a node meets few clusters, however many there
/// are.
template <class V>
class BundleSearch {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Mask = MaskOf<V>;

  /// Pairs at contact.point into contact.found_beside and found_crossing.
  static void find(BundleContact<Real>& contact) {
    BundleClusters<Real>& clusters = contact.clusters;
    clusters.beside.clear();
    clusters.crossing.clear();
    for (int cluster = 0; cluster < clusters.count; ++cluster) take(contact, cluster);
    for (int one = 0; one < clusters.count; ++one)
      for (int other = one; other < clusters.count; ++other) {
        if (!meet(clusters.whole[index(one)], clusters.whole[index(other)])) continue;
        findBetween(contact, one, other);
      }
  }

 private:
  static constexpr int kWidth = widthOf<V>;
  /// Overlap of neighbouring edges, as a part of them, so that none is missed at a kink.
  static constexpr double kEdgeSlack = 0.15;

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static bool meet(const BundleBox<Real>& a, const BundleBox<Real>& b) {
    for (std::size_t i = 0; i < 3; ++i)
      if (a.low[i] > b.high[i] || b.low[i] > a.high[i]) return false;
    return true;
  }

  /// Positions, boxes and directions of a cluster.
  static void take(BundleContact<Real>& contact, int cluster) {
    BundleClusters<Real>& clusters = contact.clusters;
    const int n = contact.node_count;
    const std::int32_t* first = clusters.first_node.data() + cluster * kLanes;
    const Real far = Real(0.01) * std::sqrt(std::numeric_limits<Real>::max());
    BundleBox<Real>& whole = clusters.whole[index(cluster)];
    whole = BundleBox<Real>();
    for (int node = 0; node < n; ++node) {
      Real* place = clusters.place.data() + (cluster * n + node) * 3 * kLanes;
      Real* reach = clusters.reach.data() + (cluster * n + node) * kLanes;
      BundleBox<Real> box;
      Real widest = 0;
      for (int lane = 0; lane < kLanes; ++lane) {
        const bool present = first[lane] < contact.rod_count * n;
        const Real* at = contact.point.data() + 4 * (first[lane] + node);
        for (int i = 0; i < 3; ++i) {
          place[i * kLanes + lane] = present ? at[i] : far;
          if (!present) continue;
          box.low[index(i)] = at[i] < box.low[index(i)] ? at[i] : box.low[index(i)];
          box.high[index(i)] = at[i] > box.high[index(i)] ? at[i] : box.high[index(i)];
        }
        reach[lane] =
            present ? contact.radius[index(first[lane] + node)] + contact.bridge[index(first[lane] / n)]
                    : Real(0);
        clusters.radius[index((cluster * n + node) * kLanes + lane)] =
            present ? contact.radius[index(first[lane] + node)] : Real(0);
        widest = reach[lane] > widest ? reach[lane] : widest;
      }
      BundleBox<Real>& own = clusters.nodes[index(cluster * n + node)];
      own = box;
      own.grow(widest + static_cast<Real>(contact.margin));
      whole.include(own);
      box.grow(widest);
      // An edge has the boxes of both its ends.
      if (node < n - 1) clusters.edges[index(cluster * n + node)] = box;
      if (node > 0) clusters.edges[index(cluster * n + node - 1)].include(box);
    }
    for (int edge = 0; edge < n - 1; ++edge) {
      const Real* from = clusters.place.data() + (cluster * n + edge) * 3 * kLanes;
      const Real* to = from + 3 * kLanes;
      double mean[3] = {}, direction[kLanes][3];
      for (int lane = 0; lane < kLanes; ++lane) {
        double square = 0.0;
        for (int i = 0; i < 3; ++i) {
          direction[lane][i] = double(to[i * kLanes + lane]) - double(from[i * kLanes + lane]);
          square += direction[lane][i] * direction[lane][i];
        }
        for (int i = 0; i < 3; ++i) {
          direction[lane][i] /= std::sqrt(square) + 1e-30;
          mean[i] += direction[lane][i];
        }
      }
      const double size = std::sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]) + 1e-30;
      BundleCone& cone = clusters.cones[index(cluster * n + edge)];
      double least = 1.0;
      for (int i = 0; i < 3; ++i) cone.axis[index(i)] = mean[i] / size;
      for (int lane = 0; lane < kLanes; ++lane) {
        if (first[lane] >= contact.rod_count * n) continue;
        double cosine = 0.0;
        for (int i = 0; i < 3; ++i) cosine += direction[lane][i] * cone.axis[index(i)];
        least = cosine < least ? cosine : least;
      }
      cone.angle = std::acos(least < -1.0 ? -1.0 : least);
    }
  }

  static bool mayCross(const BundleCone& a, const BundleCone& b) {
    double cosine = 0.0;
    for (std::size_t i = 0; i < 3; ++i) cosine += a.axis[i] * b.axis[i];
    cosine = cosine < -1.0 ? -1.0 : cosine > 1.0 ? 1.0 : cosine;
    const double between = std::acos(cosine), limit = std::acos(kCrossingCosine);
    return between + a.angle + b.angle > limit;  // and never mind those that run against each other
  }

  static void findBetween(BundleContact<Real>& contact, int one, int other) {
    BundleClusters<Real>& clusters = contact.clusters;
    const int n = contact.node_count;
    std::vector<int>&near = clusters.near, &across = clusters.across;
    for (int node = 0; node < n; ++node) {
      near.clear();
      across.clear();
      BundleBox<Real> own = clusters.edges[index(one * n + node)];
      own.grow(static_cast<Real>(contact.margin));
      for (int edge = 0; edge < n - 1; ++edge) {
        const auto target = index(other * n + edge);
        if (node > 0 && meet(clusters.nodes[index(one * n + node)], clusters.edges[target]))
          near.push_back(edge);
        if (node < n - 1 && meet(own, clusters.edges[target]) &&
            mayCross(clusters.cones[index(one * n + node)], clusters.cones[target]))
          across.push_back(edge);
      }
      if (near.empty() && across.empty()) continue;
      for (int lane = 0; lane < kLanes; ++lane) {
        const std::int32_t first = clusters.first_node[index(one * kLanes + lane)];
        if (first >= contact.rod_count * n) continue;
        if (!near.empty()) findBeside(contact, one, lane, node, other);
        if (!across.empty()) findCrossing(contact, one, lane, node, other);
      }
    }
  }

  /// Rods in lanes from here on may still be paired with the rod in `lane`.
  static CALLIGRAPHY_INLINE Mask later(int one, int lane, int other, int first) {
    alignas(64) Real number[kWidth];
    for (int k = 0; k < kWidth; ++k) number[k] = static_cast<Real>(first + k);
    return load<V>(number) > broadcast<V>(static_cast<Real>(one == other ? lane : -1));
  }

  /// One edge of each rod: the nearest.
  static void findBeside(BundleContact<Real>& contact, int one, int lane, int node, int other) {
    BundleClusters<Real>& clusters = contact.clusters;
    const int n = contact.node_count;
    const Real* place = clusters.place.data() + (one * n + node) * 3 * kLanes + lane;
    const Vector x{broadcast<V>(place[0]), broadcast<V>(place[kLanes]), broadcast<V>(place[2 * kLanes])};
    const Real reach =
        clusters.reach[index((one * n + node) * kLanes + lane)] + static_cast<Real>(contact.margin);
    std::vector<int>& met = clusters.met;
    met.clear();
    BundleBox<Real> around;
    for (int i = 0; i < 3; ++i) around.low[index(i)] = around.high[index(i)] = place[i * kLanes];
    around.grow(reach);
    for (const int edge : clusters.near)
      if (meet(around, clusters.edges[index(other * n + edge)])) met.push_back(edge);
    if (met.empty()) return;
    const V own = broadcast<V>(reach);
    const V zero{}, unit = broadcast<V>(1), none = broadcast<V>(std::numeric_limits<Real>::max());
    for (int part = 0; part < kLanes; part += kWidth) {
      V best = none, best_edge = zero, best_t = zero;
      const Mask allowed = later(one, lane, other, part);
      for (const int edge : met) {
        const Real* at = clusters.place.data() + (other * n + edge) * 3 * kLanes + part;
        const Real* radii = clusters.reach.data() + (other * n + edge) * kLanes + part;
        const Vector from = Vector::loadFrom(at), along = Vector::loadFrom(at + 3 * kLanes) - from;
        const V t = dot(x - from, along) / squaredNorm(along);
        const V before = broadcast<V>(static_cast<Real>(edge == 0 ? 0.0 : -kEdgeSlack));
        const V beyond =
            broadcast<V>(static_cast<Real>(1.0 + (edge == n - 2 ? kReachBeyondEnd : kEdgeSlack)));
        const V clamped = min(max(t, zero), unit);
        const V squared = squaredNorm(x - (from + clamped * along));
        const V limit = own + max(load<V>(radii), load<V>(radii + kLanes));
        const Mask better =
            allowed & (t >= before) & (t <= beyond) & (squared <= limit * limit) & (squared < best);
        best = select(better, squared, best);
        best_edge = select(better, broadcast<V>(static_cast<Real>(edge)), best_edge);
        best_t = select(better, clamped, best_t);
      }
      if (!any(best < none)) continue;
      alignas(64) Real squared[kWidth], edges[kWidth], ts[kWidth];
      store<V>(squared, best);
      store<V>(edges, best_edge);
      store<V>(ts, best_t);
      const std::int32_t* first = clusters.first_node.data() + other * kLanes + part;
      for (int k = 0; k < kWidth; ++k)
        if (squared[k] < std::numeric_limits<Real>::max())
          clusters.beside.push_back({clusters.first_node[index(one * kLanes + lane)] + node,
                                     first[k] + static_cast<int>(edges[k]), ts[k], squared[k]});
    }
  }

  /// Liquid between rods that cross is too little to matter: these only touch.
  static void findCrossing(BundleContact<Real>& contact, int one, int lane, int node, int other) {
    BundleClusters<Real>& clusters = contact.clusters;
    const int n = contact.node_count;
    const Real* place = clusters.place.data() + (one * n + node) * 3 * kLanes + lane;
    const Real* next = place + 3 * kLanes;
    const Vector a{broadcast<V>(place[0]), broadcast<V>(place[kLanes]), broadcast<V>(place[2 * kLanes])};
    const Vector e{broadcast<V>(next[0] - place[0]), broadcast<V>(next[kLanes] - place[kLanes]),
                   broadcast<V>(next[2 * kLanes] - place[2 * kLanes])};
    const Real* radius = clusters.radius.data() + (one * n + node) * kLanes + lane;
    const Real reach = std::max(radius[0], radius[kLanes]) + static_cast<Real>(contact.margin);
    std::vector<int>& met = clusters.met;
    met.clear();
    BundleBox<Real> around;
    for (int i = 0; i < 3; ++i) {
      around.low[index(i)] = std::min(place[i * kLanes], next[i * kLanes]);
      around.high[index(i)] = std::max(place[i * kLanes], next[i * kLanes]);
    }
    around.grow(reach);
    for (const int edge : clusters.across)
      if (meet(around, clusters.edges[index(other * n + edge)])) met.push_back(edge);
    if (met.empty()) return;
    const V own = broadcast<V>(reach);
    const V unit = broadcast<V>(1), slack = broadcast<V>(static_cast<Real>(kEdgeSlack));
    const V square_limit = broadcast<V>(static_cast<Real>(kCrossingCosine * kCrossingCosine));
    const V ee = squaredNorm(e);
    for (int part = 0; part < kLanes; part += kWidth) {
      const Mask allowed = later(one, lane, other, part);
      for (const int edge : met) {
        const Real* at = clusters.place.data() + (other * n + edge) * 3 * kLanes + part;
        const Real* radii = clusters.radius.data() + (other * n + edge) * kLanes + part;
        const Vector from = Vector::loadFrom(at), f = Vector::loadFrom(at + 3 * kLanes) - from;
        const Vector r = a - from;
        const V ff = squaredNorm(f), ef = dot(e, f), er = dot(e, r), fr = dot(f, r);
        const V area = ee * ff - ef * ef;
        const V s = (ef * fr - er * ff) / area, t = (ee * fr - ef * er) / area;
        const V limit = own + max(load<V>(radii), load<V>(radii + kLanes));
        const Vector d = r + s * e - t * f;
        const Mask found = allowed & (ef * ef < square_limit * ee * ff) & (s > -slack) &
                           (s < unit + slack) & (t > -slack) & (t < unit + slack) &
                           (squaredNorm(d) <= limit * limit);
        if (!any(found)) continue;
        alignas(64) Real flags[kWidth];
        store<V>(flags, select(found, unit, V{}));
        const std::int32_t* first = clusters.first_node.data() + other * kLanes + part;
        for (int k = 0; k < kWidth; ++k)
          if (flags[k] != Real(0))
            clusters.crossing.push_back({clusters.first_node[index(one * kLanes + lane)] + node,
                                         first[k] + edge, Real(0.5), Real(0)});
      }
    }
  }
};

}  // namespace calligraphy_brush
