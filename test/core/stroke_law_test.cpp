#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "calligraphy_brush/sim/simulator.h"

// Laws of the written line, on pictures of whole strokes.

using namespace calligraphy_brush;

namespace {

SimulatorParameters scene() {
  SimulatorParameters p;
  p.brush.rod_count = 64;
  p.paper.width = p.paper.height = 0.16;
  p.paper.px_per_mm = 4.0;
  return p;
}

/// The same by rods that touch, of hair that tapers as little as that of the medium brush.
SimulatorParameters touchingScene() {
  SimulatorParameters p = scene();
  p.brush.hair_taper = 0.85;
  p.contact.bundles = true;
  return p;
}

constexpr double kTilt = 0.35;

/// A straight stroke through the middle of the sheet: down, along at constant speed, up, as smoothly as
/// a hand moves.
struct Line {
  double length = 0.1, speed = 0.08, depth = 0.01, turn = 0.0, rate = 125.0;
};

void write(Simulator& simulator, const Line& line) {
  const SimulatorParameters& p = simulator.parameters();
  const double duration = line.length / line.speed, ramp = 0.15, soft = 0.1;
  const Eigen::Matrix3d R = Eigen::AngleAxisd(line.turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d middle(0.5 * p.paper.width, 0.5 * p.paper.height, 0.0);
  // A step of continuous curvature, and its integral.
  const auto ease = [](double u) {
    return u <= 0 ? 0.0 : u >= 1 ? 1.0 : u * u * u * (10 + u * (6 * u - 15));
  };
  const auto way = [](double u) {
    return u <= 0 ? 0.0 : u >= 1 ? u - 0.5 : u * u * u * u * (2.5 + u * (u - 3));
  };
  const int poses = static_cast<int>((duration + 2 * ramp + 0.1) * line.rate);
  for (int k = 0; k <= poses; ++k) {
    const double t = k / line.rate;
    const double depth =
        (line.depth + 0.003) * (ease(t / ramp) - ease((t - ramp - duration) / ramp)) - 0.003;
    const double along =
        line.speed * soft * (way((t - ramp) / soft) - way((t - ramp - duration) / soft)) -
        0.5 * line.length;
    HandlePose pose;
    pose.stamp_ns = 1000000000 + std::llround(t * 1e9);
    // It leans and trails: an upright brush does not know which way to bend.
    const double height = simulator.brush().tip_length * std::cos(kTilt);
    pose.position = middle + R * Eigen::Vector3d(along, 0.0, height - depth);
    pose.orientation = Eigen::Quaterniond(R) * Eigen::AngleAxisd(kTilt, Eigen::Vector3d::UnitY());
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
  }
}

using Picture = std::vector<std::vector<double>>;  // darkness 0..1, by row from below

Picture pictureOf(const Simulator& simulator) {
  const Paper& paper = simulator.paper();
  std::vector<std::uint8_t> mono8;
  paper.render(mono8);
  Picture picture(static_cast<std::size_t>(paper.height_px()));
  for (std::size_t row = 0; row < picture.size(); ++row)
    for (int column = 0; column < paper.width_px(); ++column)
      picture[row].push_back(
          1.0 - mono8[(picture.size() - 1 - row) * static_cast<std::size_t>(paper.width_px()) +
                      static_cast<std::size_t>(column)] /
                    255.0);
  return picture;
}

/// Intersection over union of what is darker than half.
double overlap(const Picture& a, const Picture& b) {
  double both = 0, either = 0;
  for (std::size_t row = 0; row < a.size(); ++row)
    for (std::size_t column = 0; column < a[row].size(); ++column) {
      const bool x = a[row][column] > 0.5, y = b[row][column] > 0.5;
      both += x && y;
      either += x || y;
    }
  return both / either;
}

/// Part of the pixels within the outline (from lowest to highest ink of each column) that are bare,
/// for columns in a part of the sheet's width.
double gaps(const Picture& picture, double from = 0.35, double to = 0.6) {
  double bare = 0, all = 0;
  const auto width = static_cast<double>(picture[0].size());
  const auto end = static_cast<std::size_t>(to * width);
  for (auto column = static_cast<std::size_t>(from * width); column < end; ++column) {
    std::size_t first = picture.size(), last = 0;
    for (std::size_t row = 0; row < picture.size(); ++row)
      if (picture[row][column] > 0.15) {
        first = std::min(first, row);
        last = row;
      }
    for (std::size_t row = first; row <= last && first < picture.size(); ++row) {
      all += 1;
      bare += picture[row][column] <= 0.3;
    }
  }
  return all > 0 ? bare / all : 1.0;
}

Picture line(const SimulatorParameters& p, const Line& how = {}) {
  Simulator simulator(p);
  write(simulator, how);
  return pictureOf(simulator);
}

/// By a brush with so many times the room for ink; by default it does not run dry.
Picture wetLine(const SimulatorParameters& p, const Line& how = {}, double room = 1000.0) {
  BrushModel brush = makeBrush(p.brush);
  for (RodModel& rod : brush.rods) rod.ink_capacity *= room;
  Simulator simulator(p, std::move(brush));
  write(simulator, how);
  return pictureOf(simulator);
}

}  // namespace

TEST(StrokeLaw, CoverageNeverRisesAlongAStrokeOnOneLoad) {
  SimulatorParameters p = scene();
  p.paper.width = 0.3;
  Line how;
  how.length = 0.24;
  const Picture picture = wetLine(p, how, 0.3);
  // Darkness by sixths of the way, without the two ends.
  std::vector<double> covered;
  for (int part = 1; part <= 4; ++part) {
    double sum = 0;
    const auto from = static_cast<std::size_t>((0.01 + 0.04 * part) * 4000);
    for (const auto& row : picture)
      for (std::size_t column = from; column < from + 160; ++column) sum += row[column];
    covered.push_back(sum / 160);
  }
  EXPECT_GT(covered.front(), 1.0);
  for (std::size_t i = 1; i < covered.size(); ++i)
    EXPECT_LE(covered[i], 1.02 * covered[i - 1]) << i;  // paper is not the same everywhere
  EXPECT_LT(covered.back(), covered.front());
}

TEST(StrokeLaw, GapsRiseWithDryness) {
  double before = -1.0;
  for (const double room : {1000.0, 0.5, 0.2, 0.08, 0.04}) {
    const double share = gaps(wetLine(scene(), {}, room));
    EXPECT_GT(share, before) << room;
    before = share;
  }
  EXPECT_GT(before, 0.3);
}

TEST(StrokeLaw, GapsRiseWithSpeed) {
  double before = -1.0;
  for (const double speed : {0.02, 0.1, 0.5}) {
    SimulatorParameters p = scene();
    p.ink.coat = 15e-6;  // as little as a nearly dry bundle has, but it does not get drier on the way
    p.ink.film_thickness = 2e-7;
    Line how;
    how.speed = speed;
    const double share = gaps(wetLine(p, how));
    EXPECT_GT(share, before) << speed;
    before = share;
  }
}

TEST(StrokeLaw, StreaksLieAlongTheMotion) {
  SimulatorParameters p = scene();
  p.ink.load = 0.1;
  const Picture picture = line(p);
  // Squared change of darkness across the stroke over that along it, where there is ink.
  double across = 0, along = 0;
  for (std::size_t row = 1; row + 1 < picture.size(); ++row)
    for (std::size_t column = 230; column < 380; ++column) {
      across += std::pow(picture[row + 1][column] - picture[row][column], 2);
      along += std::pow(picture[row][column + 1] - picture[row][column], 2);
    }
  EXPECT_GT(across / along, 1.2);
}

namespace {

/// Means of squares of 2 × 2.
Picture halved(const Picture& fine) {
  Picture mean(fine.size() / 2);
  for (std::size_t row = 0; row < mean.size(); ++row)
    for (std::size_t column = 0; column < fine[row].size() / 2; ++column)
      mean[row].push_back(0.25 * (fine[2 * row][2 * column] + fine[2 * row][2 * column + 1] +
                                  fine[2 * row + 1][2 * column] + fine[2 * row + 1][2 * column + 1]));
  return mean;
}

void expectTurnedPicturesOfTurnedInput(SimulatorParameters p) {
  p.paper.roughness = p.paper.unevenness = 0.0;  // the sheet does not turn with it
  p.paper.px_per_mm = 8.0;                       // turning a picture blurs a pixel; 4 are compared
  const Picture straight = wetLine(p);
  for (const double angle : {M_PI / 2, 1.0, 0.3}) {
    Line how;
    how.turn = angle;
    const Picture turned = wetLine(p, how);
    // Back by bilinear interpolation.
    Picture back = straight;
    const double middle = 0.5 * static_cast<double>(straight.size()) - 0.5;
    for (std::size_t row = 0; row < back.size(); ++row)
      for (std::size_t column = 0; column < back.size(); ++column) {
        const double x = double(column) - middle, y = double(row) - middle;
        const double u = std::cos(angle) * x - std::sin(angle) * y + middle;
        const double v = std::sin(angle) * x + std::cos(angle) * y + middle;
        const auto i = static_cast<std::ptrdiff_t>(std::floor(u)),
                   j = static_cast<std::ptrdiff_t>(std::floor(v));
        const auto n = static_cast<std::ptrdiff_t>(back.size());
        double sum = 0;
        for (std::ptrdiff_t a = 0; a < 2; ++a)
          for (std::ptrdiff_t b = 0; b < 2; ++b)
            if (i + a >= 0 && j + b >= 0 && i + a < n && j + b < n)
              sum += (a ? u - double(i) : 1 - u + double(i)) * (b ? v - double(j) : 1 - v + double(j)) *
                     turned[static_cast<std::size_t>(j + b)][static_cast<std::size_t>(i + a)];
        back[row][column] = sum;
      }
    EXPECT_GE(overlap(halved(straight), halved(back)), 0.98) << angle;
  }
}

}  // namespace

TEST(StrokeLaw, TurningTheInputTurnsThePicture) {
  expectTurnedPicturesOfTurnedInput(scene());
}
TEST(StrokeLaw, TurningTheInputTurnsThePictureOfRodsThatTouch) {
  expectTurnedPicturesOfTurnedInput(touchingScene());
}

TEST(StrokeLaw, TheRateOfPosesDoesNotMatter) {
  for (SimulatorParameters p : {scene(), touchingScene()}) {
    p.paper.px_per_mm = 8.0;
    const Picture usual = halved(wetLine(p));
    for (const double rate : {62.5, 250.0}) {
      Line how;
      how.rate = rate;
      EXPECT_GT(overlap(usual, halved(wetLine(p, how))), 0.98) << rate << " " << p.contact.bundles;
    }
  }
}

TEST(StrokeLaw, TwiceTheResolutionIsTheSameStroke) {
  for (SimulatorParameters p : {scene(), touchingScene()}) {
    p.paper.px_per_mm = 8.0;
    const Picture coarse = wetLine(p);
    p.paper.px_per_mm = 16.0;
    const Picture fine = wetLine(p);
    EXPECT_GE(overlap(coarse, halved(fine)), 0.97) << p.contact.bundles;
  }
}

TEST(StrokeLaw, ThereIsNoInkWhereTheTipDidNotTouch) {
  SimulatorParameters p = scene();
  p.paper.diffusivity = 0.0;  // nor does it run
  Simulator simulator(p);
  // Places that a node came near to, with room for the bundle, its coat and a pixel.
  std::vector<Eigen::Vector2d> touched;
  const double reach = 0.001;
  const double length = simulator.brush().tip_length;
  for (int k = 0; k < 150; ++k) {
    HandlePose pose;
    pose.stamp_ns = 1000000000 + 8000000LL * k;
    pose.position = {0.04 + 0.0005 * k, 0.08 + 0.01 * std::sin(0.05 * k),
                     length + 0.004 - 0.012 * std::sin(M_PI * k / 150.0)};
    ASSERT_EQ(simulator.addPose(pose), PoseVerdict::kAccepted);
    simulator.advance();
    for (int rod = 0; rod < simulator.rodCount(); ++rod)
      for (int node = 1; node < simulator.nodeCount(); ++node) {
        const Eigen::Vector3d a = simulator.nodePosition(rod, node - 1);
        const Eigen::Vector3d b = simulator.nodePosition(rod, node);
        if (std::min(a.z(), b.z()) > reach) continue;
        for (int part = 0; part <= 6; ++part) touched.push_back((a + part / 6.0 * (b - a)).head<2>());
      }
  }
  const Paper& paper = simulator.paper();
  std::vector<char> near(static_cast<std::size_t>(paper.width_px() * paper.height_px()));
  const int radius = static_cast<int>(std::ceil(0.0013 / paper.pixelSize()));
  for (const auto& place : touched) {
    const int i = static_cast<int>(place.x() / paper.pixelSize());
    const int j = static_cast<int>(place.y() / paper.pixelSize());
    for (int row = std::max(0, j - radius); row <= std::min(paper.height_px() - 1, j + radius); ++row)
      for (int column = std::max(0, i - radius); column <= std::min(paper.width_px() - 1, i + radius);
           ++column)
        near[static_cast<std::size_t>(row * paper.width_px() + column)] = 1;
  }
  int inked = 0;
  for (int row = 0; row < paper.height_px(); ++row)
    for (int column = 0; column < paper.width_px(); ++column)
      if (paper.ink(column, row) > 0.0F) {
        ++inked;
        EXPECT_TRUE(near[static_cast<std::size_t>(row * paper.width_px() + column)])
            << column << " " << row;
      }
  EXPECT_GT(inked, 1000);
}
