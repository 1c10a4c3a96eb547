#pragma once

#include "calligraphy_brush/contact/bundle_contact.h"

namespace calligraphy_brush {

/// Gradients and curvatures of the contact and cohesion of rods, several pairs at a time.
template <class V>
class BundlePull {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Mask = MaskOf<V>;

  /// Fills contact.pull, and force and gap of every pair, for the believed `point` and `way`.
  static void pull(BundleContact<Real>& contact) {
    __builtin_memset(contact.pull.data(), 0, contact.pull.size() * sizeof(Real));
    pullPairs<false>(contact, contact.beside);
    pullPairs<true>(contact, contact.crossing);
  }

 private:
  static constexpr int kWidth = widthOf<V>;
  /// Three numbers each from quads[index[k] + shift].
  static CALLIGRAPHY_INLINE Vector gather(const Real* quads, const std::int32_t* index, int shift) {
    alignas(64) Real x[kWidth], y[kWidth], z[kWidth];
    for (int k = 0; k < kWidth; ++k) {
      const Real* at = quads + 4 * (index[k] + shift);
      x[k] = at[0];
      y[k] = at[1];
      z[k] = at[2];
    }
    return {load<V>(x), load<V>(y), load<V>(z)};
  }

  template <bool kCrossing>
  static void pullPairs(BundleContact<Real>& contact, BundlePairs<Real>& pairs) {
    const V zero{}, one = broadcast<V>(1), tiny = broadcast<V>(Real(1e-12));
    const V friction = broadcast<V>(static_cast<Real>(contact.friction));
    const V slip = broadcast<V>(static_cast<Real>(contact.slip));
    const Real* point = contact.point.data();
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
      const V squeeze = one / max(one + gap / distance, broadcast<V>(Real(0.1)));
      const V bridge = well * max(one - ratio * ratio, zero);
      const V curvature = part * select(gap < zero, stiff * squeeze, bridge);
      const V force = curvature * gap;
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
        drag = friction * max(-force, zero) / max(sqrt(squaredNorm(u)), slip);
        g = g + drag * u;
      }
      const V rest = curvature - drag;
      const Symmetric3<V> H{rest * n.x * n.x + drag, rest * n.x * n.y, rest * n.x * n.z,
                            rest * n.y * n.y + drag, rest * n.y * n.z, rest * n.z * n.z + drag};

      alignas(64) Real rows[11][kWidth];
      const V values[11] = {g.x, g.y, g.z, H.xx, H.yy, H.zz, H.xy, H.xz, H.yz, t, s};
      for (int row = 0; row < 11; ++row) store<V>(rows[row], values[row]);
      alignas(64) Real strong[kWidth];
      store<V>(strong, curvature);
      const int here = pairs.count - first < kWidth ? pairs.count - first : kWidth;
      for (int k = 0; k < here; ++k) {
        if (!(strong[k] > Real(0))) continue;
        const Real given[12] = {rows[0][k], rows[1][k], rows[2][k], Real(0),    rows[3][k], rows[4][k],
                                rows[5][k], Real(0),    rows[6][k], rows[7][k], rows[8][k], Real(0)};
        const auto give = [&](int node, Real weight, Real sign) {
          Real* out = contact.pull.data() + 12 * node;
          const Real signed_weight = sign * weight;
          for (int i = 0; i < 4; ++i) out[i] += signed_weight * given[i];
          for (int i = 4; i < 12; ++i) out[i] += weight * given[i];
        };
        if constexpr (kCrossing) {
          give(a[k], Real(1) - rows[10][k], Real(1));
          give(a[k] + 1, rows[10][k], Real(1));
        } else {
          give(a[k], Real(1), Real(1));
        }
        give(b[k], Real(1) - rows[9][k], Real(-1));
        give(b[k] + 1, rows[9][k], Real(-1));
      }
    }
  }
};

}  // namespace calligraphy_brush
