#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>
#include <string>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/sim/simulator.h"
#include "calligraphy_brush/writing/brush_curve.h"
#include "calligraphy_brush/writing/trajectory.h"
#include "calligraphy_brush/writing/waypoint_curve.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
constexpr double kTipLength = 0.045;
constexpr double kPi = 3.14159265358979323846;

StrokePoint pressed(double x, double y, double depth) {
  StrokePoint point;
  point.x = x;
  point.y = y;
  point.depth = depth;
  return point;
}

StrokePoint wide(double x, double y, double width) {
  StrokePoint point;
  point.x = x;
  point.y = y;
  point.width = width;
  return point;
}

/// Depth of a pose as the stroke file defines it [m].
double depthOf(const HandlePose& pose) {
  return kTipLength - pose.position.z();
}

double distanceToPath(const std::vector<HandlePose>& poses, const Vector3d& point) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k < poses.size(); ++k) {
    const Vector3d a = poses[k - 1].position, ab = poses[k].position - a;
    const double t =
        ab.squaredNorm() > 0 ? std::clamp((point - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0) : 0.0;
    least = std::min(least, (point - a - t * ab).norm());
  }
  return least;
}

const std::vector<Stroke> kTwoStrokes{
    {"bar",
     {pressed(0.10, 0.10, 0.0), pressed(0.12, 0.10, 0.006), pressed(0.16, 0.11, 0.003),
      pressed(0.18, 0.11, 0.0)}},
    {"corner", {pressed(0.10, 0.08, 0.002), pressed(0.14, 0.08, 0.004), pressed(0.14, 0.04, 0.004)}}};

const BrushCurve kCurve({{0.001, 0.001, 0.002}, {0.004, 0.004, 0.005}, {0.010, 0.009, 0.009}});

TEST(HandleOrientation, UprightIsTheIdentityWhateverTheAzimuth) {
  for (const double azimuth : {0.0, 1.0, -2.0})
    EXPECT_LT(handleOrientation(0.0, azimuth, 0.0).angularDistance(Eigen::Quaterniond::Identity()),
              1e-12);
}

TEST(HandleOrientation, TheUpperEndLeansTowardsTheAzimuthAndTwistLeavesTheShaft) {
  for (const double azimuth : {0.0, 0.7, 2.5, -1.9})
    for (const double twist : {0.0, 0.9}) {
      const Vector3d shaft = handleOrientation(0.3, azimuth, twist) * Vector3d::UnitZ();
      const Vector3d expected(std::sin(0.3) * std::cos(azimuth), std::sin(0.3) * std::sin(azimuth),
                              std::cos(0.3));
      EXPECT_LT((shaft - expected).norm(), 1e-12);
    }
  EXPECT_NEAR(handleOrientation(0.3, 0.5, 0.9).angularDistance(handleOrientation(0.3, 0.5, 0.0)), 0.9,
              1e-12);
}

TEST(HandlePose, DepthIsBelowTheHeightOfFirstTouch) {
  EXPECT_DOUBLE_EQ(handlePoseAt(pressed(0.1, 0.2, 0.004), kTipLength).position.z(), kTipLength - 0.004);
  StrokePoint leaning = pressed(0.1, 0.2, 0.004);
  leaning.tilt = 0.4;
  leaning.azimuth = 1.1;
  const HandlePose pose = handlePoseAt(leaning, kTipLength);
  EXPECT_NEAR(pose.position.z(), kTipLength - 0.004, 1e-12);
  // The point of the undeformed brush is over (x, y).
  const Vector3d tip = pose.position - kTipLength * (pose.orientation * Vector3d::UnitZ());
  EXPECT_NEAR(tip.x(), 0.1, 1e-12);
  EXPECT_NEAR(tip.y(), 0.2, 1e-12);
}

TEST(Plan, BeginsAndEndsInTheAirAndIsUprightWithoutTilt) {
  const auto poses = planHandlePoses(kTwoStrokes, WritingParameters(), kTipLength);
  EXPECT_NEAR(depthOf(poses.front()), -WritingParameters().clearance, 1e-9);
  EXPECT_NEAR(depthOf(poses.back()), -WritingParameters().clearance, 1e-9);
  for (const HandlePose& pose : poses)
    EXPECT_LT(pose.orientation.angularDistance(Eigen::Quaterniond::Identity()), 1e-9);
}

TEST(Plan, StampsAreAtTheRateFromAFixedEpoch) {
  for (const double rate : {125.0, 60.0, 1000.0}) {
    WritingParameters parameters;
    parameters.rate = rate;
    const auto poses = planHandlePoses(kTwoStrokes, parameters, kTipLength);
    EXPECT_EQ(poses.front().stamp_ns, kWritingEpoch_ns);
    for (std::size_t k = 1; k < poses.size(); ++k)
      ASSERT_EQ(poses[k].stamp_ns - poses[k - 1].stamp_ns, std::llround(1e9 / rate));
  }
}

TEST(Plan, GoesThroughEveryPoint) {
  WritingParameters parameters;
  parameters.rate = 1000.0;
  const auto poses = planHandlePoses(kTwoStrokes, parameters, kTipLength);
  for (const Stroke& stroke : kTwoStrokes)
    for (const StrokePoint& point : stroke.points)
      EXPECT_LT(distanceToPath(poses, handlePoseAt(point, kTipLength).position), 2e-5)
          << point.x << " " << point.y << " " << *point.depth;
}

TEST(Plan, LiftsBetweenStrokes) {
  const auto poses = planHandlePoses(kTwoStrokes, WritingParameters(), kTipLength);
  // On the way from one stroke to the next the tip is as high as the clearance.
  bool crossed = false;
  for (const HandlePose& pose : poses)
    crossed = crossed || (std::abs(pose.position.y() - 0.095) < 0.003 && depthOf(pose) < -0.0119);
  EXPECT_TRUE(crossed);
}

TEST(Plan, NeverGoesDeeperOrHigherThanAsked) {
  for (const HandlePose& pose : planHandlePoses(kTwoStrokes, WritingParameters(), kTipLength)) {
    EXPECT_LE(depthOf(pose), 0.006 + 1e-12);
    EXPECT_GE(depthOf(pose), -WritingParameters().clearance - 1e-12);
  }
}

TEST(Plan, KeepsSpeedAndAcceleration) {
  WritingParameters parameters;
  parameters.rate = 1000.0;
  const auto poses = planHandlePoses(kTwoStrokes, parameters, kTipLength);
  const double dt = 1e-3;
  Vector3d before = Vector3d::Zero();
  double fastest_change = 0.0;
  for (std::size_t k = 1; k < poses.size(); ++k) {
    const Vector3d velocity = (poses[k].position - poses[k - 1].position) / dt;
    EXPECT_LE(velocity.norm(), parameters.air_speed * 1.001);
    if (depthOf(poses[k]) > 0.0 && poses[k].position.y() > 0.0999) {  // drawing, not lifting off
      EXPECT_LE(velocity.norm(), 0.0505);
    }
    if (k > 1) fastest_change = std::max(fastest_change, (velocity - before).norm());
    before = velocity;
  }
  // C1: along and across the path at once, and no jump of the velocity.
  EXPECT_LE(fastest_change / dt, 2.0 * parameters.acceleration);
}

TEST(Plan, SlowsDownInASharpTurn) {
  const std::vector<Stroke> corner{
      {"corner", {pressed(0.1, 0.1, 0.003), pressed(0.14, 0.1, 0.003), pressed(0.1, 0.101, 0.003)}}};
  double slowest = 1.0;
  const auto poses = planHandlePoses(corner, WritingParameters(), kTipLength);
  for (std::size_t k = 1; k < poses.size(); ++k)
    if (poses[k].position.x() > 0.135)
      slowest = std::min(slowest, (poses[k].position - poses[k - 1].position).norm() / 0.008);
  EXPECT_LT(slowest, 0.025);
}

TEST(Plan, ReachesPointsAtTheirTimesExactly) {
  Stroke stroke{"timed",
                {pressed(0.10, 0.10, 0.001), pressed(0.12, 0.11, 0.005), pressed(0.15, 0.10, 0.002)}};
  stroke.points[0].time = 0.0;
  stroke.points[1].time = 0.4;
  stroke.points[2].time = 1.2;
  const auto poses = planHandlePoses({stroke}, WritingParameters(), kTipLength);
  const auto start =
      std::min_element(poses.begin(), poses.end(), [&](const HandlePose& a, const HandlePose& b) {
        const Vector3d p = handlePoseAt(stroke.points[0], kTipLength).position;
        return (a.position - p).norm() < (b.position - p).norm();
      });
  for (const StrokePoint& point : stroke.points) {
    const auto pose = start + std::lround(*point.time * 125.0);
    EXPECT_LT((pose->position - handlePoseAt(point, kTipLength).position).norm(), 1e-9) << *point.time;
  }
}

TEST(Plan, WaitsWhereAPointIsGivenTwice) {
  Stroke stroke{"wait",
                {pressed(0.10, 0.10, 0.003), pressed(0.12, 0.10, 0.003), pressed(0.12, 0.10, 0.003),
                 pressed(0.14, 0.10, 0.003)}};
  const double times[] = {0.0, 0.4, 0.8, 1.2};
  for (std::size_t k = 0; k < 4; ++k) stroke.points[k].time = times[k];
  const auto poses = planHandlePoses({stroke}, WritingParameters(), kTipLength);
  int waiting = 0;
  for (const HandlePose& pose : poses)
    waiting += (pose.position - handlePoseAt(stroke.points[1], kTipLength).position).norm() < 1e-6;
  EXPECT_GE(waiting, 50);
}

TEST(Plan, RefusesTimesThatNoHandCanKeep) {
  Stroke stroke{"fast", {pressed(0.1, 0.1, 0.001), pressed(0.2, 0.1, 0.001)}};
  stroke.points[0].time = 0.0;
  stroke.points[1].time = 0.01;
  EXPECT_THROW(planHandlePoses({stroke}, WritingParameters(), kTipLength), std::invalid_argument);
}

TEST(Plan, KeepsAnApproachThatIsGiven) {
  const std::vector<Stroke> given{
      {"given", {pressed(0.10, 0.10, -0.02), pressed(0.10, 0.10, 0.002), pressed(0.15, 0.10, -0.02)}}};
  const auto poses = planHandlePoses(given, WritingParameters(), kTipLength);
  EXPECT_LT((poses.front().position - Vector3d(0.10, 0.10, kTipLength + 0.02)).norm(), 1e-9);
  EXPECT_LT((poses.back().position - Vector3d(0.15, 0.10, kTipLength + 0.02)).norm(), 1e-9);
}

TEST(Plan, TurnsSmoothlyBetweenTiltsAcrossTheWrapOfTheAzimuth) {
  Stroke stroke{"lean", {pressed(0.10, 0.10, 0.003), pressed(0.14, 0.10, 0.003)}};
  stroke.points[0].tilt = stroke.points[1].tilt = 0.3;
  stroke.points[0].azimuth = 3.1;
  stroke.points[1].azimuth = -3.1;
  for (const HandlePose& pose : planHandlePoses({stroke}, WritingParameters(), kTipLength))
    EXPECT_LT(pose.orientation.angularDistance(handleOrientation(0.3, kPi, 0.0)), 0.05);
}

TEST(Plan, ASinglePointIsADot) {
  const auto poses =
      planHandlePoses({{"dot", {pressed(0.1, 0.1, 0.004)}}}, WritingParameters(), kTipLength);
  double deepest = 0.0;
  for (const HandlePose& pose : poses) {
    EXPECT_TRUE(pose.position.allFinite());
    deepest = std::max(deepest, depthOf(pose));
  }
  EXPECT_NEAR(deepest, 0.004, 1e-4);
}

TEST(Plan, EveryPoseIsAcceptedByTheTrack) {
  std::vector<Stroke> strokes = kTwoStrokes;
  strokes.push_back(
      {"wide", {wide(0.1, 0.1, 0.001), wide(0.12, 0.12, 0.006), wide(0.12, 0.08, 0.0001)}});
  PoseTrack track{MotionParameters()};
  for (const HandlePose& pose : planHandlePoses(strokes, WritingParameters(), kTipLength, &kCurve))
    ASSERT_EQ(track.add(pose), PoseVerdict::kAccepted);
}

TEST(Plan, WithoutCompensationWidthIsDepthOfTheCurveOnTheMark) {
  WritingParameters parameters;
  parameters.rate = 1000.0;
  parameters.lag_compensation = false;
  parameters.lean = 0.0;
  const std::vector<Stroke> strokes{
      {"w", {wide(0.1, 0.1, 0.002), wide(0.12, 0.1, 0.006), wide(0.15, 0.1, 0.003)}}};
  const auto poses = planHandlePoses(strokes, parameters, kTipLength, &kCurve);
  for (const StrokePoint& point : strokes[0].points)
    EXPECT_LT(distanceToPath(poses, {point.x, point.y, kTipLength - kCurve.depth(*point.width)}), 2e-5);
  for (const HandlePose& pose : poses) EXPECT_NEAR(pose.position.y(), 0.1, 1e-9);
}

TEST(Plan, CompensationLeadsByThePartOfTheLagAndStopsAtTheEnd) {
  WritingParameters parameters;
  parameters.rate = 1000.0;
  parameters.lean = 0.0;
  const std::vector<Stroke> bar{{"w", {wide(0.1, 0.1, 0.004), wide(0.2, 0.1, 0.004)}}};
  const auto poses = planHandlePoses(bar, parameters, kTipLength, &kCurve);
  const double depth = kCurve.depth(0.004), lag = kCurve.lag(depth);
  double first = 1.0, last = 0.0;  // of the fully pressed way
  for (const HandlePose& pose : poses) {
    if (depthOf(pose) < depth - 1e-6) continue;
    first = std::min(first, pose.position.x());
    last = std::max(last, pose.position.x());
  }
  EXPECT_NEAR(first, 0.1 + lag, 2e-4);
  EXPECT_NEAR(last, 0.2, 2e-4);
}

TEST(Plan, CompensationLeadsAroundTheOutsideOfATurn) {
  Stroke arc{"arc", {}};
  for (int k = 0; k <= 24; ++k)
    arc.points.push_back(wide(0.03 * std::cos(0.1 * k), 0.03 * std::sin(0.1 * k), 0.006));
  WritingParameters parameters;
  parameters.lean = 0.0;
  const auto poses = planHandlePoses({arc}, parameters, kTipLength, &kCurve);
  const double lead = WritingParameters().lead * kCurve.lag(kCurve.depth(0.006));
  int in_turn = 0;
  for (const HandlePose& pose : poses) {
    const double angle = std::atan2(pose.position.y(), pose.position.x());
    if (angle < 1.2 || angle > 1.8) continue;
    EXPECT_NEAR(pose.position.head<2>().norm(), std::hypot(0.03, lead), 3e-4);
    ++in_turn;
  }
  EXPECT_GT(in_turn, 20);
}

TEST(Plan, LeansTheWayAStrokeByWidthGoesUnlessItHasATilt) {
  Stroke stroke{"w", {wide(0.1, 0.1, 0.004), wide(0.1, 0.2, 0.004)}};
  const auto lean = [&] {
    const auto poses = planHandlePoses({stroke}, WritingParameters(), kTipLength, &kCurve);
    return Vector3d(poses[poses.size() / 2].orientation * Vector3d::UnitZ());
  };
  EXPECT_LT(
      (lean() - Vector3d(0.0, std::sin(WritingParameters().lean), std::cos(WritingParameters().lean)))
          .norm(),
      1e-6);
  for (StrokePoint& point : stroke.points) point.tilt = 0.3;
  EXPECT_LT((lean() - Vector3d(std::sin(0.3), 0.0, std::cos(0.3))).norm(), 1e-6);
}

TEST(Plan, RefusesWhatItCannotWrite) {
  const WritingParameters parameters;
  EXPECT_THROW(planHandlePoses({}, parameters, kTipLength), std::invalid_argument);
  EXPECT_THROW(planHandlePoses({{"empty", {}}}, parameters, kTipLength), std::invalid_argument);
  EXPECT_THROW(planHandlePoses({{"w", {wide(0, 0, 0.001)}}}, parameters, kTipLength),
               std::invalid_argument);
  WritingParameters bad;
  bad.rate = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(planHandlePoses(kTwoStrokes, bad, kTipLength), ParameterError);
}

TEST(GlyphStrokes, AreScaledFromTheEmSquareToThePaper) {
  const Glyph glyph{{{{{{0, -124}, {1024, -124}, {1024, -24}, {0, -24}}}, {{100, -74}, {900, -74}}}}};
  const auto strokes = strokesOfGlyph(glyph, 0.1024, {0.1, 0.2}, StrokePoint());
  ASSERT_EQ(strokes.size(), 1u);
  for (const StrokePoint& point : strokes[0].points) {
    EXPECT_NEAR(point.y, 0.205, 2e-4);
    EXPECT_NEAR(*point.width, 0.01, 3e-4);
  }
  EXPECT_NEAR(strokes[0].points.front().x, 0.105, 1.5e-3);
  EXPECT_NEAR(strokes[0].points.back().x, 0.1974, 1.5e-3);
}

TEST(WaypointCurve, GoesThroughItsWaypointsWithOneTangentOnBothSides) {
  std::vector<Waypoint> points(5, Waypoint::Zero());
  const double x[] = {0.0, 0.01, 0.03, 0.031, 0.05}, y[] = {0.0, 0.02, 0.02, 0.0, 0.01},
               depth[] = {0, 3e-3, 3e-3, 1e-3, 2e-3};
  for (std::size_t k = 0; k < 5; ++k)
    points[k] << x[k], y[k], depth[k], 0.1 * static_cast<double>(k), 0, 0;
  const WaypointCurve curve(points, 0.005);
  for (int k = 0; k < 5; ++k) {
    EXPECT_LT((curve.at(curve.knot(k)) - points[static_cast<std::size_t>(k)]).norm(), 1e-12);
    if (k == 0 || k == 4) continue;
    const double h = 1e-6;
    const Waypoint before = (curve.at(curve.knot(k)) - curve.at(curve.knot(k) - h)) / h;
    const Waypoint after = (curve.at(curve.knot(k) + h) - curve.at(curve.knot(k))) / h;
    EXPECT_LT((before - after).norm(), 1e-3);
  }
  for (double u = 0; u < curve.end(); u += curve.end() / 1000) {
    EXPECT_GE(curve.at(u)[2], 0.0);
    EXPECT_LE(curve.at(u)[2], 3e-3 + 1e-12);
  }
}

TEST(BrushCurve, IsMonotoneAndItsInverseIsExact) {
  const BrushCurve curve(
      {{0.006, 0.005, 0.006}, {0.002, 0.003, 0.004}, {0.004, 0.0029, 0.003}, {0.009, 0.008, 0.009}});
  for (double w = 0.0; w <= curve.maxWidth(); w += 1e-5)
    EXPECT_NEAR(curve.width(curve.depth(w)), w, 1e-12);
  for (double d = 0.0; d < curve.maxDepth(); d += 1e-5) {
    EXPECT_LE(curve.width(d), curve.width(d + 1e-5) + 1e-15);
    EXPECT_LE(curve.lag(d), curve.lag(d + 1e-5) + 1e-15);
  }
  EXPECT_EQ(curve.width(-0.001), 0.0);
  EXPECT_EQ(curve.lag(0.0), 0.0);
  EXPECT_EQ(curve.depth(1.0), curve.maxDepth());
  EXPECT_EQ(curve.depth(-1.0), 0.0);
}

TEST(BrushCurve, RefusesWhatIsNoCurve) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(BrushCurve({}), std::invalid_argument);
  EXPECT_THROW(BrushCurve({{0.001, nan, 0.0}}), std::invalid_argument);
  EXPECT_THROW(BrushCurve({{0.0, 0.001, 0.0}}), std::invalid_argument);
  EXPECT_THROW(BrushCurve({{0.001, 0.0, 0.0}}), std::invalid_argument);
  EXPECT_THROW(BrushCurve({{0.001, 0.001, 0.0}, {0.001, 0.002, 0.0}}), std::invalid_argument);
}

TEST(BrushCurve, MeasuredOnTheSimulatorSaysHowWideALineWillBe) {
  SimulatorParameters parameters;
  const BrushCurve curve = measureBrushCurve(parameters, WritingParameters().lean);
  for (const BrushCurvePoint& point : curve.points())
    std::cout << "depth " << 1e3 * point.depth << " mm: width " << 1e3 * point.width << " mm, lag "
              << 1e3 * point.lag << " mm\n";
  EXPECT_GE(curve.points().size(), 4u);
  EXPECT_GT(curve.maxWidth(), 0.3 * parameters.brush.root_diameter);
  EXPECT_LE(curve.maxWidth(), 2.0 * parameters.brush.root_diameter);
  EXPECT_GT(curve.lag(curve.maxDepth()), 0.0);
  EXPECT_LT(curve.lag(curve.maxDepth()), parameters.brush.tip_length);

  // A bar of a wanted width, written and looked at in its middle.
  const double wanted = 0.6 * curve.maxWidth();
  Simulator simulator(parameters);
  for (const HandlePose& pose :
       planHandlePoses({{"bar", {wide(0.1, 0.15, wanted), wide(0.2, 0.15, wanted)}}},
                       WritingParameters(), simulator.brush().tip_length, &curve)) {
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
  }
  const Paper& paper = simulator.paper();
  double width = 0.0, middle = 0.0;
  int columns = 0;
  for (int column = static_cast<int>(0.14 / paper.pixelSize()); column * paper.pixelSize() < 0.17;
       ++column) {
    int lowest = -1, highest = -1;
    for (int row = 0; row < paper.height_px(); ++row)
      if (static_cast<double>(paper.ink(column, row)) > 0.5 * parameters.paper.dark_thickness) {
        if (lowest < 0) lowest = row;
        highest = row;
      }
    ASSERT_GE(lowest, 0) << "no ink in column " << column;
    width += (highest - lowest + 1) * paper.pixelSize();
    middle += 0.5 * (highest + lowest + 1) * paper.pixelSize();
    ++columns;
  }
  EXPECT_NEAR(width / columns, wanted, 0.25 * wanted);
  EXPECT_NEAR(middle / columns, 0.15, 1e-3);
}

}  // namespace
}  // namespace calligraphy_brush
