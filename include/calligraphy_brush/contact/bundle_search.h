#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {

/// Finds which rods are near one another.
///
/// At some levels along the tuft, points of rods as far from their roots are compared, a batch with a
/// batch at once: lane by lane, and again with the lanes of the second turned by one, and so on. Rods
/// that are neighbours at the root share a batch, so that balls around what a batch has at a level tell
/// which batches to compare: few, however many there are.
template <class V>
class BundleSearch {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Mask = MaskOf<V>;

  /// Into contact.hits, each pair once, at the believed points.
  static void find(BundleContact<Real>& contact) {
    contact.hits.clear();
    const int batches = static_cast<int>(contact.batches.size());
    const int levels = static_cast<int>(contact.levels.size());
    thread_local std::vector<Ball> balls;  // scratch: it keeps its memory
    balls.clear();
    for (BundleBatch<Real>& batch : contact.batches)
      for (BundleSection<Real>& section : batch.sections) {
        cut(batch, section);
        balls.push_back(
            ballOf(section.point.data(), section.radius.data(), section.bridge.data(), section.node));
      }
    for (int level = 0; level < levels; ++level)
      for (int a = 0; a < batches; ++a)
        for (int b = a; b < batches; ++b) {
          const Ball &own = balls[index(a * levels + level)], &other = balls[index(b * levels + level)];
          if (own.count > 0 && other.count > 0 && meet(own, other, contact.margin, 0.0))
            compare(contact, a, b, level, mostBetween(own, other));
        }
  }

  /// Into contact.all_crossings; those of batches that have not moved far relative to each other stay.
  static void findCrossings(BundleContact<Real>& contact) {
    const int batches = static_cast<int>(contact.batches.size());
    const int levels = static_cast<int>(contact.levels.size());
    const std::vector<Cone>& cones = conesOf(contact);
    const auto isOld = [&](int a, int b) {
      return contact.moved_apart[index(a * batches + b)] > kSoonApart * kApartMargins * contact.margin;
    };
    auto& all = contact.all_crossings;
    all.erase(std::remove_if(all.begin(), all.end(),
                             [&](const BundleCrossing& crossing) {
                               return isOld(crossing.a / kLanes, crossing.b / kLanes);
                             }),
              all.end());
    for (int a = 0; a < batches; ++a)
      for (int b = a; b < batches; ++b) {
        if (!isOld(a, b)) continue;
        contact.moved_apart[index(a * batches + b)] = 0.0;
        for (int one = 0; one < levels; ++one)
          for (int two = 0; two < levels; ++two) {
            const Cone &own = cones[index(a * levels + one)], &other = cones[index(b * levels + two)];
            if (mayCross(own, other) &&
                meet(own, other, kCrossingMargins * contact.margin, own.half + other.half))
              findCrossingsAt(contact, a, b, one, two, own, other);
          }
      }
  }

 private:
  static constexpr int kWidth = widthOf<V>, kVector = 3 * kLanes;
  /// Of a full batch four rods lie across: neighbours are no further apart than this part of the radii
  /// of both, times the rods of a full batch over those that there are.
  static constexpr double kNeighbours = 0.3;
  /// Last part of that over which they stop to be neighbours.
  static constexpr double kFade = 0.25;
  static constexpr int kFew = 4;  // rods that may lie anyhow
  static constexpr double kCrossingMargins = 2.0;
  /// Overlap of neighbouring edges, as a part of them, so that none is missed at a kink.
  static constexpr double kEdgeSlack = 0.15;
  /// Of the straight lines over some edges, none of which crosses another where these have a larger
  /// cosine, unless they sag by more than this part of their length.
  static constexpr double kChordCosine = 0.9, kBent = 0.1;
  static constexpr double kFarAlong = 2.5;  // how far rods may be ahead of others, in edges
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  /// Around the mean of some points of a batch, the same however it is turned.
  struct Ball {
    double middle[3]{};
    double radius = 0.0;  ///< with what its rods reach
    double spread = 0.0;  ///< without
    int count = 0;        ///< rods
  };
  /// Of the nodes of a batch at a level, and of its edges from the level before up to there.
  struct Cone : Ball {
    double half = 0.0;  ///< length of rod from the node to either end of those edges
    double axis[3]{};
    double angle = 0.0;
    alignas(
        64) Real sag[kLanes]{};  ///< of the nodes in between from the straight line over those edges [m]
  };
  /// Distance of neighbours at most [m].
  static double mostBetween(const Ball& a, const Ball& b) {
    const int fewer = a.count < b.count ? a.count : b.count;
    if (fewer < kFew) return 1e9;
    return kNeighbours * (a.spread + b.spread) * kLanes / fewer;
  }
  static int edgesBegin(const BundleContact<Real>& contact, int level) {
    return level == 0 ? 0 : contact.levels[index(level - 1)];
  }

  /// What a batch has at a level.
  static void cut(const BundleBatch<Real>& rods, BundleSection<Real>& section) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (section.node[lane] < 0) continue;
      const auto node = index(section.node[lane]);
      const Real part = section.part[lane];
      const auto between = [&](const AlignedVector<Real>& field) {
        const Real *from = &field[node * kLanes + lane], *to = from + kLanes;
        return *from + part * (*to - *from);
      };
      for (std::size_t i = 0; i < 3; ++i) {
        const Real from = rods.point[(3 * node + i) * kLanes + lane];
        const Real edge = rods.point[(3 * node + 3 + i) * kLanes + lane] - from;
        section.point[i * kLanes + lane] = from + part * edge;
        section.edge[i * kLanes + lane] = edge;
      }
      section.radius[lane] = between(rods.radius);
      section.bridge[lane] = between(rods.bridge);
    }
  }
  /// point: [3][lane]; of lanes whose number in `rods` is not negative.
  static Ball ballOf(const Real* point, const Real* radius, const Real* bridge,
                     const std::array<std::int32_t, kLanes>& rods) {
    Ball ball;
    for (int lane = 0; lane < kLanes; ++lane) {
      if (rods[index(lane)] < 0) continue;
      ++ball.count;
      for (int i = 0; i < 3; ++i) ball.middle[i] += double(point[i * kLanes + lane]);
    }
    for (double& middle : ball.middle) middle /= ball.count;
    for (int lane = 0; lane < kLanes; ++lane) {
      if (rods[index(lane)] < 0) continue;
      double square = 0.0;
      for (int i = 0; i < 3; ++i) {
        const double off = double(point[i * kLanes + lane]) - ball.middle[i];
        square += off * off;
      }
      ball.spread = std::max(ball.spread, std::sqrt(square));
      ball.radius =
          std::max(ball.radius, std::sqrt(square) + double(radius[lane]) + double(bridge[lane]));
    }
    return ball;
  }
  static std::vector<Cone>& conesOf(const BundleContact<Real>& contact) {
    thread_local std::vector<Cone> cones;  // scratch: it keeps its memory
    const int levels = static_cast<int>(contact.levels.size());
    cones.resize(contact.batches.size() * contact.levels.size());
    for (std::size_t batch = 0; batch < contact.batches.size(); ++batch)
      for (int level = 0; level < levels; ++level)
        cones[batch * contact.levels.size() + index(level)] =
            coneOf(contact, contact.batches[batch], level);
    return cones;
  }
  static Cone coneOf(const BundleContact<Real>& contact, const BundleBatch<Real>& rods, int level) {
    const int node = contact.levels[index(level)], first = edgesBegin(contact, level);
    const Real *point = rods.point.data() + node * kVector, *from = rods.point.data() + first * kVector;
    Cone cone;
    static_cast<Ball&>(cone) =
        ballOf(point, rods.radius.data() + node * kLanes, rods.bridge.data() + node * kLanes, rods.rod);
    for (int lane = 0; lane < kLanes; lane += kWidth)
      store<V>(cone.sag + lane, sagOf(rods, first, node, lane));
    double directions[kLanes][3], total[3] = {};
    for (int lane = 0; lane < kLanes; ++lane) {
      if (rods.rod[index(lane)] < 0) continue;
      double length = 0.0;
      for (int i = 0; i < 3; ++i) {
        // From the level before to here; what bends in between bends little.
        directions[lane][i] = double(point[i * kLanes + lane]) - double(from[i * kLanes + lane]);
        length += directions[lane][i] * directions[lane][i];
      }
      for (int i = 0; i < 3; ++i) {
        directions[lane][i] /= std::sqrt(length) + 1e-30;
        total[i] += directions[lane][i];
      }
      cone.half = std::max(cone.half, double(rods.length[index(lane)]) * (node - first));
    }
    const double size =
        std::sqrt(total[0] * total[0] + total[1] * total[1] + total[2] * total[2]) + 1e-30;
    double least = 1.0;
    for (int i = 0; i < 3; ++i) cone.axis[i] = total[i] / size;
    for (int lane = 0; lane < kLanes; ++lane) {
      if (rods.rod[index(lane)] < 0) continue;
      double cosine = 0.0;
      for (int i = 0; i < 3; ++i) cosine += directions[lane][i] * cone.axis[i];
      least = std::min(least, cosine);
    }
    cone.angle = std::acos(std::max(least, -1.0));
    return cone;
  }
  static V sagOf(const BundleBatch<Real>& rods, int first, int last, int lane) {
    const auto at = [&](int node) {
      return Vector::loadFrom(rods.point.data() + node * kVector + lane);
    };
    const Vector from = at(first), chord = at(last) - from;
    const V inverse = broadcast<V>(1) / (squaredNorm(chord) + broadcast<V>(static_cast<Real>(1e-24)));
    V most{};
    for (int node = first + 1; node < last; ++node) {
      const Vector d = at(node) - from;
      most = max(most, squaredNorm(d - (dot(d, chord) * inverse) * chord));
    }
    return sqrt(most);
  }
  static bool meet(const Ball& a, const Ball& b, double margin, double more) {
    double square = 0.0;
    for (int i = 0; i < 3; ++i) square += (a.middle[i] - b.middle[i]) * (a.middle[i] - b.middle[i]);
    const double reach = a.radius + b.radius + margin + more;
    return square < reach * reach;
  }
  static bool mayCross(const Cone& a, const Cone& b) {
    double cosine = 0.0;
    for (int i = 0; i < 3; ++i) cosine += a.axis[i] * b.axis[i];
    cosine = cosine < -1.0 ? -1.0 : cosine > 1.0 ? 1.0 : cosine;
    return std::acos(cosine) + a.angle + b.angle > std::acos(kCrossingCosine);
  }

  /// Two straight pieces of rod: where they are nearest to each other as endless lines.
  struct Lines {
    CALLIGRAPHY_INLINE Lines(const Vector& x, const Vector& e, const Vector& y, const Vector& f) {
      const Vector r = x - y;
      const V ee = squaredNorm(e), ff = squaredNorm(f), ef = dot(e, f), er = dot(e, r), fr = dot(f, r);
      const V inverse = broadcast<V>(1) / (ee * ff - ef * ef);
      s = (ef * fr - er * ff) * inverse;
      t = (ee * fr - ef * er) * inverse;
      square = squaredNorm(r + s * e - t * f);
      squared_cosine = ef * ef / (ee * ff);
    }
    CALLIGRAPHY_INLINE Mask within(V slack, V reach) const {
      const V one = broadcast<V>(1);
      return (s > -slack) & (s < one + slack) & (t > -slack) & (t < one + slack) &
             (square < reach * reach);
    }
    V s, t, square, squared_cosine;
  };

  /// Edges of two batches, each from one level to the next, where the straight lines over those cross.
  static void findCrossingsAt(BundleContact<Real>& contact, int a, int b, int level_a, int level_b,
                              const Cone& cone_a, const Cone& cone_b) {
    const BundleBatch<Real>&own = contact.batches[index(a)], &other = contact.batches[index(b)];
    const auto number = [](double value) { return broadcast<V>(static_cast<Real>(value)); };
    const int first_a = edgesBegin(contact, level_a), last_a = contact.levels[index(level_a)];
    const int first_b = edgesBegin(contact, level_b), last_b = contact.levels[index(level_b)];
    // Those that come up fast must not be past each other when they are found.
    const V margin = number(kCrossingMargins * contact.margin), slack = number(kEdgeSlack);
    const V bent = number(kBent * kBent), chords = number(kChordCosine * kChordCosine);
    for (int turn = 0; turn < kLanes; ++turn) {
      alignas(64) std::int32_t to[kLanes];
      for (int lane = 0; lane < kLanes; ++lane) to[lane] = (lane + turn) % kLanes;
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        const auto mine = [&](int node) {
          return Vector::loadFrom(own.point.data() + node * kVector + lane);
        };
        const auto others = [&](int node) {
          const Real* at = other.point.data() + node * kVector;
          return Vector{pick<V>(at, to + lane), pick<V>(at + kLanes, to + lane),
                        pick<V>(at + 2 * kLanes, to + lane)};
        };
        const Vector x = mine(first_a), e = mine(last_a) - x;
        const Vector y = others(first_b), f = others(last_b) - y;
        const V sag_a = load<V>(cone_a.sag + lane), sag_b = pick<V>(cone_b.sag, to + lane);
        const V reach = margin + sag_a + sag_b + load<V>(own.radius.data() + first_a * kLanes + lane) +
                        pick<V>(other.radius.data() + first_b * kLanes, to + lane);
        const Lines lines(x, e, y, f);
        const Mask may = lines.within(slack, reach) &
                         ((lines.squared_cosine < chords) | (sag_a * sag_a > bent * squaredNorm(e)) |
                          (sag_b * sag_b > bent * squaredNorm(f)));
        if (any(may)) findCrossingEdges(contact, a, b, level_a, level_b, lane, to + lane);
      }
    }
  }

  /// to: lanes of the second batch.
  static void findCrossingEdges(BundleContact<Real>& contact, int a, int b, int level_a, int level_b,
                                int lane, const std::int32_t* to) {
    const BundleBatch<Real>&own = contact.batches[index(a)], &other = contact.batches[index(b)];
    const V zero{}, one = broadcast<V>(1), slack = broadcast<V>(static_cast<Real>(kEdgeSlack));
    const V limit_square = broadcast<V>(static_cast<Real>(kCrossingCosine * kCrossingCosine));
    const V margin = broadcast<V>(static_cast<Real>(kCrossingMargins * contact.margin));
    const auto mine = [&](int node) {
      return Vector::loadFrom(own.point.data() + node * kVector + lane);
    };
    const auto others = [&](int node) {
      const Real* at = other.point.data() + node * kVector;
      return Vector{pick<V>(at, to), pick<V>(at + kLanes, to), pick<V>(at + 2 * kLanes, to)};
    };
    for (int i = edgesBegin(contact, level_a); i < contact.levels[index(level_a)]; ++i)
      for (int j = edgesBegin(contact, level_b); j < contact.levels[index(level_b)]; ++j) {
        const Vector x = mine(i), e = mine(i + 1) - x, y = others(j), f = others(j + 1) - y;
        const V reach = margin +
                        max(load<V>(own.radius.data() + i * kLanes + lane),
                            load<V>(own.radius.data() + (i + 1) * kLanes + lane)) +
                        max(pick<V>(other.radius.data() + j * kLanes, to),
                            pick<V>(other.radius.data() + (j + 1) * kLanes, to));
        const Lines lines(x, e, y, f);
        const Mask found = lines.within(slack, reach) & (lines.squared_cosine < limit_square);
        if (!any(found)) continue;
        alignas(64) Real flags[kWidth];
        store<V>(flags, select(found, one, zero));
        for (int k = 0; k < kWidth; ++k) {
          const int p = lane + k, q = to[k];
          if (flags[k] == Real(0) || own.rod[index(p)] < 0 || other.rod[index(q)] < 0) continue;
          if (a == b && p >= q) continue;  // seen from the other side
          contact.all_crossings.push_back({a * kLanes + p, i, b * kLanes + q, j});
        }
      }
  }

  /// Rods no further apart than `most` [m], and those that may touch.
  static void compare(BundleContact<Real>& contact, int a, int b, int level, double most) {
    const BundleBatch<Real>&own = contact.batches[index(a)], &other = contact.batches[index(b)];
    const BundleSection<Real>&mine = own.sections[index(level)], &others = other.sections[index(level)];
    const Real* const point = others.point.data();
    const V margin = broadcast<V>(static_cast<Real>(contact.margin));
    const V wide = broadcast<V>(static_cast<Real>(most)), fade = broadcast<V>(static_cast<Real>(kFade));
    for (int turn = a == b ? 1 : 0; turn < (a == b ? kLanes / 2 + 1 : kLanes); ++turn) {
      alignas(64) std::int32_t to[kLanes];
      for (int lane = 0; lane < kLanes; ++lane) to[lane] = (lane + turn) % kLanes;
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        const Vector x = Vector::loadFrom(mine.point.data() + lane);
        const Vector edge = Vector::loadFrom(mine.edge.data() + lane);
        const Vector d{pick<V>(point, to + lane) - x.x, pick<V>(point + kLanes, to + lane) - x.y,
                       pick<V>(point + 2 * kLanes, to + lane) - x.z};
        const V along = dot(d, edge) / squaredNorm(edge);
        const Vector across = d - along * edge;
        const V radii = load<V>(mine.radius.data() + lane) + pick<V>(others.radius.data(), to + lane);
        const V touching = radii + broadcast<V>(static_cast<Real>(kSoon)) * min(margin, radii);
        const V bridge = load<V>(mine.bridge.data() + lane) + pick<V>(others.bridge.data(), to + lane);
        const V widest = max(touching, wide), reach = min(touching + bridge, widest);
        const V far = broadcast<V>(static_cast<Real>(kFarAlong));
        const V square = squaredNorm(across);
        const V crowd = max(load<V>(own.crowd.data() + level * kLanes + lane),
                            pick<V>(other.crowd.data() + level * kLanes, to + lane));
        const Mask near = (square < min(reach * reach, crowd)) & (along < far) & (along > -far);
        if (!any(near)) continue;
        const V distance = sqrt(square);
        const V within = min(broadcast<V>(1), (widest - distance) / (fade * widest));
        alignas(64) Real flags[kWidth], xs[kWidth], ys[kWidth], zs[kWidth], gaps[kWidth], alongs[kWidth],
            withins[kWidth];
        store<V>(flags, select(near, broadcast<V>(1), V{}));
        store<V>(xs, across.x);
        store<V>(ys, across.y);
        store<V>(zs, across.z);
        store<V>(gaps, distance - radii);
        store<V>(alongs, along);
        store<V>(withins, within);
        for (int k = 0; k < kWidth; ++k) {
          if (flags[k] == Real(0)) continue;
          const int one = lane + k, two = to[lane + k];
          if (mine.node[index(one)] < 0 || others.node[index(two)] < 0) continue;
          if (a == b && turn == kLanes / 2 && one > two) continue;  // seen from the other side
          const Real shift = others.place[index(two)] - mine.place[index(one)] -
                             alongs[k] * own.places.spacing(index(one));
          contact.hits.push_back({a * kLanes + one, b * kLanes + two, level, xs[k], ys[k], zs[k],
                                  gaps[k], shift, withins[k]});
        }
      }
    }
  }
};

}  // namespace calligraphy_brush
