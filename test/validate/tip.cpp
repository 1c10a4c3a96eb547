#include "tip.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "calligraphy_brush/files/svg.h"
#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/sim/simulator_parameters.h"
#include "single_rod.h"

namespace calligraphy_brush {
namespace validate {
namespace {

using Shape = std::vector<std::vector<Eigen::Vector3d>>;

/// Diameter of the disc of equal second moment, 2 √2 times the root mean square distance of the rods
/// from their middle across their direction, over cross-sections in the part from 0.9 on of the
/// tuft's length, or of that of each rod.
double endDiameter(const BrushModel& brush, const Shape& shape, bool of_each) {
  double longest = 0.0, squares = 0.0;
  for (const RodModel& rod : brush.rods) longest = std::max(longest, rod.length);
  int count = 0;
  const int sections = 11;
  for (int section = 0; section < sections; ++section) {
    const double part = 0.9 + 0.1 * section / (sections - 1);
    std::vector<Eigen::Vector3d> points;
    Eigen::Vector3d middle(0, 0, 0), along(0, 0, 0);
    for (std::size_t rod = 0; rod < shape.size(); ++rod) {
      const auto& nodes = shape[rod];
      const double edges = static_cast<double>(nodes.size() - 1);
      const double place = part * (of_each ? 1.0 : longest / brush.rods[rod].length) * edges;
      if (place > edges * (1.0 + 1e-12)) continue;
      const std::size_t edge = std::min(static_cast<std::size_t>(place), nodes.size() - 2);
      const Eigen::Vector3d tangent = nodes[edge + 1] - nodes[edge];
      points.push_back(nodes[edge] + (place - static_cast<double>(edge)) * tangent);
      middle += points.back();
      along += tangent.normalized();
    }
    if (points.empty()) continue;
    middle /= static_cast<double>(points.size());
    if (along.norm() > 0.0) along.normalize();
    for (const Eigen::Vector3d& point : points) {
      const Eigen::Vector3d off = point - middle;
      squares += (off - off.dot(along) * along).squaredNorm();
      ++count;
    }
  }
  return count > 0 ? 2.0 * std::sqrt(2.0 * squares / count) : 0.0;
}

/// The tip as seen along x, its rods drawn thinner than they are, and the sheet where the tip lies on
/// it; in millimetres.
void drawTip(const std::string& path, const BrushModel& brush, const Shape& shape, bool on_sheet) {
  constexpr double kThin = 0.3;
  double top = 0.0, bottom = on_sheet ? 0.0 : 1e9, half = 0.0;
  for (const auto& nodes : shape)
    for (const Eigen::Vector3d& node : nodes) {
      top = std::max(top, node.z());
      bottom = std::min(bottom, node.z());
      half = std::max(half, std::abs(node.y()));
    }
  const double margin = 1e-3, width = 2.0 * (half + margin), height = top - bottom + 2.0 * margin;
  const auto at = [&](double y, double z) {
    return OutlinePoint{1e3 * (y + 0.5 * width), 1e3 * (top + margin - z)};
  };
  std::vector<std::pair<std::string, std::vector<Outline>>> shapes;
  for (std::size_t rod = 0; rod < shape.size(); ++rod) {
    const auto& nodes = shape[rod];
    // Down along one side of it and up along the other.
    Outline outline;
    for (const double side : {1.0, -1.0})
      for (std::size_t k = 0; k < nodes.size(); ++k) {
        const std::size_t node = side > 0.0 ? k : nodes.size() - 1 - k;
        const Eigen::Vector3d along =
            nodes[std::min(node + 1, nodes.size() - 1)] - nodes[node > 0 ? node - 1 : 0];
        const double size = std::hypot(along.y(), along.z());
        const double off = size > 0.0 ? side * kThin * brush.rods[rod].node_radius[node] / size : 0.0;
        outline.push_back(at(nodes[node].y() - off * along.z(), nodes[node].z() + off * along.y()));
      }
    shapes.emplace_back("rod_" + std::to_string(rod), std::vector<Outline>{outline});
  }
  if (on_sheet)
    shapes.emplace_back(
        "sheet", std::vector<Outline>{{at(-0.5 * width, 0), at(0.5 * width, 0), at(0.5 * width, -1e-4),
                                       at(-0.5 * width, -1e-4)}});
  const auto whole = [](double metres) { return static_cast<int>(std::ceil(1e3 * metres)); };
  writeSvg(path, whole(width), whole(height), 1.0, shapes);
}

}  // namespace

TipShapeResult tipShape(const TipShapeParameters& p) {
  SimulatorParameters simulator;
  loadYamlParameters(findPreset("brushes", p.brush), simulator);
  if (p.rods > 0) simulator.brush.rod_count = p.rods;
  simulator.brush.node_count = p.nodes;
  simulator.rods.time_step = p.dt;
  simulator.rods.scheme = p.scheme;
  simulator.rods.precision = p.precision;
  simulator.contact.bundles = true;
  simulator.contact.coupling_rounds = p.rounds;
  const BrushModel brush = makeBrush(simulator.brush);
  const auto tuft = makeTuft(brush, simulator.rods, simulator.contact);
  const int rod_count = static_cast<int>(brush.rods.size());

  TipShapeResult result;
  result.converged = true;
  const auto shape = [&] {
    Shape rods(brush.rods.size());
    for (int rod = 0; rod < rod_count; ++rod) tuft->readRod(rod, rods[static_cast<std::size_t>(rod)]);
    return rods;
  };
  const int steps = std::max(1, static_cast<int>(std::lround(p.duration / p.dt)));
  const auto run = [&](const std::function<Eigen::Isometry3d(double)>& pose) {
    for (int step = 1; step <= steps; ++step) {
      const TuftReport report = tuft->step(pose(static_cast<double>(step) / steps));
      result.iterations += report.iterations;
      result.converged = result.converged && report.unconverged == 0;
      result.coupling_error = report.coupling_error;
    }
  };
  const double high = brush.tip_length + (p.depth > 0.0 ? 2e-3 : 0.1);
  const auto at = [](double x, double z) { return handleAt({x, 0, z}, 0.0); };
  const auto still = [&](double) { return at(0, high); };

  tuft->place(at(0, high));
  result.rest_diameter = endDiameter(brush, shape(), false);
  result.rest_ends_diameter = endDiameter(brush, shape(), true);
  tuft->setInk(std::vector<double>(brush.rods.size() * static_cast<std::size_t>(p.nodes), p.ink));
  run(still);
  if (p.depth > 0.0) {
    const auto smooth = [](double s) { return s * s * (3.0 - 2.0 * s); };
    const double low = brush.tip_length - p.depth;
    run([&](double s) { return at(0, high + smooth(s) * (low - high)); });
    if (p.drag > 0.0) run([&](double s) { return at(smooth(s) * p.drag, low); });
    run([&](double) { return at(p.drag, low); });
  }
  const Shape last = shape();
  result.end_diameter = endDiameter(brush, last, false);
  result.ends_diameter = endDiameter(brush, last, true);
  if (!p.picture.empty()) drawTip(p.picture, brush, last, p.depth > 0.0);
  std::vector<int> label(brush.rods.size());
  result.groups = tuft->groups(0.25, label);
  result.group_sizes.assign(static_cast<std::size_t>(result.groups), 0);
  for (const int group : label) ++result.group_sizes[static_cast<std::size_t>(group)];
  std::sort(result.group_sizes.rbegin(), result.group_sizes.rend());
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
