#include "porous.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calligraphy_brush/paper/unsaturated_flow.h"
#include "reference_table.h"

using namespace calligraphy_brush;
using namespace calligraphy_brush::validate;

TEST(UnsaturatedFlow, FrontRunsAsTheTableSays) {
  int rows = 0;
  for (const Row& row : readReference("boltzmann")) {
    const double q = row.at("q (D=u^q)");
    if (q != std::floor(q)) continue;
    EXPECT_NEAR(frontFactor(static_cast<int>(q)), row.at("front_lambda"), 1e-8) << q;
    ++rows;
  }
  EXPECT_EQ(rows, 3);
}

TEST(Strip, FrontRunsAsWashburnSays) {
  // Of any exponent: the diffusivity of the full sheet is made for it.
  StripParameters p;
  p.nodes = 40;
  for (const int q : {1, 3, 6}) {
    p.exponent = q;
    for (const Row& row : readReference("washburn")) {
      p.duration = row.at("t_s");
      if (p.duration != 1.0 && (q != 1 || (p.duration != 0.01 && p.duration != 100.0))) continue;
      const PorousResult result = strip(p);
      EXPECT_NEAR(result.front.back() / row.at("l_strip"), 1.0, 0.01) << q << " " << p.duration;
      EXPECT_NEAR(result.exponent, 0.5, 0.01) << q;
      EXPECT_LT(std::abs(result.mass_error), 1e-6);
    }
  }
}

TEST(Strip, TakesUpWhatTheExactSolutionDoes) {
  // Uptake over front is 2 influx √t / λ √t of the similarity solution, per area and porosity.
  for (const Row& row : readReference("boltzmann")) {
    const double q = row.at("q (D=u^q)");
    if (q != std::floor(q)) continue;
    StripParameters p;
    p.exponent = static_cast<int>(q);
    p.nodes = 60;
    const PorousResult result = strip(p);
    const double pixel = result.front.back() / (p.nodes / 1.25);  // near enough for the first half pixel
    double uptake = 0.5 * pixel;
    for (std::size_t i = 1; i < result.filling.size(); ++i) uptake += pixel * result.filling[i];
    EXPECT_NEAR(uptake / result.front.back(),
                2.0 * row.at("influx_times_sqrt_t") / row.at("front_lambda"), 0.01)
        << q;
  }
}

TEST(Blot, GrowsAsTheRootOfTimeWhereTheBrushGivesAConstantFlow) {
  // In the plane r / √t is the only variable then, whatever the exponent.
  BlotParameters p;
  p.nodes = 50;
  for (const int q : {1, 3}) {
    p.exponent = q;
    EXPECT_NEAR(blot(p).exponent, 0.5, 0.03) << q;
  }
}

TEST(Blot, FromAFullDiscRunsAsWashburnSays) {
  // A sharp front is the limit of large exponents.
  BlotParameters p;
  p.nodes = 40;
  p.supply = "saturated";
  for (const Row& row : readReference("washburn")) {
    p.duration = row.at("t_s");
    // Before, the disc is nearly all of the blot.
    if (p.duration != 1.0 && p.duration != 10.0 && p.duration != 100.0) continue;
    const PorousResult result = blot(p);
    EXPECT_NEAR(result.front.back() / row.at("R_radial_R0=1mm"), 1.0, 0.02) << p.duration;
    EXPECT_NEAR(result.reference / row.at("R_radial_R0=1mm"), 1.0, 1e-6);
  }
}

TEST(Blot, OfADropSpreadsAsBarenblattSays) {
  BlotParameters p;
  p.nodes = 40;
  p.supply = "drop";
  p.radius = 2e-4;  // small, so that its shape is forgotten
  p.exponent = 1;
  const PorousResult result = blot(p);
  EXPECT_NEAR(result.front.back() / result.reference, 1.0, 0.02);
  EXPECT_NEAR(result.exponent, 0.25, 0.01);
  EXPECT_LT(std::abs(result.mass_error), 1e-6);
}

TEST(Blot, ReferenceForADropIsTheTablesSolution) {
  for (const Row& row : readReference("barenblatt")) {
    const double m = row.at("m"), t = row.at("t");
    if (row.at("dim") != 2 || t != 1.0) continue;
    // Unit mass and u_t = ∇²u^m: D₀ t / m = 1, π R₀² θ₀ = 1.
    const int q = static_cast<int>(m) - 1;
    BlotParameters p;
    p.nodes = 10;
    p.exponent = q;
    p.supply = "drop";
    p.radius = std::sqrt(2.0 / M_PI);
    p.filling = 0.5;
    p.duration =
        m / fullDiffusivity(p.permeability * p.capillary_pressure / p.viscosity / p.porosity, q);
    EXPECT_NEAR(blot(p).reference, row.at("R_front"), 1e-8) << m;
  }
}
