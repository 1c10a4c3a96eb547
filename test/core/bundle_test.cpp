#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "calligraphy_brush/contact/bundle_contact.h"
#include "calligraphy_brush/contact/bundle_pull.h"
#include "calligraphy_brush/contact/bundle_search.h"
#include "calligraphy_brush/sim/tuft.h"

// Rods that touch, cling and cross.

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
using Pull = BundlePull<Lanes<double, 2>>;

void search(BundleContact<double>& contact) {
  BundleSearch<Lanes<double, 2>>::find(contact);
  takePairs(contact);
}

RodModel rodAt(const Eigen::Vector3d& root, const Eigen::Vector3d& direction, double length, int nodes,
               double radius) {
  RodModel rod = makeUniformRod(length, 1.8e-7, 1.96e-4, nodes);
  rod.root_H = root;
  rod.direction_H = direction.normalized();
  rod.node_radius.assign(static_cast<std::size_t>(nodes), radius);
  return rod;
}

ContactParameters touching() {
  ContactParameters contact;
  contact.bundles = true;
  contact.paper = false;
  return contact;
}

/// Puts the straight rods of a brush, each shifted by shift(rod), into a contact.
template <class Shift>
void putStraight(const BrushModel& brush, BundleContact<double>& contact, Shift&& shift) {
  const int n = contact.node_count;
  for (int rod = 0; rod < contact.rod_count; ++rod)
    for (int node = 0; node < n; ++node) {
      const RodModel& model = brush.rods[static_cast<std::size_t>(rod)];
      const Eigen::Vector3d x =
          model.root_H + model.length * node / (n - 1) * model.direction_H + shift(rod);
      for (int i = 0; i < 3; ++i)
        contact.point[static_cast<std::size_t>(4 * (rod * n + node) + i)] = x[i];
    }
}

TEST(CohesionEnergy, RisesWithTheInkUpToTheHullOfBoth) {
  EXPECT_EQ(cohesionEnergy(0.0), 0.0);
  EXPECT_EQ(cohesionEnergy(-1.0), 0.0);
  EXPECT_NEAR(cohesionEnergy(1.0), 2.0 * (kPi - 2.0), 1e-12);
  EXPECT_EQ(cohesionEnergy(7.0), cohesionEnergy(1.0));
  double before = 0.0;
  for (double ink = 0.001; ink <= 1.0; ink += 0.001) {
    EXPECT_GT(cohesionEnergy(ink), before) << ink;
    before = cohesionEnergy(ink);
  }
  // Little liquid A fills wedges of angle α: A = 2 α³/3, w = 4 α.
  const double ink = 1e-9, alpha = std::cbrt(1.5 * ink * (4.0 - kPi));
  EXPECT_NEAR(cohesionEnergy(ink) / (4.0 * alpha), 1.0, 2e-3);
}

TEST(CohesionEnergy, FallsByThePressureOfTheMeniscusOverTheLiquidThatLeaves) {
  // At fixed places dw/dA is the pressure γ/ρ, ρ the radius of the meniscus (Young and Laplace).
  for (const double alpha : {0.2, 0.6, 1.0, 1.3}) {
    const auto liquid = [](double a) {
      const double r = 1.0 / std::cos(a) - 1.0;
      return 2.0 * (std::tan(a) - a - r * r * (0.5 * kPi - a));
    };
    const double ink = liquid(alpha) / (4.0 - kPi), step = 1e-5;
    const double slope =
        (cohesionEnergy(ink + step) - cohesionEnergy(ink - step)) / (2.0 * step * (4.0 - kPi));
    EXPECT_NEAR(slope * (1.0 / std::cos(alpha) - 1.0), 1.0, 1e-4) << alpha;
  }
}

TEST(BundlePull, ForceIsTheDerivativeOfTheEnergyOverDecadesOfGaps) {
  const double radius = 3e-4, length = 0.03, range = 0.5;
  for (const double gap : {-2e-4, -1e-5, -1e-7, 1e-7, 1e-5, 1e-4, 2.5e-4}) {
    BrushModel brush;
    brush.rods = {rodAt({0, 0, 0}, {0, 0, -1}, length, 4, radius),
                  rodAt({1e-3, 0, 0}, {0, 0, -1}, length, 4, radius)};
    ContactParameters parameters = touching();
    parameters.cohesion_range = range;
    BundleContact<double> contact = makeBundleContact<double>(brush, parameters);
    contact.hold.assign(contact.hold.size(), 5.0);
    contact.saturation.assign(contact.saturation.size(), 0.4);
    putStraight(brush, contact, [&](int rod) {
      return Eigen::Vector3d(rod == 0 ? 0.0 : 2.0 * radius + gap - 1e-3, 0, 0);
    });
    search(contact);
    ASSERT_EQ(contact.beside.count, 3) << gap;  // all nodes but the root
    Pull::pull(contact);
    const double step = std::max(1e-9, 1e-4 * std::abs(gap));
    const double w = parameters.surface_tension * cohesionEnergy(0.4) * radius;
    const auto energy = [&](double g) {
      const double voronoi = length / 3;
      return pairEnergy(g, 2.0 * radius, 5.0 * parameters.bundle_stiffness / voronoi, w,
                        range * 2.0 * radius) *
             voronoi;
    };
    const double slope = (energy(gap + step) - energy(gap - step)) / (2.0 * step);
    // The table of the law is good to a thousandth.
    EXPECT_NEAR(contact.beside.force[0] / slope, 1.0, 2e-3) << gap;
    EXPECT_NEAR(contact.beside.gap[0], gap, 1e-12);
  }
}

TEST(BundlePull, PairsMakeNoMomentum) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  BrushModel brush;
  for (int rod = 0; rod < 40; ++rod)
    brush.rods.push_back(rodAt({3e-3 * number(random), 3e-3 * number(random), 0},
                               {0.2 * number(random), 0.2 * number(random), -1}, 0.03, 12, 4e-4));
  BundleContact<double> contact = makeBundleContact<double>(brush, touching());
  contact.hold.assign(contact.hold.size(), 3.0);
  contact.saturation.assign(contact.saturation.size(), 0.5);
  contact.slip = 1e-6;
  putStraight(brush, contact, [](int) { return Eigen::Vector3d::Zero(); });
  for (std::size_t i = 0; i < contact.way.size(); ++i)
    if (i % 4 != 3) {
      contact.way[i] = 1e-4 * number(random);
      contact.point[i] += contact.way[i];
    }
  search(contact);
  Pull::pull(contact);
  ASSERT_GT(contact.beside.count, 100);
  ASSERT_GT(contact.crossing.count, 10);
  Eigen::Vector3d force(0, 0, 0), torque(0, 0, 0);
  double size = 0.0;
  for (int node = 0; node < 40 * 12; ++node) {
    const auto at = static_cast<std::size_t>(node);
    const Eigen::Vector3d g(contact.gradient[4 * at], contact.gradient[4 * at + 1],
                            contact.gradient[4 * at + 2]);
    const Eigen::Vector3d x(contact.point[4 * at], contact.point[4 * at + 1], contact.point[4 * at + 2]);
    force += g;
    torque += x.cross(g);
    size += g.norm();
  }
  EXPECT_LT(force.norm(), 1e-12 * size);
  // Friction acts on the axes, not on the surfaces: it may turn a pair by its distance.
  EXPECT_LT(torque.norm(), 1e-3 * size);
}

TEST(BundlePairs, TheSearchFindsAllThatTouch) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  BrushModel brush;
  const int n = 10;
  for (int rod = 0; rod < 60; ++rod)
    brush.rods.push_back(rodAt({6e-3 * number(random), 6e-3 * number(random), 0},
                               {0.1 * number(random), 0.1 * number(random), -1},
                               0.03 + 0.005 * number(random), n, 3e-4));
  BundleContact<double> contact = makeBundleContact<double>(brush, touching());
  contact.hold.assign(contact.hold.size(), 3.0);
  putStraight(brush, contact, [](int) { return Eigen::Vector3d::Zero(); });
  search(contact);
  std::set<std::pair<int, int>> found;
  for (int i = 0; i < contact.beside.count; ++i)
    found.emplace(contact.beside.a[static_cast<std::size_t>(i)],
                  contact.beside.b[static_cast<std::size_t>(i)] / n);
  const auto point = [&](int node) {
    const double* at = contact.point.data() + 4 * node;
    return Eigen::Vector3d(at[0], at[1], at[2]);
  };
  // Of two rods the one that comes first in the clusters has the nodes, the other the edges.
  std::vector<int> order(60);
  for (std::size_t i = 0; i < 60; ++i)
    order[static_cast<std::size_t>(contact.clusters.first_node[i] / n)] = static_cast<int>(i);
  int near = 0;
  for (int a = 0; a < 60 * n; ++a)
    for (int rod = 0; rod < 60; ++rod)
      for (int edge = 0; edge < n - 1; ++edge) {
        if (a % n == 0 || order[static_cast<std::size_t>(rod)] <= order[static_cast<std::size_t>(a / n)])
          continue;
        const Eigen::Vector3d from = point(rod * n + edge), along = point(rod * n + edge + 1) - from;
        const double t = (point(a) - from).dot(along) / along.squaredNorm();
        if (t < 0.0 || t > 1.0) continue;
        // What touches; of what liquid may bridge it finds the nearest.
        if ((point(a) - from - t * along).norm() > 6e-4) continue;
        ++near;
        EXPECT_EQ(found.count({a, rod}), 1U) << a << " " << rod;
      }
  EXPECT_GT(near, 50);
}

/// A tuft, its handle pose, and its parameters for tests of rods that meet.
struct Scene {
  BrushModel brush;
  RodParameters rods;
  ContactParameters contact = touching();

  std::unique_ptr<Tuft> make(double ink) const {
    auto tuft = makeTuft(brush, rods, contact);
    tuft->place(Eigen::Isometry3d::Identity());
    tuft->setInk(std::vector<double>(brush.rods.size() * std::size_t(brush.rods[0].nodeCount()), ink));
    return tuft;
  }
};

double leastDistance(const Tuft& tuft, int nodes) {
  double least = 1.0;
  const int kParts = 10;
  std::vector<Eigen::Vector3d> a, b;
  tuft.readRod(0, a);
  tuft.readRod(1, b);
  for (int i = 0; i < (nodes - 1) * kParts; ++i)
    for (int j = 0; j < (nodes - 1) * kParts; ++j) {
      const auto on = [&](const std::vector<Eigen::Vector3d>& x, int k) {
        const double s = double(k % kParts) / kParts;
        return Eigen::Vector3d((1 - s) * x[std::size_t(k / kParts)] +
                               s * x[std::size_t(k / kParts) + 1]);
      };
      least = std::min(least, (on(a, i) - on(b, j)).norm());
    }
  return least;
}

TEST(Bundles, RodsThatCrossDoNotPassThroughEachOther) {
  // Two horizontal rods, one above the other at a right angle, the upper one heavy; seen from a node
  // they would be far apart.
  Scene scene;
  const int n = 8;
  const double radius = 3e-4, length = 0.028, edge = length / (n - 1);
  scene.brush.rods = {rodAt({0.0, 0.0, 0.0}, {1, 0, 0}, length, n, radius),
                      rodAt({5.5 * edge, -5.5 * edge, 1.5e-3}, {0, 1, 0}, length, n, radius)};
  scene.rods.precision = "double";
  for (const bool bundles : {false, true}) {
    scene.contact.bundles = bundles;
    auto tuft = scene.make(0.0);
    tuft->setNodeForce(1, n - 1, {0, 0, -6e-5});
    for (int step = 0; step < 400; ++step) tuft->step(Eigen::Isometry3d::Identity());
    const auto heightAtCrossing = [&](int rod) {
      return 0.5 * (tuft->nodePosition(rod, 5).z() + tuft->nodePosition(rod, 6).z());
    };
    const double upper = heightAtCrossing(1), lower = heightAtCrossing(0);
    if (bundles) {
      EXPECT_GT(upper, lower);
      EXPECT_GT(leastDistance(*tuft, n), radius);  // soft, but not through
    } else {
      EXPECT_LT(upper, lower) << "the load is too small to prove anything";
    }
  }
}

TEST(Bundles, RoundsAgreeAndThenTheHandleFeelsTheWeightAlone) {
  Scene scene;
  BrushParameters brush;
  brush.rod_count = 7;
  brush.node_count = 8;
  scene.brush = makeBrush(brush);
  scene.rods.precision = "double";
  scene.rods.damping = 200.0;
  scene.contact.coupling_tolerance = 1e-8;
  scene.contact.coupling_rounds = 1000;
  auto tuft = scene.make(1.0);
  TuftReport report;
  for (int step = 0; step < 400; ++step) report = tuft->step(Eigen::Isometry3d::Identity());
  EXPECT_LT(report.coupling_error, 1e-8);
  Eigen::Matrix<double, 6, 1> wrench = Eigen::Matrix<double, 6, 1>::Zero();
  double weight = 0.0;
  for (int rod = 0; rod < 7; ++rod) {
    wrench += tuft->rodWrench(rod);
    for (const double mass : scene.brush.rods[std::size_t(rod)].node_mass) weight += 9.81 * mass;
  }
  EXPECT_NEAR(wrench[2], -weight, 0.02 * weight);
  EXPECT_LT(wrench.head<2>().norm(), 0.02 * weight);
  std::vector<int> group(7);
  EXPECT_EQ(tuft->groups(0.5, group), 1);
}

TEST(Bundles, DryRodsThatTouchNothingMoveAsIfAlone) {
  Scene scene;
  scene.brush.rods = {rodAt({0, 0, 0}, {0, 0, -1}, 0.045, 16, 3e-4),
                      rodAt({2e-3, 0, 0}, {0, 0, -1}, 0.045, 16, 3e-4)};
  std::uint64_t hash[2];
  for (const bool bundles : {false, true}) {
    scene.contact.bundles = bundles;
    auto tuft = scene.make(1.0);
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    for (int step = 0; step < 200; ++step) {
      X.translation().x() = 1e-3 * std::sin(0.05 * step);
      tuft->step(X);
    }
    hash[bundles] = tuft->hash(0);
  }
  EXPECT_EQ(hash[0], hash[1]);
}

TEST(Bundles, ThreadsDoNotChangeABit) {
  BrushParameters brush;
  brush.rod_count = 48;
  std::uint64_t hash[2];
  for (const int threads : {1, 2}) {
    Scene scene;
    scene.brush = makeBrush(brush);
    scene.rods.threads = threads;
    scene.contact.coupling_rounds = 5;
    auto tuft = scene.make(0.7);
    for (int step = 0; step < 20; ++step) tuft->step(Eigen::Isometry3d::Identity());
    hash[threads - 1] = tuft->hash(0);
  }
  EXPECT_EQ(hash[0], hash[1]);
}

}  // namespace
}  // namespace calligraphy_brush
