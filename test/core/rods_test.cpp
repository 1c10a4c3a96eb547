#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "calligraphy_brush/rods/bending_law.h"
#include "calligraphy_brush/rods/time_integration.h"
#include "rod_scene.h"

using namespace calligraphy_brush;

namespace {

constexpr double kPi = 3.14159265358979323846;

constexpr double kLaws[] = {kTangentLaw, kArcLaw, kSineLaw};

}  // namespace

TEST(BendingLaw, DerivativesAreThoseOfItsValue) {
  for (const double p : kLaws)
    for (double s = 1e-6; s < 3.9; s *= 1.7) {
      const double h = 1e-5 * s;
      const auto at = bendingTerms(s, p), below = bendingTerms(s - h, p), above = bendingTerms(s + h, p);
      EXPECT_NEAR(at.first, (above.value - below.value) / (2 * h), 1e-6 * std::abs(at.first)) << s;
      EXPECT_NEAR(at.second, (above.first - below.first) / (2 * h), 1e-5 * (at.first / s)) << s;
    }
}

TEST(BendingLaw, IsHalfTheSquaredCurvature) {
  for (const double angle : {1e-3, 0.1, 1.0, 2.5}) {
    const double s = 4 * std::pow(std::sin(angle / 2), 2);
    EXPECT_NEAR(bendingTerms(s, kTangentLaw).value, 0.5 * std::pow(2 * std::tan(angle / 2), 2), 1e-12);
    EXPECT_NEAR(bendingTerms(s, kSineLaw).value, 0.5 * std::pow(2 * std::sin(angle / 2), 2), 1e-12);
    // κ²/2 = φ²/2 − (1/12 − p) φ⁴/2 + ...
    EXPECT_NEAR(bendingTerms(s, kArcLaw).value, 0.5 * angle * angle - std::pow(angle, 4) / 96,
                0.002 * std::pow(angle, 6) + 1e-18);
  }
}

TEST(BendingLaw, IsFiniteAndRisingWhereAnEdgeFoldsBack) {
  for (const double p : kLaws) {
    EXPECT_LT(bendingTerms(3.98, p).value, bendingTerms(3.999, p).value);
    EXPECT_LT(bendingTerms(3.999, p).value, bendingTerms(4.001, p).value);
    EXPECT_TRUE(std::isfinite(bendingTerms(4.001, p).value));
  }
}

namespace {

/// Free fall and a damped spring of one node by a scheme of one stage, or of SDIRK2's two.
struct OneNode {
  double x = 0, v = 0, d = 0, v_before = 0;
  /// Minimises ½ m inertia (d − target)² + ½ k x².
  void stage(const StepCoefficients& k, double gravity, double spring) {
    const double target =
        k.displacement * d + k.velocity * v + k.previous_velocity * v_before + k.gravity * gravity;
    const double way = (k.inertia * target - spring * x) / (k.inertia + spring);
    const double next = k.from_way * way + k.from_displacement * d + k.from_velocity * v;
    v_before = v;
    v = next;
    d = way;
    x += way;
  }
};

/// Error at t = 1 of x'' = −c x' − k x, x(0) = 1, x'(0) = 0.
double springError(const char* scheme, int steps) {
  const double h = 1.0 / steps, c = 0.6, k = 20.0;
  OneNode node;
  node.x = 1;
  for (int step = 0; step < steps; ++step) {
    if (scheme == std::string("sdirk2")) {
      node.stage(backwardEuler(kSdirk2Gamma * h, c), 0, k);
      node.stage(sdirk2SecondStage(h, c), 0, k);
    } else {
      node.stage(step > 0 && scheme == std::string("bdf2") ? bdf2(h, c) : backwardEuler(h, c), 0, k);
    }
  }
  const double w = std::sqrt(k - c * c / 4);
  return std::abs(node.x - std::exp(-c / 2) * (std::cos(w) + c / (2 * w) * std::sin(w)));
}

}  // namespace

TEST(StepCoefficients, HaveTheOrderOfTheirScheme) {
  for (const auto& [scheme, order] :
       {std::pair{"backward_euler", 1.0}, {"bdf2", 2.0}, {"sdirk2", 2.0}}) {
    const double measured = std::log2(springError(scheme, 400) / springError(scheme, 800));
    EXPECT_NEAR(measured, order, 0.1) << scheme;
  }
  EXPECT_LT(springError("sdirk2", 400), 0.3 * springError("bdf2", 400));
}

TEST(StepCoefficients, FallFreely) {
  const double h = 0.01, g = -9.81;
  OneNode node;
  for (int step = 1; step <= 20; ++step) {
    node.stage(backwardEuler(kSdirk2Gamma * h, 0), g, 0);
    node.stage(sdirk2SecondStage(h, 0), g, 0);
    EXPECT_NEAR(node.v, g * h * step, 1e-12);
    EXPECT_NEAR(node.x, 0.5 * g * h * h * step * step, 1e-12);
  }
}

// Exact minimisers of the discrete energy (κ = 2 tan(turn/2), a joint of half a Voronoi length at the
// clamp), made outside this project by two independent methods; clamp angle 90°.
struct Cantilever {
  double gamma;
  int nodes;
  double tip_x, tip_z;
};

class HeavyCantilever : public testing::TestWithParam<Cantilever> {};

TEST_P(HeavyCantilever, SettlesWhereTheReferenceSays) {
  const Cantilever& c = GetParam();
  RodParameters rods = exactRods(0.05);
  rods.scheme = "backward_euler";
  rods.gravity = c.gamma;
  rods.damping = 1.0;
  ContactParameters contact;
  contact.paper = false;
  const auto tuft = makeTuft(oneRod(makeUniformRod(1.0, 1.0, 1.0, c.nodes)), rods, contact);
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, -kPi / 2);
  tuft->place(X);
  ASSERT_GT(settle(*tuft, X, c.nodes, 1e-12, 20000), 0);
  const Eigen::Vector3d tip = tuft->nodePosition(0, c.nodes - 1);
  EXPECT_NEAR(tip.x(), c.tip_x, 1e-8);
  EXPECT_NEAR(tip.y(), 0.0, 1e-12);
  EXPECT_NEAR(tip.z(), c.tip_z, 1e-8);
  // The clamp carries the weight: of all nodes, each with its own lever.
  const auto wrench = tuft->rodWrench(0);
  EXPECT_NEAR(wrench[2], -c.gamma, 1e-7 * c.gamma);
  double moment = 0;
  for (int node = 0; node < c.nodes; ++node) {
    const double mass = (node == 0 || node == c.nodes - 1 ? 0.5 : 1.0) / (c.nodes - 1);
    moment += mass * c.gamma * tuft->nodePosition(0, node).x();
  }
  EXPECT_NEAR(wrench[4], moment, 1e-7 * c.gamma);
}

INSTANTIATE_TEST_SUITE_P(Reference, HeavyCantilever,
                         testing::Values(Cantilever{0.9684309375, 10, 0.991644636829, -0.121082929633},
                                         Cantilever{0.9684309375, 40, 0.991773313694, -0.119738635442},
                                         Cantilever{10, 5, 0.655096728459, -0.717182606591},
                                         Cantilever{10, 20, 0.657055501537, -0.700368025936},
                                         Cantilever{10, 80, 0.656408364578, -0.700194569395},
                                         Cantilever{100, 10, 0.161835036247, -0.947431145007},
                                         Cantilever{100, 40, 0.160081033101, -0.937794636365}));

TEST(Rods, KeepTheirLengthInEveryStep) {
  ContactParameters contact;
  for (const char* precision : {"float", "double"}) {
    RodParameters rods;
    rods.precision = precision;
    const auto tuft = makeTuft(referenceRod(16), rods, contact);
    tuft->place(handleAt({0, 0, 0.05}));
    double worst = 0;
    for (int step = 0; step < 400; ++step) {
      tuft->step(handleAt({0.02 * std::sin(0.1 * step), 0, 0.05 - 0.03 * std::sin(0.01 * step)},
                          0.5 * std::sin(0.05 * step)));
      for (int node = 0; node < 15; ++node)
        worst = std::max(
            worst, std::abs((tuft->nodePosition(0, node + 1) - tuft->nodePosition(0, node)).norm() /
                                (kReferenceLength / 15) -
                            1));
    }
    EXPECT_LT(worst, precision == std::string("float") ? 1e-5 : 1e-13) << precision;
  }
}

TEST(Rods, LoseEnergyInADampedFreeSwing) {
  const int n = 16;
  RodParameters rods = exactRods(0.001);
  rods.scheme = "backward_euler";
  rods.damping = 5.0;
  ContactParameters contact;
  contact.paper = false;
  const auto tuft = makeTuft(referenceRod(n), rods, contact);
  const Eigen::Isometry3d X = handleAt({0, 0, 0}, -kPi / 2);
  tuft->place(X);
  const double l = kReferenceLength / (n - 1);
  std::vector<Eigen::Vector3d> before(n);
  const auto read = [&] {
    std::vector<Eigen::Vector3d> x;
    tuft->readRod(0, x);
    return x;
  };
  before = read();
  double last = 0;
  for (int step = 0; step < 3000; ++step) {
    tuft->step(X);
    const auto x = read();
    double energy = 0;
    Eigen::Vector3d direction = X.linear() * -Eigen::Vector3d::UnitZ();
    for (int i = 0; i < n; ++i) {
      const double mass = kReferenceDensity * l * (i == 0 || i == n - 1 ? 0.5 : 1.0);
      const auto node = static_cast<std::size_t>(i);
      energy += 0.5 * mass * (x[node] - before[node]).squaredNorm() / 1e-6 + mass * 9.81 * x[node].z();
      if (i + 1 < n) {
        const Eigen::Vector3d next = (x[node + 1] - x[node]) / l;
        const double s = (next - direction).squaredNorm();
        energy += kReferenceBending / (i == 0 ? 0.5 * l : l) * 2 * s / (4 - s);
        direction = next;
      }
    }
    ASSERT_LE(energy, last + 1e-18) << step;
    last = energy;
    before = x;
  }
}

TEST(Rods, FallBackToTheSameShapeWhateverTheDamping) {
  std::vector<Eigen::Vector3d> tips;
  for (const double damping : {2.0, 200.0}) {
    RodParameters rods = exactRods(0.01);
    rods.damping = damping;
    ContactParameters contact;
    contact.paper = false;
    const auto tuft = makeTuft(referenceRod(16), rods, contact);
    const Eigen::Isometry3d X = handleAt({0, 0, 0}, -kPi / 2);
    tuft->place(X);
    ASSERT_GT(settle(*tuft, X, 16, 1e-14, 100000), 0);
    tips.push_back(tuft->nodePosition(0, 15));
  }
  EXPECT_LT((tips[0] - tips[1]).norm(), 1e-9);
}

TEST(Rods, GiveTheSameMotionWhereverAndHoweverTheSceneIsTurned) {
  // Turned about z, which gravity and the sheet do not see.
  const Eigen::Isometry3d turn = [] {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T.translation() = Eigen::Vector3d(0.1, -0.2, 0);
    return T;
  }();
  const RodParameters rods = exactRods(0.001);
  const ContactParameters contact;
  const auto a = makeTuft(referenceRod(16), rods, contact);
  const auto b = makeTuft(referenceRod(16), rods, contact);
  const auto pose = [](int step) {
    return handleAt({0.0002 * step, 0, 0.05 - 0.02 * std::min(1.0, step / 200.0)}, 0.3);
  };
  a->place(pose(0));
  b->place(turn * pose(0));
  for (int step = 1; step < 500; ++step) {
    a->step(pose(step));
    b->step(turn * pose(step));
  }
  for (int node = 0; node < 16; ++node)
    EXPECT_LT((turn * a->nodePosition(0, node) - b->nodePosition(0, node)).norm(), 1e-8) << node;
}

namespace {

/// Hash of a brush of `count` reference rods of differing length after a press and a drag.
std::uint64_t strokeHash(const RodParameters& rods, int count,
                         std::vector<Eigen::Vector3d>* first_rod = nullptr) {
  BrushModel brush;
  for (int i = 0; i < count; ++i) {
    RodModel rod = makeUniformRod(kReferenceLength * (1 - 0.01 * i), kReferenceBending * (1 + i),
                                  kReferenceDensity, 12);
    rod.root_H = {0.0002 * i, -0.0001 * i, 0};
    brush.rods.push_back(rod);
  }
  const auto tuft = makeTuft(brush, rods, ContactParameters{});
  const auto pose = [](int step) {
    return handleAt({0.0001 * step, 0, 0.05 - 0.02 * std::min(1.0, step / 100.0)}, 0.2);
  };
  tuft->place(pose(0));
  for (int step = 1; step < 300; ++step) tuft->step(pose(step));
  if (first_rod) tuft->readRod(0, *first_rod);
  return tuft->hash(1);
}

}  // namespace

TEST(Tuft, GivesTheSameBitsForAnyNumberOfThreads) {
  RodParameters rods;
  const std::uint64_t one = strokeHash(rods, 40);
  for (const int threads : {2, 3, 7}) {
    rods.threads = threads;
    EXPECT_EQ(strokeHash(rods, 40), one) << threads;
  }
}

TEST(Tuft, RodsDoNotKnowTheirNeighboursInABatch) {
  for (const char* kernel : {"baseline", "avx2", "avx512"}) {
    RodParameters rods;
    rods.instruction_set = kernel;
    std::vector<Eigen::Vector3d> alone, among_others;
    try {
      strokeHash(rods, 1, &alone);
    } catch (const std::invalid_argument& error) {
      std::printf("skipped: %s\n", error.what());
      continue;
    }
    strokeHash(rods, 16, &among_others);
    for (std::size_t node = 0; node < alone.size(); ++node)
      EXPECT_EQ(alone[node], among_others[node]) << kernel;
  }
}

TEST(Tuft, KernelsAgreeToRounding) {
  RodParameters rods = exactRods(0.001);
  std::vector<Eigen::Vector3d> baseline;
  rods.instruction_set = "baseline";
  strokeHash(rods, 1, &baseline);
  for (const char* kernel : {"avx2", "avx512"}) {
    rods.instruction_set = kernel;
    std::vector<Eigen::Vector3d> wide;
    try {
      strokeHash(rods, 1, &wide);
    } catch (const std::invalid_argument& error) {
      std::printf("skipped: %s\n", error.what());
      continue;
    }
    for (std::size_t node = 0; node < wide.size(); ++node)
      EXPECT_LT((wide[node] - baseline[node]).norm(), 1e-9) << kernel;
  }
}

TEST(Tuft, RefusesRodsThatDoNotMatch) {
  BrushModel brush = referenceRod(10);
  brush.rods.push_back(makeUniformRod(0.04, 1e-7, 1e-4, 12));
  EXPECT_THROW(makeTuft(brush, RodParameters{}, ContactParameters{}), std::invalid_argument);
  EXPECT_THROW(makeTuft(BrushModel{}, RodParameters{}, ContactParameters{}), std::invalid_argument);
  RodParameters rods;
  rods.time_step = std::nan("");
  EXPECT_THROW(makeTuft(referenceRod(10), rods, ContactParameters{}), ParameterError);
}
