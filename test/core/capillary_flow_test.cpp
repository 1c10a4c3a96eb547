#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "calligraphy_brush/ink/capillary_flow.h"

// Ink that moves within the tip.

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A bundle of the same room everywhere.
RodModel uniformRod(double length, int nodes, const Eigen::Vector3d& root) {
  RodModel rod = makeUniformRod(length, 1e-7, 2e-4, nodes);
  rod.root_H = root;
  rod.node_radius.assign(static_cast<std::size_t>(nodes), 3e-4);
  rod.ink_capacity = 1e-9;
  return rod;
}

struct Flow {
  CapillaryFlow& capillary_flow;
  void flow(double seconds, TipInk& ink) const {
    capillary_flow.flowAlong(seconds, ink);
    capillary_flow.flowAcross(seconds, ink);
  }
};

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

TEST(CapillaryFlow, SmallDifferencesDecayAsDiffusionDoes) {
  const int n = 101;
  const double length = 0.04;
  BrushModel brush;
  brush.rods = {uniformRod(length, n, {0, 0, 0})};
  InkParameters parameters;
  TipInk ink(brush, parameters);
  CapillaryFlow capillary_flow(brush, parameters);
  const Flow flow{capillary_flow};
  const auto wave = [&](int node) { return std::cos(kPi * node / (n - 1)); };
  for (int node = 0; node < n; ++node)
    ink.volume()[std::size_t(node)] = ink.capacity()[std::size_t(node)] * (0.998 + 1e-4 * wave(node));
  const double time = 1.0, steps = 1000;
  for (int step = 0; step < steps; ++step) flow.flow(time / steps, ink);
  // Exact: exp(−D S³ π² t/L²), S = 0.998.
  const double decay =
      std::exp(-parameters.spreading * std::pow(0.998, 3) * kPi * kPi * time / (length * length));
  const double left = ink.volume()[0] / ink.capacity()[0] - 0.998;
  EXPECT_NEAR(left / (1e-4 * decay), 1.0, 5e-3);
}

TEST(CapillaryFlow, KeepsEveryDropAndEndsInBalance) {
  BrushParameters parameters;
  parameters.rod_count = 40;
  const BrushModel brush = makeBrush(parameters);
  InkParameters ink_parameters;
  ink_parameters.load = 0.4;
  TipInk ink(brush, ink_parameters);
  CapillaryFlow capillary_flow(brush, ink_parameters);
  const Flow flow{capillary_flow};
  // One half of the rods dry, the ink of the others thin.
  for (std::size_t i = 0; i < ink.volume().size() / 2; ++i) ink.volume()[i] = ink.pigment()[i] = 0.0;
  for (double& pigment : ink.pigment()) pigment *= 0.3;
  const double volume = sum(ink.volume()), pigment = sum(ink.pigment());
  const auto spread = [&ink] {
    double low = 1.0, high = 0.0;
    for (std::size_t i = 0; i < ink.volume().size(); ++i) {
      low = std::min(low, ink.volume()[i] / ink.capacity()[i]);
      high = std::max(high, ink.volume()[i] / ink.capacity()[i]);
    }
    return high - low;
  };
  const double before = spread();
  for (int step = 0; step < 5000; ++step) {
    flow.flow(step % 7 == 0 ? 1.0 : 0.016, ink);
    if (step % 500 == 0)
      for (std::size_t i = 0; i < ink.volume().size(); ++i) {
        ASSERT_GE(ink.volume()[i], 0.0);
        ASSERT_GE(ink.pigment()[i], 0.0);
        ASSERT_LE(ink.volume()[i], ink.capacity()[i] * (1.0 + 1e-9));
        ASSERT_LE(ink.pigment()[i], ink.volume()[i] * (0.3 + 1e-9) + 1e-24);
      }
  }
  EXPECT_NEAR(sum(ink.volume()) / volume, 1.0, 1e-12);
  EXPECT_NEAR(sum(ink.pigment()) / pigment, 1.0, 1e-12);
  EXPECT_LT(spread(), 0.05 * before);
}

TEST(CapillaryFlow, RodsThatDoNotTouchKeepTheirInk) {
  BrushModel brush;
  for (const double x : {0.0, 5.5e-4, 3e-3}) brush.rods.push_back(uniformRod(0.04, 8, {x, 0, 0}));
  InkParameters parameters;
  TipInk ink(brush, parameters);
  CapillaryFlow capillary_flow(brush, parameters);
  const Flow flow{capillary_flow};
  for (std::size_t i = 8; i < 24; ++i) ink.volume()[i] = ink.pigment()[i] = 0.0;
  for (int step = 0; step < 100; ++step) flow.flow(0.1, ink);
  EXPECT_GT(ink.rodVolume(1), 0.05 * ink.rodVolume(0));
  EXPECT_EQ(ink.rodVolume(2), 0.0);
}

TEST(CapillaryFlow, DryEndDrawsInkFromTheBelly) {
  BrushModel brush;
  brush.rods = {uniformRod(0.04, 16, {0, 0, 0})};
  InkParameters parameters;
  TipInk ink(brush, parameters);
  CapillaryFlow capillary_flow(brush, parameters);
  const Flow flow{capillary_flow};
  for (std::size_t i = 12; i < 16; ++i) ink.volume()[i] = ink.pigment()[i] = 0.0;
  flow.flow(0.1, ink);
  EXPECT_GT(ink.volume()[12], 0.01 * ink.capacity()[12]);
  EXPECT_LT(ink.volume()[11], ink.capacity()[11]);
  for (int step = 0; step < 1000; ++step) flow.flow(0.1, ink);
  EXPECT_NEAR(ink.volume()[15] / ink.capacity()[15], ink.volume()[0] / ink.capacity()[0], 1e-3);
}

}  // namespace
}  // namespace calligraphy_brush
