#include "calligraphy_brush/ink/tip_ink.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>

namespace calligraphy_brush {
namespace {

// Hair is at most this many standard deviations of the relief above its mean plane.
constexpr double kPi = 3.14159265358979323846;
constexpr double kHighestHair = 3.0;

/// Heights of the hairs across a bundle: a sum of steps as wide as the bundle, a fourth and a sixteenth
/// of it. Hairs keep them, so what they leave out are streaks along the stroke.
std::array<float, TouchingPiece::kUnderside> makeUnderside(std::size_t rod, double deviation) {
  std::mt19937_64 random(0x9E3779B9U + rod);
  std::array<double, TouchingPiece::kUnderside> height{};
  for (const std::size_t width : {16, 4, 1})
    for (std::size_t first = 0; first < height.size(); first += width) {
      // Uniform, of variance 1/3.
      const double step = 2.0 * (static_cast<double>(random() >> 11) / 9007199254740992.0) - 1.0;
      for (std::size_t i = first; i < first + width; ++i) height[i] += deviation * step;
    }
  std::array<float, TouchingPiece::kUnderside> rounded{};
  for (std::size_t i = 0; i < height.size(); ++i) rounded[i] = static_cast<float>(height[i]);
  return rounded;
}

/// Room for ink at each node: the rod's, by the volume of the bundle that a node stands for.
std::vector<double> splitCapacity(const RodModel& rod) {
  const std::size_t n = rod.node_mass.size();
  std::vector<double> part(n);
  double whole = 0.0;
  for (std::size_t node = 0; node < n; ++node) {
    const bool is_end = node == 0 || node + 1 == n;
    part[node] = rod.node_radius[node] * rod.node_radius[node] * (is_end ? 0.5 : 1.0);
    whole += part[node];
  }
  for (double& room : part)
    room = whole > 0.0 ? room / whole * rod.ink_capacity : rod.ink_capacity / static_cast<double>(n);
  return part;
}

}  // namespace

TipInk::TipInk(const BrushModel& brush, const InkParameters& parameters)
    : parameters_(parameters), node_count_(brush.rods.empty() ? 0 : brush.rods.front().nodeCount()) {
  checkParameters(parameters);
  for (const RodModel& model : brush.rods) {
    if (model.nodeCount() != node_count_)
      throw std::invalid_argument("all rods of a brush must have equally many nodes");
    Rod rod;
    rod.radius = model.node_radius;
    rod.edge_length = model.length / (node_count_ - 1);
    rod.nodes.resize(static_cast<std::size_t>(node_count_));
    rod.underside = makeUnderside(rods_.size(), parameters.hair_unevenness);
    rod.reach = *std::max_element(rod.radius.begin(), rod.radius.end()) + parameters.coat;
    rods_.push_back(std::move(rod));
    for (const double capacity : splitCapacity(model)) capacity_.push_back(capacity);
  }
  volume_.resize(capacity_.size());
  pigment_.resize(capacity_.size());
  from_surface_.resize(brush.rods.size());
  std::iota(from_surface_.begin(), from_surface_.end(), 0);
  std::stable_sort(from_surface_.begin(), from_surface_.end(), [&](int a, int b) {
    const auto outwards = [&](int rod) {
      return brush.rods[static_cast<std::size_t>(rod)].root_H.head<2>().squaredNorm();
    };
    return outwards(a) > outwards(b);
  });
  dip();
}

void TipInk::dip() {
  for (int rod = 0; rod < rodCount(); ++rod) {
    double rest = parameters_.load * rodCapacity(rod);
    for (int node = node_count_ - 1; node >= 0; --node) {
      const std::size_t i = at(rod, node);
      volume_[i] = std::min(rest, capacity_[i]);
      pigment_[i] = parameters_.concentration * volume_[i];
      rest -= volume_[i];
    }
  }
}

void TipInk::wipe(double part) {
  if (!(part >= 0.0 && part <= 1.0))
    throw std::invalid_argument("part = " + std::to_string(part) + " is outside [0, 1]");
  double rest = part * totalVolume();
  for (const int rod : from_surface_) {
    const double held = rodVolume(rod);
    const double kept = part == 1.0 || held <= rest ? 0.0 : 1.0 - rest / held;
    for (int node = 0; node < node_count_; ++node) {
      volume_[at(rod, node)] *= kept;
      pigment_[at(rod, node)] *= kept;
    }
    rest = std::max(0.0, rest - held);
  }
}

void TipInk::touch(int rod_index, const std::vector<Eigen::Vector3d>& nodes) {
  Rod& rod = rods_[static_cast<std::size_t>(rod_index)];
  rod.nodes = nodes;
  rod.since_ns = now_ns_;
  rod.is_down = true;
}

void TipInk::transfer(int rod_index, const std::vector<Eigen::Vector3d>& nodes,
                      const std::vector<double>& push, Paper& paper, Paper* picture) {
  Rod& rod = rods_[static_cast<std::size_t>(rod_index)];
  if (!rod.is_down) touch(rod_index, nodes);
  const auto last = static_cast<std::size_t>(node_count_ - 1);
  // Of a piece whose ends and middle are all too high nothing is near enough.
  bool near_before = false;
  bool near = std::min(nodes[0].z(), rod.nodes[0].z()) < rod.reach;
  for (std::size_t i = 0; i <= last; ++i) {
    const bool near_after = i < last && std::min(nodes[i + 1].z(), rod.nodes[i + 1].z()) < rod.reach;
    if (near_before || near || near_after)
      transferAtNode(rod_index, static_cast<int>(i), nodes, push[i], paper, picture);
    near_before = near;
    near = near_after;
  }
  rod.nodes = nodes;
  rod.since_ns = now_ns_;
}

double TipInk::chord(double radius, double height) {
  const double z = std::max(0.0, height);
  return std::sqrt(std::max(0.0, radius * radius - z * z));
}

void TipInk::transferAtNode(int rod_index, int node, const std::vector<Eigen::Vector3d>& nodes,
                            double push, Paper& paper, Paper* picture) {
  const Rod& rod = rods_[static_cast<std::size_t>(rod_index)];
  const std::size_t here = at(rod_index, node);
  const double part = capacity_[here] > 0.0 ? std::min(1.0, volume_[here] / capacity_[here]) : 0.0;
  if (part <= 0.0 && paper.wetTileCount() == 0 && (!picture || picture->wetTileCount() == 0)) return;
  const double coat = parameters_.coat * part;
  const auto i = static_cast<std::size_t>(node);

  // The piece of the rod that the node stands for: between the middles of its edges, cut to what is
  // within reach. Its way is that since it was last drawn.
  struct Place {
    Eigen::Vector3d now, before;
    double radius;
  };
  const auto between = [&](std::size_t k) {  // of nodes k and k + 1
    return Place{0.5 * (nodes[k] + nodes[k + 1]), 0.5 * (rod.nodes[k] + rod.nodes[k + 1]),
                 0.5 * (rod.radius[k] + rod.radius[k + 1]) + coat};
  };
  const Place own{nodes[i], rod.nodes[i], rod.radius[i] + coat};
  Place a = i > 0 ? between(i - 1) : own;
  Place b = i + 1 < nodes.size() ? between(i) : own;
  const auto heightOf = [](const Place& place) { return 0.5 * (place.now.z() + place.before.z()); };
  const auto isUp = [&](const Place& place) { return heightOf(place) >= place.radius; };
  const auto cut = [&](const Place& down, const Place& up) {
    const double gap_down = heightOf(down) - down.radius, gap_up = heightOf(up) - up.radius;
    const double s = gap_down / (gap_down - gap_up);
    return Place{down.now + s * (up.now - down.now), down.before + s * (up.before - down.before),
                 down.radius + s * (up.radius - down.radius)};
  };
  bool cut_a = false, cut_b = false;
  if (isUp(a) && isUp(b)) {
    if (isUp(own)) return;
    a = cut(own, a);
    b = cut(own, b);
    cut_a = i > 0;
    cut_b = i + 1 < nodes.size();
  } else if (isUp(a)) {
    a = cut(b, a);
    cut_a = i > 0;
  } else if (isUp(b)) {
    b = cut(a, b);
    cut_b = i + 1 < nodes.size();
  }

  TouchingPiece piece;
  // An upright end has no direction but that of its way.
  Eigen::Vector2d along = 0.5 * (b.now - a.now + b.before - a.before).head<2>();
  if (along.norm() < 0.5 * own.radius) along = 0.5 * (own.now - own.before).head<2>();
  along = along.norm() > 1e-9 ? Eigen::Vector2d(along.normalized()) : Eigen::Vector2d(1.0, 0.0);
  piece.along_x = along.x();
  piece.along_y = along.y();
  const auto makeEnd = [&](const Place& place, bool is_cut) {
    const Eigen::Vector2d middle = 0.5 * (place.now + place.before).head<2>();
    const Eigen::Vector2d way = 0.5 * (place.now - place.before).head<2>();
    // Where the bundle leaves the sheet the chord ends in a point; half of what its ellipse is on
    // average keeps its area.
    const double half = is_cut ? 0.5 * chord(own.radius, std::min(heightOf(own), 0.5 * own.radius))
                               : chord(place.radius, heightOf(place));
    return TouchingPiece::End{middle.x(), middle.y(), way.x(), way.y(), half};
  };
  piece.a = makeEnd(a, cut_a);
  piece.b = makeEnd(b, cut_b);
  piece.duration = 1e-9 * static_cast<double>(now_ns_ - rod.since_ns);

  const double area = 2.0 * own.radius * rod.edge_length;
  const double pressure = std::max(0.0, push) / std::max(area, 1e-12);
  const double scale = paper.parameters().asperity_pressure;
  const double separation = pressure * std::exp(kHighestHair) > scale
                                ? std::max(0.0, std::log(scale / pressure))
                                : kHighestHair;
  piece.gap = paper.roughness() * separation - coat;
  piece.filling = std::min(1.0, parameters_.suction_ratio * part);
  piece.film = parameters_.film_thickness * piece.filling;
  piece.concentration = volume_[here] > 0.0 ? pigment_[here] / volume_[here] : 0.0;
  piece.volume = volume_[here];
  piece.room = std::max(0.0, capacity_[here] - volume_[here]);
  piece.underside = rod.underside.data();

  if (picture) picture->exchange(piece);
  const InkExchange given = paper.exchange(piece);
  volume_[here] = std::max(0.0, volume_[here] - given.volume);
  pigment_[here] = std::max(0.0, pigment_[here] - given.pigment);
}

double TipInk::sum(const std::vector<double>& field, int rod) const {
  const auto first = field.begin() + static_cast<std::ptrdiff_t>(at(rod, 0));
  return std::accumulate(first, first + node_count_, 0.0);
}
double TipInk::totalVolume() const {
  return std::accumulate(volume_.begin(), volume_.end(), 0.0);
}
double TipInk::totalPigment() const {
  return std::accumulate(pigment_.begin(), pigment_.end(), 0.0);
}
double TipInk::totalCapacity() const {
  return std::accumulate(capacity_.begin(), capacity_.end(), 0.0);
}

}  // namespace calligraphy_brush
