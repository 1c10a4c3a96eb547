#include "calligraphy_brush/sim/tip_shape.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace calligraphy_brush {

double endWidth(const BrushModel& brush, const Tuft& tuft) {
  constexpr double kEnd = 0.1;     // of the length
  constexpr int kDirections = 32;  // in half a turn: the widest is known to a thousandth
  constexpr double kPi = 3.14159265358979323846;
  double longest = 0.0;
  for (const RodModel& rod : brush.rods) longest = std::max(longest, rod.length);

  // Nodes in the end, the point where it begins, and the way from there to the rod's end.
  std::vector<Eigen::Vector3d> places;
  std::vector<double> radii;
  Eigen::Vector3d along(0.0, 0.0, 0.0);
  for (std::size_t k = 0; k < brush.rods.size(); ++k) {
    const RodModel& rod = brush.rods[k];
    const int last = rod.nodeCount() - 1;
    const double begin = (1.0 - kEnd) * longest / rod.length * last;  // in edges
    if (begin > last) continue;
    const int edge = std::min(static_cast<int>(begin), last - 1);
    const double part = begin - edge;
    const auto index = static_cast<int>(k);
    const Eigen::Vector3d a = tuft.nodePosition(index, edge), b = tuft.nodePosition(index, edge + 1);
    const auto radius = [&](int node) { return rod.node_radius[static_cast<std::size_t>(node)]; };
    places.push_back(a + part * (b - a));
    radii.push_back(radius(edge) + part * (radius(edge + 1) - radius(edge)));
    along += tuft.nodePosition(index, last) - places.back();
    for (int node = edge + 1; node <= last; ++node) {
      places.push_back(tuft.nodePosition(index, node));
      radii.push_back(radius(node));
    }
  }
  const Eigen::Vector3d axis =
      along.norm() > 0.0 ? Eigen::Vector3d(along.normalized()) : Eigen::Vector3d(0.0, 0.0, 1.0);
  const Eigen::Vector3d u = axis.unitOrthogonal(), v = axis.cross(u);
  double width = 0.0;
  for (int k = 0; k < kDirections; ++k) {
    const double angle = kPi * k / kDirections;
    const Eigen::Vector3d direction = std::cos(angle) * u + std::sin(angle) * v;
    double low = std::numeric_limits<double>::max(), high = -low;
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double x = direction.dot(places[i]);
      low = std::min(low, x - radii[i]);
      high = std::max(high, x + radii[i]);
    }
    width = std::max(width, high - low);
  }
  return width;
}

TipShape findTipShape(const BrushModel& brush, const Tuft& tuft) {
  constexpr double kGroupedPart = 0.3;
  std::vector<int> group_of_rod(brush.rods.size());
  return {tuft.groups(kGroupedPart, group_of_rod), endWidth(brush, tuft)};
}

}  // namespace calligraphy_brush
