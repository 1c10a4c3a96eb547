#pragma once

#include "calligraphy_brush/common/quads.h"
#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {

/// Gradients and curvatures of the contact and cohesion of rods, several pairs at a time.
template <class V>
class BundlePull {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Mask = MaskOf<V>;

  /// Fills contact.gradient and energy, the links, and force and gap of every pair, for the believed
  /// `point` and `way`.
  static void pull(BundleContact<Real>& contact) {
    contact.energy = 0.0;
    __builtin_memset(contact.gradient.data(), 0, contact.gradient.size() * sizeof(Real));
    pullPairs<false>(contact, contact.beside, contact.beside_links);
    pullPairs<true>(contact, contact.crossing, contact.crossing_links);
  }

  /// Fills contact.answer: forces that the links of the last pull() put on nodes against their way
  /// contact.move, with the opposite sign, so that it is K · move with K symmetric and not negative.
  static void multiply(BundleContact<Real>& contact) {
    __builtin_memset(contact.answer.data(), 0, contact.answer.size() * sizeof(Real));
    multiplyLinks<false>(contact, contact.beside_links);
    multiplyLinks<true>(contact, contact.crossing_links);
  }

 private:
  static constexpr int kWidth = widthOf<V>;
  static CALLIGRAPHY_INLINE Vector gather(const Real* quads, const std::int32_t* index, int shift) {
    return Quads<V>::gather(quads, index, shift);
  }
  /// Shares out what acts at the closest points to the ends of their edges: b gets the opposite of
  /// x, y, z.
  template <bool kCrossing>
  static CALLIGRAPHY_INLINE void give(const typename Quads<V>::Block& block, V s, V t,
                                      const std::int32_t* a, const std::int32_t* b, Real* quads) {
    const V one = broadcast<V>(1);
    if constexpr (kCrossing) {
      Quads<V>::add((one - s) * block, quads, a, 0);
      Quads<V>::add(s * block, quads, a, 1);
    } else {
      Quads<V>::add(block, quads, a, 0);
    }
    const typename Quads<V>::Block opposite{-block.x, -block.y, -block.z, block.w};
    Quads<V>::add((one - t) * opposite, quads, b, 0);
    Quads<V>::add(t * opposite, quads, b, 1);
  }

  template <bool kCrossing>
  static void multiplyLinks(BundleContact<Real>& contact, const BundleLinks<Real>& links) {
    const Real* move = contact.move.data();
    for (int first = 0; first < links.count; first += kWidth) {
      const std::int32_t *a = links.a.data() + first, *b = links.b.data() + first;
      const V t = load<V>(links.t.data() + first);
      Vector u = gather(move, a, 0);
      if constexpr (kCrossing) u = u + load<V>(links.s.data() + first) * (gather(move, a, 1) - u);
      const Vector w0 = gather(move, b, 0);
      u = u - (w0 + t * (gather(move, b, 1) - w0));
      const Vector n{load<V>(links.x.data() + first), load<V>(links.y.data() + first),
                     load<V>(links.z.data() + first)};
      const Vector f =
          load<V>(links.drag.data() + first) * u + (load<V>(links.rest.data() + first) * dot(n, u)) * n;
      V s{};
      if constexpr (kCrossing) s = load<V>(links.s.data() + first);
      give<kCrossing>({f.x, f.y, f.z, V{}}, s, t, a, b, contact.answer.data());
    }
  }

  template <bool kCrossing>
  static void pullPairs(BundleContact<Real>& contact, BundlePairs<Real>& pairs,
                        BundleLinks<Real>& links) {
    links.count = 0;
    for (auto* field : {&links.s, &links.t, &links.x, &links.y, &links.z, &links.drag, &links.rest})
      field->resize(pairs.a.size());
    links.a.resize(pairs.a.size());
    links.b.resize(pairs.a.size());
    const V zero{}, one = broadcast<V>(1), tiny = broadcast<V>(Real(1e-12));
    const V friction = broadcast<V>(static_cast<Real>(contact.friction));
    const V slip = broadcast<V>(static_cast<Real>(contact.slip));
    const Real* point = contact.point.data();
    V total = zero;
    for (int first = 0; first < pairs.count; first += kWidth) {
      const std::int32_t *a = pairs.a.data() + first, *b = pairs.b.data() + first;
      const Vector a0 = gather(point, a, 0), b0 = gather(point, b, 0), b1 = gather(point, b, 1);
      const Vector f = b1 - b0;
      const V ff = squaredNorm(f);
      V s = zero, t, part = one;
      Vector from = a0;
      const V distance = load<V>(pairs.distance.data() + first);
      if constexpr (kCrossing) {
        // Closest points of the two lines; outside of the edges it is their neighbours' affair.
        const Vector e = gather(point, a, 1) - a0, r = a0 - b0;
        const V ee = squaredNorm(e), ef = dot(e, f), er = dot(e, r), fr = dot(f, r);
        const V sine_squared = max(one - ef * ef / (ee * ff), broadcast<V>(Real(1e-6)));
        const V inverse = one / (ee * ff * sine_squared);
        s = (ef * fr - er * ff) * inverse;
        t = (ee * fr - ef * er) * inverse;
        const Mask inside = (s >= zero) & (s < one) & (t >= zero) & (t < one);
        // From where the nodes of neither notice the other.
        const V seen = broadcast<V>(Real(0.5)) * sqrt(sine_squared * min(ee, ff)) / distance;
        part = select(inside, min(max(seen - one, zero), one), zero);
        from = a0 + s * e;
      } else {
        t = dot(a0 - b0, f) / ff;
        // Beyond the end of the rod it fades out.
        const V reach = load<V>(pairs.reach.data() + first);
        part = select(t > one + reach, zero, one) *
               min(one, max(zero, one - (t - one) / max(reach, broadcast<V>(Real(1e-3)))));
        part = select(t > one, select(reach > zero, part, one), one);
        t = min(max(t, zero), one);
      }
      const Vector d = from - (b0 + t * f);
      const V length = sqrt(squaredNorm(d) + tiny * tiny);
      const Vector n = (one / length) * d;
      const V gap = length - distance;
      const V range = load<V>(pairs.range.data() + first), well = load<V>(pairs.well.data() + first);
      const V stiff = load<V>(pairs.stiffness.data() + first) + well;
      const V ratio = gap / range;
      // Below half of the distance the energy goes on as a parabola.
      const V squeeze = one / max(one + gap / distance, broadcast<V>(Real(0.5)));
      const V bridge = well * max(one - ratio * ratio, zero);
      const V curvature =
          part * select(gap < zero, broadcast<V>(Real(0.5)) * stiff * squeeze * (one + squeeze), bridge);
      const V force = curvature * gap;
      const V depth = broadcast<V>(Real(0.25)) * well * range * range, half = broadcast<V>(Real(0.5));
      const V open = max(one - ratio * ratio, zero);
      V energy =
          part * select(gap < zero, half * stiff * squeeze * gap * gap - depth, -depth * open * open);
      store<V>(pairs.gap.data() + first, gap);
      store<V>(pairs.force.data() + first, force);
      if (!any(curvature > zero)) continue;

      Vector g = force * n;
      V drag = zero;
      if (contact.friction > 0.0 && any(force < zero)) {
        const Real* way = contact.way.data();
        Vector u = gather(way, a, 0);
        if constexpr (kCrossing) u = u + s * (gather(way, a, 1) - u);
        const Vector w0 = gather(way, b, 0);
        u = u - (w0 + t * (gather(way, b, 1) - w0));
        u = u - dot(u, n) * n;
        const V speed = sqrt(squaredNorm(u));
        drag = friction * max(-force, zero) / max(speed, slip);
        energy = energy + drag * (select(speed < slip, half * speed, speed - half * slip) * speed);
        g = g + drag * u;
      }
      total = total + energy;
      give<kCrossing>({g.x, g.y, g.z, max(curvature, drag)}, s, t, a, b, contact.gradient.data());

      // All of a block or none, so that it is copied and not picked.
      const auto link = static_cast<std::size_t>(links.count);
      __builtin_memcpy(links.a.data() + link, a, kWidth * sizeof(std::int32_t));
      __builtin_memcpy(links.b.data() + link, b, kWidth * sizeof(std::int32_t));
      store<V>(links.s.data() + link, s);
      store<V>(links.t.data() + link, t);
      store<V>(links.x.data() + link, n.x);
      store<V>(links.y.data() + link, n.y);
      store<V>(links.z.data() + link, n.z);
      store<V>(links.rest.data() + link, curvature - drag);
      store<V>(links.drag.data() + link, drag);
      links.count += kWidth;
    }
    for (int k = 0; k < kWidth; ++k) contact.energy += double(total[k]);
  }
};

}  // namespace calligraphy_brush
