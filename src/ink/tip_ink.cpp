#include "calligraphy_brush/ink/tip_ink.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

constexpr int kPiecesPerEdge = 4;
// Motions are drawn when they reach half a pixel, in pieces of half a pixel.
constexpr double kDrawnMotion = 0.5;

}  // namespace

TipInk::TipInk(const BrushModel& brush, const InkParameters& parameters) : parameters_(parameters) {
  checkParameters(parameters);
  for (const RodModel& model : brush.rods) {
    Rod rod;
    rod.capacity = model.ink_capacity;
    rod.radius = model.node_radius;
    rod.reach = *std::max_element(rod.radius.begin(), rod.radius.end()) + parameters.coat;
    rods_.push_back(std::move(rod));
  }
  dip();
}

void TipInk::dip() {
  for (Rod& rod : rods_) rod.volume = parameters_.load * rod.capacity;
}

void TipInk::wipe() {
  for (Rod& rod : rods_) rod.volume = 0.0;
}

void TipInk::transfer(int rod_index, const std::vector<Eigen::Vector3d>& nodes, Paper& paper) {
  Rod& rod = rods_[static_cast<std::size_t>(rod_index)];
  now_.clear();
  const double part = rod.capacity > 0.0 ? rod.volume / rod.capacity : 0.0;
  const double coat = parameters_.coat * part;
  bool touches = false;
  for (std::size_t node = 0; node < nodes.size() && !touches; ++node)
    touches = nodes[node].z() < rod.radius[node] + coat;
  if (!touches) {
    rod.marks.clear();
    return;
  }
  const int pieces = kPiecesPerEdge * static_cast<int>(nodes.size() - 1);
  for (int piece = 0; piece <= pieces; ++piece) {
    const auto node =
        static_cast<std::size_t>(std::min(piece / kPiecesPerEdge, static_cast<int>(nodes.size()) - 2));
    const double s = static_cast<double>(piece) / kPiecesPerEdge - static_cast<double>(node);
    const Eigen::Vector3d x = (1.0 - s) * nodes[node] + s * nodes[node + 1];
    const double radius = (1.0 - s) * rod.radius[node] + s * rod.radius[node + 1] + coat;
    const double height = std::max(0.0, x.z());
    now_.push_back({x.x(), x.y(), std::sqrt(std::max(0.0, radius * radius - height * height))});
  }

  int steps = 1;
  if (!rod.marks.empty()) {
    double motion = 0.0;
    for (std::size_t i = 0; i < now_.size(); ++i) {
      const Mark &a = rod.marks[i], &b = now_[i];
      if (a.half_width <= 0.0 && b.half_width <= 0.0) continue;
      motion =
          std::max(motion, std::hypot(b.x - a.x, b.y - a.y) + std::abs(b.half_width - a.half_width));
    }
    const double drawn_motion = kDrawnMotion * paper.pixelSize();
    if (motion < drawn_motion) return;
    steps = static_cast<int>(std::min(std::ceil(motion / drawn_motion), 1000.0));
  } else {
    rod.marks = now_;
  }

  const double thickness = parameters_.film_thickness * part;
  const auto between = [](const Mark& a, const Mark& b, double s) {
    return Mark{a.x + s * (b.x - a.x), a.y + s * (b.y - a.y),
                a.half_width + s * (b.half_width - a.half_width)};
  };
  for (int step = 1; step <= steps; ++step) {
    const double s = static_cast<double>(step) / steps;
    Mark a = between(rod.marks[0], now_[0], s);
    for (std::size_t i = 1; i < now_.size(); ++i) {
      const Mark b = between(rod.marks[i], now_[i], s);
      if (a.half_width > 0.0 || b.half_width > 0.0)
        rod.volume -= paper.deposit({a.x, a.y, a.half_width, b.x, b.y, b.half_width}, thickness);
      a = b;
    }
  }
  rod.volume = std::max(0.0, rod.volume);
  rod.marks.swap(now_);
}

double TipInk::totalVolume() const {
  double sum = 0.0;
  for (const Rod& rod : rods_) sum += rod.volume;
  return sum;
}

double TipInk::totalCapacity() const {
  double sum = 0.0;
  for (const Rod& rod : rods_) sum += rod.capacity;
  return sum;
}

}  // namespace calligraphy_brush
