#include "calligraphy_brush/rods/rod_batch.h"

#include <algorithm>

namespace calligraphy_brush {
namespace {

std::size_t size(int rows) { return static_cast<std::size_t>(rows) * kLanes; }

}  // namespace

template <class Real>
RodBatchModel<Real> makeRodBatchModel(const std::vector<RodModel>& rods, int first) {
  RodBatchModel<Real> model;
  const int last = static_cast<int>(rods.size()) - 1;
  const int n = rods[static_cast<std::size_t>(first)].nodeCount();
  model.node_count = n;
  model.rod_count = std::min(kLanes, last - first + 1);
  model.edge_length.resize(size(1));
  model.spring.resize(size(n - 1));
  model.mass.resize(size(n));
  model.stiffness.resize(size(n));
  for (int lane = 0; lane < kLanes; ++lane) {
    const RodModel& rod = rods[static_cast<std::size_t>(std::min(first + lane, last))];
    const auto at = [lane](int node) { return static_cast<std::size_t>(node * kLanes + lane); };
    const double l = rod.length / (n - 1);
    model.edge_length[at(0)] = static_cast<Real>(l);
    for (int node = 0; node < n; ++node) {
      const auto i = static_cast<std::size_t>(node);
      const auto joint = static_cast<std::size_t>(std::min(node, n - 2));
      // A joint at the clamp itself, with half a Voronoi length, makes the clamp second order in l;
      // a fixed first edge, the usual way, is first order: it clamps the rod at l/2.
      const double voronoi = node == 0 ? 0.5 * l : l;
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
  workspace.update.resize(size(2 * node_count));
  workspace.factor.resize(size(18 * node_count));
  return workspace;
}

template <class Real>
void placeAtRest(const RodBatchModel<Real>& model, const RodBatchRoots<Real>& roots,
                 RodBatchState<Real>& state) {
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
}

#define CALLIGRAPHY_INSTANTIATE(Real)                                                       \
  template RodBatchModel<Real> makeRodBatchModel(const std::vector<RodModel>&, int);        \
  template RodBatchState<Real> makeRodBatchState(const RodBatchModel<Real>&);               \
  template RodBatchRoots<Real> makeRodBatchRoots();                                         \
  template RodBatchWorkspace<Real> makeRodBatchWorkspace(int);                              \
  template void placeAtRest(const RodBatchModel<Real>&, const RodBatchRoots<Real>&,         \
                            RodBatchState<Real>&);
CALLIGRAPHY_INSTANTIATE(float)
CALLIGRAPHY_INSTANTIATE(double)
#undef CALLIGRAPHY_INSTANTIATE

}  // namespace calligraphy_brush
