#include "statics.h"

#include <cmath>

#include "reference_table.h"

using namespace calligraphy_brush::validate;

namespace {

constexpr double kPi = 3.14159265358979323846;

double tipError(const HeavyCantileverResult& result, const Row& row) {
  return std::hypot(result.tip_x - row.at("tip_x"), result.tip_z - row.at("tip_z"));
}

HeavyCantileverResult solve(const Row& row, int nodes) {
  HeavyCantileverParameters p;
  p.gamma = row.at("gamma");
  p.clamp_angle_deg = row.at("clamp_angle_deg");
  p.nodes = nodes;
  return heavyCantilever(p);
}

/// Statics of the discrete rod, from tip to clamp: what the clamp's direction and the tip must be if the
/// last edge has a given angle. No solver: each joint's moment gives its turn.
struct Backwards {
  double clamp_angle, tip_x, drop;
};

Backwards solveFromTip(const TipLoadParameters& p, double tip_angle) {
  const double h = 1.0 / (p.nodes - 1);
  // Angles turn from +x towards −z. Positions are from the tip, z downwards.
  double angle = tip_angle, x = 0, z = 0;
  const double fx = p.follower ? -std::sin(tip_angle) * p.beta : 0.0;
  const double fz = p.follower ? std::cos(tip_angle) * p.beta : p.beta;
  for (int edge = p.nodes - 2; edge >= 0; --edge) {
    x -= h * std::cos(angle);
    z -= h * std::sin(angle);
    const double moment = -x * fz + z * fx;
    // 2 K t (1 + t²) = moment, t = tan(turn/2)
    const double stiffness = 1.0 / (edge == 0 ? 0.5 * h : h);
    double t = 0;
    for (int i = 0; i < 100; ++i)
      t -= (2 * stiffness * t * (1 + t * t) - moment) / (2 * stiffness * (1 + 3 * t * t));
    angle -= 2 * std::atan(t);
  }
  return {angle, -x, -z};
}

}  // namespace

TEST(HeavyCantilever, IsTheMinimiserOfTheDiscreteEnergy) {
  for (const Row& row : readReference("heavy_cantilever_discrete")) {
    const HeavyCantileverResult result = solve(row, static_cast<int>(row.at("nodes")));
    EXPECT_TRUE(result.converged);
    EXPECT_LT(tipError(result, row), 1e-8) << "gamma " << row.at("gamma") << " angle "
                                           << row.at("clamp_angle_deg") << " nodes " << row.at("nodes");
  }
}

TEST(HeavyCantilever, NearsTheContinuousRodWithOrderTwo) {
  for (const Row& row : readReference("heavy_cantilever")) {
    const double gamma = row.at("gamma"), angle = row.at("clamp_angle_deg");
    SCOPED_TRACE(testing::Message() << "gamma " << gamma << " angle " << angle);
    const double coarse = tipError(solve(row, 20), row);
    // Beyond, so few edges do not resolve the bend at the clamp, of length gamma^(-1/3) or less.
    const bool resolved = gamma <= 20 && angle <= 90;
    EXPECT_LT(coarse, resolved ? 2e-3 : 4e-2);
    if (coarse < 1e-6) continue;
    const double n80 = tipError(solve(row, 77), row), n160 = tipError(solve(row, 153), row);  // h/4, h/8
    const double order = std::log2(n80 / n160);
    EXPECT_GT(order, gamma <= 200 ? 1.65 : 1.5);
    EXPECT_LT(order, 2.4);
  }
}

TEST(HeavyCantilever, BucklesWhenItStandsAndIsTooHeavy) {
  HeavyCantileverParameters p;
  p.clamp_angle_deg = 180;
  p.nodes = 80;
  p.gamma = 7.83;
  EXPECT_NEAR(heavyCantilever(p).tip_x, 0.0, 1e-6);
  p.gamma = 7.85;
  EXPECT_GT(heavyCantilever(p).tip_x, 0.02);
}

TEST(HeavyCantilever, InFloatAgreesWithDouble) {
  HeavyCantileverParameters p;
  p.gamma = 20;
  const HeavyCantileverResult exact = heavyCantilever(p);
  p.precision = "float";
  const HeavyCantileverResult single = heavyCantilever(p);
  EXPECT_TRUE(single.converged);
  EXPECT_NEAR(single.tip_x, exact.tip_x, 1e-5);
  EXPECT_NEAR(single.tip_z, exact.tip_z, 1e-5);
}

TEST(TipLoad, IsTheEquilibriumOfTheDiscreteRod) {
  for (const bool follower : {false, true})
    for (const double beta : {0.1, 0.7, 2.0, 4.4, 9.0, 13.0, 20.0})
      for (const int nodes : {10, 33}) {
        SCOPED_TRACE(testing::Message()
                     << "beta " << beta << " follower " << follower << " nodes " << nodes);
        TipLoadParameters p;
        p.beta = beta;
        p.follower = follower;
        p.nodes = nodes;
        const TipLoadResult result = tipLoad(p);
        EXPECT_TRUE(result.converged);
        const Backwards exact = solveFromTip(p, result.tip_angle_deg * kPi / 180);
        EXPECT_NEAR(exact.clamp_angle, 0.0, 1e-7);
        EXPECT_NEAR(result.tip_x, exact.tip_x, 1e-7);
        EXPECT_NEAR(result.drop, exact.drop, 1e-7);
      }
}

TEST(TipLoad, NearsTheContinuousRodWithOrderTwo) {
  for (const bool follower : {false, true})
    for (const Row& row : readReference(follower ? "tip_load_follower" : "tip_load")) {
      SCOPED_TRACE(testing::Message() << "beta " << row.at("beta") << " follower " << follower);
      std::vector<double> errors;
      for (const int nodes : {20, 39, 77}) {
        TipLoadParameters p;
        p.beta = row.at("beta");
        p.follower = follower;
        p.nodes = nodes;
        const TipLoadResult result = tipLoad(p);
        errors.push_back(std::hypot(result.tip_x - row.at("tip_x"), result.drop - row.at("drop")));
      }
      EXPECT_LT(errors[0], row.at("beta") <= 4 || !follower ? 2e-3 : 4e-2);
      const double order = std::log2(errors[1] / errors[2]);
      EXPECT_GT(order, 1.7);
      EXPECT_LT(order, 2.3);
    }
}
