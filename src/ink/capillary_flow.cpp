#include "calligraphy_brush/ink/capillary_flow.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

/// Permeability across hairs over that along them.
constexpr double kAcross = 0.5;
/// Differences of filling that are left alone: far below what a picture can show.
constexpr double kBalanced = 1e-5;
/// Gap of surfaces at rest, over the sum of radii, up to which rods count as touching.
constexpr double kTouching = 0.1;

/// Solves the tridiagonal system with −below, diagonal, −above; the result is left in `right`.
void solveTridiagonal(const std::vector<double>& below, const std::vector<double>& diagonal,
                      const std::vector<double>& above, std::vector<double>& forward,
                      std::vector<double>& right) {
  const std::size_t n = diagonal.size();
  double pivot = diagonal[0];
  right[0] /= pivot;
  for (std::size_t i = 1; i < n; ++i) {
    forward[i] = -above[i - 1] / pivot;
    pivot = diagonal[i] + below[i] * forward[i];
    right[i] = (right[i] + below[i] * right[i - 1]) / pivot;
  }
  for (std::size_t i = n - 1; i-- > 0;) right[i] -= forward[i + 1] * right[i + 1];
}

}  // namespace

CapillaryFlow::CapillaryFlow(const BrushModel& brush, const InkParameters& parameters)
    : node_count_(brush.rods.front().nodeCount()) {
  const TipInk ink(brush, parameters);
  const auto n = static_cast<std::size_t>(node_count_);
  const double spreading = parameters.spreading;
  struct Place {
    Eigen::Vector3d x;
    double radius, room_per_length, length;
    std::size_t rod;
  };
  std::vector<Place> places;
  for (std::size_t rod = 0; rod < brush.rods.size(); ++rod) {
    const RodModel& model = brush.rods[rod];
    const double edge = model.length / static_cast<double>(n - 1);
    for (std::size_t node = 0; node < n; ++node) {
      const double length = node == 0 || node + 1 == n ? 0.5 * edge : edge;
      const double room = ink.capacity()[rod * n + node];
      places.push_back({model.root_H + edge * static_cast<double>(node) * model.direction_H,
                        model.node_radius[node], room / length, length, rod});
      if (node > 0) {
        const std::size_t at = rod * n + node;
        // Conductances in series: half an edge of each node's.
        const double before = places[at - 1].room_per_length, here = places[at].room_per_length;
        const double mean = before > 0.0 && here > 0.0 ? 2.0 * before * here / (before + here) : 0.0;
        conductance_.push_back(spreading * mean / edge);
      }
    }
  }
  // Nodes that touch: sorted along x, so that each looks at a slab only.
  std::vector<std::size_t> order(places.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  double widest = 0.0, longest = 0.0;
  for (const Place& place : places) {
    widest = std::max(widest, place.radius);
    longest = std::max(longest, place.length);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return places[a].x.x() < places[b].x.x(); });
  const double slab = 2.0 * widest * (1.0 + kTouching);
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t j = i + 1; j < order.size(); ++j) {
      const Place &a = places[order[i]], &b = places[order[j]];
      if (b.x.x() - a.x.x() > slab) break;
      if (a.rod == b.rod) continue;
      const Eigen::Vector3d apart = b.x - a.x;
      const double across = apart.head<2>().norm(), sum = a.radius + b.radius;
      const double overlap = 1.0 - std::abs(apart.z()) / (0.5 * (a.length + b.length));
      if (across > sum * (1.0 + kTouching) || overlap <= 0.0 || !(across > 0.0)) continue;
      // Through a strip as wide as a radius, over the distance of the axes.
      const double room = std::min(a.room_per_length, b.room_per_length);
      const double width = 1.0 / std::max(3.14159265358979 * std::min(a.radius, b.radius), 1e-9);
      const double conductance =
          kAcross * spreading * room * width * overlap * std::min(a.length, b.length) / across;
      bridges_.push_back({order[i], order[j], conductance});
    }
  for (auto* field :
       {&filling_, &pull_, &forward_, &flux_, &concentration_, &below_, &diagonal_, &above_})
    field->resize(n);
}

void CapillaryFlow::flowAlong(double seconds, TipInk& ink) {
  for (int rod = 0; rod < ink.rodCount(); ++rod) flowInRod(rod, seconds, ink);
}

void CapillaryFlow::flowAcross(double seconds, TipInk& ink) const {
  for (const Bridge& bridge : bridges_) flowOver(bridge, seconds, ink);
}

void CapillaryFlow::flowInRod(int rod, double seconds, TipInk& ink) {
  const auto n = static_cast<std::size_t>(node_count_), first = static_cast<std::size_t>(rod) * n;
  double* volume = ink.volume().data() + first;
  double* pigment = ink.pigment().data() + first;
  const double* room = ink.capacity().data() + first;
  const double* conductance = conductance_.data() + static_cast<std::size_t>(rod) * (n - 1);
  double low = 1.0, high = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!(room[i] > 0.0)) return;
    filling_[i] = volume[i] / room[i];
    low = std::min(low, filling_[i]);
    high = std::max(high, filling_[i]);
  }
  if (high - low < kBalanced) return;

  // Backward Euler in the filling; how easily ink passes is taken from where it comes from, before.
  std::vector<double>& g = pull_;
  std::vector<double>&below = below_, &diagonal = diagonal_, &above = above_;
  std::fill(below.begin(), below.end(), 0.0);
  std::fill(above.begin(), above.end(), 0.0);
  for (std::size_t i = 0; i < n; ++i) diagonal[i] = room[i];
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double upstream = std::min(1.0, std::max(filling_[i], filling_[i + 1]));
    g[i] = seconds * conductance[i] * upstream * upstream * upstream;
    diagonal[i] += g[i];
    diagonal[i + 1] += g[i];
    above[i] = g[i];
    below[i + 1] = g[i];
  }
  for (std::size_t i = 0; i < n; ++i) filling_[i] = volume[i];
  solveTridiagonal(below, diagonal, above, forward_, filling_);
  for (std::size_t i = 0; i + 1 < n; ++i) flux_[i] = g[i] * (filling_[i] - filling_[i + 1]);

  // Pigment: concentrations after the step, carried by the same fluxes out of where they come from.
  std::fill(below.begin(), below.end(), 0.0);
  std::fill(above.begin(), above.end(), 0.0);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    volume[i] -= flux_[i];
    volume[i + 1] += flux_[i];
  }
  for (std::size_t i = 0; i < n; ++i) diagonal[i] = std::max(volume[i], 1e-30);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double forward = std::max(flux_[i], 0.0), back = std::max(-flux_[i], 0.0);
    diagonal[i] += forward;
    diagonal[i + 1] += back;
    below[i + 1] = forward;
    above[i] = back;
  }
  for (std::size_t i = 0; i < n; ++i) concentration_[i] = pigment[i];
  solveTridiagonal(below, diagonal, above, forward_, concentration_);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double moved = flux_[i] * (flux_[i] > 0.0 ? concentration_[i] : concentration_[i + 1]);
    pigment[i] -= moved;
    pigment[i + 1] += moved;
  }
}

void CapillaryFlow::flowOver(const Bridge& bridge, double seconds, TipInk& ink) {
  double &from = ink.volume()[bridge.a], &to = ink.volume()[bridge.b];
  const double room_a = ink.capacity()[bridge.a], room_b = ink.capacity()[bridge.b];
  if (!(room_a > 0.0 && room_b > 0.0)) return;
  const double filling_a = from / room_a, filling_b = to / room_b;
  if (std::abs(filling_a - filling_b) < kBalanced) return;
  const double upstream = std::min(1.0, std::max(filling_a, filling_b));
  const double g = seconds * bridge.conductance * upstream * upstream * upstream;
  // Backward Euler for two vessels.
  const double flux = g * (filling_a - filling_b) / (1.0 + g * (1.0 / room_a + 1.0 / room_b));
  double &pigment_a = ink.pigment()[bridge.a], &pigment_b = ink.pigment()[bridge.b];
  const double moved = flux > 0.0 ? pigment_a * (flux / from) : pigment_b * (flux / to);
  from -= flux;
  to += flux;
  pigment_a -= moved;
  pigment_b += moved;
}

}  // namespace calligraphy_brush
