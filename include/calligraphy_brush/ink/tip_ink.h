#pragma once

#include <Eigen/Core>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/ink/ink_parameters.h"
#include "calligraphy_brush/paper/paper.h"

namespace calligraphy_brush {

/// The ink that the rods hold, and how it gets onto the sheet.
///
/// Ink is never made or lost: what the sheet gains, the rod under it loses.
class TipInk {
 public:
  TipInk(const BrushModel& brush, const InkParameters& parameters);

  /// Fills every rod to `load` of its capacity.
  void dip();
  /// Empties every rod.
  void wipe();
  /// The rod is off the sheet: forgets where it last touched.
  void lift(int rod) { rods_[static_cast<std::size_t>(rod)].marks.clear(); }
  /// A rod whose lowest node is higher than this leaves nothing [m].
  double reach(int rod) const { return rods_[static_cast<std::size_t>(rod)].reach; }

  /// Leaves ink along what the rod's contact swept since the last call.
  ///
  /// nodes: the rod's node positions in the paper frame [m]. A bundle of radius r, its
  /// coat of ink included, whose centreline is at height z over the sheet lies on it with a chord of
  /// half width √(r² − z²), so an end that just touches leaves a point and a bundle that lies flat
  /// its whole breadth. Film and coat are film_thickness and coat times the part of its capacity
  /// that the rod still holds.
  void transfer(int rod, const std::vector<Eigen::Vector3d>& nodes, Paper& paper);

  double volume(int rod) const { return rods_[static_cast<std::size_t>(rod)].volume; }      ///< [m³]
  double capacity(int rod) const { return rods_[static_cast<std::size_t>(rod)].capacity; }  ///< [m³]
  double totalVolume() const;
  double totalCapacity() const;

 private:
  /// A place on a rod over the sheet.
  struct Mark {
    double x, y, half_width;
  };
  struct Rod {
    double volume = 0.0;
    double capacity = 0.0;
    double reach = 0.0;
    std::vector<double> radius;  // at the nodes
    std::vector<Mark> marks;     // where it was last drawn; empty: it did not touch
  };

  InkParameters parameters_;
  std::vector<Rod> rods_;
  std::vector<Mark> now_;  // scratch
};

}  // namespace calligraphy_brush
