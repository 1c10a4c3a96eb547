#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "calligraphy_brush/ink/tip_ink.h"

using namespace calligraphy_brush;

namespace {

PaperParameters smallSheet(double px_per_mm = 4) {
  PaperParameters parameters;
  parameters.width = 0.04;
  parameters.height = 0.03;
  parameters.px_per_mm = px_per_mm;
  return parameters;
}

}  // namespace

TEST(Paper, HasThePixelsOfItsSize) {
  const Paper paper(smallSheet());
  EXPECT_EQ(paper.width_px(), 160);
  EXPECT_EQ(paper.height_px(), 120);
  EXPECT_DOUBLE_EQ(paper.pixelSize(), 0.00025);
}

TEST(Paper, RefusesMorePixelsThanFitInMemory) {
  PaperParameters parameters;
  parameters.width = parameters.height = 2.0;
  parameters.px_per_mm = 40;
  EXPECT_THROW(Paper{parameters}, ParameterError);
}

TEST(Paper, CoversTheAreaOfACapsule) {
  const double radius = 0.002, length = 0.01, thickness = 1e-5;
  const double area = 3.14159265358979 * radius * radius + 2 * radius * length;
  for (const double angle : {0.0, 0.3, 0.8, 1.57}) {
    Paper paper(smallSheet());
    const double volume = paper.deposit({0.015, 0.012, radius, 0.015 + length * std::cos(angle),
                                         0.012 + length * std::sin(angle), radius},
                                        thickness);
    EXPECT_NEAR(volume / thickness / area, 1.0, 0.005) << angle;
    EXPECT_NEAR(paper.inkVolume(), volume, 1e-6 * volume);
  }
}

TEST(Paper, CoversTheAreaOfALineThinnerThanAPixel) {
  const double half_width = 0.00003, length = 0.02;  // a quarter of a pixel
  Paper paper(smallSheet());
  const double volume =
      paper.deposit({0.005, 0.0151, half_width, 0.005 + length, 0.0151, half_width}, 1e-5);
  EXPECT_NEAR(volume / 1e-5 / (2 * half_width * length), 1.0, 0.05);
}

TEST(Paper, DrawsUpwardsAndShowsTheTopRowFirst) {
  Paper paper(smallSheet());
  paper.deposit({0.001, 0.029, 0.0005, 0.001, 0.029, 0.0005}, 1e-4);  // upper left corner
  EXPECT_GT(paper.ink(4, 116), 0.0F);
  std::vector<std::uint8_t> picture;
  paper.render(picture);
  EXPECT_LT(picture[4 * 160 + 4], 10);
  EXPECT_EQ(picture[116 * 160 + 4], 255);
}

TEST(Paper, NeverLosesInkUnderAThinnerFilm) {
  Paper paper(smallSheet());
  paper.deposit({0.02, 0.015, 0.003, 0.02, 0.015, 0.003}, 2e-5);
  const double before = paper.inkVolume();
  EXPECT_EQ(paper.deposit({0.02, 0.015, 0.002, 0.02, 0.015, 0.002}, 1e-5), 0.0);
  EXPECT_EQ(paper.inkVolume(), before);
}

TEST(Paper, IgnoresWhatIsOffTheSheetOrNotANumber) {
  Paper paper(smallSheet());
  EXPECT_EQ(paper.deposit({-1, -1, 0.001, -1, -1, 0.001}, 1e-5), 0.0);
  EXPECT_EQ(paper.deposit({1e30, 0, 0.001, 1e30, 0, 0.001}, 1e-5), 0.0);
  EXPECT_EQ(paper.deposit({std::nan(""), 0, 0.001, 0, 0, 0.001}, 1e-5), 0.0);
  EXPECT_EQ(paper.deposit({0.02, 0.015, 0.003, 0.02, 0.015, 0.003}, std::nan("")), 0.0);
  EXPECT_EQ(paper.inkVolume(), 0.0);
  EXPECT_GT(paper.deposit({-0.01, 0.015, 0.001, 0.05, 0.015, 0.001}, 1e-5), 0.0);  // right across it
}

TEST(Paper, DarkensByBeerAndLambert) {
  PaperParameters parameters = smallSheet();
  parameters.dark_thickness = 1e-5;
  for (const double thickness : {1e-6, 5e-6, 1e-5, 3e-5}) {
    Paper paper(parameters);
    paper.deposit({0.02, 0.015, 0.003, 0.02, 0.015, 0.003}, thickness);
    std::vector<std::uint8_t> picture;
    paper.render(picture);
    EXPECT_NEAR(*std::min_element(picture.begin(), picture.end()), 255 * std::exp(-thickness / 1e-5),
                0.8);
  }
}

namespace {

/// One rod of three nodes, of radius 0.5 mm, 1 mm³ of room for ink.
BrushModel plainBrush() {
  BrushModel brush;
  RodModel rod = makeUniformRod(0.02, 1e-7, 1e-4, 3);
  rod.node_radius.assign(3, 0.0005);
  rod.ink_capacity = 1e-9;
  brush.rods = {rod};
  return brush;
}

std::vector<Eigen::Vector3d> rodWithTipAt(double x, double y, double z) {
  return {{x, y, z + 0.02}, {x, y, z + 0.01}, {x, y, z}};
}

}  // namespace

TEST(TipInk, LosesWhatTheSheetGains) {
  Paper paper(smallSheet());
  TipInk ink(plainBrush(), InkParameters{});
  const double before = ink.totalVolume();
  for (int step = 0; step <= 200; ++step)
    ink.transfer(0, rodWithTipAt(0.005 + 0.0001 * step, 0.015, 0), paper);
  EXPECT_GT(paper.inkVolume(), 0.0);
  EXPECT_NEAR(ink.totalVolume() + paper.inkVolume(), before, 1e-6 * paper.inkVolume());
}

TEST(TipInk, LeavesNothingAboveTheSheet) {
  Paper paper(smallSheet());
  InkParameters parameters;
  TipInk ink(plainBrush(), parameters);
  for (int step = 0; step <= 100; ++step)
    ink.transfer(0, rodWithTipAt(0.005 + 0.0001 * step, 0.015, 0.0005 + parameters.coat + 1e-9), paper);
  EXPECT_EQ(paper.inkVolume(), 0.0);
}

TEST(TipInk, DrawsAsWideAsTheBundleLies) {
  // A bundle of radius r whose middle is at height z touches in a chord of half width √(r² − z²).
  InkParameters parameters;
  parameters.coat = 0.0;
  for (const double z : {0.0, 0.0003, 0.00045}) {
    Paper paper(smallSheet(20));
    BrushModel brush = plainBrush();
    brush.rods[0].ink_capacity = 1e-6;  // so that it does not fade
    TipInk ink(brush, parameters);
    for (int step = 0; step <= 300; ++step)
      ink.transfer(0, rodWithTipAt(0.005 + 0.0001 * step, 0.015, z), paper);
    double width = 0;
    for (int row = 0; row < paper.height_px(); ++row) width += double(paper.ink(400, row));
    width *= paper.pixelSize() / parameters.film_thickness;
    EXPECT_NEAR(width, 2 * std::sqrt(0.0005 * 0.0005 - z * z), 0.00003) << z;
  }
}

TEST(TipInk, JoinsFastMotionsWithoutGaps) {
  Paper paper(smallSheet());
  TipInk ink(plainBrush(), InkParameters{});
  ink.transfer(0, rodWithTipAt(0.005, 0.015, 0), paper);
  ink.transfer(0, rodWithTipAt(0.030, 0.015, 0), paper);  // 25 mm in one step
  for (int column = 20; column <= 120; ++column) EXPECT_GT(paper.ink(column, 60), 1e-5F) << column;
}

TEST(TipInk, ForgetsWhereItWasWhenLifted) {
  Paper paper(smallSheet());
  TipInk ink(plainBrush(), InkParameters{});
  ink.transfer(0, rodWithTipAt(0.005, 0.015, 0), paper);
  ink.transfer(0, rodWithTipAt(0.015, 0.015, 0.005), paper);
  ink.transfer(0, rodWithTipAt(0.030, 0.015, 0), paper);
  EXPECT_EQ(paper.ink(70, 60), 0.0F);
}

TEST(TipInk, FadesAsItRunsDry) {
  Paper paper(smallSheet());
  BrushModel brush = plainBrush();
  brush.rods[0].ink_capacity = 4e-10;
  TipInk ink(brush, InkParameters{});
  for (int line = 0; line < 10; ++line) {
    ink.lift(0);
    for (int step = 0; step <= 300; ++step)
      ink.transfer(0, rodWithTipAt(0.005 + 0.0001 * step, 0.002 + 0.0025 * line, 0), paper);
  }
  float before = paper.ink(80, 8);
  EXPECT_GT(before, 0.0F);
  for (int line = 1; line < 10; ++line) {
    const float now = paper.ink(80, static_cast<int>((0.002 + 0.0025 * line) / 0.00025));
    EXPECT_LT(now, before) << line;
    before = now;
  }
  EXPECT_GE(ink.totalVolume(), 0.0);
  ink.dip();
  EXPECT_NEAR(ink.totalVolume(), ink.totalCapacity(), 1e-20);
  ink.wipe();
  EXPECT_EQ(ink.totalVolume(), 0.0);
}
