#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/tablet/pointer_brush.h"
#include "tuft_width.h"

// A mouse as the handle of a brush: what it says comes late, in bursts and with a button that has no
// way.

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart_ns = 1'600'000'000'000'000'000;
constexpr double kPressure = 0.4;

/// An upright brush: its point is under its handle.
PointerBrushParameters upright() {
  PointerBrushParameters parameters;
  parameters.grip.tilt = 0.0;
  return parameters;
}

/// A hand with a mouse, and a window that tells of it whenever it has time.
class Hand {
 public:
  explicit Hand(const PointerBrushParameters& parameters = upright(), const BrushOnSheet& brush = {})
      : mouse(parameters, brush) {}

  /// Moves evenly to a place; the window tells every `interval`, give or take half of it.
  void move(const Vector2d& to, double pressure, std::int64_t duration_ns,
            std::int64_t interval_ns = 16 * kMs) {
    std::uniform_real_distribution<double> jitter(-0.5, 0.5);
    const Vector2d from = place;
    const std::int64_t begin_ns = now_ns;
    for (std::int64_t t = 0; t < duration_ns;) {
      t = std::min(duration_ns,
                   t + interval_ns + static_cast<std::int64_t>(jitter(random) * double(interval_ns)));
      wait(begin_ns + t - now_ns);
      place = from + double(t) / double(duration_ns) * (to - from);
      EXPECT_TRUE(mouse.point(now_ns, place, pressure));
    }
  }
  void press(double pressure) { EXPECT_TRUE(mouse.point(now_ns, place, pressure)); }

  /// Time goes by; poses are asked for every 5 to 30 ms.
  void wait(std::int64_t duration_ns) {
    std::uniform_int_distribution<std::int64_t> step(5 * kMs, 30 * kMs);
    for (const std::int64_t end_ns = now_ns + duration_ns; now_ns < end_ns;) {
      now_ns = std::min(end_ns, now_ns + step(random));
      const auto given = mouse.advanceTo(now_ns);
      poses.insert(poses.end(), given.begin(), given.end());
    }
  }

  PointerBrush mouse;
  std::int64_t now_ns = kStart_ns;
  Vector2d place{0.08, 0.15};
  std::vector<HandlePose> poses;
  std::mt19937 random{4};
};

/// How far the point of the undeformed tip is above the sheet [m], the brush being upright.
double height(const HandlePose& pose) {
  return pose.position.z() - BrushOnSheet().tip_length;
}

/// Hovers, presses, draws a line of 120 mm in a second, lifts, hovers.
void writeLine(Hand& hand, std::int64_t interval_ns = 16 * kMs) {
  hand.move({0.09, 0.15}, 0.0, 200 * kMs);
  hand.press(kPressure);
  hand.wait(120 * kMs);
  hand.move({0.21, 0.15}, kPressure, 1000 * kMs, interval_ns);
  hand.wait(60 * kMs);
  hand.press(0.0);
  hand.wait(100 * kMs);
  hand.move({0.24, 0.2}, 0.0, 200 * kMs);
}

TEST(Pointer, PosesAreEvenlySpacedHoweverTheMouseTells) {
  Hand hand;
  writeLine(hand);
  ASSERT_GT(hand.poses.size(), 300U);
  for (std::size_t k = 1; k < hand.poses.size(); ++k)
    ASSERT_EQ(hand.poses[k].stamp_ns - hand.poses[k - 1].stamp_ns, 5 * kMs) << k;
}

TEST(Pointer, EqualEventsGiveEqualPosesHoweverOftenTheyAreAskedFor) {
  PointerBrush often({}, {}), seldom({}, {});
  std::vector<HandlePose> a, b;
  for (int k = 0; k < 100; ++k) {
    const std::int64_t now_ns = kStart_ns + k * 20 * kMs;
    const Vector2d place(0.1 + 0.001 * k, 0.1 + 0.02 * std::sin(0.1 * k));
    for (PointerBrush* mouse : {&often, &seldom})
      mouse->point(now_ns, place, k > 20 && k < 80 ? 0.5 : 0.0);
    for (int ms = 1; ms <= 20; ++ms)
      for (const HandlePose& pose : often.advanceTo(now_ns + ms * kMs)) a.push_back(pose);
    for (const HandlePose& pose : seldom.advanceTo(now_ns + 20 * kMs)) b.push_back(pose);
  }
  ASSERT_EQ(a.size(), b.size());
  ASSERT_GT(a.size(), 380U);
  for (std::size_t k = 0; k < a.size(); ++k) {
    EXPECT_EQ(a[k].stamp_ns, b[k].stamp_ns);
    EXPECT_EQ(a[k].position, b[k].position);
  }
}

TEST(Pointer, HoversAtTheClearanceWhileTheButtonIsUp) {
  Hand hand;
  hand.move({0.2, 0.1}, 0.0, 500 * kMs);
  hand.wait(900 * kMs);  // A tuft that is carried swings, and is held higher.
  ASSERT_FALSE(hand.poses.empty());
  for (const HandlePose& pose : hand.poses)
    EXPECT_GE(height(pose), TabletPressureParameters().clearance - 1e-12);
  EXPECT_NEAR(height(hand.poses.back()), TabletPressureParameters().clearance, 1e-4);
  EXPECT_NEAR((hand.poses.back().position.head<2>() - Vector2d(0.2, 0.1)).norm(), 0.0, 1e-6);
}

TEST(Pointer, PressesToTheDepthThatIsAskedForAndNoDeeper) {
  Hand hand;
  writeLine(hand);
  const double depth = PointerBrushParameters().pressure.full_depth * BrushOnSheet().tip_length *
                       (kPressure - 0.01) / 0.99;
  double lowest = 1.0;
  for (const HandlePose& pose : hand.poses) lowest = std::min(lowest, height(pose));
  EXPECT_NEAR(lowest, -depth, 1e-5);
}

TEST(Pointer, ApproachAndLiftHaveNoJump) {
  for (const std::int64_t interval_ns : {4 * kMs, 16 * kMs, 45 * kMs}) {
    Hand hand;
    writeLine(hand, interval_ns);
    double largest_way = 0.0, fastest_down = 0.0, fastest_up = 0.0, sharpest = 0.0;
    Vector2d velocity_before = Vector2d::Zero();
    for (std::size_t k = 1; k < hand.poses.size(); ++k) {
      const Eigen::Vector3d velocity = (hand.poses[k].position - hand.poses[k - 1].position) / 0.005;
      largest_way = std::max(largest_way, velocity.head<2>().norm());
      fastest_down = std::max(fastest_down, -velocity.z());
      fastest_up = std::max(fastest_up, velocity.z());
      sharpest = std::max(sharpest, (velocity.head<2>() - velocity_before).norm() / 0.005);
      velocity_before = velocity.head<2>();
    }
    // The hand goes at 0.12 m/s when it writes and 0.4 m/s in the air.
    EXPECT_LT(largest_way, 0.8) << interval_ns;
    EXPECT_LT(fastest_down, 0.3) << interval_ns;
    EXPECT_LT(fastest_up, 2.0) << interval_ns;  // pressure/lift: two depths within 15 ms
    EXPECT_LT(sharpest, 40.0) << interval_ns;   // [m/s²]: 0.4 m/s in 10 ms
  }
}

TEST(Pointer, AnEvenLineIsDrawnEvenly) {
  // Told every 16 ms give or take 8, as by a window that draws: each place is told when it is there, so
  // the line is even up to the corners that the smoothing rounds.
  Hand hand;
  hand.move({0.09, 0.15}, kPressure, 300 * kMs);
  const std::size_t begin = hand.poses.size() + 30;
  hand.move({0.21, 0.15}, kPressure, 1000 * kMs);
  for (std::size_t k = begin; k < hand.poses.size(); ++k)
    EXPECT_NEAR((hand.poses[k].position - hand.poses[k - 1].position).norm() / 0.005, 0.12, 0.002) << k;
  hand.wait(300 * kMs);
  EXPECT_NEAR(hand.poses.back().position.x(), 0.21, 1e-6);
}

TEST(Pointer, APauseIsNotAWay) {
  // A mouse that rests tells nothing: when it moves on the brush must not have crept ahead.
  Hand hand;
  hand.press(kPressure);
  hand.wait(500 * kMs);
  const Vector2d rest = hand.poses.back().position.head<2>();
  const std::size_t before = hand.poses.size();
  hand.wait(400 * kMs);
  hand.place.x() += 0.01;
  hand.press(kPressure);
  hand.wait(10 * kMs);
  for (std::size_t k = before; k < hand.poses.size(); ++k) {
    EXPECT_LT((hand.poses[k].position.head<2>() - rest).norm(), 0.002);
  }
  EXPECT_EQ(hand.poses[before + 70].position.head<2>(), rest);
  hand.wait(300 * kMs);
  EXPECT_NEAR(hand.poses.back().position.x(), hand.place.x(), 1e-6);
}

TEST(Pointer, FollowsAJumpOfTheMouseNoFasterThanItMay) {
  PointerBrushParameters parameters = upright();
  parameters.motion.max_speed = 0.5;
  Hand hand(parameters);
  hand.press(kPressure);
  hand.wait(300 * kMs);
  hand.place = {0.25, 0.25};
  hand.press(kPressure);
  hand.wait(800 * kMs);
  for (std::size_t k = 1; k < hand.poses.size(); ++k) {
    const auto way = hand.poses[k].position.head<2>() - hand.poses[k - 1].position.head<2>();
    EXPECT_LE(way.norm(), 0.5 * 0.005 + 1e-12);
  }
  EXPECT_NEAR((hand.poses.back().position.head<2>() - hand.place).norm(), 0.0, 1e-4);
}

TEST(Pointer, StopsWhenNobodyMovesItAndBeginsWhereItComesBack) {
  Hand hand;
  hand.move({0.1, 0.1}, 0.0, 200 * kMs);
  hand.wait(3000 * kMs);
  EXPECT_FALSE(hand.mouse.isInUse());
  const std::size_t count = hand.poses.size();
  EXPECT_LT(count, 270U);  // 0.2 s + idle_after
  hand.place = {0.25, 0.2};
  hand.press(0.0);
  hand.wait(50 * kMs);
  ASSERT_GT(hand.poses.size(), count + 2);
  // One pose ends the motion before the pause, the rest is at the new place.
  for (std::size_t k = count + 1; k < hand.poses.size(); ++k)
    EXPECT_EQ(hand.poses[k].position.head<2>(), hand.place);
  // A button that is held down does not rest.
  hand.press(kPressure);
  hand.wait(3000 * kMs);
  EXPECT_TRUE(hand.mouse.isInUse());
  EXPECT_LT(height(hand.poses.back()), 0.0);
}

TEST(Pointer, LeavingLiftsTheBrush) {
  Hand hand;
  hand.press(kPressure);
  hand.wait(400 * kMs);
  ASSERT_LT(height(hand.poses.back()), -0.004);
  const auto last = hand.mouse.leave(hand.now_ns);
  ASSERT_FALSE(last.empty());
  EXPECT_GE(height(last.back()), TabletPressureParameters().clearance - 1e-12);
  EXPECT_FALSE(hand.mouse.isInUse());
  EXPECT_TRUE(hand.mouse.leave(hand.now_ns + kMs).empty());
}

TEST(Pointer, AWindowThatHangsLiftsTheBrush) {
  Hand hand;
  hand.press(kPressure);
  hand.wait(400 * kMs);
  const auto late = hand.mouse.advanceTo(hand.now_ns + 2000 * kMs);
  ASSERT_FALSE(late.empty());
  EXPECT_LE(late.size(), 25U);  // a way up of 0.1 s at most
  EXPECT_GE(height(late.back()), TabletPressureParameters().clearance - 1e-12);
  // And a clock that is set back.
  hand.now_ns -= 5000 * kMs;
  hand.press(kPressure);
  hand.wait(300 * kMs);
  for (std::size_t k = 1; k < hand.poses.size(); ++k)
    ASSERT_GT(hand.poses[k].stamp_ns, hand.poses[k - 1].stamp_ns);
}

TEST(Pointer, WhatIsNotFiniteIsRefusedAndChangesNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  PointerBrush mouse(upright(), {});
  EXPECT_FALSE(mouse.point(kStart_ns, {nan, 0.1}, 0.0));
  EXPECT_FALSE(mouse.point(kStart_ns, {0.1, 0.1}, nan));
  EXPECT_FALSE(mouse.point(kStart_ns, {0.1, std::numeric_limits<double>::infinity()}, 0.0));
  EXPECT_FALSE(mouse.isInUse());
  // Far away is cut to the margin, too hard to full pressure.
  EXPECT_TRUE(mouse.point(kStart_ns, {7.0, -7.0}, 55.0));
  std::vector<HandlePose> poses;
  for (int k = 1; k < 200; ++k) {
    mouse.point(kStart_ns + k * 5 * kMs, {7.0, -7.0}, 55.0);
    for (const HandlePose& pose : mouse.advanceTo(kStart_ns + k * 5 * kMs)) poses.push_back(pose);
  }
  EXPECT_NEAR(poses.back().position.x(), 0.33, 1e-9);
  EXPECT_NEAR(poses.back().position.y(), -0.03, 1e-9);
  EXPECT_NEAR(height(poses.back()), -0.3 * 0.045, 1e-6);
}

TEST(Pointer, BadParametersAreNamed) {
  PointerBrushParameters parameters;
  parameters.motion.rate = 0.0;
  parameters.pressure.full_depth = 2.0;
  parameters.grip.tilt = std::numeric_limits<double>::quiet_NaN();
  try {
    PointerBrush(parameters, {});
    FAIL() << "taken";
  } catch (const ParameterError& error) {
    ASSERT_EQ(error.problems().size(), 3U) << error.what();
    EXPECT_EQ(error.problems()[0], "motion/rate = 0 is outside [20, 1000] Hz");
    EXPECT_EQ(error.problems()[1].rfind("pressure/full_depth = 2 ", 0), 0U);
    EXPECT_EQ(error.problems()[2].rfind("grip/tilt = ", 0), 0U);
  }
}

TEST(Pointer, WritesALineWithoutABlotAndNothingBesideIt) {
  SimulatorParameters parameters;
  parameters.paper.width = 0.16;
  parameters.paper.height = 0.06;
  parameters.paper.px_per_mm = 8.0;
  for (const double pressure : {0.3, 0.6, 1.0})
    for (const std::int64_t rest_ns : {0 * kMs, 100 * kMs, 400 * kMs}) {
      SCOPED_TRACE(testing::Message()
                   << "pressure " << pressure << ", moved after " << rest_ns << " ns");
      Simulator simulator(parameters);
      BrushOnSheet sheet;
      sheet.width = parameters.paper.width;
      sheet.height = parameters.paper.height;
      Hand hand({}, sheet);
      hand.place = {0.01, 0.05};
      hand.move({0.03, 0.03}, 0.0, 300 * kMs);
      hand.press(pressure);
      hand.wait(rest_ns);
      const std::int64_t moves_ns = hand.now_ns + 200 * kMs;
      hand.move({0.13, 0.03}, pressure, 1000 * kMs, 33 * kMs);
      hand.press(0.0);
      const std::int64_t lifts_ns = hand.now_ns;
      hand.wait(200 * kMs);
      hand.move({0.05, 0.05}, 0.0, 300 * kMs);   // through the air
      std::vector<double> at_touch_down, along;  // widths of the tuft [m]
      for (const HandlePose& pose : hand.poses) {
        ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
        simulator.advance();
        // Not yet lifted.
        const double width = pose.stamp_ns < lifts_ns ? widthOnSheet(simulator) : 0.0;
        if (width > 0.0) (pose.stamp_ns < moves_ns ? at_touch_down : along).push_back(width);
      }
      ASSERT_GT(at_touch_down.size(), 10U);
      ASSERT_GT(along.size(), 100U);
      std::nth_element(along.begin(), along.begin() + 50, along.end());
      EXPECT_LE(*std::max_element(at_touch_down.begin(), at_touch_down.end()), 1.5 * along[50])
          << "a blot";
      EXPECT_GT(along[50], 0.001);

      std::vector<std::uint8_t> picture;
      simulator.paper().render(picture);
      const int columns = simulator.paper().width_px(), rows = simulator.paper().height_px();
      int first = columns, last = 0, top = rows, bottom = 0;  // of the ink
      for (int column = 0; column < columns; ++column)
        for (int row = 0; row < rows; ++row)
          if (picture[static_cast<std::size_t>(row * columns + column)] < 200) {
            first = std::min(first, column);
            last = column;
            top = std::min(top, row);
            bottom = std::max(bottom, row);
          }
      if (const char* folder = std::getenv("CALLIGRAPHY_PICTURES"))
        writePng(std::string(folder) + "/pointer_" + std::to_string(pressure) + "_" +
                     std::to_string(rest_ns / kMs) + ".png",
                 columns, rows, picture, parameters.paper.px_per_mm);
      // The tip begins at the upper left of the place and trails it by less than its length.
      EXPECT_GT(first, 8 * (30 - 15));
      EXPECT_GT(last - first, 8 * 90);
      EXPECT_LT(last, 8 * (130 + 15));
      EXPECT_GT(top, 8 * (30 - 15)) << "ink beside the line";
      EXPECT_LT(bottom, 8 * (30 + 10)) << "ink beside the line";
    }
}

}  // namespace
}  // namespace calligraphy_brush
