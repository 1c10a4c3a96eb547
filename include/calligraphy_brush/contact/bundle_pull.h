#pragma once

#include <algorithm>
#include <cmath>

#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {

/// Gradients and curvatures of the contact and cohesion of rods, in phases: fill() when pairs or ink
/// have changed, spread() all batches, push() the ties of one of BundleContact::phases after another,
/// gather() all batches. Within each, tasks may run in parallel.
template <class V>
class BundlePull {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Mask = MaskOf<V>;

  /// What the pairs of all packs are made of.
  static void fill(BundleContact<Real>& contact) {
    contact.terms.resize(contact.packs.size() * index(contact.stride) * kTerms);
    for (const BundleTie<Real>& tie : contact.ties)
      for (int p = tie.first_pack; p < tie.last_pack; ++p) {
        fillPack(contact, tie, contact.packs[index(p)]);
        for (int step = 0; step < contact.stride; ++step)
          for (int lane = 0; lane < kLanes; lane += kWidth) fillTerms(contact, tie, p, step, lane);
      }
  }

  /// The nodes of a batch at the believed `point` and `way` into records, and nothing that pulls them.
  static void spread(BundleContact<Real>& contact, int batch) {
    const BundleBatch<Real>& own = contact.batches[index(batch)];
    const int size = 4 * contact.records;
    const std::size_t first = index(batch * kLanes) * index(size);
    __builtin_memset(contact.pulls.data() + first, 0, index(size * kLanes) * sizeof(Real));
    std::int32_t at[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) at[lane] = lane * size;
    for (int record = 0; record < contact.records; ++record) {
      const int node = std::clamp(record - contact.nodes_before, 0, contact.node_count - 1);
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        const auto put = [&](const AlignedVector<Real>& field, AlignedVector<Real>& records) {
          const Vector x = Vector::loadFrom(field.data() + node * kVector + lane);
          const V values[4] = {x.x, x.y, x.z, V{}};
          storeRecords<V>(records.data() + first + index(4 * record), at + lane, values);
        };
        put(own.point, contact.points);
        put(own.way, contact.ways);
      }
    }
  }

  /// The pairs of a tie. What ties groups may be left as it was.
  static void push(BundleContact<Real>& contact, int tie_index, bool with_ties) {
    BundleTie<Real>& tie = contact.ties[index(tie_index)];
    const int n = contact.node_count;
    thread_local AlignedVector<Real> sums;  // curvatures and turns, [place][2][lane]
    if (with_ties) sums.assign(index(2 * n * kWidth), Real(0));
    V most{};
    for (int p = tie.first_pack; p < tie.last_pack; ++p)
      for (int lane = 0; lane < contact.packs[index(p)].count; lane += kWidth)
        pushLanes(contact, p, lane, with_ties ? sums.data() : nullptr, most);
    for (int place = 0; with_ties && place < n; ++place) {
      tie.stiffness[index(place)] = sumOf<V>(load<V>(sums.data() + 2 * place * kWidth));
      tie.turns[index(place)] = sumOf<V>(load<V>(sums.data() + (2 * place + 1) * kWidth));
    }
    alignas(64) Real largest[kWidth];
    store<V>(largest, most);
    tie.most_relative = *std::max_element(largest, largest + kWidth);
  }

  /// What the batch's rods feel by all pairs, as NodeSprings wants it.
  static void gather(BundleContact<Real>& contact, int batch) {
    BundleBatch<Real>& own = contact.batches[index(batch)];
    const int size = 4 * contact.records;
    std::int32_t at[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) at[lane] = lane * size;
    const Real* pulls = contact.pulls.data() + index(batch * kLanes) * index(size);
    for (int node = 0; node < contact.node_count; ++node)
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        V pull[4];
        loadRecords<V>(pulls + 4 * (contact.nodes_before + node), at + lane, pull);
        Real* springs = own.springs.data() + node * kSpring + lane;
        Vector{pull[0], pull[1], pull[2]}.storeTo(springs);
        // Twice the curvature by a node alone: then the sum over all nodes lies above the energy.
        store<V>(springs + 3 * kLanes, pull[3] + pull[3]);
      }
    clear(own.turns);
    clear(own.kinks);
    for (const int i : contact.ties_of[index(batch)]) {
      const BundleTie<Real>& tie = contact.ties[index(i)];
      // A pair with another batch is stretched by the difference of places and by that of the shifts.
      const Real part = tie.a == tie.b ? Real(1) : Real(2);
      for (std::size_t k = 0; k < own.turns.size(); ++k) {
        own.turns[k] += part * tie.turns[k];
        own.kinks[k] += static_cast<Real>(kMissedBend) * part * tie.stiffness[k];
      }
    }
  }

  /// Adds what edges that cross do to each other, after all batches have gathered.
  static void cross(BundleContact<Real>& contact) {
    for (BundleBatch<Real>& batch : contact.batches) clear(batch.anchors);
    for (const BundleCrossing& crossing : contact.crossings) pushCrossing(contact, crossing);
  }

  /// Of all pairs at the spread points, friction left out [J].
  static double energy(const BundleContact<Real>& contact) {
    double sum = 0.0;
    for (int p = 0; p < static_cast<int>(contact.packs.size()); ++p)
      for (int lane = 0; lane < kLanes; lane += kWidth) {
        const Face face(contact, p, lane);
        for (int step = 0; step < contact.stride; ++step) {
          const auto two = [&](int shift) {
            return face.vectorAt(contact.points, face.two, step + shift);
          };
          const Facing facing(face.vectorAt(contact.points, face.one, step), two(-1), two(0), two(1),
                              face.endsAt(step), face.inverse_square);
          sum += double(sumOf<V>(Terms(contact, p, step, lane, facing).energy));
        }
      }
    return sum;
  }

 private:
  static constexpr int kWidth = widthOf<V>, kVector = 3 * kLanes, kSpring = 4 * kLanes;
  static CALLIGRAPHY_INLINE std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static CALLIGRAPHY_INLINE V real(double value) { return broadcast<V>(static_cast<Real>(value)); }
  static constexpr std::size_t kTerms = 4 * kLanes;

  /// Gap of surfaces that may touch at any moment, over the distance of the axes.
  static constexpr double kNearlyTouching = 0.1;
  /// Twice the square of the part of a bend at a place, a second difference, by which the straight line
  /// over it is off.
  static constexpr double kMissedBend = 2.0 / 16.0;
  /// How far beyond a rod's end its last edge is felt, in edges.
  static constexpr double kReachBeyondEnd = 0.25;

  /// Lanes of a pack.
  struct Face {
    CALLIGRAPHY_INLINE Face(const BundleContact<Real>& contact, int pack_index, int lane)
        : pack(contact.packs[index(pack_index)]),
          one(pack.record_one.data() + lane),
          two(pack.record_two.data() + lane),
          inverse_square(load<V>(pack.inverse_square.data() + lane)),
          to_end(load<V>(pack.to_end.data() + lane)) {}
    /// Of the node after so many steps from the stretch's first.
    static CALLIGRAPHY_INLINE Vector vectorAt(const AlignedVector<Real>& records, const std::int32_t* at,
                                              int step) {
      V values[4];
      loadRecords<V>(records.data() + 4 * step, at, values);
      return {values[0], values[1], values[2]};
    }
    CALLIGRAPHY_INLINE Mask endsAt(int step) const { return !(to_end > real(step)); }

    const BundlePack<Real>& pack;
    const std::int32_t *one, *two;
    V inverse_square, to_end;
  };

  /// A node and the nearest point of the two edges that meet at the other rod's node.
  struct Facing {
    CALLIGRAPHY_INLINE Facing(const Vector& x, const Vector& before, const Vector& at,
                              const Vector& after, Mask is_end, V inverse_square) {
      const V zero{}, one = real(1);
      const Vector r = x - at, back = before - at, on = select(is_end, at - before, after - at);
      const V t_on = dot(r, on) * inverse_square, t_back = dot(r, back) * inverse_square;
      forward = t_on > t_back;
      const V ahead = max(t_on, t_back);
      const V most = select(is_end & forward, zero, one);
      t = min(max(ahead, zero), most);
      // Beyond the last edge, or beyond the edges that are looked at, it fades out.
      part = min(one, max(zero, one - (ahead - most) * real(1.0 / kReachBeyondEnd)));
      edge = select(forward, on, back);
      const Vector d = r - t * edge;
      length = sqrt(squaredNorm(d) + real(1e-24));
      n = (one / length) * d;
    }

    Mask forward;  ///< on the edge after the node
    Vector edge;   ///< from the node
    V t;           ///< part of that edge
    V part;        ///< of the pair that counts
    V length;      ///< distance of the axes
    Vector n;      ///< from the other rod to the node
  };

  template <class Field>
  static void clear(Field& field) {
    __builtin_memset(field.data(), 0, field.size() * sizeof(Real));
  }

  static void fillPack(const BundleContact<Real>& contact, const BundleTie<Real>& tie,
                       BundlePack<Real>& pack) {
    const BundleBatch<Real>&a = contact.batches[index(tie.a)], &b = contact.batches[index(tie.b)];
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const int one = pack.one[lane], two = pack.two[lane];
      const int first = contact.levels[index(pack.level[lane])] - contact.stride + 1;
      const int first_two = first + pack.shift[lane];
      const Real other = b.length[index(two)];
      pack.inverse_square[lane] = Real(1) / (other * other);
      pack.to_end[lane] = static_cast<Real>(contact.node_count - 1 - first_two);
      const auto record = [&](int batch, int in_lane, int node) {
        return 4 * ((batch * kLanes + in_lane) * contact.records + contact.nodes_before + node);
      };
      pack.record_one[lane] = record(tie.a, one, first);
      pack.record_two[lane] = record(tie.b, two, first_two);
      pack.spacing_one[lane] = a.places.spacing(index(one));
      pack.spacing_two[lane] = b.places.spacing(index(two));
      pack.place_one[lane] = static_cast<Real>(first) * pack.spacing_one[lane];
      pack.place_two[lane] = static_cast<Real>(first_two) * pack.spacing_two[lane];
    }
    const auto extremes = [](const auto& of, Real& least, Real& most) {
      least = *std::min_element(of.begin(), of.end());
      most = *std::max_element(of.begin(), of.end());
    };
    extremes(pack.place_one, pack.low, pack.high);
    extremes(pack.spacing_one, pack.least, pack.most);
  }

  /// The terms of pairs, see BundleContact.
  static void fillTerms(BundleContact<Real>& contact, const BundleTie<Real>& tie, int pack_index,
                        int step, int lane) {
    const BundleBatch<Real>&a = contact.batches[index(tie.a)], &b = contact.batches[index(tie.b)];
    const BundlePack<Real>& pack = contact.packs[index(pack_index)];
    const std::int32_t *one = pack.one.data() + lane, *two = pack.two.data() + lane;
    const int last_node = contact.node_count - 1;
    std::int32_t at_one[kWidth], at_two[kWidth];
    alignas(64) Real parts[kWidth], weights[kWidth], beyond[kWidth];
    for (int k = 0; k < kWidth; ++k) {
      const auto in_pack = index(lane + k);
      const int node = contact.levels[index(pack.level[in_pack])] - contact.stride + 1 + step;
      const int within = std::max(node, 0);
      // What lies beside it: from one time to the next it may be at another node, but not elsewhere.
      const Real beside =
          std::clamp((static_cast<Real>(node) * pack.spacing_one[in_pack] + pack.ahead[in_pack]) /
                         pack.spacing_two[in_pack],
                     Real(0), static_cast<Real>(last_node));
      const int node_two = std::min(static_cast<int>(beside), last_node - 1);
      at_one[k] = within * kLanes + one[k];
      at_two[k] = node_two * kLanes + two[k];
      beyond[k] = beside - static_cast<Real>(node_two);
      parts[k] = static_cast<Real>(within) / static_cast<Real>(last_node);
      // Length that a node stands for, in edges.
      const bool counts = node >= 1 && node + pack.shift[in_pack] <= last_node && lane + k < pack.count;
      weights[k] = !counts ? Real(0) : node == last_node ? Real(0.5) : Real(1);
    }
    const auto of_one = [&](const AlignedVector<Real>& field) {
      alignas(64) Real values[kWidth];
      for (int k = 0; k < kWidth; ++k) values[k] = field[index(at_one[k])];
      return load<V>(values);
    };
    const auto of_two = [&](const AlignedVector<Real>& field) {
      alignas(64) Real values[kWidth];
      for (int k = 0; k < kWidth; ++k) {
        const Real* from = &field[index(at_two[k])];
        values[k] = *from + beyond[k] * (from[kLanes] - *from);
      }
      return load<V>(values);
    };
    const auto vectorOf = [&](const AlignedVector<Real>& field, const std::int32_t* at) {
      return Vector{pick<V>(field.data(), at), pick<V>(field.data() + kLanes, at),
                    pick<V>(field.data() + 2 * kLanes, at)};
    };
    const V zero{}, tiny = real(1e-6), weight = load<V>(weights);
    const V length = pick<V>(a.length.data(), one);
    const V at_rest = distanceAtRest<V>(
        vectorOf(b.rest, two) - vectorOf(a.rest, one), vectorOf(a.along, one),
        (length / pick<V>(b.length.data(), two)) * vectorOf(b.along, two), load<V>(parts));
    const V radii = of_one(a.radius) + of_two(b.radius);
    const V distance = max(tiny, min(radii, at_rest));
    const V hold = min(of_one(a.hold), of_two(b.hold));
    const V stiff = max(real(contact.stiffness) * select(weight > zero, hold, zero),
                        real(contact.modulus) * weight * length);
    const V range = max(tiny, of_one(a.bridge) + of_two(b.bridge));
    // From the level before to this one.
    const V before = load<V>(pack.before.data() + lane), here = load<V>(pack.here.data() + lane);
    const V share = before + real(static_cast<double>(step + 1) / contact.stride) * (here - before);
    // 2 w/range, w being the mean of both rods'.
    const V pull = (of_one(a.cling) + of_two(b.cling)) * weight * length * share / range;
    Real* terms = contact.terms.data() + (index(pack_index * contact.stride + step)) * kTerms + lane;
    store<V>(terms, distance);
    store<V>(terms + kLanes, stiff);
    store<V>(terms + 2 * kLanes, range);
    store<V>(terms + 3 * kLanes, pull);
  }

  /// By the gap. push: of the contact [N]; pull: of the liquid [N]; stiff: the
  /// contact's curvature where surfaces overlap; bridge: one that lies above the energy of the liquid
  /// wherever the pull takes them, up to where they meet: pull over gap.
  struct Terms {
    CALLIGRAPHY_INLINE Terms(const BundleContact<Real>& contact, int pack_index, int step, int lane,
                             const Facing& facing) {
      const Real* const terms =
          contact.terms.data() + index(pack_index * contact.stride + step) * kTerms + lane;
      const V zero{}, one = real(1), half = real(0.5);
      distance = load<V>(terms);
      const V hard = load<V>(terms + kLanes), range = load<V>(terms + 2 * kLanes),
              strongest = load<V>(terms + 3 * kLanes);
      gap = facing.length - distance;
      const V overlap = min(gap, zero), apart = max(gap, zero);
      // Below half of the distance the energy goes on as a parabola.
      const V squeeze = distance / max(distance + overlap, half * distance);
      push = facing.part * (half * hard * squeeze * (one + squeeze)) * -overlap;
      stiff = facing.part * hard * squeeze * squeeze * squeeze;
      const V open = facing.part * max(zero, one - apart / range);
      pull = open * strongest;
      bridge = pull / max(gap, real(kNearlyTouching) * distance);
      energy = facing.part * (half * hard * squeeze * overlap * overlap + strongest * overlap) -
               half * pull * (range - apart);
    }
    V gap, distance, push, pull, stiff, bridge, energy;
  };

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
    CALLIGRAPHY_INLINE void addTo(Real* pulls, const std::int32_t* at) const {
      const V values[4] = {force.x, force.y, force.z, stiffness};
      addToRecords<V>(pulls, at, values);
    }
  };

  /// A pack's lanes. sums: of what ties groups of rods, [place][2][lane], or null; most: see BundleTie.
  static CALLIGRAPHY_INLINE void pushLanes(BundleContact<Real>& contact, int pack_index, int lane,
                                           Real* sums, V& most) {
    const Face face(contact, pack_index, lane);
    const V zero{}, one = real(1);
    const V friction = real(contact.friction), slip = real(contact.slip + 1e-12);
    const V spacing_one = load<V>(face.pack.spacing_one.data() + lane),
            spacing_two = load<V>(face.pack.spacing_two.data() + lane);
    V place_one = load<V>(face.pack.place_one.data() + lane),
      place_two = load<V>(face.pack.place_two.data() + lane);
    Real* const pulls = contact.pulls.data();
    Vector before = face.vectorAt(contact.points, face.two, -1),
           at = face.vectorAt(contact.points, face.two, 0);
    Vector way_before = face.vectorAt(contact.ways, face.two, -1),
           way_at = face.vectorAt(contact.ways, face.two, 0);
    Sum sum_before, sum_at;
    for (int step = 0; step < contact.stride; ++step) {
      const Vector after = face.vectorAt(contact.points, face.two, step + 1);
      const Vector way_after = face.vectorAt(contact.ways, face.two, step + 1);
      const Facing facing(face.vectorAt(contact.points, face.one, step), before, at, after,
                          face.endsAt(step), face.inverse_square);
      const Terms terms(contact, pack_index, step, lane, facing);
      const V t = facing.t, rest = one - t;
      const V on = select(facing.forward, t, zero), back = select(facing.forward, zero, t);
      const Vector u = face.vectorAt(contact.ways, face.one, step) -
                       (rest * way_at + on * way_after + back * way_before);
      const V closing = dot(u, facing.n);
      // Surfaces that meet in this step or the next resist as those that overlap.
      const Mask meets =
          terms.gap + min(closing + closing, zero) < real(kNearlyTouching) * terms.distance;
      const V curvature = select(meets, max(terms.stiff, terms.bridge), terms.bridge);
      Sum sum_after;
      if (any(curvature > zero)) {
        const V along = dot(u, facing.edge);
        const V across = squaredNorm(u) - along * along * face.inverse_square;
        most = max(most, select(curvature > zero, across, zero));
        Vector g = (terms.pull - terms.push) * facing.n;
        // Friction by the way of this step, at the force that there is.
        const V push = friction * terms.push;
        const Vector slide = u - closing * facing.n;
        const V drag = push / (sqrt(squaredNorm(slide)) + slip);
        g = g + drag * slide;
        const V c = max(curvature, drag);
        Sum own;
        own.add(one, g, c);
        own.addTo(pulls + 4 * step, face.one);
        const Vector opposite = (-one) * g;
        sum_before.add(back, opposite, c);
        sum_at.add(rest, opposite, c);
        sum_after.add(on, opposite, c);
        if (sums)
          share(contact.node_count - 1, face.pack, step, place_one,
                place_one - place_two - (on - back) * spacing_two, c, sums);
      }
      sum_before.addTo(pulls + 4 * (step - 1), face.two);
      sum_before = sum_at;
      sum_at = sum_after;
      before = at;
      at = after;
      way_before = way_at;
      way_at = way_after;
      place_one = place_one + spacing_one;
      place_two = place_two + spacing_two;
    }
    sum_before.addTo(pulls + 4 * (contact.stride - 1), face.two);
    sum_at.addTo(pulls + 4 * contact.stride, face.two);
  }

  /// What ties groups of rods, at the places around a node.
  static CALLIGRAPHY_INLINE void share(int last_place, const BundlePack<Real>& pack, int step, V place,
                                       V apart, V curvature, Real* sums) {
    const V zero{}, one = real(1);
    const V turn = curvature * apart * apart;
    const Real low = pack.low + static_cast<Real>(step) * pack.least,
               high = pack.high + static_cast<Real>(step) * pack.most;
    const int first = low > Real(0) ? static_cast<int>(low) : 0;
    const int last = std::min(last_place, static_cast<int>(high) + 2);
    for (int to = first; to <= last; ++to) {
      const V off = place - real(to);
      const V part = max(zero, one - max(off, -off));
      Real* out = sums + 2 * to * kWidth;
      store<V>(out, load<V>(out) + part * curvature);
      // Points a little apart may lie on this edge between places, and on the ones beside it.
      const V beside = off + real(0.5);
      store<V>(out + kWidth,
               load<V>(out + kWidth) + select(max(beside, -beside) < real(1.5), turn, zero));
    }
  }
};

}  // namespace calligraphy_brush
