#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <new>
#include <vector>

#include "calligraphy_brush/sim/simulator.h"

namespace {
std::atomic<long> allocations{0};
}

// Counts every allocation of the process. Not inlined, or GCC takes new and free for a mismatch.
__attribute__((noinline)) void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
__attribute__((noinline)) void operator delete(void* memory) noexcept {
  std::free(memory);
}
__attribute__((noinline)) void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

using namespace calligraphy_brush;

namespace {

constexpr std::int64_t kStart = 1000000000;

SimulatorParameters smallScene() {
  SimulatorParameters p;
  p.brush.rod_count = 20;
  p.paper.width = 0.12;
  p.paper.height = 0.06;
  return p;
}

/// A press, a drag along +x and a lift, at 125 Hz: pose k.
HandlePose strokePose(const Simulator& simulator, int k) {
  const double length = simulator.brush().tip_length;
  const auto ease = [](double u) { return u <= 0 ? 0.0 : u >= 1 ? 1.0 : u * u * (3 - 2 * u); };
  HandlePose pose;
  pose.stamp_ns = kStart + 8000000LL * k;
  const double depth = -0.005 + 0.013 * ease((k - 5) / 25.0) - 0.013 * ease((k - 100) / 25.0);
  pose.position = {0.02 + 0.06 * ease((k - 10) / 110.0), 0.03, length - depth};
  pose.orientation = Eigen::AngleAxisd(0.2 * ease(k / 60.0), Eigen::Vector3d::UnitY());
  return pose;
}
constexpr int kStrokePoses = 135;

std::uint64_t runStroke(Simulator& simulator, int poses_at_once = 1) {
  for (int k = 0; k < kStrokePoses; ++k) {
    EXPECT_EQ(simulator.addPose(strokePose(simulator, k)), PoseVerdict::kAccepted);
    if (k % poses_at_once == 0) simulator.advance();
  }
  simulator.advance();
  return simulator.stateHash();
}

}  // namespace

TEST(Simulator, WritesAStrokeThatBeginsAndEndsInAPoint) {
  SimulatorParameters p = smallScene();
  p.brush.rod_count = 64;
  Simulator simulator(p);
  runStroke(simulator);
  const Paper& paper = simulator.paper();
  const auto width = [&](int column) {
    double sum = 0;
    for (int row = 0; row < paper.height_px(); ++row) sum += paper.ink(column, row) > 1e-6F;
    return sum * paper.pixelSize();
  };
  int first = paper.width_px(), last = 0;
  double widest = 0;
  for (int column = 0; column < paper.width_px(); ++column) {
    if (width(column) <= 0) continue;
    first = std::min(first, column);
    last = std::max(last, column);
    widest = std::max(widest, width(column));
  }
  EXPECT_GT(widest, 0.002);
  EXPECT_LT(width(last), 0.4 * widest);
  EXPECT_GT((last - first) * paper.pixelSize(), 0.04);
  // Nothing at the rim of the sheet.
  EXPECT_GT(first, 0);
  EXPECT_LT(last, paper.width_px() - 1);
}

TEST(Simulator, LeavesNothingWhileItRestsAboveTheSheet) {
  Simulator simulator(smallScene());
  for (int k = 0; k < 200; ++k) {
    HandlePose pose;
    pose.stamp_ns = kStart + 8000000LL * k;
    pose.position = {0.05, 0.03, simulator.brush().tip_length + 0.001};
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
  }
  EXPECT_EQ(simulator.paper().inkVolume(), 0.0);
  EXPECT_EQ(simulator.report().touching_rods, 0);
}

TEST(Simulator, KeepsTheInkThatTipAndSheetHold) {
  Simulator simulator(smallScene());
  const double before = simulator.report().ink_in_tip;
  runStroke(simulator);
  const double on_sheet = simulator.paper().inkVolume();
  EXPECT_GT(on_sheet, 0.0);
  const Paper& paper = simulator.paper();
  EXPECT_NEAR(simulator.report().ink_in_tip + paper.waterVolume() + paper.evaporatedVolume(), before,
              1e-9 * on_sheet);
  EXPECT_NEAR(simulator.report().pigment_in_tip + on_sheet, before, 1e-9 * on_sheet);
}

TEST(Simulator, GivesTheSameBitsHoweverPosesArriveAndForAnyThreads) {
  for (const bool bundles : {false, true}) {
    SimulatorParameters p = smallScene();
    p.contact.bundles = bundles;
    p.brush.rod_count = 40;
    Simulator one(p);
    const std::uint64_t hash = runStroke(one);
    Simulator in_bunches(p);
    EXPECT_EQ(runStroke(in_bunches, 7), hash) << bundles;
    p.rods.threads = 3;
    Simulator threaded(p);
    EXPECT_EQ(runStroke(threaded), hash) << bundles;
  }
}

TEST(Simulator, StartsAnewAfterReset) {
  for (const bool bundles : {false, true}) {
    SimulatorParameters p = smallScene();
    p.contact.bundles = bundles;
    Simulator simulator(p);
    const std::uint64_t hash = runStroke(simulator);
    simulator.reset();
    EXPECT_EQ(simulator.paper().inkVolume(), 0.0);
    EXPECT_EQ(simulator.report().step_count, 0);
    EXPECT_EQ(runStroke(simulator), hash) << bundles;
  }
}

TEST(Simulator, IsUnchangedByARefusedPose) {
  Simulator with(smallScene()), without(smallScene());
  for (int k = 0; k < kStrokePoses; ++k) {
    HandlePose bad = strokePose(with, k);
    bad.position.x() = std::nan("");
    EXPECT_EQ(with.addPose(bad), PoseVerdict::kNotFinite);
    with.addPose(strokePose(with, k));
    EXPECT_EQ(with.addPose(strokePose(with, k)), PoseVerdict::kNotLater);
    with.advance();
    without.addPose(strokePose(without, k));
    without.advance();
  }
  EXPECT_EQ(with.stateHash(), without.stateHash());
}

TEST(Simulator, PutsTheBrushDownAnewAfterALongGap) {
  // Such as a first stamp of 0 and then that of a clock: not a step for every millisecond since 1970.
  Simulator simulator(smallScene());
  HandlePose pose;
  pose.position = {0.05, 0.03, simulator.brush().tip_length - 0.004};
  ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
  pose.stamp_ns = 1800000000000000000LL;
  pose.position.x() = 0.08;
  HandlePose bad = pose;
  bad.position.z() = std::nan("");
  EXPECT_EQ(simulator.addPose(bad), PoseVerdict::kNotFinite);
  ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
  // It comes from above, as the pose is below where the tip would touch.
  const int descent = simulator.advance();
  EXPECT_EQ(descent, std::lround(0.5 * MotionParameters().hold_after / RodParameters().time_step));
  for (int k = 1; k < 100; ++k) {
    pose.stamp_ns += 8000000;
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
  }
  EXPECT_EQ(simulator.report().step_count, descent + 99 * 8);
  // No line between the two places, and a tip that found its way out of the sheet.
  EXPECT_EQ(simulator.paper().ink(260, 120), 0.0F);
  EXPECT_LT(simulator.report().max_penetration, 1e-4);  // some of them still swing
  EXPECT_TRUE(std::isfinite(simulator.handleWrench().force_P.norm()));
}

TEST(Simulator, BrushIsPutDownElsewhereInTheShapeThatItHas) {
  SimulatorParameters p = smallScene();
  p.contact.bundles = true;
  Simulator simulator(p);
  runStroke(simulator);
  // Leaning in the air, it sags, and remembers how it was bent.
  HandlePose pose = strokePose(simulator, kStrokePoses);
  for (int k = 0; k < 60; ++k) {
    pose.stamp_ns += 8000000;
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
  }
  simulator.advance();
  const auto shape = [&simulator] {
    const HandlePose handle = simulator.handlePose();
    std::vector<Eigen::Vector3d> nodes;
    for (int rod = 0; rod < simulator.rodCount(); ++rod)
      for (int node = 0; node < simulator.nodeCount(); ++node)
        nodes.push_back(handle.orientation.conjugate() *
                        (simulator.nodePosition(rod, node) - handle.position));
    return nodes;
  };
  const auto before = shape();
  const auto farthest = [&before, &shape] {
    const auto now = shape();
    double most = 0.0;
    for (std::size_t i = 0; i < now.size(); ++i) most = std::max(most, (now[i] - before[i]).norm());
    return most;
  };
  pose.stamp_ns += 600000000;
  pose.position += Eigen::Vector3d(0.01, -0.01, 0.002);
  pose.orientation = Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()) * pose.orientation;
  ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
  EXPECT_LT(farthest(), 5e-5);  // what is left of coming to rest
  // It was nearly at rest, and the way to here shook nothing: straight rods would sag by millimetres.
  for (int k = 0; k < 10; ++k) {
    pose.stamp_ns += 8000000;
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
    EXPECT_LT(farthest(), 1e-4) << k;
  }
}

TEST(Simulator, RodsThatTouchFallTogetherTheSameHoweverTheBrushIsHeld) {
  // Before it meets the sheet a wet tuft is as it always is, but for its weight.
  std::vector<std::vector<Eigen::Vector3d>> shapes;
  for (const double turn : {0.0, 1.0, 0.5 * M_PI, 4.0}) {
    SimulatorParameters p = smallScene();
    p.contact.bundles = true;
    Simulator simulator(p);
    HandlePose pose = strokePose(simulator, 0);
    pose.position.z() += 0.02;
    pose.orientation = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()) * pose.orientation;
    for (int k = 0; k < 40; ++k) {
      ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
      pose.stamp_ns += 8000000;
    }
    simulator.advance();
    shapes.emplace_back();
    for (int rod = 0; rod < simulator.rodCount(); ++rod)
      for (int node = 0; node < simulator.nodeCount(); ++node)
        shapes.back().push_back(pose.orientation.conjugate() *
                                (simulator.nodePosition(rod, node) - pose.position));
  }
  for (const auto& shape : shapes)
    for (std::size_t i = 0; i < shape.size(); ++i) EXPECT_LT((shape[i] - shapes[0][i]).norm(), 2e-5);
}

TEST(Simulator, DipsWipesAndClears) {
  Simulator simulator(smallScene());
  simulator.wipe();
  EXPECT_EQ(simulator.report().ink_in_tip, 0.0);
  runStroke(simulator);
  EXPECT_EQ(simulator.paper().inkVolume(), 0.0);  // a dry brush leaves nothing
  simulator.dip();
  EXPECT_NEAR(simulator.report().ink_in_tip, simulator.report().ink_capacity, 1e-18);
  Simulator wet(smallScene());
  runStroke(wet);
  EXPECT_GT(wet.paper().inkVolume(), 0.0);
  wet.clearPaper();
  EXPECT_EQ(wet.paper().inkVolume(), 0.0);
}

TEST(Simulator, PushesTheHandleUpWhilePressed) {
  SimulatorParameters p = smallScene();
  p.rods.gravity = 0;
  Simulator simulator(p);
  double highest = 0;
  for (int k = 0; k < 90; ++k) {
    simulator.addPose(strokePose(simulator, k));
    simulator.advance();
    highest = std::max(highest, simulator.handleWrench().force_P.z());
  }
  EXPECT_GT(highest, 1e-4);
  EXPECT_LT(highest, 10.0);
}

TEST(Simulator, AllocatesNothingInAStep) {
  Simulator simulator(smallScene());
  long during = 0;
  int tiles = 0, steps_with_old_tiles = 0;
  for (int k = 0; k < kStrokePoses; ++k) {
    simulator.addPose(strokePose(simulator, k));
    const long before = allocations;
    simulator.advance();
    // But for ink where there was none yet.
    const int new_tiles = simulator.paper().tileCount() - tiles;
    tiles = simulator.paper().tileCount();
    if (new_tiles == 0) {
      during += allocations - before;
      ++steps_with_old_tiles;
    }
  }
  EXPECT_EQ(during, 0);
  EXPECT_GT(steps_with_old_tiles, kStrokePoses / 2);
}

TEST(Simulator, NamesEveryBadParameterAtOnce) {
  SimulatorParameters p;
  p.brush.tip_length = -1;
  p.rods.time_step = std::nan("");
  p.rods.scheme = "leapfrog";
  p.paper.px_per_mm = 1e9;
  try {
    Simulator simulator(p);
    FAIL() << "accepted";
  } catch (const ParameterError& error) {
    ASSERT_EQ(error.problems().size(), 4U);
    for (const char* name : {"brush/tip_length", "rods/time_step", "rods/scheme", "paper/px_per_mm"})
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << name;
  }
}
