#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/lanes.h"
#include "calligraphy_brush/contact/contact_parameters.h"

namespace calligraphy_brush {

/// Energy per length that two touching parallel cylinders of radius 1 gain by the liquid between them
/// at surface tension 1, when they hold the part `saturation` of what fits into their hull.
///
/// With menisci that leave the surfaces at the angle α from the line of centres, of radius
/// ρ = 1/cos α − 1, all wetted (Princen 1969):
///
///   liquid   A = 2 (tan α − α − ρ² (π/2 − α))        energy   w = 4 α − 2 ρ (π − 2 α)
///
/// From 0, at first as the cube root of the liquid, up to 2 (π − 2) where it fills the hull, whose
/// liquid is A = 4 − π. saturation is taken into 0..1. [1]
double cohesionEnergy(double saturation);

/// Energy of two rods per length by the gap g of their surfaces [J/m].
///
///   g < 0        the force is (k + 4 w/a²) g/(1 + g/D): overlap stays short of the distance D of the
///   axes 0 ≤ g < a    −w (1 − (g/a)²)²: a bridge of liquid, gone at the range a
///
/// k: stiffness [N/m²], w: energy of cohesion [J/m]. Curvature does not jump where surfaces meet.
double pairEnergy(double gap, double distance, double stiffness, double cohesion, double range);

/// Places on the rods that are near enough to feel each other: a node of one rod and an edge of
/// another, or two edges that cross. One a lane; arrays are as long as a multiple of kLanes, and
/// those beyond `count` have no stiffness and no energy.
template <class Real>
struct BundlePairs {
  int count = 0;
  AlignedVector<std::int32_t> a, b;  ///< the node, or first node of an edge: rod · node count + node
  AlignedVector<Real> distance;      ///< of the axes where the surfaces touch [m]
  AlignedVector<Real> range;         ///< gap at which the liquid lets go [m]
  AlignedVector<Real> stiffness;     ///< of the contact [N/m]
  AlignedVector<Real> well;          ///< curvature of the cohesion where they touch, 4 w l/range² [N/m]
  AlignedVector<Real> reach;         ///< how far beyond the edge's end the pair still counts, in edges
  AlignedVector<Real> force;         ///< gradient of the energy by the gap after pull() [N]
  AlignedVector<Real> gap;           ///< between the surfaces after pull() [m]
};

/// Pairs that act, as springs between their closest points: what BundlePull::multiply needs.
template <class Real>
struct BundleLinks {
  int count = 0;
  AlignedVector<std::int32_t> a, b;  ///< as in BundlePairs
  AlignedVector<Real> s, t;          ///< parts of the edges at which the points lie; s of crossing pairs
  AlignedVector<Real> x, y, z;       ///< direction of the line between them
  AlignedVector<Real> drag;          ///< stiffness in all directions, by friction [N/m]
  AlignedVector<Real> rest;          ///< what the stiffness along the line has more than that [N/m]
};

/// Cosine of the angle between edges from which they may cross unseen by nodes.
constexpr double kCrossingCosine = 0.94;
/// How far beyond a rod's end its last edge is felt, in edges.
constexpr double kReachBeyondEnd = 0.25;

template <class Real>
struct BundleBox {
  std::array<Real, 3> low{kFar, kFar, kFar}, high{-kFar, -kFar, -kFar};

  void include(const BundleBox& other) {
    for (std::size_t i = 0; i < 3; ++i) {
      low[i] = std::min(low[i], other.low[i]);
      high[i] = std::max(high[i], other.high[i]);
    }
  }
  void grow(Real by) {
    for (std::size_t i = 0; i < 3; ++i) {
      low[i] -= by;
      high[i] += by;
    }
  }

 private:
  static constexpr Real kFar = Real(1e9);
};

/// Directions no further than `angle` [rad] from an axis.
struct BundleCone {
  std::array<double, 3> axis{};
  double angle = 0.0;
};

/// Rods in groups of neighbours, and what BundleSearch knows of them: [cluster][node or edge].
template <class Real>
struct BundleClusters {
  int count = 0;
  std::vector<std::int32_t> first_node;  ///< rod · node count, or rod_count · node count: none. [lane]
  AlignedVector<Real> place;             ///< [m], [3][lane]
  AlignedVector<Real> radius;            ///< [m], [lane]
  AlignedVector<Real> reach;             ///< radius and what liquid bridges [m], [lane]
  std::vector<BundleBox<Real>> whole, nodes, edges;
  std::vector<BundleCone> cones;  ///< of the edges

  struct Hit {
    std::int32_t a, b;
    Real t;
    Real squared;  ///< distance [m²]
  };
  std::vector<Hit> beside, crossing;  ///< found

  // Scratch.
  std::vector<int> near, across, met, begin, next;
  std::vector<Hit> sorted;
};

/// Contact and cohesion of the rods with one another.
///
/// A pair at gap g has the energy of pairEnergy(), times the length of rod that it stands for, with w
/// from the ink of both (cohesionEnergy), the surface tension and the radius. Where many neighbours
/// crowd around a rod they share its perimeter: together they gain no more than its whole wet surface.
/// Rods that overlap where they are straight at rest count as touching there: bundles fill what room
/// the ferrule leaves them.
///
/// The energy is a sum over the nodes of one rod of their closest points on the other's edges: equal
/// forces in opposite directions through one line, so neither momentum is made. Where rods cross at
/// an angle too large for nodes to notice, the closest points of their edges take over.
///
/// A step needs from it the gradient and a curvature by each node alone, as if the others kept the
/// place that is believed. For g > 0 the energy is concave in g², so (dE/dg)/g is a curvature that
/// lies above it; a node of an edge takes its barycentric part of it, and the two sides of a pair
/// twice their part, as |a − b|² ≤ 2 |a|² + 2 |b|². Rounds of such steps never raise the energy.
/// Source: Hunter & Lange 2004, A Tutorial on MM Algorithms.
template <class Real>
struct BundleContact {
  int rod_count = 0;
  int node_count = 0;

  // Constant. Per node, [rod][node], unless said otherwise.
  AlignedVector<Real> radius;            ///< [m]
  AlignedVector<Real> voronoi;           ///< length of rod that the node stands for [m]
  AlignedVector<Real> hold;              ///< inertia and bending that hold it in its place [N/m]
  AlignedVector<Real> bridge;            ///< a rod's part of the gap that liquid bridges [m], [rod]
  std::vector<Eigen::Vector3d> root_H;   ///< of the straight rods at rest, [rod]
  std::vector<Eigen::Vector3d> along_H;  ///< to their ends, [rod]
  double friction = 0.0;                 ///< Coulomb coefficient
  double slip = 0.0;                     ///< way in a step at which friction is fully there [m]
  double stiffness = 0.0;                ///< contact/bundle_stiffness
  double modulus = 0.0;                  ///< contact/bundle_modulus [Pa]
  double cohesion_range = 0.0;           ///< contact/cohesion_range
  double surface_tension = 0.0;          ///< [N/m]

  /// What the other rods are believed to do in the step.
  AlignedVector<Real> point;  ///< at its end [m], quads
  AlignedVector<Real> way;    ///< [m], quads

  /// Ink as a part of what there is room for, 0..1.
  AlignedVector<Real> saturation;
  AlignedVector<Real> crowd;  ///< neighbours that touched when the pairs were found

  BundlePairs<Real> beside, crossing;
  BundleLinks<Real> beside_links, crossing_links;  ///< after pull()
  // Quads, see common/quads.h, of the nodes: [rod][node][4], and those of a rod more that is not there.
  /// Of the energy after pull() [N]; the fourth number is a curvature by this node alone that no
  /// direction exceeds [N/m].
  AlignedVector<Real> gradient;
  AlignedVector<Real> move;    ///< of BundlePull::multiply [m]
  AlignedVector<Real> answer;  ///< [N]

  double energy = 0.0;  ///< of all pairs after pull() [J]

  // Of the search.
  AlignedVector<Real> found_at;  ///< `point` when the pairs were found
  double margin = 0.0;           ///< relative motion for which they hold [m]
  std::int64_t search_count = 0;
  BundleClusters<Real> clusters;

  bool empty() const { return beside.count == 0 && crossing.count == 0; }
};

template <class Real>
BundleContact<Real> makeBundleContact(const BrushModel& brush, const ContactParameters& parameters);

/// How far nodes have moved relative to their neighbours since the pairs were found [m]: what the rods
/// of a cluster do each by itself, or a part of what clusters do by themselves.
template <class Real>
double motionSinceSearch(const BundleContact<Real>& contact);

/// Makes the pairs that BundleSearch found.
template <class Real>
void takePairs(BundleContact<Real>& contact);

/// Takes the ink in `saturation` into the pairs.
template <class Real>
void updateCohesion(BundleContact<Real>& contact);

/// Which rods hang together, by pairs closer than half the range of the liquid, or touching if dry: a
/// label for each rod, equal for rods of one group, 0 .. groups − 1 in the order of the rods. Only pairs
/// on the last part of a rod count, from the node `first_node` on. Returns the number of groups.
template <class Real>
int findGroups(const BundleContact<Real>& contact, int first_node, std::vector<int>& group_of_rod);

}  // namespace calligraphy_brush
