#include "calligraphy_brush/rods/wet_hair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "../benchmark/standard_stroke.h"
#include "rod_scene.h"

// Wet hair is softer than dry hair, and takes on a part of its bend.

namespace calligraphy_brush {
namespace {

constexpr int kNodes = 12;

RodModel makeRod(bool framed) {
  RodModel rod = makeUniformRod(kReferenceLength, kReferenceBending, kReferenceDensity, kNodes);
  if (framed) {
    rod.bending_stiffness_2 = rod.twisting_stiffness = rod.bending_stiffness;
    for (double& stiffness : rod.bending_stiffness_2) stiffness *= 1.5;
  }
  return rod;
}

std::vector<double> ink(double part, int rods = 1, int nodes = kNodes) {
  return std::vector<double>(static_cast<std::size_t>(rods * nodes), part);
}

ContactParameters inAir() {
  ContactParameters contact;
  contact.paper = false;
  return contact;
}

/// A rod that points along x at rest, without weight; its end's height is its bend.
struct Cantilever {
  explicit Cantilever(RodParameters rods, bool framed)
      : tuft(makeTuft(oneRod(makeRod(framed)), rods, inAir())), step_size(rods.time_step) {
    tuft->place(X);
  }
  void load(double force) { tuft->setNodeForce(0, kNodes - 1, {0, 0, force}); }
  double stepFor(double seconds) {
    for (int step = 0; step < seconds / step_size; ++step) tuft->step(X);
    return bend();
  }
  double bend() const { return tuft->nodePosition(0, kNodes - 1).z() - 0.1; }

  std::unique_ptr<Tuft> tuft;
  double step_size;
  Eigen::Isometry3d X = handleAt({0, 0, 0.1}, -1.57079632679489661923);
};

RodParameters weightless(double stiffness, double memory, double memory_time) {
  RodParameters rods;
  rods.precision = "double";
  rods.tolerance = 1e-12;
  rods.gravity = 0;
  rods.damping = 60;
  rods.sleep = 0;
  rods.wet_stiffness = stiffness;
  rods.wet_memory = memory;
  rods.wet_memory_time = memory_time;
  return rods;
}

constexpr double kForce = 1e-6;  // bends by a 250th of the length [N]

}  // namespace

/// Of plain and of framed rods.
class WetHairOf : public testing::TestWithParam<bool> {};

TEST_P(WetHairOf, BendsByTheLoadOverItsStiffness) {
  const double dry = [&] {
    Cantilever rod(weightless(0.4, 0, 1), GetParam());
    rod.load(kForce);
    return rod.stepFor(1.0);
  }();
  ASSERT_GT(dry, 1e-4);
  for (const double stiffness : {0.25, 0.4, 1.0})
    for (const double part : {0.0, 0.25, 0.5, 1.0}) {
      Cantilever rod(weightless(stiffness, 0, 1), GetParam());
      rod.tuft->setInk(ink(part));
      rod.load(kForce);
      const double softer = 1 - (1 - stiffness) * part;
      EXPECT_NEAR(rod.stepFor(1.0) * softer / dry, 1.0, 3e-3) << stiffness << " " << part;
    }
}

TEST_P(WetHairOf, IsSoftWhereItIsWetAlone) {
  // The half next to the clamp: the end is let down by M dθ = F x dx / B, x from the end.
  const double share = 7.0 / 8.0;  // of the cube's integral, that of x from 1/2 to 1
  Cantilever dry(weightless(0.4, 0, 1), GetParam()), rod(weightless(0.4, 0, 1), GetParam());
  std::vector<double> half = ink(0);
  std::fill(half.begin(), half.begin() + kNodes / 2, 1.0);
  rod.tuft->setInk(half);
  for (Cantilever* each : {&dry, &rod}) each->load(kForce);
  const double ratio = rod.stepFor(1.0) / dry.stepFor(1.0);
  EXPECT_NEAR(ratio, (1 - share) + share / 0.4, 0.02 * ratio);
}

TEST_P(WetHairOf, HasTheStiffnessOfItsInkHoweverThatCame) {
  Cantilever a(weightless(0.4, 0, 1), GetParam()), b(weightless(0.4, 0, 1), GetParam());
  for (const double part : {0.1, 1.0, 0.703, 0.704, 0.3}) a.tuft->setInk(ink(part));
  b.tuft->setInk(ink(0.3));
  EXPECT_EQ(a.tuft->hash(1), b.tuft->hash(1));
  for (Cantilever* rod : {&a, &b}) {
    rod->load(kForce);
    rod->stepFor(0.05);
  }
  EXPECT_EQ(a.tuft->hash(1), b.tuft->hash(1));
  // As dry as it was, to the bit.
  Cantilever c(weightless(0.4, 0, 1), GetParam()), d(weightless(0.4, 0, 1), GetParam());
  c.tuft->setInk(ink(1));
  c.tuft->setInk(ink(0));
  for (Cantilever* rod : {&c, &d}) {
    rod->load(kForce);
    rod->stepFor(0.05);
  }
  EXPECT_EQ(c.tuft->hash(1), d.tuft->hash(1));
}

TEST_P(WetHairOf, KeepsThePartOfItsBendThatIsItsMemory) {
  for (const double memory : {0.2, 0.5, 0.8}) {
    Cantilever rod(weightless(1, memory, 0.05), GetParam());
    rod.tuft->setInk(ink(1));
    rod.load(kForce);
    // Under a load the bend itself goes on: B (κ − pκ) = M, with the time constant τ/(1 − p).
    const double held = rod.stepFor(12 * 0.05 / (1 - memory));
    rod.tuft->setInk(ink(0));
    rod.load(0);
    EXPECT_NEAR(rod.stepFor(1.5) / held, memory, 0.02 * memory) << memory;
    // And dry for ever.
    EXPECT_NEAR(rod.stepFor(1.0) / held, memory, 0.02 * memory) << memory;
    // Put down anew it is new.
    Cantilever other(weightless(1, memory, 0.05), GetParam());
    rod.tuft->place(rod.X);
    EXPECT_EQ(rod.tuft->hash(1), other.tuft->hash(1));
    EXPECT_EQ(rod.stepFor(0.1), other.stepFor(0.1));
    EXPECT_EQ(rod.tuft->hash(1), other.tuft->hash(1));
  }
}

TEST_P(WetHairOf, KeepsThePartOfItsBendAfterItWasPressed) {
  // Lying nearly flat, pressed onto a sheet without friction by 0.3 mm, held for 10 τ, dried, lifted.
  const double memory = 0.4, time = 0.1;
  RodParameters rods = weightless(1, memory, time);
  ContactParameters contact;
  contact.paper_friction = 0;
  contact.tolerance = 1e-9;
  const auto tuft = makeTuft(oneRod(makeRod(GetParam())), rods, contact);
  const double lean = 1.5, drop = kReferenceLength * std::cos(lean);
  Eigen::Isometry3d X = handleAt({0, 0, drop + 1e-4}, -lean);
  tuft->place(X);
  tuft->setInk(ink(1));
  const auto moveTo = [&](double height) {
    const double from = X.translation().z();
    for (int step = 1; step <= 200; ++step) {
      X.translation().z() = from + (height - from) * step / 200;
      tuft->step(X);
    }
  };
  const auto holdFor = [&](double seconds) {
    for (int step = 0; step < 1000 * seconds; ++step) tuft->step(X);
    return (X.inverse() * tuft->nodePosition(0, kNodes - 1)).x();
  };
  moveTo(drop - 3e-4);
  const double held = holdFor(10 * time);
  ASSERT_GT(std::abs(held), 2.9e-4);
  tuft->setInk(ink(0));
  moveTo(drop + 5e-3);
  EXPECT_NEAR(holdFor(2.0) / held, memory, 0.02 * memory);
}

TEST_P(WetHairOf, GivesInToALoadAsAZenerSolid) {
  const double memory = 0.5, time = 2.0;
  Cantilever rod(weightless(1, memory, time), GetParam());
  rod.tuft->setInk(ink(1));
  rod.load(kForce);
  const double elastic = [&] {
    Cantilever other(weightless(1, 0, time), GetParam());
    other.load(kForce);
    return other.stepFor(1.0);
  }();
  // κ − κ₀ = M/B, κ₀' = (p κ − κ₀)/τ.
  const double slow = time / (1 - memory);
  const auto expected = [&](double t) { return 1 + memory / (1 - memory) * (1 - std::exp(-t / slow)); };
  double t = 0;
  for (int k = 0; k < 4; ++k) EXPECT_NEAR(rod.stepFor(2.0) / elastic, expected(t += 2), 0.01) << t;
  // Half as fast where it is half as wet.
  Cantilever half(weightless(1, memory, time), GetParam());
  half.tuft->setInk(ink(0.5));
  half.load(kForce);
  EXPECT_NEAR(half.stepFor(4.0) / elastic, expected(2.0), 0.01);
  // And back, wet.
  rod.load(0);
  const double kept = expected(t) - 1;
  EXPECT_NEAR(rod.stepFor(2.0) / elastic, kept * std::exp(-2.0 / slow), 0.01);
}

TEST_P(WetHairOf, HasNoMemoryAtZeroToTheBit) {
  // Neither dry with a memory, nor wet without.
  Cantilever with(weightless(1, 0.5, 0.1), GetParam()), without(weightless(1, 0, 0.1), GetParam());
  without.tuft->setInk(ink(1));
  for (Cantilever* rod : {&with, &without}) {
    rod->load(kForce);
    rod->stepFor(0.3);
    rod->load(0);
  }
  for (int step = 0; step < 3; ++step) {
    EXPECT_NE(with.bend(), 0.0);
    EXPECT_EQ(with.stepFor(0.01), without.stepFor(0.01));
  }
  EXPECT_NEAR(without.stepFor(3.0), 0.0, 1e-12);
}

TEST_P(WetHairOf, TurnsWithTheHandle) {
  // A set that is carried round, about all axes, is the same set.
  Cantilever rod(weightless(1, 0.6, 0.05), GetParam());
  rod.tuft->setInk(ink(1));
  rod.tuft->setNodeForce(0, kNodes - 1, {0, 3e-4, 2e-4});
  rod.stepFor(1.0);
  rod.tuft->setInk(ink(0));
  rod.tuft->setNodeForce(0, kNodes - 1, {0, 0, 0});
  rod.stepFor(2.0);
  const auto end_H = [&](const Eigen::Isometry3d& X) {
    return Eigen::Vector3d(X.inverse() * rod.tuft->nodePosition(0, kNodes - 1));
  };
  const Eigen::Vector3d before = end_H(rod.X);
  ASSERT_GT(before.head<2>().norm(), 2e-3);
  Eigen::Isometry3d X = rod.X;
  const Eigen::Vector3d axes[] = {Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitX(),
                                  Eigen::Vector3d(1, 2, 3).normalized()};
  for (const Eigen::Vector3d& axis : axes)
    for (int step = 0; step < 500; ++step) {
      X.rotate(Eigen::AngleAxisd(0.01, axis));
      rod.tuft->step(X);
    }
  for (int step = 0; step < 2000; ++step) rod.tuft->step(X);
  EXPECT_LT((end_H(X) - before).norm(), 1e-6);
}

TEST_P(WetHairOf, PutsNothingOnTheHandleByItsSet) {
  Cantilever rod(weightless(1, 0.6, 0.05), GetParam());
  rod.tuft->setInk(ink(1));
  rod.load(4e-4);
  const double held = rod.stepFor(2.0);
  ASSERT_GT(held, 5e-3);
  // While it is held the handle holds the load, and its torque, and no more.
  const Eigen::Vector3d arm = rod.tuft->nodePosition(0, kNodes - 1) - Eigen::Vector3d(0, 0, 0.1);
  const Eigen::Vector3d force(0, 0, 4e-4), torque = arm.cross(force);
  EXPECT_LT((rod.tuft->rodWrench(0).head<3>() - force).norm(), 1e-3 * force.norm());
  EXPECT_LT((rod.tuft->rodWrench(0).tail<3>() - torque).norm(), 1e-3 * torque.norm());
  rod.tuft->setInk(ink(0));
  rod.load(0);
  rod.stepFor(3.0);
  EXPECT_LT(rod.tuft->rodWrench(0).head<3>().norm(), 1e-6 * force.norm());
  EXPECT_LT(rod.tuft->rodWrench(0).tail<3>().norm(), 1e-6 * torque.norm());
}

INSTANTIATE_TEST_SUITE_P(Kernels, WetHairOf, testing::Bool(), [](const auto& kernel) {
  return std::string(kernel.param ? "framed" : "plain");
});

TEST(WetHair, RemembersTheSameInBothKernels) {
  // Bent far, out of one plane, and let go.
  std::vector<Eigen::Vector3d> ends;
  for (const bool framed : {false, true}) {
    RodParameters rods = weightless(1, 0.5, 0.1);
    RodModel rod = makeRod(false);
    if (framed) {
      rod.bending_stiffness_2 = rod.twisting_stiffness = rod.bending_stiffness;
      for (double& stiffness : rod.twisting_stiffness) stiffness *= 50;
    }
    const auto tuft = makeTuft(oneRod(rod), rods, inAir());
    const Eigen::Isometry3d X = handleAt({0, 0, 0.1});
    tuft->place(X);
    tuft->setInk(ink(1));
    const auto run = [&](int steps) {
      for (int step = 0; step < steps; ++step) tuft->step(X);
    };
    tuft->setNodeForce(0, kNodes - 1, {1e-3, 0, 5e-4});
    run(300);
    tuft->setNodeForce(0, kNodes / 2, {0, 1e-3, 0});
    run(300);
    tuft->setInk(ink(0));
    for (const int node : {kNodes / 2, kNodes - 1}) tuft->setNodeForce(0, node, {0, 0, 0});
    run(3000);
    ends.push_back(tuft->nodePosition(0, kNodes - 1));
  }
  // It is a long way from straight, and the twist that the plain rod leaves out is little.
  EXPECT_GT((ends[0] - Eigen::Vector3d(0, 0, 0.1 - kReferenceLength)).norm(), 0.01);
  EXPECT_LT((ends[0] - ends[1]).norm(), 1e-3);
}

TEST(WetHair, GivesTheSameBitsWithAnyNumberOfThreads) {
  std::vector<std::uint64_t> hashes;
  for (const int threads : {1, 2}) {
    RodParameters rods;
    rods.threads = threads;
    rods.wet_memory = 0.5;
    rods.wet_memory_time = 0.1;
    const auto tuft = makeTuft(StandardStroke::brush(40, kNodes), rods, ContactParameters{});
    tuft->place(StandardStroke::pose(0));
    for (int step = 1; step < 600; ++step) {
      if (step % 16 == 0) tuft->setInk(ink(1.0 - step / 800.0, 40));
      tuft->step(StandardStroke::pose(0.2 + 0.001 * step));
    }
    hashes.push_back(tuft->hash(1));
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

TEST(WetHair, SleepsWhenItHasComeToRestAndWakesByItsInk) {
  RodParameters rods;
  rods.wet_memory = 0.5;
  rods.wet_memory_time = 0.05;
  const auto tuft = makeTuft(oneRod(makeRod(false)), rods, inAir());
  const Eigen::Isometry3d X = handleAt({0, 0, 0.1}, 1.0);
  tuft->place(X);
  const auto sleepsAfter = [&] {
    for (int step = 0; step < 20000; ++step)
      if (tuft->step(X).solved_rods == 0) return step;
    return -1;
  };
  const int dry = sleepsAfter();
  ASSERT_GT(dry, 0);
  tuft->setInk(ink(0.3 * kSaturationStep));  // too little to notice
  EXPECT_EQ(tuft->step(X).solved_rods, 0);
  tuft->setInk(ink(1.0));
  EXPECT_EQ(tuft->step(X).solved_rods, 1);
  const Eigen::Vector3d before = tuft->nodePosition(0, kNodes - 1);
  EXPECT_GT(sleepsAfter(), 100);
  EXPECT_GT((tuft->nodePosition(0, kNodes - 1) - before).norm(), 1e-3);  // sagged, in its time
  tuft->setInk(ink(1.0));
  EXPECT_EQ(tuft->step(X).solved_rods, 0);
}

TEST(WetHair, StaysCalmInWhatNoHandDoes) {
  // Strong memory, soaked, over schemes, precisions, steps and nodes: pressed, spun, jumped, folded.
  int unconverged = 0, steps = 0;
  for (const char* scheme : {"bdf2", "backward_euler"})  // with sdirk2 such a rod swings on anyway
    for (const char* precision : {"float", "double"})
      for (const double h : {2e-4, 1e-3, 5e-3})
        for (const int nodes : {4, 12, 40})
          for (const double scale : {0.01, 1.0, 100.0}) {
            RodParameters rods;
            rods.scheme = scheme;
            rods.precision = precision;
            rods.time_step = h;
            rods.wet_memory = 0.9;
            rods.wet_memory_time = 0.02;
            BrushModel brush;
            for (const double thick : {1.0, 10.0})
              brush.rods.push_back(makeUniformRod(kReferenceLength, thick * scale * kReferenceBending,
                                                  std::sqrt(thick) * kReferenceDensity, nodes));
            const auto tuft = makeTuft(brush, rods, ContactParameters{});
            const auto pose = [](double t) {
              const double down = std::clamp(t / 0.05, 0.0, 1.0),
                           up = std::clamp((t - 0.2) / 0.02, 0.0, 1.0);
              Eigen::Isometry3d X =
                  handleAt({t > 0.1 ? 0.02 : 0, 0, kReferenceLength + 0.001 - 0.03 * down + 0.05 * up},
                           0.3 + (t > 0.15 ? 1.0 : 0.0));
              X.linear() = Eigen::AngleAxisd(20 * t, Eigen::Vector3d::UnitZ()) * X.linear();
              return X;
            };
            tuft->place(pose(0));
            tuft->setInk(ink(1, 2, nodes));
            double largest = 0, fastest = 0;
            std::vector<Eigen::Vector3d> before(2), now(2);
            for (int step = 1; step * h < 0.75; ++step) {
              const TuftReport report = tuft->step(pose(std::min(step * h, 0.3)));
              unconverged += report.unconverged;
              steps += report.solved_rods;
              for (int rod = 0; rod < 2; ++rod) {
                const auto k = static_cast<std::size_t>(rod);
                now[k] = tuft->nodePosition(rod, nodes - 1);
                ASSERT_TRUE(now[k].allFinite());
                if (step * h > 0.7) fastest = std::max(fastest, (now[k] - before[k]).norm() / h);
                largest = std::max(largest, (now[k] - pose(0.3).translation()).norm());
              }
              before = now;
            }
            EXPECT_LT(largest, 0.2);
            // Half a second after it was lifted it has swung out, as without memory.
            EXPECT_LT(fastest, 0.3) << scheme << " " << precision << " " << h << " " << nodes << " "
                                    << scale;
          }
  EXPECT_LT(unconverged, 0.02 * steps);
}

}  // namespace calligraphy_brush
