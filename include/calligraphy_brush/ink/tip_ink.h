#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/ink/ink_parameters.h"
#include "calligraphy_brush/paper/paper.h"

namespace calligraphy_brush {

/// The ink that the rods hold, node by node, and how it gets onto the sheet.
///
/// Node i of rod k is entry k · nodeCount() + i of every array. Volume is that of the liquid [m³].
/// Pigment is measured by the volume of undiluted ink that carries as much of it [m³]: a tip dipped
/// into undiluted ink holds equally much of both. Neither is ever made or lost: what the sheet gains, a
/// node loses.
class TipInk {
 public:
  TipInk(const BrushModel& brush, const InkParameters& parameters);

  /// Fills every rod from its tip upwards until it holds `load` of its capacity.
  void dip();
  /// Takes a part of the ink, 0..1, from the surface inwards: the outermost rods are wiped first.
  void wipe(double part = 1.0);
  /// A rod whose lowest node is higher than this leaves nothing [m].
  double reach(int rod) const { return rods_[static_cast<std::size_t>(rod)].reach; }

  /// Time goes on.
  void pass(std::int64_t nanoseconds) { now_ns_ += nanoseconds; }
  /// The rod is within reach of the sheet from now on.
  void touch(int rod, const std::vector<Eigen::Vector3d>& nodes);
  bool isDown(int rod) const { return rods_[static_cast<std::size_t>(rod)].is_down; }

  /// Exchanges ink between the sheet and what the rod's contact swept since the last call or touch().
  ///
  /// nodes: positions in the paper frame [m]; push: force of the sheet along z [N] on each.
  ///
  /// Chord: a bundle of radius r, its coat of ink included, whose middle is at height z over the
  /// sheet lies on it with half the width √(r² − z²). So an end that just touches leaves a point and a
  /// bundle that lies flat its whole breadth.
  /// Gap: by Greenwood and Williamson (Proc. R. Soc. A 295, 1966), for heights with an exponential tail,
  /// dry hair under a pressure p is σ ln(p₀ / p) over the mean plane of a relief of standard deviation
  /// σ; ink on it fills coat · S of that, S being the part of its room that is filled. So a wet bundle
  /// reaches everything, a dry one the peaks: kasure. Balance: with the same law of suction over filling
  /// in tip and sheet, the sheet's filling is S too.
  /// `picture`, if there is one, is drawn on alike, and the bundle does not feel it.
  void transfer(int rod, const std::vector<Eigen::Vector3d>& nodes, const std::vector<double>& push,
                Paper& paper, Paper* picture = nullptr);

  /// The rod is off the sheet: forgets where it last touched.
  void lift(int rod) { rods_[static_cast<std::size_t>(rod)].is_down = false; }

  int rodCount() const { return static_cast<int>(rods_.size()); }
  int nodeCount() const { return node_count_; }
  std::vector<double>& volume() { return volume_; }                  ///< liquid at each node [m³]
  const std::vector<double>& volume() const { return volume_; }      ///< liquid at each node [m³]
  std::vector<double>& pigment() { return pigment_; }                ///< pigment at each node [m³]
  const std::vector<double>& pigment() const { return pigment_; }    ///< pigment at each node [m³]
  const std::vector<double>& capacity() const { return capacity_; }  ///< room at each node [m³]

  double rodVolume(int rod) const { return sum(volume_, rod); }      ///< [m³]
  double rodCapacity(int rod) const { return sum(capacity_, rod); }  ///< [m³]
  double totalVolume() const;                                        ///< [m³]
  double totalPigment() const;                                       ///< [m³]
  double totalCapacity() const;                                      ///< [m³]

 private:
  struct Rod {
    double reach = 0.0;
    bool is_down = false;
    std::int64_t since_ns = 0;           // when it was drawn
    std::vector<double> radius;          // at the nodes
    std::vector<Eigen::Vector3d> nodes;  // where it was drawn
    double edge_length = 0.0;
    std::array<float, TouchingPiece::kUnderside> underside;
  };

  /// Half of the chord in which a bundle touches [m].
  static double chord(double radius, double height);
  void transferAtNode(int rod, int node, const std::vector<Eigen::Vector3d>& nodes, double push,
                      Paper& paper, Paper* picture);

  std::size_t at(int rod, int node) const { return static_cast<std::size_t>(rod * node_count_ + node); }
  double sum(const std::vector<double>& field, int rod) const;

  InkParameters parameters_;
  int node_count_;
  std::vector<Rod> rods_;
  std::vector<int> from_surface_;  // rods, outermost first
  std::vector<double> capacity_, volume_, pigment_;
  std::int64_t now_ns_ = 0;
};

}  // namespace calligraphy_brush
