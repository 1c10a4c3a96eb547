#include "calligraphy_brush/rods/wet_hair.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "calligraphy_brush/common/lane_vectors.h"
#include "calligraphy_brush/common/lanes.h"
#include "calligraphy_brush/rods/bending_law.h"
#include "calligraphy_brush/rods/joint_energy.h"

namespace calligraphy_brush {
namespace {

/// Registers that every processor has: no instruction set changes what is remembered.
template <class Real>
using Register = Lanes<Real, 16 / static_cast<int>(sizeof(Real))>;

/// Numbers of a joint in `dry`.
template <class Real>
int dryRows(const FramedRods<Real>* framed) {
  return framed ? 6 : 1;
}

std::size_t at(int row, int lane = 0) {
  return static_cast<std::size_t>(row * kLanes + lane);
}

/// The memory's part of a strain of that squared size, of no more than 1 rad.
template <class V>
CALLIGRAPHY_INLINE V takenOn(V memory, V squared) {
  const V one = broadcast<V>(1);
  return any(squared > one) ? memory / sqrt(max(squared, one)) : memory;
}

/// One joint's natural strain after a step; `off` becomes the largest distance that is left.
template <class V>
CALLIGRAPHY_INLINE void relaxStrain(V target, V part, V& off, RealOf<V>* strain) {
  const V before = load<V>(strain);
  const V way = target - before;
  store<V>(strain, before + part * way);
  off = max(off, select(part > V{}, max(way, -way), V{}));
}

template <class V>
void relaxPlain(V memory, V law, const RodBatchModel<RealOf<V>>& model,
                const RodBatchRoots<RealOf<V>>& roots, const RealOf<V>* director,
                const RodBatchState<RealOf<V>>& state, WetHair<RealOf<V>>& hair, int lane, V& off) {
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  const V one = broadcast<V>(1), two = broadcast<V>(2);
  const int n = model.node_count;
  const V length = load<V>(model.edge_length.data() + lane), inverse = one / length;
  Vector t = inverse * Vector::loadFrom(roots.clamp.data() + lane);
  Vector d1 = Vector::loadFrom(director + lane), d2 = cross(t, d1);
  Vector couple{};  // of the edge before
  for (int joint = 0; joint < n - 1; ++joint) {
    const Vector e = inverse * Vector::loadFrom(state.edge.data() + at(3 * joint, lane));
    // |E'| of bendingTerms is 2 f' |t × e|, in units of the joint's stiffness.
    const V bend = two * bendingTerms(squaredNorm(e - t), law).first;
    const Vector sigma = bend * cross(t, e);
    const V s1 = dot(sigma, d1), s2 = dot(sigma, d2);
    const V target = takenOn(memory, s1 * s1 + s2 * s2);
    Real* strain = hair.strain.data() + at(2 * joint, lane);
    const V part = load<V>(hair.part.data() + at(joint, lane));
    relaxStrain(target * s1, part, off, strain);
    relaxStrain(target * s2, part, off, strain + kLanes);

    const V stiffness = load<V>(model.spring.data() + at(joint, lane)) * length;  // B/(l̄ l)
    const V c1 = stiffness * load<V>(strain), c2 = stiffness * load<V>(strain + kLanes);
    if (joint > 0)
      (couple - cross(c1 * d1 + c2 * d2, t)).storeTo(hair.couple.data() + at(3 * (joint - 1), lane));

    // Carried on by the turn from t to e; where they fold, only made perpendicular.
    const V fold = max(one + dot(t, e), broadcast<V>(Real(1e-3)));
    d1 = d1 - (dot(d1, e) / fold) * (t + e);
    // Rounding adds up to nothing over the nodes of a rod, but a fold does.
    d1 = d1 - dot(d1, e) * e;
    if (any(fold <= broadcast<V>(Real(1e-3))))
      d1 = (one / sqrt(max(squaredNorm(d1), broadcast<V>(Real(1e-12))))) * d1;
    t = e;
    d2 = cross(t, d1);
    couple = cross(c1 * d1 + c2 * d2, t);
  }
  couple.storeTo(hair.couple.data() + at(3 * (n - 2), lane));

  Vector before{};
  for (int node = 0; node < n; ++node) {
    const Vector next =
        node < n - 1 ? Vector::loadFrom(hair.couple.data() + at(3 * node, lane)) : Vector{};
    const V inverse_mass = load<V>(hair.inverse_mass.data() + at(node, lane));
    (inverse_mass * (before - next)).storeTo(hair.push.data() + at(3 * node, lane));
    before = next;
  }
}

template <class V>
void relaxFramed(V memory, V law, FramedRods<RealOf<V>>& framed, WetHair<RealOf<V>>& hair, int lane,
                 V& off) {
  using Real = RealOf<V>;
  using Rotation = Quaternion<V>;
  const V round = broadcast<V>(1) - broadcast<V>(4) * law;
  Rotation before = Rotation::loadFrom(framed.clamp_frame.data() + lane);
  const int joints = static_cast<int>(hair.wet.size()) / kLanes;
  for (int joint = 0; joint < joints; ++joint) {
    const Rotation here = joint < joints - 1
                              ? Rotation::loadFrom(framed.frame.data() + at(4 * joint, lane))
                              : Rotation::loadFrom(framed.end_frame.data() + lane);
    const Rotation turn = before.conjugate() * here;
    const JointStrain<V> strain =
        jointStrain(select(turn.w < V{}, Rotation{-turn.w, -turn.x, -turn.y, -turn.z}, turn), round);
    const Real* rest = hair.dry.data() + at(6 * joint + 3, lane);
    const V off_rest[3] = {strain.bend1 - load<V>(rest), strain.bend2 - load<V>(rest + kLanes),
                           strain.twist - load<V>(rest + 2 * kLanes)};
    const V target = takenOn(
        memory, off_rest[0] * off_rest[0] + off_rest[1] * off_rest[1] + off_rest[2] * off_rest[2]);
    // Beyond a free end there is no joint.
    const V part = select(load<V>(hair.dry.data() + at(6 * joint, lane)) > V{},
                          load<V>(hair.part.data() + at(joint, lane)), V{});
    for (int k = 0; k < 3; ++k) {
      Real* kept = hair.strain.data() + at(3 * joint + k, lane);
      relaxStrain(target * off_rest[k], part, off, kept);
      store<V>(framed.joint.data() + at(6 * joint + 3 + k, lane),
               load<V>(rest + k * kLanes) + load<V>(kept));
    }
    before = here;
  }
}

}  // namespace

template <class Real>
WetHair<Real> makeWetHair(const RodBatchModel<Real>& model, const FramedRods<Real>* framed,
                          const RodParameters& parameters, double interval) {
  WetHair<Real> hair;
  hair.stiffness = parameters.wet_stiffness;
  hair.memory = parameters.wet_memory;
  hair.memory_time = parameters.wet_memory_time;
  hair.interval = interval;
  if (hair.stiffness == 1.0 && hair.memory == 0.0) return hair;
  const int n = model.node_count, joints = framed ? n : n - 1;
  hair.dry = framed ? framed->joint : model.spring;
  hair.wet.resize(at(joints));
  if (hair.memory == 0.0) return hair;
  hair.part.resize(at(joints));
  hair.strain.resize(at((framed ? 3 : 2) * joints));
  if (framed) return hair;
  hair.couple.resize(at(3 * (n - 1)));
  hair.push.resize(at(3 * n));
  for (const Real mass : model.mass) hair.inverse_mass.push_back(Real(1) / mass);
  return hair;
}

template <class Real>
bool soak(const std::vector<int>& rods, const std::vector<double>& saturation, WetHair<Real>& hair,
          RodBatchModel<Real>& model, FramedRods<Real>* framed) {
  if (hair.wet.empty()) return false;
  const int joints = static_cast<int>(hair.wet.size()) / kLanes, rows = dryRows(framed);
  bool changed = false;
  for (int lane = 0; lane < kLanes; ++lane) {
    const int rod = rods[std::min(static_cast<std::size_t>(lane), rods.size() - 1)];
    for (int joint = 0; joint < joints; ++joint) {
      const double part = saturation[static_cast<std::size_t>(rod * model.node_count + joint)];
      const auto wet =
          static_cast<Real>(kSaturationStep * std::round(std::clamp(part, 0.0, 1.0) / kSaturationStep));
      Real& known = hair.wet[at(joint, lane)];
      if (wet == known) continue;
      known = wet;
      const double rate = hair.interval / hair.memory_time * double(wet);
      if (hair.memory > 0.0) hair.part[at(joint, lane)] = static_cast<Real>(rate / (1.0 + rate));
      changed = true;
      const auto softer = static_cast<Real>(1.0 - (1.0 - hair.stiffness) * double(wet));
      AlignedVector<Real>& out = framed ? framed->joint : model.spring;
      for (int row = 0; row < std::min(rows, 3); ++row)
        out[at(rows * joint + row, lane)] = softer * hair.dry[at(rows * joint + row, lane)];
    }
  }
  return changed;
}

template <class Real>
bool relax(double law, const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
           const Real* director, const RodBatchState<Real>& state, FramedRods<Real>* framed,
           WetHair<Real>& hair) {
  using V = Register<Real>;
  if (hair.strain.empty()) return false;
  const auto isZero = [](Real value) { return value == Real(0); };
  if (!hair.is_bent && std::all_of(hair.wet.begin(), hair.wet.end(), isZero)) return false;
  hair.is_bent = true;
  const V memory = broadcast<V>(static_cast<Real>(hair.memory));
  const V p = broadcast<V>(static_cast<Real>(law));
  V off{};
  for (int lane = 0; lane < kLanes; lane += widthOf<V>) {
    if (framed)
      relaxFramed<V>(memory, p, *framed, hair, lane, off);
    else
      relaxPlain<V>(memory, p, model, roots, director, state, hair, lane, off);
  }
  return any(off > broadcast<V>(static_cast<Real>(kStrainAtRest)));
}

template <class Real>
void forgetBends(FramedRods<Real>* framed, WetHair<Real>& hair) {
  if (!hair.is_bent) return;
  for (auto* field : {&hair.strain, &hair.couple, &hair.push})
    std::fill(field->begin(), field->end(), Real(0));
  if (framed)
    for (int row = 0; row < static_cast<int>(framed->joint.size()) / kLanes; ++row)
      if (row % 6 >= 3)
        std::copy_n(hair.dry.begin() + static_cast<std::ptrdiff_t>(at(row)), kLanes,
                    framed->joint.begin() + static_cast<std::ptrdiff_t>(at(row)));
  hair.is_bent = false;
}

template <class Real>
void turnBends(const Eigen::Matrix3d& turn, WetHair<Real>& hair) {
  for (auto* field : {&hair.couple, &hair.push})
    changeVectors(*field, [&](const Eigen::Vector3d& vector) { return turn * vector; });
}

template <class Real>
Eigen::Vector3d torqueOfCouples(const RodBatchState<Real>& state, const WetHair<Real>& hair, int lane) {
  const auto vector = [lane](const AlignedVector<Real>& field, int edge) {
    return Eigen::Vector3d(double(field[at(3 * edge, lane)]), double(field[at(3 * edge + 1, lane)]),
                           double(field[at(3 * edge + 2, lane)]));
  };
  Eigen::Vector3d sum(0, 0, 0);
  for (int edge = 0; edge < static_cast<int>(hair.couple.size()) / (3 * kLanes); ++edge)
    sum += vector(state.edge, edge).cross(vector(hair.couple, edge));
  return sum;
}

#define CALLIGRAPHY_INSTANTIATE(Real)                                                              \
  template WetHair<Real> makeWetHair(const RodBatchModel<Real>&, const FramedRods<Real>*,          \
                                     const RodParameters&, double);                                \
  template bool soak(const std::vector<int>&, const std::vector<double>&, WetHair<Real>&,          \
                     RodBatchModel<Real>&, FramedRods<Real>*);                                     \
  template bool relax(double, const RodBatchModel<Real>&, const RodBatchRoots<Real>&, const Real*, \
                      const RodBatchState<Real>&, FramedRods<Real>*, WetHair<Real>&);              \
  template void forgetBends(FramedRods<Real>*, WetHair<Real>&);                                    \
  template void turnBends(const Eigen::Matrix3d&, WetHair<Real>&);                                 \
  template Eigen::Vector3d torqueOfCouples(const RodBatchState<Real>&, const WetHair<Real>&, int);
CALLIGRAPHY_INSTANTIATE(float)
CALLIGRAPHY_INSTANTIATE(double)
#undef CALLIGRAPHY_INSTANTIATE

}  // namespace calligraphy_brush
