#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/common_places.h"
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
///   contact, g < 0: ½ k g²/(1 + g/D), so that overlap stays short of the distance D of the axes
///   cohesion, g < a: −w (1 − g/a)², a bridge of liquid that lets go at the range a. Its pull is
///   strongest where the surfaces touch, 2 w/a, and stays so where they overlap
///
/// k: stiffness [N/m²], w: energy of cohesion [J/m].
double pairEnergy(double gap, double distance, double stiffness, double cohesion, double range);

/// Distance of the axes of two straight rods at rest, across the first, at equal lengths along both [m].
/// root: from the first one's to the second one's; along: of the first, from root to end; other: of the
/// second, as long as the first; part: of that length.
template <class V>
CALLIGRAPHY_INLINE V distanceAtRest(const Vec3<V>& root, const Vec3<V>& along, const Vec3<V>& other,
                                    V part) {
  const Vec3<V> between = root + part * (other - along);
  return sqrt(squaredNorm(between - (dot(between, along) / squaredNorm(along)) * along));
}

/// Stretches of rods of a batch along which they face rods of a batch, kLanes of them: each the nodes
/// after one level of the search up to the next.
///
/// A pair is a node of the first rod and the nearest point of the two edges that meet at a node of the
/// second, whose index is larger by `shift`. Lanes beyond the last stretch repeat the first one, without
/// any force.
template <class Real>
struct alignas(64) BundlePack {
  std::array<Real, kLanes> before{}, here{};      ///< part of the pull that pairs have at either level
  std::array<std::int32_t, kLanes> one{}, two{};  ///< lanes of the rods in their batches
  std::array<std::int32_t, kLanes> level{};       ///< at which the stretch ends
  std::array<std::int32_t, kLanes> shift{};
  std::array<Real, kLanes> ahead{};  ///< places from one on the first rod to that beside it

  // By BundlePull::fill:
  std::array<Real, kLanes> inverse_square{};              ///< of the second rod's edges [1/m²]
  std::array<Real, kLanes> place_one{}, place_two{};      ///< common place of the stretch's first node
  std::array<Real, kLanes> spacing_one{}, spacing_two{};  ///< of nodes, in common places
  std::array<Real, kLanes> to_end{};  ///< nodes from the second rod's first in the stretch to its end
  std::array<std::int32_t, kLanes> record_one{},
      record_two{};                             ///< of the first nodes, see BundleContact
  Real low = 0, high = 0, least = 0, most = 0;  ///< of place_one and spacing_one, over all lanes

  int count = 0;  ///< stretches
};

/// How the rods of a batch and of a later one, or of the same, act on each other.
template <class Real>
struct BundleTie {
  int a = 0, b = 0;
  int first_pack = 0, last_pack = 0;  ///< up to last_pack − 1
  std::vector<Real> stiffness;        ///< curvatures of the pairs, at common places [N/m], [place]
  std::vector<Real> turns;            ///< see BundleBatch, of these pairs
  Real most_relative = 0;  ///< way of a node relative to one that it faces, across it, squared [m²]
};

/// Where the search looks at the rods of a batch: at one of its levels, or at the end of those that end
/// not far before it.
template <class Real>
struct alignas(64) BundleSection {
  std::array<std::int32_t, kLanes> node{};       ///< before it; -1: the rod ends before
  std::array<Real, kLanes> part{};               ///< of the edge from there
  std::array<Real, kLanes> place{};              ///< common place
  std::array<Real, 3 * kLanes> point{}, edge{};  ///< [m], [3][lane]
  std::array<Real, kLanes> radius{}, bridge{};   ///< [m]
};

/// The rods of a batch as the others see them. Lanes without a rod have no radius, far from all others.
template <class Real>
struct BundleBatch {
  std::array<int, kLanes> rod{};     ///< −1: none
  AlignedVector<Real> present;       ///< 1 or 0, [lane]
  AlignedVector<Real> length;        ///< of an edge [m], [lane]
  AlignedVector<Real> radius, hold;  ///< [m]; inertia and bending that hold a node [N/m], [node][lane]
  AlignedVector<Real> rest, along;  ///< root at rest and the way to the end, handle frame [m], [3][lane]
  AlignedVector<Real> saturation;   ///< ink as a part of what there is room for, 0..1, [node][lane]
  AlignedVector<Real> cling;        ///< γ · cohesionEnergy · radius [J/m], [node][lane]
  AlignedVector<Real> bridge;       ///< a rod's part of the gap that liquid bridges [m], [node][lane]
  /// Square of the distance within which a rod has as many neighbours as are looked at, and some more
  /// [m²], [level][lane]
  AlignedVector<Real> crowd;
  std::vector<BundleSection<Real>> sections;  ///< [level]

  AlignedVector<Real>
      point;  ///< where the nodes are believed to be at the end of the step [m], [node][3][lane]
  AlignedVector<Real> way;      ///< from where they were when it began [m], [node][3][lane]
  AlignedVector<Real> springs;  ///< see NodeSprings, [node][4][lane]

  CommonPlaces<Real> places;
  /// Pairs between points at different places resist where these are shifted differently: curvatures,
  /// times the square of the difference, [place].
  std::vector<Real> turns;
  /// Where these are bent at a place, an edge from node to node misses the bend and a node does not:
  /// curvatures that resist bends, [place].
  std::vector<Real> kinks;
  std::vector<Real> anchors;    ///< curvatures of what crosses its rods, at common places [N/m], [place]
  AlignedVector<Real> scratch;  ///< of the mean way, see extrapolate(), [node][4 + 2][lane]
};

/// Cosine of the angle between edges from which they may cross unseen by nodes.
constexpr double kCrossingCosine = 0.8;
/// Rods that cross come from far off: they are looked for when two batches have moved by so many margins
/// relative to each other.
constexpr double kApartMargins = 3.0;
/// With them, those that have moved by this part of it.
constexpr double kSoonApart = 0.6;

/// Gap below which rods may soon touch, in margins and over the distance of their axes.
constexpr double kSoon = 0.5;

/// Two edges that cross, of rods as batch · kLanes + lane.
struct BundleCrossing {
  std::int32_t a, edge_a, b, edge_b;
};

/// Levels along the rods at which neighbours are looked for, at most.
constexpr std::size_t kMostLevels = 8;

/// Two rods that feel each other, as batch · kLanes + lane, the second the later one.
struct BundlePair {
  std::int32_t b;
  std::uint32_t seen;  ///< a bit for each level at which they are in each other's reach
  std::uint32_t near;  ///< and for those where they may touch, or have liquid between them
  std::uint32_t acts;  ///< and where they touch, or there is liquid between them
  std::array<float, kMostLevels> open;   ///< how far there is, at the levels, 0..1
  std::array<float, kMostLevels> shift;  ///< places from one on the first rod to that beside it
};

/// Neighbours of a rod that are looked at, at a level: more than can lie around it.
constexpr int kNearest = 16;

/// The nearest neighbours of rods at a level, and what is far off in empty places.
struct BundleNeighbours {
  AlignedVector<float> x, y, z;  ///< to them, across the rods [m], [rod][place]
  AlignedVector<float> square;   ///< of that [m²]
  std::vector<int> count;        ///< [rod]
  std::vector<float> reach;      ///< square of the distance of the last of kNearest [m²], [rod]
};

/// Contact and cohesion of the rods with one another.
///
/// A node of a rod is paired with what lies beside it of another: rods of different lengths end beside
/// each other's middles, and where they are bent inner ones get ahead of outer ones.
///
/// A pair at gap g has the energy of pairEnergy(), times the length of rod that the node stands for. Of
/// rods that overlap where they are straight at rest the distance at rest counts as touching: bundles
/// fill what room the ferrule leaves them. Liquid bridges neighbours between which nobody stands: the
/// edges of the Gabriel graph of the cross-section (Gabriel & Sokal 1969). w follows the ink of both
/// (cohesionEnergy), the surface tension and the radius; where more neighbours crowd around a rod than
/// wet it all round, they share. The range a grows with the square root of the ink, for so does the
/// width of a bridge of given cross-section.
///
/// Where rods cross at an angle too large for nodes to notice, the closest points of their edges take
/// over; of liquid between those there is too little to matter.
///
/// A step needs from it the gradient and a curvature by each node alone, as if the others kept the
/// place that is believed. The energy of the liquid is concave in the square of the gap, so
/// that (dE/dg)/g is a curvature that lies above it. The contact has the curvature of the overlap, as
/// soon as surfaces may meet within the step; a node of an edge takes its barycentric part of it, and
/// the two sides of a pair twice their part, as |a − b|² ≤ 2 |a|² + 2 |b|². Source: Hunter & Lange 2004,
/// A Tutorial on MM Algorithms.
template <class Real>
struct BundleContact {
  int rod_count = 0;
  int node_count = 0;
  double friction = 0.0;         ///< Coulomb coefficient
  double slip = 0.0;             ///< way in a step at which friction is fully there [m]
  double stiffness = 0.0;        ///< contact/bundle_stiffness
  double modulus = 0.0;          ///< contact/bundle_modulus [Pa]
  double cohesion_range = 0.0;   ///< contact/cohesion_range
  double surface_tension = 0.0;  ///< [N/m]
  double margin = 0.0;  ///< by which rods may be further apart than they reach, to be listed [m]

  std::vector<BundleBatch<Real>> batches;
  std::vector<BundlePack<Real>> packs;
  std::vector<BundleTie<Real>> ties;      ///< in the order of a, then b
  std::vector<std::vector<int>> ties_of;  ///< those whose second rods are in the batch, [batch]
  /// Ties for whom tasks may run at once: none of them have a batch in common.
  std::vector<std::vector<int>> phases;
  std::vector<BundleTie<Real>> spare_ties;  ///< memory of those that are gone

  /// What pairs read and write of nodes: records of four numbers, those of a rod one after another,
  /// [rod][node], from `nodes_before` before its root to as many after its end.
  int records = 0, nodes_before = 0;
  AlignedVector<Real> points, ways;  ///< as BundleBatch's [m], and 0
  AlignedVector<Real> pulls;         ///< gradient [N] and curvature [N/m] by all pairs of a node
  /// Of the pairs of packs: distance of the axes where surfaces touch [m], stiffness [N/m], range of the
  /// liquid [m], its strongest pull [N]. [pack][node of the stretch][4][lane]
  AlignedVector<Real> terms;

  /// What the search found: rods as batch · kLanes + lane, at one of `levels`.
  struct Hit {
    std::int32_t a, b;
    std::int32_t level;
    Real x, y, z;  ///< from a to b across a [m]
    Real gap;      ///< between their surfaces, or what is wet of them [m]
    Real shift;    ///< places from the level's on a to that beside it on b
    Real within;   ///< 1, falling to 0 where they are too far apart for neighbours
  };
  int stride = 1;  ///< nodes from a level to the next, and up to the first
  /// Places at which the search looks: the last, and every so many before it; of each rod these are
  /// nodes at which stretches end.
  std::vector<int> levels;
  std::vector<Hit> hits;
  std::vector<BundleCrossing> crossings;      ///< of rods that are no pair
  std::vector<BundleCrossing> all_crossings;  ///< of any
  /// By how much rods of a batch and of a later one may have moved relative to each other since it was
  /// looked for crossings of them [m], [a · batches + b].
  std::vector<double> moved_apart;
  std::vector<std::vector<BundlePair>> pairs;  ///< of rod a with those after it, [a]
  BundleNeighbours near;                       ///< scratch, as are those after it
  /// A stretch that is to come into a pack of two batches.
  struct Stretch {
    std::int32_t one, two, level, shift;
    float ahead, before, here;
  };
  std::vector<std::vector<Stretch>> acting, idle;  ///< of one batch with each, [batch]
  std::vector<std::vector<float>> neighbours;      ///< how many a rod has at a level, [level][rod]
  bool is_flowing = false;  ///< whether liquid is still coming between rods, or going

  bool empty() const { return packs.empty() && crossings.empty(); }
};

/// batches: the rods in the lanes of each, at most kLanes.
template <class Real>
BundleContact<Real> makeBundleContact(const BrushModel& brush, const ContactParameters& parameters,
                                      const std::vector<std::vector<int>>& batches);

/// Takes the ink of the rods, [rod · node count + node]. Returns whether it changed by what matters.
template <class Real>
bool takeInk(BundleContact<Real>& contact, const std::vector<double>& saturation);

/// Takes the crossings of rods that are no pair out of all.
template <class Real>
void takeCrossings(BundleContact<Real>& contact);

/// How far rods of two batches may move relative to each other [m].
struct WaysApart {
  double of_step;  ///< in a step, at most
  double largest;  ///< since it was looked for crossings of the two, at most
};
/// Adds what the believed ways of a step are to `moved_apart`.
template <class Real>
WaysApart noteWays(BundleContact<Real>& contact);

/// As if nothing had been found yet.
template <class Real>
void forgetPairs(BundleContact<Real>& contact);

/// Makes pairs and packs of what BundleSearch found, `elapsed` [s] after the last time.
template <class Real>
void takeHits(BundleContact<Real>& contact, double elapsed);

/// Which rods hang together, by pairs closer than half the range of the liquid, or touching if dry: a
/// label for each rod, equal for rods of one group, 0 .. groups − 1 in the order of the rods. Only pairs
/// on the last part of a rod count, from the node `first_node` on. Returns the number of groups.
template <class Real>
int findGroups(const BundleContact<Real>& contact, int first_node,
               const std::function<Eigen::Vector3d(int rod, int node)>& position,
               std::vector<int>& group_of_rod);

}  // namespace calligraphy_brush
