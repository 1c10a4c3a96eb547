#include <gtest/gtest.h>

#include <cmath>
#include <memory>
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
using V = Lanes<double, 2>;
using Pull = BundlePull<V>;

void search(BundleContact<double>& contact) {
  BundleSearch<V>::find(contact);
  takeHits(contact, 1.0);
  BundleSearch<V>::findCrossings(contact);
  takeCrossings(contact);
  Pull::fill(contact);
}

void pull(BundleContact<double>& contact) {
  const int batches = static_cast<int>(contact.batches.size());
  for (int batch = 0; batch < batches; ++batch) Pull::spread(contact, batch);
  for (int tie = 0; tie < static_cast<int>(contact.ties.size()); ++tie) Pull::push(contact, tie, true);
  for (int batch = 0; batch < batches; ++batch) Pull::gather(contact, batch);
  Pull::cross(contact);
}

/// Batches as they come.
BundleContact<double> makeContact(const BrushModel& brush, const ContactParameters& parameters,
                                  double hold) {
  std::vector<std::vector<int>> batches;
  for (int rod = 0; rod < static_cast<int>(brush.rods.size()); ++rod) {
    if (rod % kLanes == 0) batches.emplace_back();
    batches.back().push_back(rod);
  }
  BundleContact<double> contact = makeBundleContact<double>(brush, parameters, batches);
  for (auto& batch : contact.batches) std::fill(batch.hold.begin(), batch.hold.end(), hold);
  return contact;
}

void wet(BundleContact<double>& contact, double ink) {
  takeInk(contact,
          std::vector<double>(static_cast<std::size_t>(contact.rod_count * contact.node_count), ink));
}

Eigen::Vector3d at(const AlignedVector<double>& field, int rows, int rod, int node) {
  const auto first = static_cast<std::size_t>(node * rows * kLanes + rod % kLanes);
  return {field[first], field[first + kLanes], field[first + 2 * kLanes]};
}
Eigen::Vector3d pointOf(const BundleContact<double>& contact, int rod, int node) {
  return at(contact.batches[static_cast<std::size_t>(rod / kLanes)].point, 3, rod, node);
}
Eigen::Vector3d gradientOf(const BundleContact<double>& contact, int rod, int node) {
  return at(contact.batches[static_cast<std::size_t>(rod / kLanes)].springs, 4, rod, node);
}
double stiffnessOf(const BundleContact<double>& contact, int rod, int node) {
  return contact.batches[static_cast<std::size_t>(rod / kLanes)]
      .springs[static_cast<std::size_t>((node * 4 + 3) * kLanes + rod % kLanes)];
}
void put(AlignedVector<double>& field, int rod, int node, const Eigen::Vector3d& x) {
  for (int i = 0; i < 3; ++i)
    field[static_cast<std::size_t>((node * 3 + i) * kLanes + rod % kLanes)] = x[i];
}
bool isPair(const BundleContact<double>& contact, int a, int b) {
  for (const auto& pair : contact.pairs[static_cast<std::size_t>(std::min(a, b))])
    if (pair.b == std::max(a, b)) return true;
  return false;
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

/// Puts the straight rods of a brush, each shifted by shift(rod), into a contact. Lanes beyond the last
/// rod follow it, as a tuft's do.
template <class Shift>
void putStraight(const BrushModel& brush, BundleContact<double>& contact, Shift&& shift) {
  const int n = contact.node_count;
  for (int lane = 0; lane < static_cast<int>(contact.batches.size()) * kLanes; ++lane)
    for (int node = 0; node < n; ++node) {
      const int rod = std::min(lane, contact.rod_count - 1);
      const RodModel& model = brush.rods[static_cast<std::size_t>(rod)];
      put(contact.batches[static_cast<std::size_t>(lane / kLanes)].point, lane, node,
          model.root_H + model.length * node / (n - 1) * model.direction_H + shift(rod));
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
    BundleContact<double> contact = makeContact(brush, parameters, 0.01);
    wet(contact, 1.0);
    putStraight(brush, contact, [&](int rod) {
      return Eigen::Vector3d(rod == 0 ? 0.0 : 2.0 * radius + gap - 1e-3, 0, 0);
    });
    search(contact);
    ASSERT_EQ(contact.pairs[0].size(), 1U) << gap;
    pull(contact);
    const double step = std::max(1e-9, 1e-4 * std::abs(gap)), voronoi = length / 3;
    const double w = parameters.surface_tension * cohesionEnergy(1.0) * radius;
    const auto energy = [&](double g) {
      return pairEnergy(g, 2.0 * radius, parameters.bundle_modulus, w, range * 2.0 * radius) * voronoi;
    };
    const double slope = (energy(gap + step) - energy(gap - step)) / (2.0 * step);
    const double curvature =
        (energy(gap + step) - 2.0 * energy(gap) + energy(gap - step)) / (step * step);
    for (const int node : {1, 2}) {
      // The second rod is on the side of +x; what it feels of opening the gap is the slope.
      EXPECT_NEAR(gradientOf(contact, 1, node).x() / slope, 1.0, 1e-3) << gap;
      EXPECT_NEAR(gradientOf(contact, 0, node).x() / slope, -1.0, 1e-3) << gap;
      // The sum over the two of their halves is above the energy.
      EXPECT_GE(stiffnessOf(contact, 1, node), 2.0 * 0.999 * curvature) << gap;
    }
    // All of them; the end node stands for half a length, the root is held.
    EXPECT_NEAR(Pull::energy(contact) / (2.5 * energy(gap)), 1.0, 1e-9);
  }
}

TEST(BundlePull, PairsMakeNoMomentum) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  BrushModel brush;
  const int rods = 40, n = 12;
  for (int rod = 0; rod < rods; ++rod)
    brush.rods.push_back(rodAt({3e-3 * number(random), 3e-3 * number(random), 0},
                               {0.5 * number(random), 0.5 * number(random), -1}, 0.03, n, 4e-4));
  BundleContact<double> contact = makeContact(brush, touching(), 3.0);
  wet(contact, 0.5);
  contact.slip = 1e-6;
  putStraight(brush, contact, [](int) { return Eigen::Vector3d::Zero(); });
  for (int rod = 0; rod < rods; ++rod)
    for (int node = 0; node < n; ++node) {
      auto& batch = contact.batches[static_cast<std::size_t>(rod / kLanes)];
      const Eigen::Vector3d way = 1e-4 * Eigen::Vector3d(number(random), number(random), number(random));
      put(batch.way, rod, node, way);
      put(batch.point, rod, node, at(batch.point, 3, rod, node) + way);
    }
  search(contact);
  pull(contact);
  int pairs = 0;
  for (const auto& of_rod : contact.pairs) pairs += static_cast<int>(of_rod.size());
  ASSERT_GT(pairs, 100);
  ASSERT_GT(contact.crossings.size(), 5U);
  Eigen::Vector3d force(0, 0, 0), torque(0, 0, 0);
  double size = 0.0;
  for (int rod = 0; rod < rods; ++rod)
    for (int node = 0; node < n; ++node) {
      const Eigen::Vector3d g = gradientOf(contact, rod, node);
      force += g;
      torque += pointOf(contact, rod, node).cross(g);
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
  const int n = 16, rods = 60;
  for (int rod = 0; rod < rods; ++rod)
    brush.rods.push_back(rodAt({4e-3 * number(random), 4e-3 * number(random), 0},
                               {0.05 * number(random), 0.05 * number(random), -1},
                               0.045 + 1e-3 * number(random), n, 3e-4));
  BundleContact<double> contact = makeContact(brush, touching(), 3.0);
  putStraight(brush, contact, [](int) { return Eigen::Vector3d::Zero(); });
  search(contact);
  int near = 0;
  for (int a = 0; a < rods; ++a)
    for (int b = a + 1; b < rods; ++b) {
      int touching_nodes = 0;
      for (int node = 1; node < n; ++node)
        for (int edge = std::max(0, node - 1); edge < std::min(n - 1, node + 1); ++edge) {
          const Eigen::Vector3d from = pointOf(contact, b, edge),
                                along = pointOf(contact, b, edge + 1) - from;
          const double t = (pointOf(contact, a, node) - from).dot(along) / along.squaredNorm();
          if (t < 0.0 || t > 1.0) continue;
          touching_nodes += (pointOf(contact, a, node) - from - t * along).norm() < 6e-4;
        }
      // The search looks at every third node.
      if (touching_nodes < 3) continue;
      ++near;
      EXPECT_TRUE(isPair(contact, a, b)) << a << " " << b;
    }
  EXPECT_GT(near, 40);
}

TEST(BundlePairs, LiquidBridgesRodsBetweenWhichNobodyStands) {
  // Nine in a square lattice, just apart: sides are bridged, and what is two further on is not.
  BrushModel brush;
  const double pitch = 7e-4;
  for (int i = 0; i < 9; ++i)
    brush.rods.push_back(rodAt({pitch * (i % 3), pitch * (i / 3), 0}, {0, 0, -1}, 0.03, 8, 3e-4));
  BundleContact<double> contact = makeContact(brush, touching(), 3.0);
  wet(contact, 1.0);
  putStraight(brush, contact, [](int) { return Eigen::Vector3d::Zero(); });
  search(contact);
  EXPECT_TRUE(isPair(contact, 0, 1));
  EXPECT_TRUE(isPair(contact, 4, 7));
  EXPECT_FALSE(isPair(contact, 0, 2));
  EXPECT_FALSE(isPair(contact, 1, 7));
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
  scene.rods.tolerance = 1e-10;
  scene.contact.coupling_tolerance = 1e-7;  // a ten-thousandth of a bundle
  scene.contact.coupling_rounds = 100;
  auto tuft = scene.make(1.0);
  TuftReport report;
  for (int step = 0; step < 400; ++step) report = tuft->step(Eigen::Isometry3d::Identity());
  EXPECT_LT(report.coupling_error, 1e-7);
  EXPECT_LT(report.coupling_rounds, 100);
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

TEST(Bundles, BearWhatNoHandDoes) {
  // Slammed onto the sheet, dragged, thrown 20 mm and spun, dry and wet, over steps, schemes and
  // stiffness.
  BrushParameters brush;
  brush.rod_count = 40;
  const BrushModel model = makeBrush(brush);
  const auto pose = [](double t) {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    const double thrown = t > 0.15 ? 0.02 : 0.0, turn = t > 0.2 ? 40.0 * (t - 0.2) : 0.0;
    X.linear() = (Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()) *
                  Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()))
                     .toRotationMatrix();
    X.translation() = Eigen::Vector3d(0.5 * std::min(t, 0.15) + thrown, 0.0, 0.05 - std::min(t, 0.02));
    return X;
  };
  for (const char* scheme : {"backward_euler", "bdf2", "sdirk2"})
    for (const double time_step : {5e-4, 1e-3, 5e-3})
      for (const double modulus : {60.0, 600.0, 6000.0})
        for (const double ink : {0.0, 0.01, 1.0}) {
          Scene scene;
          scene.brush = model;
          scene.rods.scheme = scheme;
          scene.rods.time_step = time_step;
          scene.contact.paper = true;
          scene.contact.bundle_modulus = modulus;
          auto tuft = makeTuft(scene.brush, scene.rods, scene.contact);
          tuft->place(pose(0.0));
          tuft->setInk(std::vector<double>(40 * 16, ink));
          double deepest = 0.0, longest = 0.0;
          bool finite = true;
          std::vector<Eigen::Vector3d> nodes;
          const int steps = static_cast<int>(0.25 / time_step);
          for (int step = 1; step <= steps; ++step) {
            tuft->step(pose(step * time_step));
            if (step % 5 != 0 && step != steps) continue;
            for (int rod = 0; rod < 40; ++rod) {
              tuft->readRod(rod, nodes);
              const double edge = model.rods[std::size_t(rod)].length / 15;
              for (std::size_t node = 1; node < nodes.size(); ++node) {
                finite = finite && nodes[node].allFinite();
                deepest = std::max(deepest, -nodes[node].z());
                longest =
                    std::max(longest, std::abs((nodes[node] - nodes[node - 1]).norm() / edge - 1.0));
              }
            }
          }
          const std::string what = std::string(scheme) + " " + std::to_string(time_step) + " s, " +
                                   std::to_string(modulus) + " Pa, ink " + std::to_string(ink);
          EXPECT_TRUE(finite) << what;
          EXPECT_LT(longest, 1e-4) << what;
          EXPECT_LT(deepest, 1.1e-3)
              << what;  // half a millimetre and a fifth of an edge, as in `stress`
        }
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

/// A wet tuft in the air, and where its rods end from step to step.
class WetTuft {
 public:
  explicit WetTuft(double hair_taper) {
    BrushParameters parameters;
    parameters.rod_count = kRods;
    parameters.hair_taper = hair_taper;
    ContactParameters contact;
    contact.bundles = true;
    contact.paper = false;
    const BrushModel brush = makeBrush(parameters);
    nodes_ = brush.rods.front().nodeCount();
    tuft_ = makeTuft(brush, {}, contact);
    tuft_->setInk(std::vector<double>(static_cast<std::size_t>(kRods * nodes_), 1.0));
    X_PH_.translation().z() = 0.1;
    tuft_->place(X_PH_);
  }
  std::vector<Eigen::Vector3d> step() {
    tuft_->step(X_PH_);
    std::vector<Eigen::Vector3d> ends;
    for (int rod = 0; rod < kRods; ++rod) ends.push_back(tuft_->nodePosition(rod, nodes_ - 1));
    return ends;
  }
  /// Root of the mean square over rods and steps of the ways of the ends in a step, or of what these
  /// change by from one step to the next [m].
  double way(int steps, bool change = false) {
    double sum = 0.0;
    auto first = step(), second = step();
    for (int k = 0; k < steps; ++k) {
      const auto third = step();
      for (std::size_t rod = 0; rod < kRods; ++rod)
        sum += (third[rod] - (change ? 2.0 * second[rod] - first[rod] : second[rod])).squaredNorm();
      first = second;
      second = third;
    }
    return std::sqrt(sum / (steps * kRods));
  }

 private:
  static constexpr int kRods = 64;
  std::unique_ptr<Tuft> tuft_;
  Eigen::Isometry3d X_PH_ = Eigen::Isometry3d::Identity();
  int nodes_ = 0;
};

TEST(Bundles, AWetTuftComesToRest) {
  // Liquid that follows rods at once makes them go to and fro for ever, at a millimetre a second.
  WetTuft tuft(0.85);
  EXPECT_GT(tuft.way(50), 5e-6);  // it falls together
  tuft.way(2500);
  EXPECT_LT(tuft.way(100), 4e-7);
}

TEST(Bundles, AFinePointDoesNotShake) {
  // A common motion that does not see what bends cost where rods of different lengths lie together goes
  // to and fro from step to step, by 3 um here.
  WetTuft tuft(0.4);
  tuft.way(2500);
  EXPECT_LT(tuft.way(60, true), 5e-7);
}

}  // namespace
}  // namespace calligraphy_brush
