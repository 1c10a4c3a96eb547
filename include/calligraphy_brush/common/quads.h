#pragma once

#include <cstdint>

#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Vectors of nodes as x, y, z and one number more, node after node. Nodes that stand in no
/// order are read and written faster in this form than component by component.
template <class V>
struct Quads {
  using Real = RealOf<V>;
  static constexpr int kWidth = widthOf<V>;

  /// Four numbers of each of kWidth nodes.
  struct Block {
    V x, y, z, w;

    friend CALLIGRAPHY_INLINE Block operator*(V s, const Block& a) {
      return {s * a.x, s * a.y, s * a.z, s * a.w};
    }
  };

  /// Lane k: quads[index[k] + shift].
  static CALLIGRAPHY_INLINE Block gatherAll(const Real* quads, const std::int32_t* index, int shift) {
    alignas(64) Real x[kWidth], y[kWidth], z[kWidth], w[kWidth];
    if constexpr (kWidth % 4 == 0) {
      for (int k = 0; k < kWidth; k += 4) {
        const Quad q0 = at(quads, index[k] + shift), q1 = at(quads, index[k + 1] + shift),
                   q2 = at(quads, index[k + 2] + shift), q3 = at(quads, index[k + 3] + shift);
        const Quad xy01 = __builtin_shuffle(q0, q1, Order{0, 4, 1, 5}),
                   xy23 = __builtin_shuffle(q2, q3, Order{0, 4, 1, 5}),
                   zw01 = __builtin_shuffle(q0, q1, Order{2, 6, 3, 7}),
                   zw23 = __builtin_shuffle(q2, q3, Order{2, 6, 3, 7});
        store<Quad>(x + k, __builtin_shuffle(xy01, xy23, Order{0, 1, 4, 5}));
        store<Quad>(y + k, __builtin_shuffle(xy01, xy23, Order{2, 3, 6, 7}));
        store<Quad>(z + k, __builtin_shuffle(zw01, zw23, Order{0, 1, 4, 5}));
        store<Quad>(w + k, __builtin_shuffle(zw01, zw23, Order{2, 3, 6, 7}));
      }
    } else {
      for (int k = 0; k < kWidth; ++k) {
        const Real* quad = quads + 4 * (index[k] + shift);
        x[k] = quad[0];
        y[k] = quad[1];
        z[k] = quad[2];
        w[k] = quad[3];
      }
    }
    return {load<V>(x), load<V>(y), load<V>(z), load<V>(w)};
  }
  static CALLIGRAPHY_INLINE Vec3<V> gather(const Real* quads, const std::int32_t* index, int shift) {
    const Block block = gatherAll(quads, index, shift);
    return {block.x, block.y, block.z};
  }

  /// Adds lane k to quads[index[k] + shift], one after another: nodes may come twice.
  static CALLIGRAPHY_INLINE void add(const Block& block, Real* quads, const std::int32_t* index,
                                     int shift) {
    spread(block, [&](int k, const auto& quad) {
      if constexpr (kWidth % 4 == 0) {
        put(quads, index[k] + shift, at(quads, index[k] + shift) + quad);
      } else {
        for (int i = 0; i < 4; ++i) quads[4 * (index[k] + shift) + i] += quad[i];
      }
    });
  }

  /// quads[index[k] + shift] becomes lane k.
  static CALLIGRAPHY_INLINE void scatter(const Vec3<V>& v, Real* quads, const std::int32_t* index,
                                         int shift) {
    spread(Block{v.x, v.y, v.z, V{}}, [&](int k, const auto& quad) {
      if constexpr (kWidth % 4 == 0) {
        put(quads, index[k] + shift, quad);
      } else {
        for (int i = 0; i < 4; ++i) quads[4 * (index[k] + shift) + i] = quad[i];
      }
    });
  }

 private:
  using Int = std::conditional_t<sizeof(Real) == 4, int, long long>;
  typedef Int Order __attribute__((vector_size(4 * sizeof(Int))));
  /// Where V is narrower there is none, so that no file uses registers that its flags do not allow.
  using Quad = Lanes<Real, kWidth % 4 == 0 ? 4 : 1>;

  static CALLIGRAPHY_INLINE Quad at(const Real* quads, int index) {
    Quad quad;
    __builtin_memcpy(&quad, __builtin_assume_aligned(quads + 4 * index, sizeof(quad)), sizeof(quad));
    return quad;
  }
  static CALLIGRAPHY_INLINE void put(Real* quads, int index, Quad quad) {
    __builtin_memcpy(__builtin_assume_aligned(quads + 4 * index, sizeof(quad)), &quad, sizeof(quad));
  }

  /// Calls take(k, quad) for every lane in order.
  template <class Take>
  static CALLIGRAPHY_INLINE void spread(const Block& block, Take&& take) {
    alignas(64) Real rows[4][kWidth];
    store<V>(rows[0], block.x);
    store<V>(rows[1], block.y);
    store<V>(rows[2], block.z);
    store<V>(rows[3], block.w);
    if constexpr (kWidth % 4 == 0) {
      for (int k = 0; k < kWidth; k += 4) {
        const Quad x = load<Quad>(rows[0] + k), y = load<Quad>(rows[1] + k), z = load<Quad>(rows[2] + k),
                   w = load<Quad>(rows[3] + k);
        const Quad xy01 = __builtin_shuffle(x, y, Order{0, 4, 1, 5}),
                   zw01 = __builtin_shuffle(z, w, Order{0, 4, 1, 5}),
                   xy23 = __builtin_shuffle(x, y, Order{2, 6, 3, 7}),
                   zw23 = __builtin_shuffle(z, w, Order{2, 6, 3, 7});
        take(k, __builtin_shuffle(xy01, zw01, Order{0, 1, 4, 5}));
        take(k + 1, __builtin_shuffle(xy01, zw01, Order{2, 3, 6, 7}));
        take(k + 2, __builtin_shuffle(xy23, zw23, Order{0, 1, 4, 5}));
        take(k + 3, __builtin_shuffle(xy23, zw23, Order{2, 3, 6, 7}));
      }
    } else {
      for (int k = 0; k < kWidth; ++k) {
        const Real quad[4] = {rows[0][k], rows[1][k], rows[2][k], rows[3][k]};
        take(k, quad);
      }
    }
  }
};

}  // namespace calligraphy_brush
