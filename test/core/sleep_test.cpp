#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "../benchmark/standard_stroke.h"
#include "rod_scene.h"

using namespace calligraphy_brush;

namespace {

constexpr int kRods = 40, kNodes = 12;
constexpr int kMost = 6000;  // steps in which a tuft comes to rest

std::unique_ptr<Tuft> makeScene(RodParameters rods) {
  auto tuft = makeTuft(StandardStroke::brush(kRods, kNodes), rods, ContactParameters{});
  tuft->place(StandardStroke::pose(0));
  return tuft;
}

/// Pressed and drawn along; the drag ends, and the handle stays, at 0.7 s.
Eigen::Isometry3d pose(int step) {
  return StandardStroke::pose(std::min(0.7, 0.2 + 0.001 * step));
}

/// Steps until no rod is solved any more, or −1.
int fallAsleep(Tuft& tuft, int first) {
  for (int step = first; step < kMost; ++step)
    if (tuft.step(pose(step)).solved_rods == 0) return step;
  return -1;
}

double largestDifference(const Tuft& a, const Tuft& b) {
  double largest = 0;
  for (int rod = 0; rod < kRods; ++rod)
    for (int node = 0; node < kNodes; ++node)
      largest = std::max(largest, (a.nodePosition(rod, node) - b.nodePosition(rod, node)).norm());
  return largest;
}

}  // namespace

class Sleep : public testing::TestWithParam<const char*> {};

TEST_P(Sleep, SavesEveryStepAtRestAndMovesNothing) {
  RodParameters with, without;
  with.precision = without.precision = GetParam();
  without.sleep = 0;
  const auto a = makeScene(with), b = makeScene(without);
  const int asleep = fallAsleep(*a, 1);
  ASSERT_GT(asleep, 500);
  for (int step = 1; step <= asleep; ++step) EXPECT_EQ(b->step(pose(step)).solved_rods, kRods);
  // Awake or asleep, as far as the reports say. Ten times the motion in 32 steps that counts as rest.
  EXPECT_LT(largestDifference(*a, *b), 10 * with.sleep);
  for (int step = asleep; step < asleep + 5000; ++step) {
    EXPECT_EQ(a->step(pose(step)).solved_rods, 0);
    b->step(pose(step));
  }
  EXPECT_LT(largestDifference(*a, *b), 10 * with.sleep);
  double force = 0, error = 0;
  for (int rod = 0; rod < kRods; ++rod) {
    force += a->rodWrench(rod).head<3>().norm();
    error += (a->rodWrench(rod) - b->rodWrench(rod)).head<3>().norm();
  }
  EXPECT_LT(error, 1e-3 * force);
  // And lifted off again.
  for (int step = 0; step < 600; ++step) {
    const Eigen::Isometry3d X = StandardStroke::pose(0.7 + 0.001 * step);
    EXPECT_EQ(a->step(X).solved_rods, step == 0 ? 0 : kRods);
    b->step(X);
  }
  EXPECT_LT(largestDifference(*a, *b), 1e-5);
}

INSTANTIATE_TEST_SUITE_P(Precisions, Sleep, testing::Values("float", "double"));

TEST(Sleep, EndsWithAnyChange) {
  const auto tuft = makeScene(RodParameters{});
  ASSERT_GT(fallAsleep(*tuft, 1), 0);
  // A load on a node: of its batch only.
  tuft->setNodeForce(0, kNodes - 1, {1e-5, 0, 0});
  const int woken = tuft->step(pose(kMost)).solved_rods;
  EXPECT_GT(woken, 0);
  EXPECT_LE(woken, 16);
  ASSERT_GT(fallAsleep(*tuft, 1), 0);
  // The handle, by a bit.
  Eigen::Isometry3d X = pose(kMost);
  X.translation().x() = std::nextafter(X.translation().x(), 1.0);
  EXPECT_EQ(tuft->step(X).solved_rods, kRods);
  ASSERT_GT(fallAsleep(*tuft, 1), 0);
  tuft->place(pose(kMost));
  EXPECT_EQ(tuft->step(pose(kMost)).solved_rods, kRods);
}

TEST(Sleep, DoesNotTakeATurningPointForRest) {
  // A rod that swings without damping, through every turning point.
  RodParameters rods;
  rods.damping = 0;
  rods.precision = "double";
  ContactParameters contact;
  contact.paper = false;
  const auto tuft = makeTuft(referenceRod(kNodes), rods, contact);
  const Eigen::Isometry3d X = handleAt({0, 0, 0.1}, 1.0);
  tuft->place(X);
  for (int step = 0; step < 2000; ++step) ASSERT_EQ(tuft->step(X).solved_rods, 1);
}
