#include "calligraphy_brush/rods/rod_batch.h"

#include <algorithm>

#include "calligraphy_brush/common/lane_vectors.h"

namespace calligraphy_brush {
namespace {

std::size_t size(int rows) {
  return static_cast<std::size_t>(rows) * kLanes;
}

/// Lanes beyond the last rod hold it once more.
const RodModel& rodInLane(const std::vector<RodModel>& rods, const std::vector<int>& indices, int lane) {
  const auto k = std::min(static_cast<std::size_t>(lane), indices.size() - 1);
  return rods[static_cast<std::size_t>(indices[k])];
}

/// Length that a joint stands for over that of an edge; joints from a clamp on: 0, 1, ...
double jointLength(int from_clamp, ClampRule clamp) {
  if (clamp == ClampRule::kHalf) return from_clamp == 0 ? 0.5 : 1.0;
  return from_clamp == 0 ? 5.0 / 12.0 : from_clamp == 1 ? 13.0 / 12.0 : 1.0;
}

}  // namespace

template <class Real>
RodBatchModel<Real> makeRodBatchModel(const std::vector<RodModel>& rods, const std::vector<int>& indices,
                                      ClampRule clamp) {
  RodBatchModel<Real> model;
  const int n = rodInLane(rods, indices, 0).nodeCount();
  model.node_count = n;
  model.rod_count = static_cast<int>(indices.size());
  model.edge_length.resize(size(1));
  model.spring.resize(size(n - 1));
  model.mass.resize(size(n));
  model.stiffness.resize(size(n));
  for (int lane = 0; lane < kLanes; ++lane) {
    const RodModel& rod = rodInLane(rods, indices, lane);
    const auto at = [lane](int node) { return static_cast<std::size_t>(node * kLanes + lane); };
    const double l = rod.length / (n - 1);
    model.edge_length[at(0)] = static_cast<Real>(l);
    for (int node = 0; node < n; ++node) {
      const auto i = static_cast<std::size_t>(node);
      const auto joint = static_cast<std::size_t>(std::min(node, n - 2));
      const double voronoi = l * jointLength(node, clamp);
      if (node < n - 1)
        model.spring[at(node)] = static_cast<Real>(rod.bending_stiffness[i] / (voronoi * l * l));
      model.mass[at(node)] = static_cast<Real>(rod.node_mass[i]);
      model.stiffness[at(node)] = static_cast<Real>(rod.bending_stiffness[joint] / (l * l * l));
    }
  }
  return model;
}

template <class Real>
RodBatchState<Real> makeRodBatchState(const RodBatchModel<Real>& model) {
  const int n = model.node_count;
  RodBatchState<Real> state;
  state.edge.resize(size(3 * (n - 1)));
  for (auto* field : {&state.position, &state.displacement, &state.velocity, &state.previous_velocity})
    field->resize(size(3 * n));
  state.lowest.resize(size(1));
  return state;
}

template <class Real>
RodBatchRoots<Real> makeRodBatchRoots() {
  RodBatchRoots<Real> roots;
  for (auto* field : {&roots.position, &roots.displacement, &roots.clamp}) field->resize(size(3));
  return roots;
}

template <class Real>
RodBatchWorkspace<Real> makeRodBatchWorkspace(int node_count) {
  RodBatchWorkspace<Real> workspace;
  workspace.target.resize(size(3 * node_count));
  workspace.gradient.resize(size(3 * node_count));
  workspace.trial_edge.resize(size(3 * node_count));
  workspace.next_edge.resize(size(3 * node_count));
  workspace.factor.resize(size(kRodFactorRows * node_count));
  return workspace;
}

template <class Real>
FramedRods<Real> makeFramedRods(const std::vector<RodModel>& rods, const std::vector<int>& indices,
                                ClampRule clamp) {
  FramedRods<Real> framed;
  const int n = rodInLane(rods, indices, 0).nodeCount();
  framed.joint.resize(size(6 * n));
  framed.frame.resize(size(4 * (n - 1)));
  framed.trial_frame.resize(size(4 * (n - 1)));
  framed.next_frame.resize(size(4 * (n - 1)));
  framed.clamp_frame.resize(size(4));
  framed.end_frame.resize(size(4));
  framed.end_position.resize(size(3));
  framed.tether_stiffness.resize(size(1));
  framed.tether_multiplier.resize(size(3));
  framed.factor.resize(size(27 * (n - 1)));
  for (int lane = 0; lane < kLanes; ++lane) {
    const RodModel& rod = rodInLane(rods, indices, lane);
    const double l = rod.length / (n - 1);
    for (int node = 0; node < n; ++node) {
      const bool is_end = node == n - 1;
      if (is_end && !rod.end_clamped) break;
      const auto i = static_cast<std::size_t>(is_end ? n - 2 : node);
      double voronoi = l * jointLength(node, clamp);
      if (rod.end_clamped) voronoi *= jointLength(n - 1 - node, clamp);
      const double bending = rod.bending_stiffness[i];
      const double second = rod.bending_stiffness_2.empty() ? bending : rod.bending_stiffness_2[i];
      // Free twist still needs one shape: a little stiffness makes it the untwisted one.
      const double twisting =
          rod.twisting_stiffness.empty() ? 1e-3 * bending : rod.twisting_stiffness[i];
      const Eigen::Vector3d rest = rod.natural_strain.empty()
                                       ? Eigen::Vector3d(0, 0, 0)
                                       : Eigen::Vector3d(rod.natural_strain[i] * voronoi);
      const double values[6] = {bending / voronoi, second / voronoi, twisting / voronoi,
                                rest[0],           rest[1],          rest[2]};
      for (int k = 0; k < 6; ++k)
        framed.joint[size(6 * node + k) + static_cast<std::size_t>(lane)] = static_cast<Real>(values[k]);
    }
    if (rod.end_clamped)
      framed.tether_stiffness[static_cast<std::size_t>(lane)] =
          static_cast<Real>(100.0 * rod.bending_stiffness.back() / (l * l * l));
  }
  return framed;
}

namespace {

template <class Real>
void findLowest(const RodBatchModel<Real>& model, RodBatchState<Real>& state) {
  for (std::size_t lane = 0; lane < size(1); ++lane) {
    state.lowest[lane] = state.position[size(2) + lane];
    for (int node = 1; node < model.node_count; ++node)
      state.lowest[lane] = std::min(state.lowest[lane], state.position[size(3 * node + 2) + lane]);
  }
}

/// Turns the quaternions of a field [..][4][lane].
template <class Real>
void turnFrames(const Eigen::Quaterniond& turn, AlignedVector<Real>& field) {
  for (std::size_t row = 0; row < field.size(); row += size(4))
    for (std::size_t at = row; at < row + size(1); ++at) {
      const Eigen::Quaterniond turned =
          turn * Eigen::Quaterniond(double(field[at]), double(field[at + size(1)]),
                                    double(field[at + size(2)]), double(field[at + size(3)]));
      const double values[4] = {turned.w(), turned.x(), turned.y(), turned.z()};
      for (int i = 0; i < 4; ++i) field[at + size(i)] = static_cast<Real>(values[i]);
    }
}

}  // namespace

template <class Real>
void placeAtRest(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
                 RodBatchState<Real>& state, FramedRods<Real>* framed) {
  for (auto* field : {&state.displacement, &state.velocity, &state.previous_velocity})
    std::fill(field->begin(), field->end(), Real(0));
  for (std::size_t i = 0; i < size(3); ++i) {
    Real position = roots.position[i];
    state.position[i] = position;
    for (int edge = 0; edge < model.node_count - 1; ++edge) {
      state.edge[size(3 * edge) + i] = roots.clamp[i];
      position += roots.clamp[i];
      state.position[size(3 * (edge + 1)) + i] = position;
    }
  }
  findLowest(model, state);
  if (!framed) return;
  for (int edge = 0; edge < model.node_count - 1; ++edge)
    std::copy(framed->clamp_frame.begin(), framed->clamp_frame.end(),
              framed->frame.begin() + static_cast<std::ptrdiff_t>(size(4 * edge)));
  framed->end_frame = framed->clamp_frame;
  std::copy(state.position.end() - static_cast<std::ptrdiff_t>(size(3)), state.position.end(),
            framed->end_position.begin());
  std::fill(framed->tether_multiplier.begin(), framed->tether_multiplier.end(), Real(0));
}

template <class Real>
void carryShape(const Eigen::Isometry3d& motion, const RodBatchModel<Real>& model,
                const RodBatchRoots<Real>& roots, RodBatchState<Real>& state, FramedRods<Real>* framed) {
  for (auto* field : {&state.displacement, &state.velocity, &state.previous_velocity})
    std::fill(field->begin(), field->end(), Real(0));
  state.guess.clear();
  changeVectors(state.edge, [&](const Eigen::Vector3d& edge) { return motion.linear() * edge; });
  for (std::size_t i = 0; i < size(3); ++i) {
    Real position = roots.position[i];
    state.position[i] = position;
    for (int edge = 0; edge < model.node_count - 1; ++edge) {
      position += state.edge[size(3 * edge) + i];
      state.position[size(3 * (edge + 1)) + i] = position;
    }
  }
  findLowest(model, state);
  if (!framed) return;
  const Eigen::Quaterniond turn(motion.linear());
  turnFrames(turn, framed->frame);
  turnFrames(turn, framed->end_frame);
  changeVectors(framed->end_position, [&](const Eigen::Vector3d& end) { return motion * end; });
  std::fill(framed->tether_multiplier.begin(), framed->tether_multiplier.end(), Real(0));
}

#define CALLIGRAPHY_INSTANTIATE(Real)                                                                   \
  template RodBatchModel<Real> makeRodBatchModel(const std::vector<RodModel>&, const std::vector<int>&, \
                                                 ClampRule);                                            \
  template FramedRods<Real> makeFramedRods(const std::vector<RodModel>&, const std::vector<int>&,       \
                                           ClampRule);                                                  \
  template RodBatchState<Real> makeRodBatchState(const RodBatchModel<Real>&);                           \
  template RodBatchRoots<Real> makeRodBatchRoots();                                                     \
  template RodBatchWorkspace<Real> makeRodBatchWorkspace(int);                                          \
  template void placeAtRest(const RodBatchModel<Real>&, const RodBatchRoots<Real>&,                     \
                            RodBatchState<Real>&, FramedRods<Real>*);                                   \
  template void carryShape(const Eigen::Isometry3d&, const RodBatchModel<Real>&,                        \
                           const RodBatchRoots<Real>&, RodBatchState<Real>&, FramedRods<Real>*);
CALLIGRAPHY_INSTANTIATE(float)
CALLIGRAPHY_INSTANTIATE(double)
#undef CALLIGRAPHY_INSTANTIATE

}  // namespace calligraphy_brush
