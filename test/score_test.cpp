#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "calligraphy_brush/brush/brush_model.h"
#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/score/calibration.h"
#include "calligraphy_brush/score/glyph_scores.h"
#include "calligraphy_brush/score/metrics.h"
#include "calligraphy_brush/score/recorded_strokes.h"
#include "calligraphy_brush/score/stroke_scores.h"
#include "calligraphy_brush/writing/trajectory.h"
#include "temporary_folder.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

const std::string kSource = CALLIGRAPHY_BRUSH_SOURCE_DIR;

/// Ink in columns [x0, x1) and rows [y0, y1).
Mask box(int x0, int y0, int x1, int y1, int side = 40, double px_per_mm = 2.0) {
  Mask mask(side, side, px_per_mm);
  for (int row = y0; row < y1; ++row)
    for (int column = x0; column < x1; ++column) mask.set(column, row);
  return mask;
}

GreyPicture pictureOf(const Mask& mask) {
  GreyPicture picture{mask.width_px, mask.height_px, {}};
  for (const auto ink : mask.ink) picture.mono8.push_back(ink ? 0 : 255);
  return picture;
}

TEST(IntersectionOverUnion, IsThatOfBoxesCountedByHand) {
  EXPECT_EQ(intersectionOverUnion(box(0, 0, 10, 10), box(0, 0, 10, 10)), 1.0);
  EXPECT_EQ(intersectionOverUnion(box(0, 0, 10, 10), box(20, 0, 30, 10)), 0.0);
  EXPECT_DOUBLE_EQ(intersectionOverUnion(box(0, 0, 10, 10), box(5, 0, 15, 10)), 50.0 / 150.0);
  EXPECT_DOUBLE_EQ(intersectionOverUnion(box(0, 0, 10, 10), box(2, 3, 5, 9)), 18.0 / 100.0);
  EXPECT_EQ(intersectionOverUnion(Mask(4, 4, 1.0), Mask(4, 4, 1.0)), 1.0);
  EXPECT_THROW(intersectionOverUnion(Mask(4, 4, 1.0), Mask(4, 5, 1.0)), std::invalid_argument);
  EXPECT_THROW(intersectionOverUnion(Mask(4, 4, 1.0), Mask(4, 4, 2.0)), std::invalid_argument);
}

TEST(Registered, FindsAShiftWithinReachAndSaysWhichWay) {
  // b is 3 px right of and 5 px below a, at 2 px/mm: it has to go left and up.
  const Registration found = registered(box(10, 10, 20, 14), box(13, 15, 23, 19), 4.0);
  EXPECT_DOUBLE_EQ(found.iou, 1.0);
  EXPECT_DOUBLE_EQ(found.dx_mm, -1.5);
  EXPECT_DOUBLE_EQ(found.dy_mm, 2.5);
  // 10 px away with a reach of 8: two columns of ten stay apart.
  const Registration far = registered(box(0, 0, 10, 10), box(10, 0, 20, 10), 4.0);
  EXPECT_DOUBLE_EQ(far.iou, 80.0 / 120.0);
  EXPECT_DOUBLE_EQ(far.dx_mm, -4.0);
  EXPECT_DOUBLE_EQ(far.dy_mm, 0.0);
  // Without reach it is the plain one.
  const Mask a = box(3, 4, 17, 11), b = box(9, 2, 20, 8);
  EXPECT_DOUBLE_EQ(registered(a, b, 0.0).iou, intersectionOverUnion(a, b));
  // What leaves the picture still counts in the union.
  EXPECT_DOUBLE_EQ(registered(box(0, 0, 2, 10), box(2, 0, 10, 10), 4.0).iou, 20.0 / 80.0);
}

TEST(CosineLikeness, IsTheAngleOfDarknesses) {
  const GreyPicture a = pictureOf(box(0, 0, 10, 10)), b = pictureOf(box(5, 0, 15, 10));
  EXPECT_DOUBLE_EQ(cosineLikeness(a, a), 1.0);
  EXPECT_DOUBLE_EQ(cosineLikeness(a, b), 0.5);
  EXPECT_EQ(cosineLikeness(a, pictureOf(box(20, 20, 25, 25))), 0.0);
  GreyPicture pale = a;  // the same shape, half as dark
  for (auto& grey : pale.mono8) grey = static_cast<std::uint8_t>(255 - (255 - grey) / 2);
  EXPECT_NEAR(cosineLikeness(a, pale), 1.0, 1e-12);
  EXPECT_EQ(cosineLikeness(a, pictureOf(Mask(40, 40, 2.0))), 0.0);
}

TEST(Chamfer, IsTheDistanceOfParallelLinesAndInfiniteWithoutInk) {
  const Mask a = box(5, 10, 35, 11), b = box(5, 16, 35, 17);
  EXPECT_DOUBLE_EQ(chamferDistance_mm(a, b), 3.0);
  EXPECT_EQ(chamferDistance_mm(a, a), 0.0);
  EXPECT_EQ(chamferDistance_mm(a, Mask(40, 40, 2.0)), std::numeric_limits<double>::infinity());
  EXPECT_EQ(chamferDistance_mm(Mask(40, 40, 2.0), Mask(40, 40, 2.0)), 0.0);
}

TEST(DistanceToInk, IsThatOfEveryPixelByBruteForce) {
  Mask mask(23, 17, 1.0);
  for (const auto& [column, row] : {std::pair{3, 4}, {20, 1}, {11, 16}, {12, 8}}) mask.set(column, row);
  const std::vector<double> distance = distanceToInk(mask);
  for (int row = 0; row < mask.height_px; ++row)
    for (int column = 0; column < mask.width_px; ++column) {
      double least = std::numeric_limits<double>::infinity();
      for (int y = 0; y < mask.height_px; ++y)
        for (int x = 0; x < mask.width_px; ++x)
          if (mask.at(x, y)) least = std::min(least, std::hypot(x - column, y - row));
      ASSERT_NEAR(distance[mask.index(column, row)], least, 1e-12) << column << " " << row;
    }
  EXPECT_TRUE(std::isinf(distanceToInk(Mask(3, 3, 1.0))[4]));
}

TEST(WidestLine, IsTheDiameterOfADiscAndTheHeightOfABar) {
  Mask disc(120, 120, 4.0);
  for (int row = 0; row < 120; ++row)
    for (int column = 0; column < 120; ++column)
      if (std::hypot(column + 0.5 - 60.0, row + 0.5 - 60.0) < 32.0) disc.set(column, row);
  EXPECT_NEAR(widestLine_mm(disc), 16.0, 1.3 / 4.0);
  EXPECT_NEAR(widestLine_mm(box(0, 10, 40, 19)), 4.5, 1.3 / 2.0);
  EXPECT_NEAR(widestLine_mm(box(0, 10, 40, 20)), 5.0, 1.3 / 2.0);
  EXPECT_EQ(widestLine_mm(Mask(9, 9, 1.0)), 0.0);
}

TEST(Statistics, AreThoseOfListsByHand) {
  EXPECT_NEAR(correlation({1, 2, 3, 4}, {2, 4, 6, 8}), 1.0, 1e-12);
  EXPECT_NEAR(correlation({1, 2, 3}, {3, 1, 2}), -0.5, 1e-12);
  EXPECT_EQ(correlation({1, 1, 1}, {1, 2, 3}), 0.0);
  EXPECT_DOUBLE_EQ(quantile({3, 1, 2, 4}, 0.5), 2.5);
  EXPECT_DOUBLE_EQ(quantile({5}, 0.9), 5.0);
  EXPECT_TRUE(std::isnan(mean({})));
  const Line line = fitLine({0, 1, 2, 3}, {1, 3.5, 5.5, 8});
  EXPECT_NEAR(line.slope, 2.3, 1e-12);
  EXPECT_NEAR(line.offset, 1.05, 1e-12);
  EXPECT_THROW(fitLine({1, 1}, {0, 1}), std::invalid_argument);
}

TEST(Masks, LoseSpecksAndHolesAndKeepWhatTouchesThePath) {
  Mask mask = box(10, 10, 30, 30);
  for (int k = 15; k < 20; ++k) mask.ink[mask.index(k, 20)] = 0;  // a hole
  mask.set(36, 36);                                               // a speck
  // At 2 px/mm, place (10, 10) mm is column 20, row 19.
  const Mask kept = withoutHoles(piecesNear(mask, {Vector2d(10.0, 10.0)}, 0.5));
  EXPECT_EQ(kept.ink, box(10, 10, 30, 30).ink);
  // Nothing near: the largest piece.
  EXPECT_EQ(piecesNear(mask, {Vector2d(0.5, 0.5)}, 0.5).area_px(), 395);
  // A bay that is open to the rim is no hole.
  Mask bay = box(0, 0, 40, 40);
  for (int row = 0; row < 20; ++row) bay.ink[bay.index(5, row)] = 0;
  EXPECT_EQ(withoutHoles(bay).ink, bay.ink);
}

TEST(Resampled, KeepsTheMeanAndThePlace) {
  const GreyPicture fine = pictureOf(box(8, 16, 24, 32));  // 40 px at 2 px/mm, ink 4..12 mm by 4..12 mm
  const GreyPicture coarse = resampled(fine, 2.0, Vector2d(2.0, 2.0), 18, 18, 1.0);
  EXPECT_EQ(maskOf(coarse, 1.0).area_px(), 64);
  const Mask mask = maskOf(coarse, 1.0);
  for (int row = 0; row < 18; ++row)
    for (int column = 0; column < 18; ++column)
      EXPECT_EQ(mask.at(column, row), column >= 2 && column < 10 && 17 - row >= 2 && 17 - row < 10);
}

TEST(DrawOutlines, FillsAPolygonToItsAreaAndUnitesOverlaps) {
  const Outline square{{{2, 3}, {12, 3}, {12, 13}, {2, 13}}};
  const Outline turned{{{7, 8}, {7, 18}, {17, 18}, {17, 8}}};  // the other way round
  EXPECT_EQ(maskOf(drawOutlines({square}, 40, 40, 2.0), 2.0).area_px(), 400);
  EXPECT_EQ(maskOf(drawOutlines({square, turned}, 40, 40, 2.0), 2.0).area_px(), 700);
  double dark = 0.0;  // a triangle: half of its box, by the grey of its edge
  for (const auto grey : drawOutlines({{{{1, 1}, {17, 1}, {1, 14}}}}, 20, 20, 1.0).mono8)
    dark += (255 - grey) / 255.0;
  EXPECT_NEAR(dark, 0.5 * 16 * 13, 0.5);
}

TEST(RecordedStroke, IsAPathOfKnownPlacesAndDepths) {
  RecordedStroke stroke;
  stroke.place = {Vector2d(0, 0), Vector2d(0.01, 0.02), Vector2d(0.02, 0.02), Vector2d(0.03, 0)};
  stroke.depth = {0.0036, 0.009, 0.012, 0.0036};
  EXPECT_NEAR((stroke.placeAt(0.5) - Vector2d(0.015, 0.015)).norm(), 0.0, 1e-15);
  EXPECT_NEAR((stroke.headingAt(0.5) - Vector2d(1, 0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR(stroke.bend(), 0.015, 1e-12);
  EXPECT_NEAR(stroke.depthAt(0.333), 0.009, 1e-15);
  EXPECT_NEAR(stroke.depthAt(0.4995), 0.0105, 1e-15);
  EXPECT_NEAR(stroke.depthAt(1.0), 0.0036, 1e-15);

  ArmMotion motion;
  const double length = 0.04;
  const auto poses = posesOf(stroke, motion, Vector2d(0.1, 0.2), 0.0, length);
  double way = 0.0;
  bool in_air = true;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const double depth = length - poses[k].position.z();
    if (k > 0) {
      const double step = (poses[k].position - poses[k - 1].position).head<2>().norm();
      EXPECT_LE(step, 1.02 * motion.speed * motion.period);
      way += step;
    }
    in_air = in_air && depth <= 0;
    EXPECT_LE(depth, 0.012 + 1e-9);
  }
  EXPECT_FALSE(in_air);
  EXPECT_NEAR(length - poses.front().position.z(), -motion.clearance, 1e-9);
  EXPECT_NEAR(length - poses.back().position.z(), -motion.clearance, 1e-9);
  EXPECT_NEAR(poses.back().position.x(), 0.13, 1e-9);
  double length_of_path = 0.0;
  for (int k = 0; k < 10000; ++k)
    length_of_path += (stroke.placeAt((k + 1) * 1e-4) - stroke.placeAt(k * 1e-4)).norm();
  EXPECT_NEAR(way, length_of_path, 1e-4);
  // Turned by a right angle about its origin, +x becomes +y.
  EXPECT_NEAR(posesOf(stroke, motion, Vector2d(0.1, 0.2), M_PI / 2, length).back().position.y(), 0.23,
              1e-9);
}

TEST(RecordedStroke, OfAnArmWithWaypointsIsAPolygonWithRoundCorners) {
  RecordedStroke stroke;
  stroke.place = {Vector2d(0, 0), Vector2d(0.02, 0.03), Vector2d(0.04, 0.03), Vector2d(0.06, 0)};
  stroke.depth = {0.0036, 0.012, 0.012, 0.0036};
  stroke.tilt = {0.05, 0.05, 0.05, 0.05};
  ArmMotion motion;
  motion.waypoints = 5;
  motion.corner = 0.0;
  motion.offset = {0.001, -0.002};
  const double length = 0.04;
  // The point of the brush, which the tilt turns about.
  const auto pointsOf = [&](const ArmMotion& m) {
    std::vector<Eigen::Vector3d> points;
    for (const HandlePose& pose : posesOf(stroke, m, Vector2d(0.1, 0.2), 0.0, length))
      points.push_back(pose.position - pose.orientation * Eigen::Vector3d(0, 0, length));
    return points;
  };
  const auto distanceTo = [](const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& place) {
    double nearest = 1.0;
    for (const Eigen::Vector3d& point : points) nearest = std::min(nearest, (point - place).norm());
    return nearest;
  };
  const auto waypoint = [&](double t) {
    const Vector2d place = Vector2d(0.1, 0.2) + motion.offset + stroke.placeAt(t);
    return Eigen::Vector3d(place.x(), place.y(), -stroke.depthAt(t));
  };
  const auto sharp = pointsOf(motion);
  motion.corner = 0.005;
  const auto round = pointsOf(motion);
  for (const double t : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    EXPECT_LT(distanceTo(sharp, waypoint(t)), 2e-4) << t;
    EXPECT_GT(distanceTo(round, waypoint(t)), 4e-4) << t;
    EXPECT_LT(distanceTo(round, waypoint(t)), 0.0036) << t;
  }
  // Half of the way between two it is on their chord, not on the curve.
  for (const auto& points : {sharp, round}) {
    EXPECT_LT(distanceTo(points, 0.5 * (waypoint(0.25) + waypoint(0.5))), 2e-4);
    EXPECT_NEAR(points.front().z(), motion.clearance, 3e-4);
    EXPECT_NEAR(points.back().z(), motion.clearance, 3e-4);
  }
  for (std::size_t k = 1; k < round.size(); ++k)
    EXPECT_LE((round[k] - round[k - 1]).norm(), 1.02 * motion.air_speed * motion.period);
}

TEST(ApexLag, IsHowFarInsideTheMiddleOfTheInkIs) {
  RecordedStroke stroke;
  for (const double side : {1.0, -1.0}) {
    stroke.place = {Vector2d(0, 0), Vector2d(0.005, side * 0.012), Vector2d(0.010, side * 0.012),
                    Vector2d(0.015, 0)};
    // The apex is 9 mm from the chord, which lies at 10 mm; ink over 2 mm whose middle is 5 mm from it.
    Mask trace(40, 40, 2.0);
    const double middle = 10.0 + side * 5.0;
    for (int row = 0; row < 40; ++row)
      if (std::abs((40 - row - 0.5) / 2.0 - middle) < 1.0)
        for (int column = 0; column < 40; ++column) trace.set(column, row);
    const ApexLag lag = apexLag(stroke, trace, Vector2d(2.0, 10.0));
    ASSERT_TRUE(lag.measured);
    EXPECT_NEAR(lag.lag_mm, 4.0, 1e-9);
  }
  EXPECT_FALSE(apexLag(stroke, Mask(40, 40, 2.0), Vector2d(2.0, 10.0)).measured);
}

TEST(RecordedSet, IsReadFromItsThreeFilesAndDamageIsNamed) {
  const TemporaryFolder folder;
  const std::string header =
      "stroke,x0_m,y0_m,z0_norm,tilt0_rad,x1_m,y1_m,z1_norm,tilt1_rad,x2_m,y2_m,z2_norm,tilt2_rad,"
      "x3_m,y3_m,z3_norm,tilt3_rad\n";
  const std::string meta =
      "{\"n\": 1, \"cols\": 1, \"tile_w_px\": 40, \"tile_h_px\": 20, \"px_per_mm\": 2.0, "
      "\"origin_px\": [10, 12], \"depth_range_mm\": 18.0}";
  folder.write("meta.json", meta);
  folder.write("strokes.csv", header + "7,0,0,.2,0,.003,0,.5,0,.006,0,.5,0,.01,0,.2,0\n");
  Mask tile(40, 20, 2.0);
  for (int row = 10; row < 14; ++row)
    for (int column = 10; column < 30; ++column) tile.set(column, row);
  tile.set(2, 2);  // a speck
  const GreyPicture picture = pictureOf(tile);
  writePng(folder.path("strokes.png"), 40, 20, picture.mono8);

  const RecordedSet set = readRecordedSet(folder.path("."));
  ASSERT_EQ(set.strokes.size(), 1u);
  EXPECT_EQ(set.strokes[0].number, 7);
  EXPECT_NEAR(set.strokes[0].middleDepth(), 0.009, 1e-12);
  EXPECT_NEAR((set.origin() - Vector2d(0.005, 0.004)).norm(), 0.0, 1e-12);
  EXPECT_EQ(photographOf(set, 0, 2.0).area_px(), 80);
  EXPECT_EQ(photographOf(set, 0, 1.0).area_px(), 20);

  folder.write("strokes.csv", header + "7,0,0,.2,0,.003,x,.5,0,.006,0,.5,0,.01,0,.2,0\n");
  try {
    readRecordedSet(folder.path("."));
    FAIL() << "a number that is none was read";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("strokes.csv:2: y1_m = \"x\""), std::string::npos)
        << error.what();
  }
  EXPECT_THROW(readRecordedSet(folder.path("none")), std::runtime_error);
}

TEST(Calibrate, FindsTheTopOfAHillAndKeepsTheTuftFilled) {
  const std::vector<FittedParameter> fitted{{"brush/tip_length", 0.02, 0.06},
                                            {"brush/root_diameter", 0.004, 0.016},
                                            {"contact/paper_friction", 0.0, 1.0}};
  const auto hill = [](const SimulatorParameters& p) {
    return 1.0 - std::pow((p.brush.tip_length - 0.033) / 0.04, 2) -
           std::pow((p.brush.root_diameter - 0.011) / 0.012, 2) -
           std::pow(p.contact.paper_friction - 0.62, 2);
  };
  CalibrationOptions options;
  options.evaluations = 400;
  const CalibrationResult result = calibrate(SimulatorParameters(), fitted, hill, options);
  EXPECT_NEAR(result.parameters.brush.tip_length, 0.033, 4e-4);
  EXPECT_NEAR(result.parameters.brush.root_diameter, 0.011, 2e-4);
  EXPECT_NEAR(result.parameters.contact.paper_friction, 0.62, 0.01);
  EXPECT_LE(result.evaluations, options.evaluations);
  const auto fill = [](const BrushParameters& b) { return b.hair_count / std::pow(b.root_diameter, 2); };
  EXPECT_NEAR(fill(result.parameters.brush) / fill(BrushParameters()), 1.0, 1e-3);
  EXPECT_EQ(calibrate(SimulatorParameters(), fitted, hill, options).value, result.value);

  EXPECT_THROW(calibrate(SimulatorParameters(), {{"brush/none", 0, 1}}, hill, options),
               std::invalid_argument);
  EXPECT_THROW(calibrate(SimulatorParameters(), {{"brush/cone", 1, 1}}, hill, options),
               std::invalid_argument);
}

TEST(Preset, IsReadBackAsItWas) {
  SimulatorParameters parameters;
  parameters.brush.tip_length = 0.0412345;
  parameters.brush.hair_count = 12345;
  parameters.contact.paper_friction = 0.45;
  const TemporaryFolder folder;
  SimulatorParameters loaded;
  loadYamlParameters(folder.write("p.yaml", presetText(parameters, "A brush.")), loaded);
  const auto before = listParameters(parameters), after = listParameters(loaded);
  for (std::size_t k = 0; k < before.size(); ++k)
    EXPECT_EQ(after[k].value, before[k].value) << after[k].name;
}

/// A brush of few rods, for tests of what is done with it.
SimulatorParameters quickBrush() {
  SimulatorParameters parameters;
  parameters.brush.tip_length = 0.03;
  parameters.brush.root_diameter = 0.012;
  parameters.brush.hair_count = 18000;
  parameters.brush.rod_count = 96;
  parameters.brush.node_count = 10;
  parameters.rods.time_step = 0.002;
  return parameters;
}

TEST(Correction, WritesAnArcMoreLikeItsOutlineThanThePlan) {
  // Three quarters of a turn of a ring, 30 mm across in the middle of a line of 4.5 mm.
  Glyph glyph;
  GlyphStroke arc;
  std::vector<Vector2d> line;
  const auto at = [](double radius, double part) {
    const double angle = 1.5 * M_PI * part;
    return Vector2d(500 + radius * std::cos(angle), 400 + radius * std::sin(angle));
  };
  for (int k = 0; k <= 48; ++k) line.push_back(at(172, k / 48.0));
  for (int k = 48; k >= 0; --k) line.push_back(at(128, k / 48.0));
  arc.outline.push_back(line);
  for (int k = 0; k <= 12; ++k) arc.median.push_back(at(150, k / 12.0));
  glyph.strokes.push_back(arc);

  SimulatorParameters parameters = quickBrush();
  parameters.paper.px_per_mm = 4.0;
  const WritingParameters writing;
  const BrushCurve curve = measureBrushCurve(parameters, writing.lean, 6);
  const double size = 0.1024;
  const Eigen::Vector2d origin(0.0, 0.0);
  StrokePoint defaults;
  defaults.speed = GlyphOptions().speed;  // as it is written below
  const auto strokes = strokesOfGlyph(glyph, size, origin, defaults);
  CorrectionOptions options;
  const auto corrected =
      correctStrokes(strokes, outlinesOfGlyph(glyph, size, origin), parameters, writing, curve, options);
  ASSERT_EQ(corrected.size(), 1u);
  ASSERT_EQ(static_cast<int>(corrected[0].iou.size()), options.passes);
  const double planned = corrected[0].iou.front();
  const double practised = *std::max_element(corrected[0].iou.begin(), corrected[0].iou.end());
  std::cout << "IoU of an arc: planned " << planned << ", practised " << practised << "\n";
  EXPECT_GT(planned, 0.4);
  EXPECT_GT(practised, planned + 0.015);

  // Written again on a larger sheet with the other strokes of a character, it is what was practised.
  GlyphOptions whole;
  whole.size = size;
  whole.px_per_mm = parameters.paper.px_per_mm;
  whole.correction = options;
  const GlyphScore score = scoreGlyph(glyph, "arc", parameters, writing, curve, whole);
  EXPECT_NEAR(score.likeness.iou, practised, 0.03);
  EXPECT_GT(score.disc_iou, 0.93);
  // Ink that is not quite black does not look narrow, and is not asked for wider.
  const auto area = [&](const GreyPicture& picture) {
    return static_cast<double>(maskOf(picture, whole.px_per_mm).area_px());
  };
  EXPECT_NEAR(area(score.written) / area(score.wanted), 1.0, 0.05);
}

TEST(Correction, WritesACornerMoreLikeItsOutlineThanThePlan) {
  // Across and down, as in 口: lines of 6 mm with a sharp corner, where the tuft swings round.
  Glyph glyph;
  glyph.strokes.push_back({{{{300, 660}, {760, 660}, {760, 200}, {700, 200}, {700, 600}, {300, 600}}},
                           {{310, 630}, {500, 630}, {730, 630}, {730, 400}, {730, 210}}});
  SimulatorParameters parameters = quickBrush();
  parameters.paper.px_per_mm = 4.0;
  const WritingParameters writing;
  const BrushCurve curve = measureBrushCurve(parameters, writing.lean, 6);
  const double size = 0.1024;
  StrokePoint defaults;
  defaults.speed = GlyphOptions().speed;
  const auto corrected = correctStrokes(strokesOfGlyph(glyph, size, {0.0, 0.0}, defaults),
                                        outlinesOfGlyph(glyph, size, {0.0, 0.0}), parameters, writing,
                                        curve, CorrectionOptions());
  const double planned = corrected[0].iou.front();
  const double practised = *std::max_element(corrected[0].iou.begin(), corrected[0].iou.end());
  std::cout << "IoU of a corner: planned " << planned << ", practised " << practised << "\n";
  EXPECT_GT(practised, planned + 0.015);
}

TEST(Correction, RefusesWhatDoesNotFit) {
  const SimulatorParameters parameters = quickBrush();
  const BrushCurve curve({{0.001, 0.001, 0.0}, {0.004, 0.004, 0.001}});
  EXPECT_THROW(correctStrokes({Stroke{}}, {}, parameters, WritingParameters(), curve, {}),
               std::invalid_argument);
  CorrectionOptions none;
  none.passes = 0;
  EXPECT_THROW(correctStrokes({}, {}, parameters, WritingParameters(), curve, none),
               std::invalid_argument);
}

TEST(RecordedStroke, TurnedWithItsHandleGivesTheTurnedPicture) {
  SimulatorParameters parameters = quickBrush();
  parameters.paper.width = parameters.paper.height = 0.08;
  parameters.paper.px_per_mm = 4.0;
  // Nothing that does not turn with the handle: no fibres, no rounding to speak of.
  parameters.paper.roughness = parameters.paper.unevenness = 0.0;
  parameters.rods.precision = "double";
  RecordedStroke stroke;
  stroke.place = {Vector2d(0, 0), Vector2d(0.01, 0.015), Vector2d(0.02, 0.015), Vector2d(0.03, 0)};
  stroke.depth = {0.002, 0.006, 0.006, 0.002};
  const double length = makeBrush(parameters.brush).tip_length;
  // Both about the middle of the sheet.
  const Vector2d middle(0.04, 0.04), origin(0.025, 0.03);
  const GreyPicture plain =
      simulatePicture(parameters, posesOf(stroke, ArmMotion(), origin, 0.0, length));
  const GreyPicture turned = simulatePicture(
      parameters, posesOf(stroke, ArmMotion(), middle + Vector2d(0.01, -0.015), M_PI / 2, length));
  ASSERT_EQ(plain.width_px, plain.height_px);
  const int side = plain.width_px;
  GreyPicture expected = plain;  // (x, y) to (−y, x) about the middle
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column)
      expected.mono8[static_cast<std::size_t>((side - 1 - column) * side + row)] =
          plain.mono8[static_cast<std::size_t>(row * side + column)];
  EXPECT_GT(maskOf(plain, 4.0).area_px(), 1000);
  EXPECT_GE(intersectionOverUnion(maskOf(expected, 4.0), maskOf(turned, 4.0)), 0.998);
}

TEST(RecordedStrokes, OfARealBrushAreScored) {
  const char* shared = std::getenv("CALLIGRAPHY_SHARED");
  const std::string folder =
      (shared != nullptr ? std::string(shared) : kSource + "/../shared") + "/data/frida/11_14_big";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recorded strokes in " << folder;
  const RecordedSet set = readRecordedSet(folder);
  EXPECT_EQ(set.strokes.size(), 165u);
  // What the data's own description says of the photographs.
  std::vector<double> width, depth, lag;
  int inside = 0;
  for (std::size_t k = 0; k < set.strokes.size(); ++k) {
    const Mask photograph = photographOf(set, k, 2.0);
    if (photograph.area_px() == 0) continue;
    width.push_back(widestLine_mm(photograph));
    depth.push_back(1e3 * set.strokes[k].middleDepth());
    if (1e3 * std::abs(set.strokes[k].bend()) < kStrongBend_mm) continue;
    const ApexLag apex = apexLag(set.strokes[k], photograph, 1e3 * set.origin());
    lag.push_back(apex.lag_mm);
    inside += apex.lag_mm > 0;
  }
  EXPECT_EQ(inside, static_cast<int>(lag.size()));
  EXPECT_NEAR(quantile(lag, 0.5), 7.0, 0.5);
  EXPECT_GT(correlation(width, depth), 0.83);

  const auto scores = scoreRecorded(set, {3, 41}, quickBrush(), ArmMotion(), 2.0, 1);
  for (const RecordedScore& score : scores) {
    EXPECT_GT(score.likeness.iou, 0.1);
    EXPECT_GE(score.likeness.registered.iou, score.likeness.iou);
  }
}

}  // namespace
}  // namespace calligraphy_brush
