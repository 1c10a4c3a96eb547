#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "calligraphy_brush/ink/tip_ink.h"
#include "calligraphy_brush/paper/unsaturated_flow.h"

using namespace calligraphy_brush;

namespace {

PaperParameters smallSheet(double px_per_mm = 4) {
  PaperParameters parameters;
  parameters.width = 0.04;
  parameters.height = 0.03;
  parameters.px_per_mm = px_per_mm;
  return parameters;
}

/// Smooth, even, and nothing moves in it.
PaperParameters plainSheet(double px_per_mm = 4) {
  PaperParameters parameters = smallSheet(px_per_mm);
  parameters.roughness = parameters.unevenness = parameters.diffusivity = 0.0;
  parameters.evaporation = parameters.settling_rate = 0.0;
  return parameters;
}

void wait(Paper& paper, double seconds) {
  for (double t = 0.0; t < seconds - 1e-9; t += 0.016) paper.flow(0.016);
}

/// Radius of the disc with as much area as there is liquid on, or pigment that shows.
double radiusOf(const Paper& paper, double least_ink) {
  double count = 0.0;
  for (int row = 0; row < paper.height_px(); ++row)
    for (int column = 0; column < paper.width_px(); ++column)
      count += double(paper.ink(column, row)) > least_ink;
  return std::sqrt(count / 3.14159265358979) * paper.pixelSize();
}

constexpr double kMiddleX = 0.02, kMiddleY = 0.015;

}  // namespace

// ---------------------------------------------------------------- the sheet and its picture

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

TEST(Paper, TakesMemoryOnlyWhereThereIsInk) {
  PaperParameters a1;
  a1.width = 0.594;
  a1.height = 0.841;
  a1.px_per_mm = 8.0;
  Paper paper(a1);
  EXPECT_EQ(paper.tileCount(), 0);
  paper.addDisc(0.3, 0.4, 0.001, 1e-6);
  EXPECT_LE(paper.tileCount(), 4);
}

TEST(Paper, HoldsTheDiscThatIsPutOnIt) {
  Paper paper(smallSheet());
  const double volume = paper.addDisc(kMiddleX, kMiddleY, 0.003, 1e-5);
  EXPECT_NEAR(volume / (3.14159265358979 * 0.003 * 0.003 * 1e-5), 1.0, 0.005);
  EXPECT_NEAR(paper.inkVolume(), volume, 1e-12 * volume);
  EXPECT_NEAR(paper.waterVolume(), volume, 1e-12 * volume);
}

TEST(Paper, DrawsUpwardsAndShowsTheTopRowFirst) {
  Paper paper(smallSheet());
  paper.addDisc(0.001, 0.029, 0.0005, 1e-4);  // upper left corner
  EXPECT_GT(paper.ink(4, 116), 0.0F);
  std::vector<std::uint8_t> picture;
  paper.render(picture);
  EXPECT_LT(picture[4 * 160 + 4], 10);
  EXPECT_EQ(picture[116 * 160 + 4], 255);
}

TEST(Paper, IgnoresWhatIsOffTheSheetOrNotANumber) {
  Paper paper(smallSheet());
  EXPECT_EQ(paper.addDisc(-1, -1, 0.001, 1e-5), 0.0);
  EXPECT_EQ(paper.addDisc(1e30, 0, 0.001, 1e-5), 0.0);
  EXPECT_EQ(paper.addDisc(std::nan(""), 0, 0.001, 1e-5), 0.0);
  EXPECT_EQ(paper.addDisc(kMiddleX, kMiddleY, 0.003, std::nan("")), 0.0);
  EXPECT_THROW(paper.setInk(0, 120, 0.0, 0.0), std::invalid_argument);
  EXPECT_THROW(paper.setInk(0, 0, std::nan(""), 0.0), std::invalid_argument);
  const float hairs[TouchingPiece::kUnderside] = {};
  TouchingPiece piece{{-1, 0, 0, 0, 1e-3}, {-1, 0.01, 0, 0, 1e-3}, 0, 1, 1, -1, 1e-5, 1, 1, 1, 1, hairs};
  EXPECT_EQ(paper.exchange(piece).volume, 0.0);
  piece.a.x = std::nan("");
  EXPECT_EQ(paper.exchange(piece).volume, 0.0);
  EXPECT_EQ(paper.inkVolume(), 0.0);
}

TEST(Paper, PieceMarksAllThatItSweptAndNothingElse) {
  // A needle that moves by one vector sweeps the hexagon around it, in one drawing or in many.
  PaperParameters parameters = plainSheet();
  parameters.roughness = 0.0;
  const float hairs[TouchingPiece::kUnderside] = {};
  constexpr double length = 0.004, half_width = 0.0008, middle_x = kMiddleX, middle_y = kMiddleY;
  for (const double heading : {0.0, 0.4, 1.2, 2.5})
    for (const double turn : {0.0, 0.6, 1.57}) {
      const Eigen::Vector2d along(std::cos(turn), std::sin(turn)), across(-along.y(), along.x());
      const Eigen::Vector2d way = 0.005 * (std::cos(heading) * along + std::sin(heading) * across);
      const auto sweep = [&](int parts) {
        Paper paper(parameters);
        for (int part = 0; part < parts; ++part) {
          const Eigen::Vector2d middle =
              Eigen::Vector2d(middle_x, middle_y) + ((part + 0.5) / parts - 0.5) * way;
          const Eigen::Vector2d a = middle - 0.5 * length * along, b = middle + 0.5 * length * along;
          const Eigen::Vector2d half = 0.5 / parts * way;
          paper.beginContact();
          paper.exchange({{a.x(), a.y(), half.x(), half.y(), half_width},
                          {b.x(), b.y(), half.x(), half.y(), half_width},
                          along.x(),
                          along.y(),
                          0.008,
                          -1e-3,
                          1e-5,
                          1.0,
                          1.0,
                          1.0,
                          1.0,
                          hairs});
        }
        return paper;
      };
      const Paper once = sweep(1), often = sweep(20);
      int inside = 0;
      for (int row = 0; row < once.height_px(); ++row)
        for (int column = 0; column < once.width_px(); ++column) {
          const Eigen::Vector2d place = once.pixelSize() * Eigen::Vector2d(column + 0.5, row + 0.5) -
                                        Eigen::Vector2d(middle_x, middle_y);
          // Least distance of the place from the needle on its way, 0 within.
          double distance = 1.0, depth = -1.0;
          for (int k = 0; k <= 400; ++k) {
            const Eigen::Vector2d d = place - (k / 400.0 - 0.5) * way;
            const double beyond = std::abs(d.dot(along)) - 0.5 * length,
                         beside = std::abs(d.dot(across)) - half_width;
            distance = std::min(distance, std::hypot(std::max(0.0, beyond), std::max(0.0, beside)));
            depth = std::max(depth, -std::max(beyond, beside));
          }
          for (const Paper* paper : {&once, &often}) {
            // The corners of what is drawn in parts stand out by a pixel or two.
            if (distance > (paper == &once ? 1.5 : 2.0) * once.pixelSize()) {
              EXPECT_EQ(paper->ink(column, row), 0.0F) << heading << " " << turn;
            }
            if (depth > once.pixelSize()) {
              EXPECT_GT(paper->ink(column, row), 0.9e-5F) << heading << " " << turn;
            }
          }
          inside += depth > once.pixelSize();
        }
      EXPECT_GT(inside, 50);
    }
}

TEST(Paper, DarkensByKubelkaAndMunk) {
  PaperParameters parameters = plainSheet();
  const double r0 = parameters.green;
  double before = 1.0;
  for (const double ink : {2e-7, 1e-6, 5e-6, 3e-5}) {
    Paper paper(parameters);
    paper.addDisc(kMiddleX, kMiddleY, 0.003, ink);
    // K/S = (1 − R)² / (2 R), in R of bare paper and in R of ink on it.
    std::vector<std::uint16_t> mono16;
    paper.render(mono16);
    const double r = r0 * *std::min_element(mono16.begin(), mono16.end()) / 65535.0;
    const double bare = (1 - r0) * (1 - r0) / (2 * r0);
    const double inked = (1 - r) * (1 - r) / (2 * r);
    EXPECT_NEAR((inked - bare) / (ink / parameters.dark_thickness / parameters.scattering), 1.0, 2e-3);
    EXPECT_LT(r / r0, before);
    before = r / r0;
    std::vector<std::uint8_t> mono8;
    paper.render(mono8);
    EXPECT_NEAR(*std::min_element(mono8.begin(), mono8.end()), 255 * r / r0, 0.51);
  }
}

TEST(Paper, TransparentInkOverWhiteLooksAsItDoesOnTheSheet) {
  // Of a sheet that is nearly white.
  PaperParameters parameters = plainSheet();
  parameters.red = parameters.green = parameters.blue = 0.999;
  Paper paper(parameters);
  for (int i = 0; i < 20; ++i)
    paper.addDisc(0.002 + 0.0018 * i, kMiddleY, 0.001, 1e-7 * std::pow(1.5, i));
  std::vector<std::uint8_t> rgb, rgba;
  paper.renderColour(rgb);
  paper.renderTransparent(rgba);
  int clear = 0;
  for (std::size_t pixel = 0; pixel < rgb.size() / 3; ++pixel) {
    const double opacity = rgba[4 * pixel + 3] / 255.0;
    clear += opacity == 0.0;
    for (std::size_t i = 0; i < 3; ++i)
      ASSERT_NEAR(opacity * rgba[4 * pixel + i] + 255.0 * (1.0 - opacity), rgb[3 * pixel + i], 1.6);
  }
  EXPECT_GT(clear, 1000);
}

TEST(Paper, ThinInkIsBrownishAndBarePaperHasItsTint) {
  Paper paper(plainSheet());
  paper.addDisc(kMiddleX, kMiddleY, 0.003, 5e-7);
  std::vector<std::uint8_t> rgb;
  paper.renderColour(rgb);
  const std::size_t middle = 3 * (60 * 160 + 80);
  EXPECT_GT(rgb[0], rgb[2]);
  EXPECT_GT(int(rgb[middle]) * rgb[2], int(rgb[middle + 2]) * rgb[0]);  // more so than the paper
}

// ---------------------------------------------------------------- relief

TEST(Relief, HasTheRoughnessAskedForAtAnyResolution) {
  for (const double px_per_mm : {2.0, 8.0, 32.0}) {
    PaperParameters parameters;
    const Relief relief(parameters, 1e-3 / px_per_mm);
    constexpr int kSize = 128;
    std::vector<float> height(kSize * kSize);
    double sum = 0.0, squares = 0.0;
    constexpr int kSquares = 6;  // far apart
    for (int k = 0; k < kSquares; ++k) {
      relief.sampleHeight(1000 * k, 500, kSize, height.data());
      for (const float h : height) {
        sum += double(h);
        squares += double(h) * double(h);
      }
    }
    const double n = kSize * kSize * kSquares;
    const double spread = relief.spreadInPixel();
    EXPECT_NEAR(sum / n, 0.0, 0.05 * parameters.roughness) << px_per_mm;
    EXPECT_NEAR(std::sqrt(squares / n + spread * spread) / parameters.roughness, 1.0, 0.1) << px_per_mm;
  }
}

TEST(Relief, IsTheSameSheetAtAnyResolution) {
  PaperParameters parameters;
  const Relief coarse(parameters, 2.5e-4), fine(parameters, 1.25e-4);
  std::vector<float> a(64 * 64), b(128 * 128);
  coarse.sampleHeight(32, 32, 64, a.data());
  fine.sampleHeight(64, 64, 128, b.data());
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t row = 0; row < 64; ++row)
    for (std::size_t column = 0; column < 64; ++column) {
      const double mean =
          0.25 * double(b[2 * row * 128 + 2 * column] + b[2 * row * 128 + 2 * column + 1] +
                        b[(2 * row + 1) * 128 + 2 * column] + b[(2 * row + 1) * 128 + 2 * column + 1]);
      const double value = double(a[row * 64 + column]);
      ab += value * mean;
      aa += value * value;
      bb += mean * mean;
    }
  EXPECT_GT(ab / std::sqrt(aa * bb), 0.97);
}

TEST(Relief, IsAnotherSheetForAnotherSeedAndJoinsAtTiles) {
  PaperParameters parameters;
  const Relief relief(parameters, 2.5e-4);
  std::vector<float> whole(64 * 64), part(32 * 32), other(64 * 64);
  relief.sampleHeight(0, 0, 64, whole.data());
  relief.sampleHeight(32, 32, 32, part.data());
  for (std::size_t row = 0; row < 32; ++row)
    for (std::size_t column = 0; column < 32; ++column)
      ASSERT_NEAR(part[row * 32 + column], whole[(row + 32) * 64 + column + 32], 1e-9);
  parameters.seed = 2;
  Relief(parameters, 2.5e-4).sampleHeight(0, 0, 64, other.data());
  EXPECT_NE(whole, other);
}

// ---------------------------------------------------------------- flow

TEST(Flow, LosesNothing) {
  PaperParameters parameters = smallSheet(8);
  parameters.diffusivity = 1e-6;
  parameters.evaporation = 1e-6;
  Paper paper(parameters);
  paper.addDisc(kMiddleX, kMiddleY, 0.004, 5e-5);
  paper.addDisc(0.001, 0.001, 0.004, 1e-4);  // runs against two edges of the sheet
  const double ink = paper.inkVolume(), water = paper.waterVolume();
  for (int second = 1; second <= 20; ++second) {
    wait(paper, 1.0);
    EXPECT_NEAR(paper.inkVolume(), ink, 1e-12 * ink) << second;
    EXPECT_NEAR(paper.waterVolume() + paper.evaporatedVolume(), water, 1e-12 * water) << second;
    for (int row = 0; row < paper.height_px(); ++row)
      for (int column = 0; column < paper.width_px(); ++column) {
        ASSERT_GE(paper.water(column, row), 0.0F);
        ASSERT_GE(paper.ink(column, row), 0.0F);
      }
  }
  EXPECT_GT(paper.evaporatedVolume(), 0.1 * water);
}

TEST(Flow, SpreadsAlikeInAllDirectionsAndAcrossTiles) {
  PaperParameters parameters = plainSheet(8);
  parameters.height = 0.04;
  parameters.diffusivity = 1e-6;
  parameters.evaporation = 1e-7;
  Paper paper(parameters);
  // The middle of the sheet is a corner of four tiles; that of the blot too.
  paper.addDisc(0.02, 0.02, 0.002, 1e-4);
  wait(paper, 3.0);
  const int n = paper.width_px();
  ASSERT_EQ(n, paper.height_px());
  int wet = 0;
  for (int row = 0; row < n; ++row)
    for (int column = 0; column < n; ++column) {
      wet += paper.water(column, row) > 0.0F;
      ASSERT_NEAR(paper.water(column, row), paper.water(n - 1 - column, row), 1e-11F);
      ASSERT_NEAR(paper.water(column, row), paper.water(row, column), 1e-11F);
    }
  EXPECT_GT(wet, 1500);
}

TEST(Flow, ADryOrDriedSheetCostsNothing) {
  PaperParameters parameters = smallSheet(8);
  parameters.evaporation = 1e-5;
  Paper paper(parameters);
  wait(paper, 1.0);
  EXPECT_EQ(paper.revision(), 0U);
  paper.addDisc(kMiddleX, kMiddleY, 0.003, 2e-5);
  EXPECT_GT(paper.wetTileCount(), 0);
  wait(paper, 5.0);
  EXPECT_EQ(paper.wetTileCount(), 0);
  EXPECT_EQ(paper.movingTileCount(), 0);
  const std::uint64_t revision = paper.revision();
  wait(paper, 2.0);
  EXPECT_EQ(paper.revision(), revision);
}

TEST(Flow, WorksOnlyOnTilesInWhichLiquidMoves) {
  std::uint64_t count[2];
  for (const bool large : {false, true}) {
    PaperParameters parameters = smallSheet(8);
    if (large) parameters.width = parameters.height = 0.8;  // 667 times as many tiles
    Paper paper(parameters);
    wait(paper, 1.0);
    EXPECT_EQ(paper.flowCount(), 0U);  // dry
    paper.addDisc(kMiddleX, kMiddleY, 0.002, 4e-5);
    wait(paper, 2.0);
    EXPECT_LT(paper.tileCount(), 10);
    count[large] = paper.flowCount();
  }
  EXPECT_GT(count[0], 0U);
  EXPECT_EQ(count[1], count[0]);
}

TEST(Flow, AFullBlotDoesNotHastenAFaintOne) {
  // The faint one costs as much beside a full one as alone.
  std::uint64_t count[3];
  for (const int which : {1, 2, 3}) {
    Paper paper(smallSheet(8));
    if (which & 1) paper.addDisc(0.01, kMiddleY, 0.002, 8e-5);
    if (which & 2) paper.addDisc(0.03, kMiddleY, 0.002, 3e-6);
    wait(paper, 2.0);
    count[which - 1] = paper.flowCount();
  }
  EXPECT_GT(count[0], 4 * count[1]);
  const auto sum = static_cast<double>(count[0] + count[1]);
  EXPECT_NEAR(static_cast<double>(count[2]), sum, 0.02 * sum);  // calls are divided otherwise
}

TEST(Flow, TilesAtTheirOwnStepsDoAsOneGridAtShortSteps) {
  PaperParameters parameters = smallSheet(8);
  parameters.unevenness = parameters.evaporation = parameters.film_flow = 0.0;
  parameters.diffusivity = 3e-7;
  Paper paper(parameters);
  // On the corner of four tiles, full, and beside it faint: their steps are far from each other.
  paper.addDisc(0.020, 0.016, 0.003, 4e-5);
  paper.addDisc(0.025, 0.016, 0.003, 1e-5);
  const int columns = paper.width_px(), rows = paper.height_px();
  const double seconds = 4.0, step = 5e-4, full = paper.capacity();
  const int q = parameters.flow_exponent;
  std::vector<double> filling, potential, flux;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column)
      filling.push_back(double(paper.water(column, row)) / full);
  const double rate = step * fullDiffusivity(parameters.diffusivity, q) /
                      (paper.pixelSize() * paper.pixelSize() * (q + 1));
  potential.resize(filling.size());
  for (double t = 0.0; t < seconds - 1e-9; t += step) {
    for (std::size_t i = 0; i < filling.size(); ++i) {
      const double inside = std::min(1.0, filling[i]);
      potential[i] =
          filling[i] < 1e-4 ? 0.0 : rate * (std::pow(inside, q + 1) + (q + 1) * (filling[i] - inside));
    }
    for (int row = 0; row < rows; ++row)
      for (int column = 0; column < columns; ++column) {
        const auto at = static_cast<std::size_t>(row * columns + column);
        const auto flow = [&](std::size_t other) {
          filling[at] += potential[other] - potential[at];
          filling[other] += potential[at] - potential[other];
        };
        if (column + 1 < columns) flow(at + 1);
        if (row + 1 < rows) flow(at + static_cast<std::size_t>(columns));
      }
  }
  wait(paper, seconds);
  double difference = 0.0, sum = 0.0;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const double expected = full * filling[static_cast<std::size_t>(row * columns + column)];
      difference += std::abs(double(paper.water(column, row)) - expected);
      sum += expected;
    }
  EXPECT_LT(difference / sum, 0.01);
}

TEST(Flow, BleedsFurtherOnRawThanOnSizedPaper) {
  double before = 0.0;
  for (const double diffusivity : {0.0, 1e-8, 1e-7, 1e-6}) {
    PaperParameters parameters = smallSheet(8);
    parameters.diffusivity = diffusivity;
    Paper paper(parameters);
    paper.addDisc(kMiddleX, kMiddleY, 0.003, 4e-5);
    wait(paper, 10.0);
    const double radius = radiusOf(paper, 1e-7);
    EXPECT_GT(radius, before + 1e-5) << diffusivity;
    before = radius;
  }
}

TEST(Flow, LeavesADarkerRim) {
  PaperParameters parameters = smallSheet(8);
  parameters.diffusivity = 3e-7;
  parameters.evaporation = 5e-7;
  parameters.settling_rate = 0.0;
  parameters.unevenness = 0.0;
  Paper paper(parameters);
  paper.addDisc(kMiddleX, kMiddleY, 0.003, 4e-5);
  wait(paper, 120.0);
  ASSERT_EQ(paper.wetTileCount(), 0);
  // Along a row through the middle: inner half, and the darkest place beyond.
  const int row = paper.height_px() / 2, middle = paper.width_px() / 2;
  const double inner = double(paper.ink(middle, row));
  double rim = 0.0;
  for (int column = middle + 8; column < paper.width_px(); ++column)
    rim = std::max(rim, double(paper.ink(column, row)));
  EXPECT_GT(rim, 1.2 * inner);
}

TEST(Flow, RewettingMovesWhatHasNotSettled) {
  for (const double rate : {0.0, 10.0}) {
    PaperParameters parameters = plainSheet(8);
    parameters.diffusivity = 1e-7;
    parameters.evaporation = 5e-6;
    parameters.settling_rate = rate;
    Paper paper(parameters);
    paper.addDisc(kMiddleX, kMiddleY, 0.002, 1e-5);
    wait(paper, 10.0);
    ASSERT_EQ(paper.wetTileCount(), 0);
    const double before = radiusOf(paper, 1e-8);
    // Clear water.
    const double wet = paper.capacity();
    for (int row = 0; row < paper.height_px(); ++row)
      for (int column = 0; column < paper.width_px(); ++column)
        if (paper.ink(column, row) > 0.0F)
          paper.setInk(column, row, wet, rate > 0.0 ? 0.0 : double(paper.ink(column, row)));
    wait(paper, 3.0);
    const double after = radiusOf(paper, 1e-8);
    if (rate == 0.0) {
      EXPECT_GT(after, before + 2e-4);
    } else {
      EXPECT_NEAR(after, before, 1e-9);
    }
  }
}

// ---------------------------------------------------------------- tip and sheet

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

/// The rod lies along x with its last half on the sheet.
std::vector<Eigen::Vector3d> rodLyingAt(double x, double y) {
  return {{x - 0.01, y, 0.01}, {x, y, 0}, {x + 0.01, y, 0}};
}

const std::vector<double> kPush{0.0, 1e-3, 1e-3};

/// One step with contact.
void draw(TipInk& ink, Paper& paper, const std::vector<Eigen::Vector3d>& nodes, double seconds = 0.001) {
  ink.pass(std::llround(seconds * 1e9));
  paper.beginContact();
  ink.transfer(0, nodes, kPush, paper);
}

}  // namespace

TEST(TipInk, HasTheRodsRoomAtItsNodes) {
  const TipInk ink(plainBrush(), InkParameters{});
  EXPECT_EQ(ink.rodCount(), 1);
  EXPECT_EQ(ink.nodeCount(), 3);
  EXPECT_DOUBLE_EQ(ink.rodCapacity(0), 1e-9);
  EXPECT_DOUBLE_EQ(ink.capacity()[1], 2.0 * ink.capacity()[0]);  // an end stands for half an edge
}

TEST(TipInk, IsDippedFromTheTipUpwards) {
  InkParameters parameters;
  parameters.load = 0.5;
  parameters.concentration = 0.25;
  const TipInk ink(plainBrush(), parameters);
  EXPECT_DOUBLE_EQ(ink.totalVolume(), 0.5e-9);
  EXPECT_DOUBLE_EQ(ink.totalPigment(), 0.125e-9);
  EXPECT_DOUBLE_EQ(ink.volume()[2], ink.capacity()[2]);
  EXPECT_DOUBLE_EQ(ink.volume()[1], 0.25e-9);
  EXPECT_EQ(ink.volume()[0], 0.0);
}

TEST(TipInk, IsWipedFromTheSurface) {
  BrushModel brush = plainBrush();
  brush.rods.push_back(brush.rods[0]);
  brush.rods.push_back(brush.rods[0]);
  brush.rods[1].root_H.x() = 0.002;
  brush.rods[2].root_H.x() = 0.001;
  TipInk ink(brush, InkParameters{});
  ink.wipe(0.5);
  EXPECT_NEAR(ink.totalVolume(), 1.5e-9, 1e-22);
  EXPECT_EQ(ink.rodVolume(1), 0.0);
  EXPECT_NEAR(ink.rodVolume(2), 0.5e-9, 1e-22);
  EXPECT_NEAR(ink.rodVolume(0), 1e-9, 1e-22);
  EXPECT_THROW(ink.wipe(std::nan("")), std::invalid_argument);
  ink.wipe();
  EXPECT_EQ(ink.totalVolume(), 0.0);
}

TEST(TipInk, LosesWhatTheSheetGains) {
  Paper paper(smallSheet());
  TipInk ink(plainBrush(), InkParameters{});
  const double before = ink.totalVolume();
  for (int step = 0; step <= 200; ++step) draw(ink, paper, rodLyingAt(0.005 + 0.0001 * step, 0.015));
  EXPECT_GT(paper.inkVolume(), 1e-12);
  EXPECT_NEAR(ink.totalVolume() + paper.waterVolume(), before, 1e-12 * before);
  EXPECT_NEAR(ink.totalPigment() + paper.inkVolume(), before, 1e-12 * before);
}

TEST(TipInk, TakesFromAWetSheetWhenItIsDry) {
  PaperParameters sheet = plainSheet();
  Paper paper(sheet);
  TipInk ink(plainBrush(), InkParameters{});
  ink.wipe();
  draw(ink, paper, rodLyingAt(0.015, 0.015), 1.0);
  EXPECT_EQ(ink.totalVolume(), 0.0);  // from a dry sheet it takes nothing
  paper.addDisc(kMiddleX, kMiddleY, 0.005, 3e-5);
  const double before = paper.waterVolume();
  for (int step = 0; step < 50; ++step) draw(ink, paper, rodLyingAt(0.015, 0.015), 0.02);
  EXPECT_GT(ink.totalVolume(), 1e-11);
  EXPECT_NEAR(ink.totalVolume() + paper.waterVolume(), before, 1e-12 * before);
  EXPECT_NEAR(ink.totalPigment() + paper.inkVolume(), before, 1e-12 * before);
}

TEST(TipInk, LeavesMoreTheLongerItTouches) {
  double before = 0.0;
  for (const double seconds : {0.01, 0.1, 1.0}) {
    Paper paper(plainSheet());
    TipInk ink(plainBrush(), InkParameters{});
    draw(ink, paper, rodLyingAt(0.015, 0.015), 0.001);
    draw(ink, paper, rodLyingAt(0.015, 0.015), seconds);
    EXPECT_GT(paper.waterVolume(), 1.1 * before);
    before = paper.waterVolume();
  }
}

TEST(TipInk, LeavesTheSameInManyStepsAsInFew) {
  double volume[2];
  for (const int steps : {1, 10}) {
    Paper paper(plainSheet());
    BrushModel brush = plainBrush();
    brush.rods[0].ink_capacity = 1e-6;  // so that it does not fade
    TipInk ink(brush, InkParameters{});
    draw(ink, paper, rodLyingAt(0.015, 0.015), 1e-6);
    for (int step = 0; step < steps; ++step) draw(ink, paper, rodLyingAt(0.015, 0.015), 0.1 / steps);
    volume[steps > 1] = paper.waterVolume();
  }
  EXPECT_NEAR(volume[1] / volume[0], 1.0, 1e-2);
}

TEST(TipInk, BundlesOverEachOtherTouchForNoLonger) {
  double volume[2];
  for (const int count : {1, 8}) {
    BrushModel brush = plainBrush();
    brush.rods[0].ink_capacity = 1e-6;
    brush.rods.resize(static_cast<std::size_t>(count), brush.rods[0]);
    InkParameters parameters;
    parameters.hair_unevenness = 0.0;
    TipInk ink(brush, parameters);
    Paper paper(plainSheet());
    for (int step = 0; step < 5; ++step) {
      ink.pass(10000000);
      paper.beginContact();
      for (int rod = 0; rod < count; ++rod) ink.transfer(rod, rodLyingAt(0.015, 0.015), kPush, paper);
    }
    volume[count > 1] = paper.waterVolume();
  }
  EXPECT_NEAR(volume[1] / volume[0], 1.0, 0.05);
}

TEST(TipInk, LeavesNothingAboveTheSheet) {
  Paper paper(smallSheet());
  InkParameters parameters;
  TipInk ink(plainBrush(), parameters);
  for (int step = 0; step <= 100; ++step)
    draw(ink, paper, rodWithTipAt(0.005 + 0.0001 * step, 0.015, 0.0005 + parameters.coat + 1e-9));
  EXPECT_EQ(paper.inkVolume(), 0.0);
}

TEST(TipInk, DrawsAsWideAsTheBundleLies) {
  // A bundle of radius r whose middle is at height z touches in a chord of half width √(r² − z²).
  InkParameters parameters;
  parameters.coat = parameters.hair_unevenness = 0.0;
  for (const double z : {0.0, 0.0003, 0.00045}) {
    Paper paper(plainSheet(20));
    BrushModel brush = plainBrush();
    brush.rods[0].ink_capacity = 1e-6;  // so that it does not fade
    TipInk ink(brush, parameters);
    // Sideways, so that all of the chord is under the same part of the rod.
    for (int step = 0; step <= 300; ++step) {
      auto nodes = rodLyingAt(0.02, 0.015);
      for (auto& node : nodes) node.z() += z;
      draw(ink, paper, nodes);
    }
    double width = 0;
    for (int row = 0; row < paper.height_px(); ++row) width += double(paper.ink(500, row));
    width *= paper.pixelSize() / double(paper.ink(500, 300));
    EXPECT_NEAR(width, 2 * std::sqrt(0.0005 * 0.0005 - z * z), 0.00005) << z;
  }
}

TEST(TipInk, FillsWhatItSweepsSideways) {
  Paper paper(plainSheet());
  BrushModel brush = plainBrush();
  brush.rods[0].ink_capacity = 1e-6;
  TipInk ink(brush, InkParameters{});
  draw(ink, paper, rodLyingAt(0.015, 0.005));
  draw(ink, paper, rodLyingAt(0.015, 0.025));  // 20 mm in one step
  for (int row = 22; row <= 98; ++row) EXPECT_GT(paper.ink(80, row), 5e-6F) << row;
  EXPECT_EQ(paper.ink(80, 14), 0.0F);
  EXPECT_EQ(paper.ink(80, 106), 0.0F);
}

TEST(TipInk, JoinsFastMotionsWithoutGaps) {
  Paper paper(plainSheet());
  TipInk ink(plainBrush(), InkParameters{});
  draw(ink, paper, rodWithTipAt(0.005, 0.015, 0));
  draw(ink, paper, rodWithTipAt(0.030, 0.015, 0));  // 25 mm in one step
  for (int column = 20; column <= 118; ++column) EXPECT_GT(paper.ink(column, 60), 1e-7F) << column;
}

TEST(TipInk, ForgetsWhereItWasWhenLifted) {
  Paper paper(smallSheet());
  TipInk ink(plainBrush(), InkParameters{});
  draw(ink, paper, rodWithTipAt(0.005, 0.015, 0));
  ink.lift(0);
  draw(ink, paper, rodWithTipAt(0.030, 0.015, 0));
  EXPECT_EQ(paper.ink(70, 60), 0.0F);
}

TEST(TipInk, TouchesOnlyPeaksWhenDry) {
  double before = 1.1;
  for (const double load : {1.0, 0.2, 0.1, 0.05}) {
    Paper paper(smallSheet(8));
    BrushModel brush = plainBrush();
    brush.rods[0].ink_capacity = 1e-6;
    InkParameters parameters;
    parameters.hair_unevenness = 0.0;
    TipInk ink(brush, parameters);
    for (std::size_t i = 0; i < 3; ++i) ink.volume()[i] = load * ink.capacity()[i];
    ink.pigment() = ink.volume();
    for (int step = 0; step < 5; ++step) draw(ink, paper, rodLyingAt(0.015, 0.015), 0.05);
    // What is inked is higher than what is not.
    double inked = 0, all = 0, high = 0, low = 0;
    for (int column = 130; column < 180; ++column)
      for (int row = 117; row < 123; ++row) {
        const bool is_inked = double(paper.ink(column, row)) > 1e-6;
        inked += is_inked;
        all += 1;
        (is_inked ? high : low) += double(paper.height(column, row));
      }
    EXPECT_LT(inked / all, before) << load;
    if (inked > 0 && inked < all) {
      EXPECT_GT(high / inked, low / (all - inked)) << load;
    }
    before = inked / all + 1e-9;
  }
  EXPECT_LT(before, 0.9);
}

TEST(TipInk, FadesAsItRunsDry) {
  Paper paper(plainSheet());
  TipInk ink(plainBrush(), InkParameters{});
  std::vector<double> lines;
  for (int line = 0; line < 10; ++line) {
    const double held = ink.totalVolume();
    ink.lift(0);
    for (int step = 0; step <= 300; ++step)
      draw(ink, paper, rodLyingAt(0.005 + 0.0001 * step, 0.002 + 0.0025 * line));
    lines.push_back(held - ink.totalVolume());
  }
  EXPECT_GT(lines.front(), 0.0);
  for (std::size_t line = 1; line < lines.size(); ++line)
    EXPECT_LT(lines[line], lines[line - 1]) << line;
  EXPECT_GE(*std::min_element(ink.volume().begin(), ink.volume().end()), 0.0);
  ink.dip();
  EXPECT_NEAR(ink.totalVolume(), ink.totalCapacity(), 1e-20);
}
