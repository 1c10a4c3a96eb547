#pragma once

#include <vector>

#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/lanes.h"
#include "calligraphy_brush/common/orthonormal_basis.h"
#include "calligraphy_brush/contact/bundle_contact.h"
#include "calligraphy_brush/rods/rod_batch.h"

namespace calligraphy_brush {

/// Groups of a level that are one group of the next.
constexpr int kJoined = 4;
/// Numbers that a sweep keeps of an edge.
constexpr int kCommonFactorRows = 18;

/// What ties two groups at every place [N/m].
template <class Real>
struct CommonTie {
  int a = 0, b = 0;
  std::vector<Real> stiffness;
};

/// Rods that move as one: groups of rods that are neighbours at the root, and groups of kJoined such
/// groups, and so on up to the whole tuft. A group is a lane; lanes without one have mass and nothing
/// else. Fields are [tier][node][rows][lane].
template <class Real>
struct CommonLevel {
  int count = 0;
  AlignedVector<Real> sums;           ///< see kCommonRows
  AlignedVector<Real> hold;           ///< twice the stiffness of all ties [N/m], 1 row
  AlignedVector<Real> shift;          ///< of the nodes [m], 3 rows
  AlignedVector<Real> pull;           ///< gradient of the ties by it [N], 3 rows
  std::vector<CommonTie<Real>> ties;  ///< some of them
  int tie_count = 0;                  ///< that count
};

template <class Real>
struct CommonMotionState {
  int node_count = 0;
  std::vector<CommonLevel<Real>> levels;  ///< from batches to the whole tuft
  AlignedVector<Real> factor;             ///< scratch of a sweep, [edge][kCommonFactorRows][lane]
};

/// What rods that are solved one by one, each among believed neighbours, do not see: how they move
/// together. A rod holds on to where it believes its neighbours to be, and they to where they believe
/// it, so that what many do at once is slowed as if they were heavy. Therefore beliefs are first moved
/// by what groups of rods would do as one.
///
/// A group is a rod itself: its edges the means, its masses, joints, loads and contacts the sums of its
/// rods'. With the ties to other groups in place of neighbours it is solved as they are, in one Newton
/// step from the beliefs; but the other groups are believed to move as the larger group does that both
/// are part of, and that is solved first. So from the tuft down to the batches, a Riccati sweep each.
/// Stiffness is taken isotropic and positive, as is enough for beliefs: what they are off by, the rods'
/// own solutions mend, and at rest they are where they are whatever is believed of their motion.
/// Source: the cascade of coarse spaces is that of multigrid by aggregation, Vaněk, Mandel & Brezina
/// 1996, with each level solved once, from the top.
template <class V>
class CommonMotion {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;

  /// For level 0 with its sums filled: the shifts of all groups.
  static void solve(CommonMotionState<Real>& state) {
    const int n = state.node_count;
    for (std::size_t i = 1; i < state.levels.size(); ++i) join(state.levels[i - 1], state.levels[i], n);
    for (std::size_t i = state.levels.size(); i-- > 0;) {
      CommonLevel<Real>& level = state.levels[i];
      if (i + 1 < state.levels.size()) {
        follow(state.levels[i + 1], level, n);
        pullTies(level, n);
      } else {
        __builtin_memset(level.shift.data(), 0, level.shift.size() * sizeof(Real));
        __builtin_memset(level.pull.data(), 0, level.pull.size() * sizeof(Real));
      }
      for (int tier = 0; tier * kLanes < level.count; ++tier)
        for (int lane = 0; lane < kLanes; lane += kWidth) sweep(state, level, tier, lane);
    }
  }

 private:
  static constexpr int kWidth = widthOf<V>;
  static constexpr int kFactor = kCommonFactorRows * kWidth;
  static constexpr double kLeastPivot = 1e-6;
  static CALLIGRAPHY_INLINE std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static CALLIGRAPHY_INLINE V real(double value) { return broadcast<V>(static_cast<Real>(value)); }
  static int at(int group, int node, int node_count, int rows) {
    return ((group / kLanes * node_count + node) * rows) * kLanes + group % kLanes;
  }

  static void join(const CommonLevel<Real>& parts, CommonLevel<Real>& whole, int n) {
    for (int group = 0; group < whole.count; ++group)
      for (int node = 0; node < n; ++node)
        for (int row = 0; row < kCommonRows; ++row) {
          Real sum = 0;
          for (int part = kJoined * group; part < kJoined * (group + 1) && part < parts.count; ++part)
            sum += parts.sums[index(at(part, node, n, kCommonRows) + row * kLanes)];
          whole.sums[index(at(group, node, n, kCommonRows) + row * kLanes)] = sum;
        }
  }
  static void follow(const CommonLevel<Real>& whole, CommonLevel<Real>& parts, int n) {
    for (int part = 0; part < parts.count; ++part)
      for (int node = 0; node < n; ++node)
        for (int row = 0; row < 3; ++row)
          parts.shift[index(at(part, node, n, 3) + row * kLanes)] =
              whole.shift[index(at(part / kJoined, node, n, 3) + row * kLanes)];
  }
  static void pullTies(CommonLevel<Real>& level, int n) {
    __builtin_memset(level.pull.data(), 0, level.pull.size() * sizeof(Real));
    for (int tie_index = 0; tie_index < level.tie_count; ++tie_index)
      for (int node = 1; node < n; ++node) {
        const CommonTie<Real>& tie = level.ties[index(tie_index)];
        const int a = at(tie.a, node, n, 3), b = at(tie.b, node, n, 3);
        for (int i = 0; i < 3; ++i) {
          const Real force = tie.stiffness[index(node)] *
                             (level.shift[index(a + i * kLanes)] - level.shift[index(b + i * kLanes)]);
          level.pull[index(a + i * kLanes)] += force;
          level.pull[index(b + i * kLanes)] -= force;
        }
      }
  }

  /// As RodKernel::sweep and solveForUpdate, see there, for joints that resist in all directions alike.
  static void sweep(CommonMotionState<Real>& state, CommonLevel<Real>& level, int tier, int lane) {
    const int n = state.node_count;
    const Real* sums = level.sums.data() + tier * n * kCommonRows * kLanes + lane;
    const Real* hold = level.hold.data() + tier * n * kLanes + lane;
    const Real* pull = level.pull.data() + tier * n * 3 * kLanes + lane;
    Real* shift = level.shift.data() + tier * n * 3 * kLanes + lane;
    const auto in = [&](int node, int row) {
      return load<V>(sums + (node * kCommonRows + row) * kLanes);
    };
    const auto vectorIn = [&](int node, int row) {
      return Vector::loadFrom(sums + (node * kCommonRows + row) * kLanes);
    };
    const auto shiftOf = [&](int node) { return Vector::loadFrom(shift + node * 3 * kLanes); };
    const auto turnOf = [&](int edge) { return shiftOf(edge + 1) - shiftOf(edge); };
    const auto basisOf = [&](int edge, Vector& p0, Vector& p1) {
      const Vector e = vectorIn(edge + 1, kCommonEdge);
      orthonormalBasis((real(1) / sqrt(squaredNorm(e) + real(1e-30))) * e, p0, p1);
    };
    const V zero{};
    Symmetric3<V> S{};
    Vector R0{}, R1{}, p{}, P0, P1;
    V Q00{}, Q01{}, Q11{}, q0{}, q1{};
    V bend_after = zero;
    Vector turn_after{};
    basisOf(n - 2, P0, P1);
    for (int i = n - 2;; --i) {
      const int node = i + 1;
      const V mass = in(node, kCommonMass), held = load<V>(hold + node * kLanes);
      const Vector own = mass * Vector{real(1), real(1), real(1)} + vectorIn(node, kCommonContact);
      S.xx = S.xx + own.x + held;
      S.yy = S.yy + own.y + held;
      S.zz = S.zz + own.z + held;
      const Vector shift_here = shiftOf(node);
      p = p + vectorIn(node, kCommonGradient) +
          Vector{own.x * shift_here.x, own.y * shift_here.y, own.z * shift_here.z} +
          Vector::loadFrom(pull + node * 3 * kLanes);
      // Joints by the turns that the larger group makes already.
      const V bend = in(node, kCommonBend), stiff = in(node, kCommonTurn);
      const Vector turn = turnOf(i), turn_before = i > 0 ? turnOf(i - 1) : Vector{};
      const Vector w = bend * (turn - turn_before) - bend_after * (turn_after - turn) + stiff * turn;

      const V diagonal = bend + bend_after + stiff;
      const Vector W0 = S * P0 + R0, W1 = S * P1 + R1;
      const V H00 = Q00 + diagonal + dot(P0, W0 + R0), H11 = Q11 + diagonal + dot(P1, W1 + R1);
      const V H01 = Q01 + dot(P1, R0) + dot(P0, W1);
      const V g0 = q0 + dot(P0, p + w), g1 = q1 + dot(P1, p + w);
      // Positive but for rounding, where a place has next to nothing: that does not turn.
      const V determinant = H00 * H11 - H01 * H01;
      const V inverse =
          select(determinant > real(kLeastPivot) * (H00 * H11), real(1) / determinant, zero);
      const V I00 = H11 * inverse, I01 = -H01 * inverse, I11 = H00 * inverse;
      const V k0 = I00 * g0 + I01 * g1, k1 = I01 * g0 + I11 * g1;
      const Vector X0 = I00 * W0 + I01 * W1, X1 = I01 * W0 + I11 * W1;
      Real* row = state.factor.data() + i * kFactor;
      store<V>(row, k0);
      store<V>(row + kWidth, k1);
      X0.template storeTo<kWidth>(row + 2 * kWidth);
      X1.template storeTo<kWidth>(row + 5 * kWidth);
      P0.template storeTo<kWidth>(row + 8 * kWidth);
      P1.template storeTo<kWidth>(row + 11 * kWidth);
      if (i == 0) break;

      Vector N0, N1;
      basisOf(i - 1, N0, N1);
      const V C00 = -bend * dot(P0, N0), C01 = -bend * dot(P0, N1);
      const V C10 = -bend * dot(P1, N0), C11 = -bend * dot(P1, N1);
      const V U00 = I00 * C00 + I01 * C10, U10 = I01 * C00 + I11 * C10;
      const V U01 = I00 * C01 + I01 * C11, U11 = I01 * C01 + I11 * C11;
      store<V>(row + 14 * kWidth, U00);
      store<V>(row + 15 * kWidth, U01);
      store<V>(row + 16 * kWidth, U10);
      store<V>(row + 17 * kWidth, U11);
      S.xx = S.xx - W0.x * X0.x - W1.x * X1.x;
      S.xy = S.xy - W0.x * X0.y - W1.x * X1.y;
      S.xz = S.xz - W0.x * X0.z - W1.x * X1.z;
      S.yy = S.yy - W0.y * X0.y - W1.y * X1.y;
      S.yz = S.yz - W0.y * X0.z - W1.y * X1.z;
      S.zz = S.zz - W0.z * X0.z - W1.z * X1.z;
      p = p - k0 * W0 - k1 * W1;
      R0 = (-U00) * W0 - U10 * W1;
      R1 = (-U01) * W0 - U11 * W1;
      Q00 = -(C00 * U00 + C10 * U10);
      Q01 = -(C00 * U01 + C10 * U11);
      Q11 = -(C01 * U01 + C11 * U11);
      q0 = -(C00 * k0 + C10 * k1);
      q1 = -(C01 * k0 + C11 * k1);
      bend_after = bend;
      turn_after = turn;
      P0 = N0;
      P1 = N1;
    }
    Vector way{};
    V u0{}, u1{};
    for (int i = 0; i < n - 1; ++i) {
      const Real* row = state.factor.data() + i * kFactor;
      const auto vectorAt = [&](int r) { return Vector::template loadFrom<kWidth>(row + r * kWidth); };
      V v0 = -load<V>(row) - dot(vectorAt(2), way), v1 = -load<V>(row + kWidth) - dot(vectorAt(5), way);
      if (i > 0) {
        v0 = v0 - load<V>(row + 14 * kWidth) * u0 - load<V>(row + 15 * kWidth) * u1;
        v1 = v1 - load<V>(row + 16 * kWidth) * u0 - load<V>(row + 17 * kWidth) * u1;
      }
      u0 = v0;
      u1 = v1;
      way = way + u0 * vectorAt(8) + u1 * vectorAt(11);
      (shiftOf(i + 1) + way).storeTo(shift + (i + 1) * 3 * kLanes);
    }
  }
};

}  // namespace calligraphy_brush
