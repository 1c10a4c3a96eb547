#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

/// A small vocabulary for doing the same thing to several rods at once.
///
/// Lanes<Real, W> holds W numbers in one register; + − * / and comparisons work lane by lane, and
/// a comparison gives a mask for select(). Every function here also takes a plain float or double,
/// so a formula is written once and runs in a kernel or alone in a test.
///
/// Files that use wider registers than the rest of the package are compiled with their own
/// instruction-set flags. Each uses its own W, so no two of them instantiate the same template,
/// and everything is inlined: the linker can not mix them up.
namespace calligraphy_brush {

/// Rods that are stored side by side. A kernel of narrower registers takes several turns.
constexpr int kLanes = 16;

#define CALLIGRAPHY_INLINE inline __attribute__((always_inline))

namespace lanes_detail {
template <class Real, int Width>
struct Vector {
  typedef Real type __attribute__((vector_size(sizeof(Real) * Width)));
};
template <class Real>
struct Vector<Real, 1> {
  using type = Real;
};
template <class V>
struct Traits {
  using Real = std::decay_t<decltype(V{}[0])>;
  static constexpr int width = static_cast<int>(sizeof(V) / sizeof(Real));
};
template <>
struct Traits<float> {
  using Real = float;
  static constexpr int width = 1;
};
template <>
struct Traits<double> {
  using Real = double;
  static constexpr int width = 1;
};
}  // namespace lanes_detail

template <class Real, int Width>
using Lanes = typename lanes_detail::Vector<Real, Width>::type;

/// The number in a lane: float or double.
template <class V>
using RealOf = typename lanes_detail::Traits<V>::Real;

/// How many numbers V holds.
template <class V>
constexpr int widthOf = lanes_detail::Traits<V>::width;

/// What a comparison of two V gives.
template <class V>
using MaskOf = decltype(V{} < V{});

template <class V>
CALLIGRAPHY_INLINE V broadcast(RealOf<V> value) {
  return V{} + value;
}

/// Reads or writes a V at an address that is a multiple of its size.
template <class V>
CALLIGRAPHY_INLINE V load(const RealOf<V>* address) {
  V value;
  __builtin_memcpy(&value, __builtin_assume_aligned(address, sizeof(V)), sizeof(V));
  return value;
}
template <class V>
CALLIGRAPHY_INLINE void store(RealOf<V>* address, V value) {
  __builtin_memcpy(__builtin_assume_aligned(address, sizeof(V)), &value, sizeof(V));
}

/// a where the mask is set, else b.
template <class Mask, class V>
CALLIGRAPHY_INLINE V select(Mask mask, V a, V b) {
  return mask ? a : b;
}
template <class V>
CALLIGRAPHY_INLINE V min(V a, V b) {
  return a < b ? a : b;
}
template <class V>
CALLIGRAPHY_INLINE V max(V a, V b) {
  return a > b ? a : b;
}

/// Whether any lane of a mask is set.
template <class Mask>
CALLIGRAPHY_INLINE bool any(Mask mask) {
#if defined(__AVX512DQ__)
  if constexpr (sizeof(Mask) == 64) return _mm512_movepi32_mask((__m512i)mask) != 0;
#endif
#if defined(__AVX2__)
  if constexpr (sizeof(Mask) == 32) return _mm256_movemask_epi8((__m256i)mask) != 0;
#endif
#if defined(__SSE2__)
  if constexpr (sizeof(Mask) == 16) return _mm_movemask_epi8((__m128i)mask) != 0;
#endif
  bool result = false;
  for (std::size_t lane = 0; lane < sizeof(Mask) / sizeof(mask[0]); ++lane) result |= mask[lane] != 0;
  return result;
}
CALLIGRAPHY_INLINE bool any(bool mask) {
  return mask;
}

CALLIGRAPHY_INLINE float sqrt(float x) {
  return __builtin_sqrtf(x);
}
CALLIGRAPHY_INLINE double sqrt(double x) {
  return __builtin_sqrt(x);
}
template <class V>
CALLIGRAPHY_INLINE V sqrt(V x) {
#if defined(__AVX512F__)
  // Masked with all lanes: GCC 12 warns of its own unmasked form.
  if constexpr (sizeof(V) == 64 && sizeof(x[0]) == 4) return (V)_mm512_maskz_sqrt_ps(0xffff, (__m512)x);
  if constexpr (sizeof(V) == 64 && sizeof(x[0]) == 8) return (V)_mm512_maskz_sqrt_pd(0xff, (__m512d)x);
#endif
#if defined(__AVX2__)
  if constexpr (sizeof(V) == 32 && sizeof(x[0]) == 4) return (V)_mm256_sqrt_ps((__m256)x);
  if constexpr (sizeof(V) == 32 && sizeof(x[0]) == 8) return (V)_mm256_sqrt_pd((__m256d)x);
#endif
#if defined(__SSE2__)
  if constexpr (sizeof(V) == 16 && sizeof(x[0]) == 4) return (V)_mm_sqrt_ps((__m128)x);
  if constexpr (sizeof(V) == 16 && sizeof(x[0]) == 8) return (V)_mm_sqrt_pd((__m128d)x);
#endif
  V result;
  for (int lane = 0; lane < widthOf<V>; ++lane) result[lane] = sqrt(x[lane]);
  return result;
}

/// Lane k: row[from[k]], of a row of kLanes numbers.
template <class V>
CALLIGRAPHY_INLINE V pick(const RealOf<V>* row, const std::int32_t* from) {
#if defined(__AVX512F__)
  if constexpr (sizeof(V) == 64 && sizeof(RealOf<V>) == 4)
    return (V)_mm512_maskz_permutexvar_ps(0xffff, _mm512_loadu_si512(from), _mm512_load_ps(row));
  if constexpr (sizeof(V) == 64 && sizeof(RealOf<V>) == 8)
    return (V)_mm512_maskz_permutex2var_pd(
        0xff, _mm512_load_pd(row),
        _mm512_maskz_cvtepi32_epi64(0xff, _mm256_loadu_si256((const __m256i*)from)),
        _mm512_load_pd(row + 8));
#endif
#if defined(__AVX2__)
  if constexpr (sizeof(V) == 32 && sizeof(RealOf<V>) == 4) {
    const __m256i index = _mm256_loadu_si256((const __m256i*)from);
    return (V)_mm256_blendv_ps(_mm256_permutevar8x32_ps(_mm256_load_ps(row), index),
                               _mm256_permutevar8x32_ps(_mm256_load_ps(row + 8), index),
                               _mm256_castsi256_ps(_mm256_slli_epi32(index, 28)));
  }
#endif
  if constexpr (widthOf<V> == 1) {
    return row[from[0]];
  } else {
    alignas(64) RealOf<V> values[widthOf<V>];
    for (int lane = 0; lane < widthOf<V>; ++lane) values[lane] = row[from[lane]];
    return load<V>(values);
  }
}

namespace lanes_detail {
#if defined(__SSE2__)
/// In every 16 bytes of four vectors: the 4 × 4 numbers, transposed.
template <class V>
CALLIGRAPHY_INLINE void transpose(V (&rows)[4]) {
  const auto [a, b, c, d] = rows;
#if defined(__AVX512F__)
  if constexpr (sizeof(V) == 64) {
    // Masked with all lanes: see sqrt.
    const auto low = [](auto x, auto y) {
      return (__m512d)_mm512_maskz_unpacklo_ps(0xffff, (__m512)x, (__m512)y);
    };
    const auto high = [](auto x, auto y) {
      return (__m512d)_mm512_maskz_unpackhi_ps(0xffff, (__m512)x, (__m512)y);
    };
    rows[0] = (V)_mm512_maskz_unpacklo_pd(0xff, low(a, b), low(c, d));
    rows[1] = (V)_mm512_maskz_unpackhi_pd(0xff, low(a, b), low(c, d));
    rows[2] = (V)_mm512_maskz_unpacklo_pd(0xff, high(a, b), high(c, d));
    rows[3] = (V)_mm512_maskz_unpackhi_pd(0xff, high(a, b), high(c, d));
  }
#endif
#if defined(__AVX2__)
  if constexpr (sizeof(V) == 32) {
    const auto low = [](auto x, auto y) { return (__m256d)_mm256_unpacklo_ps((__m256)x, (__m256)y); };
    const auto high = [](auto x, auto y) { return (__m256d)_mm256_unpackhi_ps((__m256)x, (__m256)y); };
    rows[0] = (V)_mm256_unpacklo_pd(low(a, b), low(c, d));
    rows[1] = (V)_mm256_unpackhi_pd(low(a, b), low(c, d));
    rows[2] = (V)_mm256_unpacklo_pd(high(a, b), high(c, d));
    rows[3] = (V)_mm256_unpackhi_pd(high(a, b), high(c, d));
  }
#endif
  if constexpr (sizeof(V) == 16) {
    const auto low = [](auto x, auto y) { return (__m128d)_mm_unpacklo_ps((__m128)x, (__m128)y); };
    const auto high = [](auto x, auto y) { return (__m128d)_mm_unpackhi_ps((__m128)x, (__m128)y); };
    rows[0] = (V)_mm_unpacklo_pd(low(a, b), low(c, d));
    rows[1] = (V)_mm_unpackhi_pd(low(a, b), low(c, d));
    rows[2] = (V)_mm_unpacklo_pd(high(a, b), high(c, d));
    rows[3] = (V)_mm_unpackhi_pd(high(a, b), high(c, d));
  }
}

/// 16 bytes of a vector, the part `kPart`.
template <int kPart, class V>
CALLIGRAPHY_INLINE __m128 partOf(V value) {
#if defined(__AVX512F__)
  if constexpr (sizeof(V) == 64) return _mm512_maskz_extractf32x4_ps(0xf, (__m512)value, kPart);
#endif
#if defined(__AVX2__)
  if constexpr (sizeof(V) == 32) return _mm256_extractf128_ps((__m256)value, kPart);
#endif
  if constexpr (sizeof(V) == 16) return (__m128)value;
}

template <class V>
constexpr bool kByQuarters = sizeof(RealOf<V>) == 4 &&
                             (sizeof(V) == 16 || sizeof(V) == 32 || sizeof(V) == 64);

/// Of records of lanes k, 4 + k, 8 + k ..: one after another.
template <class V>
CALLIGRAPHY_INLINE V everyFourth(const float* base, const std::int32_t* at) {
#if defined(__AVX512F__)
  if constexpr (sizeof(V) == 64) {
    __m512 all = _mm512_maskz_insertf32x4(0xffff, __m512{}, _mm_load_ps(base + at[0]), 0);
    all = _mm512_maskz_insertf32x4(0xffff, all, _mm_load_ps(base + at[4]), 1);
    all = _mm512_maskz_insertf32x4(0xffff, all, _mm_load_ps(base + at[8]), 2);
    return (V)_mm512_maskz_insertf32x4(0xffff, all, _mm_load_ps(base + at[12]), 3);
  }
#endif
#if defined(__AVX2__)
  if constexpr (sizeof(V) == 32)
    return (V)_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(base + at[0])),
                                   _mm_load_ps(base + at[4]), 1);
#endif
  if constexpr (sizeof(V) == 16) return (V)_mm_load_ps(base + at[0]);
}

/// To where everyFourth takes them from.
template <bool kAdd, class V>
CALLIGRAPHY_INLINE void putEveryFourth(float* base, const std::int32_t* at, V value) {
  const auto put = [&](int lane, __m128 part) {
    float* record = base + at[lane];
    _mm_store_ps(record, kAdd ? _mm_add_ps(_mm_load_ps(record), part) : part);
  };
  put(0, partOf<0>(value));
  if constexpr (sizeof(V) >= 32) put(4, partOf<1>(value));
  if constexpr (sizeof(V) >= 64) {
    put(8, partOf<2>(value));
    put(12, partOf<3>(value));
  }
}
#endif

template <bool kAdd, class V>
CALLIGRAPHY_INLINE void putRecords(RealOf<V>* base, const std::int32_t* at, const V (&values)[4]) {
#if defined(__SSE2__)
  if constexpr (kByQuarters<V>) {
    V rows[4] = {values[0], values[1], values[2], values[3]};
    transpose<V>(rows);
    for (int k = 0; k < 4; ++k) putEveryFourth<kAdd, V>(base, at + k, rows[k]);
    return;
  }
#endif
  alignas(64) RealOf<V> rows[4][widthOf<V>];
  for (int i = 0; i < 4; ++i) store<V>(rows[i], values[i]);
  for (int lane = 0; lane < widthOf<V>; ++lane)
    for (int i = 0; i < 4; ++i)
      base[at[lane] + i] = kAdd ? base[at[lane] + i] + rows[i][lane] : rows[i][lane];
}
}  // namespace lanes_detail

/// Four numbers of lane k, base[at[k]] and the three after it, for all lanes: at[k] are multiples of 4.
template <class V>
CALLIGRAPHY_INLINE void loadRecords(const RealOf<V>* base, const std::int32_t* at, V (&values)[4]) {
#if defined(__SSE2__)
  if constexpr (lanes_detail::kByQuarters<V>) {
    for (int k = 0; k < 4; ++k) values[k] = lanes_detail::everyFourth<V>(base, at + k);
    lanes_detail::transpose<V>(values);
    return;
  }
#endif
  for (int i = 0; i < 4; ++i) {
    alignas(64) RealOf<V> row[widthOf<V>];
    for (int lane = 0; lane < widthOf<V>; ++lane) row[lane] = base[at[lane] + i];
    values[i] = load<V>(row);
  }
}
template <class V>
CALLIGRAPHY_INLINE void storeRecords(RealOf<V>* base, const std::int32_t* at, const V (&values)[4]) {
  lanes_detail::putRecords<false, V>(base, at, values);
}
/// Lane by lane: lanes may have the same record.
template <class V>
CALLIGRAPHY_INLINE void addToRecords(RealOf<V>* base, const std::int32_t* at, const V (&values)[4]) {
  lanes_detail::putRecords<true, V>(base, at, values);
}

/// Over all lanes.
template <class V>
CALLIGRAPHY_INLINE RealOf<V> sumOf(V values) {
  if constexpr (widthOf<V> == 1) {
    return values;
  } else {
    // By halves, with the neighbour, then the neighbours' neighbours.
    alignas(64) RealOf<V> sums[widthOf<V>];
    store<V>(sums, values);
    for (int half = widthOf<V> / 2; half > 0; half /= 2)
      for (int lane = 0; lane < half; ++lane) sums[lane] += sums[lane + half];
    return sums[0];
  }
}

/// Three numbers a lane.
template <class V>
struct Vec3 {
  V x, y, z;

  /// A vector field is stored component by component, kStride numbers each.
  template <int kStride = kLanes>
  static CALLIGRAPHY_INLINE Vec3 loadFrom(const RealOf<V>* address) {
    return {load<V>(address), load<V>(address + kStride), load<V>(address + 2 * kStride)};
  }
  template <int kStride = kLanes>
  CALLIGRAPHY_INLINE void storeTo(RealOf<V>* address) const {
    store<V>(address, x);
    store<V>(address + kStride, y);
    store<V>(address + 2 * kStride, z);
  }

  friend CALLIGRAPHY_INLINE Vec3 operator+(const Vec3& a, const Vec3& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
  }
  friend CALLIGRAPHY_INLINE Vec3 operator-(const Vec3& a, const Vec3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
  }
  friend CALLIGRAPHY_INLINE Vec3 operator*(V s, const Vec3& a) { return {s * a.x, s * a.y, s * a.z}; }
};

template <class V>
CALLIGRAPHY_INLINE V dot(const Vec3<V>& a, const Vec3<V>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class V>
CALLIGRAPHY_INLINE Vec3<V> cross(const Vec3<V>& a, const Vec3<V>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class V>
CALLIGRAPHY_INLINE V squaredNorm(const Vec3<V>& a) {
  return dot(a, a);
}
template <class Mask, class V>
CALLIGRAPHY_INLINE Vec3<V> select(Mask mask, const Vec3<V>& a, const Vec3<V>& b) {
  return {select(mask, a.x, b.x), select(mask, a.y, b.y), select(mask, a.z, b.z)};
}

/// Symmetric 3×3 matrix a lane.
template <class V>
struct Symmetric3 {
  V xx, xy, xz, yy, yz, zz;

  friend CALLIGRAPHY_INLINE Vec3<V> operator*(const Symmetric3& m, const Vec3<V>& v) {
    return {m.xx * v.x + m.xy * v.y + m.xz * v.z, m.xy * v.x + m.yy * v.y + m.yz * v.z,
            m.xz * v.x + m.yz * v.y + m.zz * v.z};
  }
};

}  // namespace calligraphy_brush
