#pragma once

#include <algorithm>
#include <cmath>

#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {

/// Gradients and curvatures of the contact and cohesion of rods, in phases for the batches to take in
/// parallel: push() all, then gather() all.
template <class V>
class BundlePull {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Mask = MaskOf<V>;

  /// The pairs whose first rod is in the batch, at the believed `point` and `way`: what its nodes feel
  /// into its springs, what those of others feel into the ties.
  static void push(BundleContact<Real>& contact, int batch) {
    BundleBatch<Real>& own = contact.batches[index(batch)];
    clear(own.springs);
    clear(own.turns);
    own.most_relative = 0;
    for (int i = contact.first_tie[index(batch)]; i < contact.first_tie[index(batch) + 1]; ++i) {
      BundleTie<Real>& tie = contact.ties[index(i)];
      clear(tie.stiffness);
      clear(tie.turns);
      const bool is_own = tie.a == tie.b;
      if (!is_own) clear(tie.answer);
      for (int m = tie.first_match; m < tie.last_match; ++m)
        pushMatch(contact, own, contact.matches[index(m)], tie, is_own ? own.springs : tie.answer);
      if (is_own) add(tie.turns, Real(1), own.turns);
    }
  }

  /// Adds what the batch's rods feel by other batches. Then its springs are what NodeSprings wants.
  static void gather(BundleContact<Real>& contact, int batch) {
    BundleBatch<Real>& own = contact.batches[index(batch)];
    for (const int i : contact.incoming[index(batch)]) {
      const BundleTie<Real>& tie = contact.ties[index(i)];
      add(tie.answer, Real(1), own.springs);
      // Such a pair is stretched both by the difference of places and by that of the shifts.
      add(tie.turns, Real(2), own.turns);
    }
    // Twice the curvature by a node alone: then the sum over all nodes lies above the energy.
    for (int node = 0; node < contact.node_count; ++node)
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        Real* curvature = own.springs.data() + node * kSpring + 3 * kLanes + lane;
        store<V>(curvature, load<V>(curvature) + load<V>(curvature));
      }
  }

  /// Adds what edges that cross do to each other, after all batches have gathered.
  static void cross(BundleContact<Real>& contact) {
    for (BundleBatch<Real>& batch : contact.batches) clear(batch.anchors);
    for (const BundleCrossing& crossing : contact.crossings) pushCrossing(contact, crossing);
  }

  /// Of all pairs at the believed points, friction left out [J].
  static double energy(const BundleContact<Real>& contact) {
    double sum = 0.0;
    for (const BundleMatch<Real>& match : contact.matches)
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        const PairOf pair(contact, match, lane);
        for (int node = match.first; node < match.last; ++node) {
          const bool is_end = node + 1 == contact.node_count;
          const auto other = [&](int at) {
            return pickVector(pair.b.point.data() + at * kVector, pair.to);
          };
          const Facing facing(Vector::loadFrom(pair.a.point.data() + node * kVector + lane),
                              other(node - 1), other(node), other(is_end ? node : node + 1), is_end,
                              pair.inverse_square);
          sum += double(sumOf<V>(pairTerms(contact, match, pair, node, lane, facing).energy));
        }
      }
    return sum;
  }

 private:
  static constexpr int kWidth = widthOf<V>, kVector = 3 * kLanes, kSpring = 4 * kLanes;
  static CALLIGRAPHY_INLINE std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static CALLIGRAPHY_INLINE V real(double value) { return broadcast<V>(static_cast<Real>(value)); }
  static CALLIGRAPHY_INLINE Vector pickVector(const Real* rows, const std::int32_t* from) {
    return {pick<V>(rows, from), pick<V>(rows + kLanes, from), pick<V>(rows + 2 * kLanes, from)};
  }

  /// Gap of surfaces that may touch at any moment, over the distance of the axes.
  static constexpr double kNearlyTouching = 0.1;
  /// How far beyond a rod's end its last edge is felt, in edges.
  static constexpr double kReachBeyondEnd = 0.25;

  /// A node and the nearest point of the two edges that meet at the other rod's node.
  struct Facing {
    CALLIGRAPHY_INLINE Facing(const Vector& x, const Vector& before, const Vector& at,
                              const Vector& after, bool is_end, V inverse_square) {
      const V zero{}, one = real(1);
      const Vector r = x - at, back = before - at, on = is_end ? at - before : after - at;
      const V t_on = dot(r, on) * inverse_square, t_back = dot(r, back) * inverse_square;
      forward = t_on > t_back;
      const V ahead = max(t_on, t_back);
      const V most = is_end ? select(forward, zero, one) : one;
      t = min(max(ahead, zero), most);
      // Beyond the last edge, or beyond the edges that are looked at, it fades out.
      part = min(one, max(zero, one - (ahead - most) * real(1.0 / kReachBeyondEnd)));
      const Vector d = r - t * select(forward, on, back);
      length = sqrt(squaredNorm(d) + real(1e-24));
      n = (one / length) * d;
    }

    Mask forward;  ///< on the edge after the node
    V t;           ///< part of that edge
    V part;        ///< of the pair that counts
    V length;      ///< distance of the axes
    Vector n;      ///< from the other rod to the node
  };

  template <class Field>
  static void clear(Field& field) {
    __builtin_memset(field.data(), 0, field.size() * sizeof(Real));
  }
  template <class Field>
  static void add(const Field& values, Real part, Field& sums) {
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += part * values[i];
  }

  /// What is the same along the rods of a match.
  struct PairOf {
    PairOf(const BundleContact<Real>& contact, const BundleMatch<Real>& match, int lane)
        : a(contact.batches[index(match.a)]),
          b(contact.batches[index(match.b)]),
          to(match.to.data() + lane),
          apart(Vector::loadFrom(match.apart.data() + lane)) {
      const V other = pick<V>(b.length.data(), to);
      inverse_square = real(1) / (other * other);
      alignas(64) Real flags[kWidth];
      for (int k = 0; k < kWidth; ++k) flags[k] = static_cast<Real>(match.pairs >> (lane + k) & 1u);
      present = load<V>(flags);
      length = present * load<V>(a.length.data() + lane);
    }
    const BundleBatch<Real>&a, &b;
    const std::int32_t* to;
    Vector apart;
    V inverse_square, present, length;
  };

  /// By the gap. push: of the contact [N]; pull: of the liquid [N]; stiff: the
  /// contact's curvature where surfaces overlap; bridge: one that lies above the energy of the liquid
  /// wherever the pull takes them, up to where they meet: pull over gap.
  struct Terms {
    V gap, distance, push, pull, stiff, bridge, energy;
  };
  static CALLIGRAPHY_INLINE Terms pairTerms(const BundleContact<Real>& contact,
                                            const BundleMatch<Real>& match, const PairOf& pair, int node,
                                            int lane, const Facing& facing) {
    const V zero{}, one = real(1), half = real(0.5), tiny = real(1e-6);
    const int row = node * kLanes, at = row + lane;
    const auto sum = [&](const AlignedVector<Real>& mine, const AlignedVector<Real>& others) {
      return load<V>(mine.data() + at) + pick<V>(others.data() + row, pair.to);
    };
    const V part = real(static_cast<double>(node) / (contact.node_count - 1));
    const V at_rest = pair.apart.x + part * (pair.apart.y + part * pair.apart.z);
    const V radii = sum(pair.a.radius, pair.b.radius);
    const V distance = sqrt(max(tiny * tiny, min(radii * radii, at_rest)));
    const V length = node + 1 == contact.node_count ? half * pair.length : pair.length;
    const V stiff =
        max(real(contact.stiffness) * pair.present *
                min(load<V>(pair.a.hold.data() + at), pick<V>(pair.b.hold.data() + row, pair.to)),
            real(contact.modulus) * length);
    const V range = max(tiny, sum(pair.a.bridge, pair.b.bridge));
    // 2 w/range, w being the mean of both rods'.
    const V pull = sum(pair.a.cling, pair.b.cling) * length * load<V>(match.clings.data() + at) / range;
    Terms terms;
    terms.distance = distance;
    terms.gap = facing.length - distance;
    const V overlap = min(terms.gap, zero);
    // Below half of the distance the energy goes on as a parabola.
    const V squeeze = one / max(one + overlap / distance, half);
    terms.push = facing.part * (half * stiff * squeeze * (one + squeeze)) * -overlap;
    terms.stiff = facing.part * stiff * squeeze * squeeze * squeeze;
    const V open = facing.part * max(zero, one - max(terms.gap, zero) / range);
    terms.pull = open * pull;
    terms.bridge = open * pull / max(terms.gap, real(kNearlyTouching) * distance);
    terms.energy = facing.part * (half * stiff * squeeze * overlap * overlap + pull * overlap) -
                   half * open * pull * (range - max(terms.gap, zero));
    return terms;
  }

  using One = Vec3<Real>;
  /// Speed at which edges that cross part at most, over that at which friction is fully there.
  static constexpr double kParting = 50.0;
  /// An edge of one of two that cross.
  struct Edge {
    Edge(BundleContact<Real>& contact, int rod, int edge)
        : batch(contact.batches[index(rod / kLanes)]), lane(rod % kLanes), node(edge) {}
    One vectorAt(const AlignedVector<Real>& field, int offset) const {
      return One::loadFrom(field.data() + (node + offset) * kVector + lane);
    }
    One between(const AlignedVector<Real>& field, Real s) const {
      const One from = vectorAt(field, 0);
      return from + s * (vectorAt(field, 1) - from);
    }
    Real numberAt(const AlignedVector<Real>& field, Real s) const {
      const Real* at = field.data() + node * kLanes + lane;
      return at[0] + s * (at[kLanes] - at[0]);
    }
    /// Gradient and curvature at the part s of it.
    void give(const One& g, Real c, Real s) const {
      for (const int end : {0, 1}) {
        const Real part = end == 0 ? Real(1) - s : s;
        Real* out = batch.springs.data() + (node + end) * kSpring + lane;
        (One::loadFrom(out) + part * g).storeTo(out);
        out[3 * kLanes] += 2 * part * c;
      }
      const Real place = numberAt(batch.places.place, s);
      const auto first = static_cast<std::size_t>(place);
      for (std::size_t to = first; to < first + 2 && to < batch.anchors.size(); ++to)
        batch.anchors[to] += 2 * c;
    }
    BundleBatch<Real>& batch;
    int lane, node;
  };

  static void pushCrossing(BundleContact<Real>& contact, const BundleCrossing& crossing) {
    const Edge a(contact, crossing.a, crossing.edge_a), b(contact, crossing.b, crossing.edge_b);
    const One x = a.vectorAt(a.batch.point, 0), y = b.vectorAt(b.batch.point, 0);
    const One e = a.vectorAt(a.batch.point, 1) - x, f = b.vectorAt(b.batch.point, 1) - y, r = x - y;
    // Closest points of the two lines; outside of the edges it is their neighbours' affair.
    const Real ee = squaredNorm(e), ff = squaredNorm(f), ef = dot(e, f), er = dot(e, r), fr = dot(f, r);
    const Real sine_squared = std::max(Real(1) - ef * ef / (ee * ff), Real(1e-6));
    const Real inverse = Real(1) / (ee * ff * sine_squared);
    const Real s = (ef * fr - er * ff) * inverse, t = (ee * fr - ef * er) * inverse;
    if (!(s >= 0 && s < 1 && t >= 0 && t < 1)) return;
    const Real distance = a.numberAt(a.batch.radius, s) + b.numberAt(b.batch.radius, t);
    // From where the nodes of neither notice the other.
    const Real seen = Real(0.5) * std::sqrt(sine_squared * std::min(ee, ff)) / distance;
    const auto inside = [](Real place) {
      return std::min(Real(1), 10 * std::min(place, 1 - place) + Real(0.5));
    };
    const Real part = std::min(std::max(seen - Real(1), Real(0)), Real(1)) * inside(s) * inside(t);
    const One d = x + s * e - (y + t * f);
    const Real length = std::sqrt(squaredNorm(d)) + Real(1e-12);
    const One n = (Real(1) / length) * d;
    const One u = a.between(a.batch.way, s) - b.between(b.batch.way, t);
    const Real gap = length - distance, closing = dot(u, n);
    if (!(part > 0) || !(gap + std::min(2 * closing, Real(0)) < Real(kNearlyTouching) * distance))
      return;
    const Real hold = std::min(a.numberAt(a.batch.hold, s), b.numberAt(b.batch.hold, t));
    const Real stiff =
        part * std::max(static_cast<Real>(contact.stiffness) * hold,
                        static_cast<Real>(contact.modulus) * a.batch.length[index(a.lane)]);
    // Those that were found late, or slid onto each other, are not shot apart.
    const Real overlap = std::min(std::max(-gap, Real(0)), static_cast<Real>(kParting * contact.slip));
    const Real push = stiff * overlap;
    const One slide = u - closing * n;
    const Real drag = static_cast<Real>(contact.friction) * push /
                      (std::sqrt(squaredNorm(slide)) + static_cast<Real>(contact.slip + 1e-12));
    const One g = drag * slide - push * n;
    const Real c = std::max(stiff, drag);
    a.give(g, c, s);
    b.give(Real(-1) * g, c, t);
  }

  struct Sum {
    Vector force{};
    V stiffness{};
    CALLIGRAPHY_INLINE void add(V part, const Vector& g, V c) {
      force = force + part * g;
      stiffness = stiffness + part * c;
    }
    CALLIGRAPHY_INLINE void storeTo(Real* address) const {
      force.storeTo(address);
      store<V>(address + 3 * kLanes, stiffness);
    }
  };

  /// into: springs of the second rods.
  static void pushMatch(BundleContact<Real>& contact, BundleBatch<Real>& own,
                        const BundleMatch<Real>& match, BundleTie<Real>& tie,
                        AlignedVector<Real>& into) {
    const int n = contact.node_count;
    Real *answer = own.scratch.data(), *ties = answer + n * kSpring;
    __builtin_memset(ties, 0, static_cast<std::size_t>(2 * n * kLanes) * sizeof(Real));
    for (int lane = 0; lane < kLanes; lane += kWidth) pushLanes(contact, own, match, lane, answer, ties);
    const int last = match.last < n ? match.last + 1 : match.last;
    for (int row = 4 * (match.first - 1); row < 4 * last; ++row)
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        Real* sum = into.data() + row * kLanes + lane;
        store<V>(sum, load<V>(sum) + pick<V>(answer + row * kLanes, match.from.data() + lane));
      }
    for (int place = 0; place < n; ++place) {
      V curvature{}, turn{};
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        curvature = curvature + load<V>(ties + place * 2 * kLanes + lane);
        turn = turn + load<V>(ties + place * 2 * kLanes + kLanes + lane);
      }
      tie.stiffness[index(place)] += sumOf<V>(curvature);
      tie.turns[index(place)] += sumOf<V>(turn);
    }
  }

  static void pushLanes(const BundleContact<Real>& contact, BundleBatch<Real>& own,
                        const BundleMatch<Real>& match, int lane, Real* answer, Real* ties) {
    const PairOf pair(contact, match, lane);
    const BundleBatch<Real>& other = pair.b;
    const std::int32_t* to = pair.to;
    const V zero{}, one = real(1);
    const V friction = real(contact.friction), slip = real(contact.slip + 1e-12);
    const Real *point = other.point.data(), *way = other.way.data(), *place = other.places.place.data();

    int node = match.first;
    Vector before = pickVector(point + (node - 1) * kVector, to),
           at = pickVector(point + node * kVector, to);
    Vector way_before = pickVector(way + (node - 1) * kVector, to),
           way_at = pickVector(way + node * kVector, to);
    V place_before = pick<V>(place + (node - 1) * kLanes, to),
      place_at = pick<V>(place + node * kLanes, to);
    Sum sum_before, sum_at;
    V most{};
    for (; node < match.last; ++node) {
      const bool is_end = node + 1 == contact.node_count;
      const Vector after = is_end ? at : pickVector(point + (node + 1) * kVector, to);
      const Vector way_after = is_end ? way_at : pickVector(way + (node + 1) * kVector, to);
      const V place_after = is_end ? place_at : pick<V>(place + (node + 1) * kLanes, to);
      const Facing facing(Vector::loadFrom(own.point.data() + node * kVector + lane), before, at, after,
                          is_end, pair.inverse_square);
      const Terms terms = pairTerms(contact, match, pair, node, lane, facing);
      Sum sum_after;
      const V t = facing.t, rest = one - t;
      const V on = select(facing.forward, t, zero), back = select(facing.forward, zero, t);
      const Vector u = Vector::loadFrom(own.way.data() + node * kVector + lane) -
                       (rest * way_at + on * way_after + back * way_before);
      const V closing = dot(u, facing.n);
      // Surfaces that meet in this step or the next resist as those that overlap.
      const Mask meets =
          terms.gap + min(closing + closing, zero) < real(kNearlyTouching) * terms.distance;
      const V curvature = select(meets, max(terms.stiff, terms.bridge), terms.bridge);
      if (any(curvature > zero)) {
        most = max(most, select(curvature > zero, squaredNorm(u), zero));
        Vector g = (terms.pull - terms.push) * facing.n;
        // Friction by the way of this step, at the force that there is.
        V drag = zero;
        const V push = friction * terms.push;
        if (any(push > zero)) {
          const Vector slide = u - closing * facing.n;
          drag = push / (sqrt(squaredNorm(slide)) + slip);
          g = g + drag * slide;
        }
        const V c = max(curvature, drag);
        Real* out = own.springs.data() + node * kSpring + lane;
        (Vector::loadFrom(out) + g).storeTo(out);
        store<V>(out + 3 * kLanes, load<V>(out + 3 * kLanes) + c);
        const Vector opposite = (-one) * g;
        sum_before.add(back, opposite, c);
        sum_at.add(rest, opposite, c);
        sum_after.add(on, opposite, c);
        const V apart = load<V>(own.places.place.data() + node * kLanes + lane) -
                        (rest * place_at + on * place_after + back * place_before);
        share(own.places, node, lane, c, apart, ties, contact.node_count - 1);
      }
      sum_before.storeTo(answer + (node - 1) * kSpring + lane);
      sum_before = sum_at;
      sum_at = sum_after;
      before = at;
      at = after;
      way_before = way_at;
      way_at = way_after;
      place_before = place_at;
      place_at = place_after;
    }
    alignas(64) Real largest[kWidth];
    store<V>(largest, most);
    for (int k = 0; k < kWidth; ++k)
      own.most_relative = largest[k] > own.most_relative ? largest[k] : own.most_relative;
    sum_before.storeTo(answer + (node - 1) * kSpring + lane);
    if (node < contact.node_count) sum_at.storeTo(answer + node * kSpring + lane);
  }

  /// What ties groups of rods, at the places around a node.
  static CALLIGRAPHY_INLINE void share(const CommonPlaces<Real>& places, int node, int lane, V curvature,
                                       V apart, Real* ties, int last_place) {
    const V zero{};
    const V place = load<V>(places.place.data() + node * kLanes + lane);
    const V turn = curvature * apart * apart;
    int last = places.last[index(node)] + 1;
    last = last < last_place ? last : last_place;
    for (int to = places.first[index(node)]; to <= last; ++to) {
      const V part = partOfPlace<V>(places, node, to, lane);
      Real* sums = ties + to * 2 * kLanes + lane;
      store<V>(sums, load<V>(sums) + part * curvature);
      // Points a little apart may lie on this edge between places, and on the ones beside it.
      const V beside = place - real(to - 0.5);
      store<V>(sums + kLanes,
               load<V>(sums + kLanes) + select(max(beside, -beside) < real(1.5), turn, zero));
    }
  }
};

}  // namespace calligraphy_brush
