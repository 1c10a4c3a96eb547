#include "dynamics.h"

#include <algorithm>
#include <cmath>

#include "chain_reference.h"
#include "reference_table.h"

using namespace calligraphy_brush::validate;

namespace {

constexpr double kPi = 3.14159265358979323846;

double distance(const TipAt& tip, const Row& row) {
  return std::hypot(tip.x - row.at("tip_x"), tip.z - row.at("tip_z"));
}

std::vector<Row> releaseRows(int nodes, double damping, double duration) {
  std::vector<Row> rows;
  for (const Row& row : readReference("release"))
    if (row.at("nodes") == nodes && row.at("damping") == damping && row.at("t") <= duration)
      rows.push_back(row);
  return rows;
}

}  // namespace

TEST(Modes, AreThoseOfTheDiscreteRod) {
  for (const Row& row : readReference("modes_discrete")) {
    ModesParameters p;
    p.nodes = static_cast<int>(row.at("nodes"));
    p.length = 0.3;
    p.bending = 2e-5;
    p.line_density = 7e-3;
    const ModesResult result = modes(p);
    EXPECT_TRUE(result.converged);
    ASSERT_EQ(result.frequencies_hz.size(), 4u);
    const double unit = std::sqrt(p.bending / p.line_density) / (p.length * p.length) / (2 * kPi);
    for (std::size_t mode = 0; mode < 4; ++mode) {
      const double exact = unit * row.at("omega" + std::to_string(mode + 1));
      EXPECT_NEAR(result.frequencies_hz[mode], exact, 1e-7 * exact) << p.nodes << " mode " << mode + 1;
    }
  }
}

TEST(Modes, NearThoseOfTheContinuousRodWithOrderTwo) {
  const double exact = 8.39585256013;  // of the default rod [Hz]
  std::vector<double> errors;
  for (const int nodes : {20, 39, 77}) {
    ModesParameters p;
    p.nodes = nodes;
    errors.push_back(std::abs(modes(p).frequencies_hz[0] - exact));
  }
  EXPECT_NEAR(std::log2(errors[0] / errors[1]), 2.0, 0.1);
  EXPECT_NEAR(std::log2(errors[1] / errors[2]), 2.0, 0.1);
}

TEST(PlanarChain, IsTheMotionOfTheReference) {
  for (const int nodes : {10, 20})
    for (const double damping : {0.0, 5.0, 20.0}) {
      const ReleaseParameters p;
      PlanarChain chain;
      chain.link = p.length / (nodes - 1);
      chain.mass.assign(static_cast<std::size_t>(nodes), p.line_density * chain.link);
      chain.mass.front() = chain.mass.back() = 0.5 * p.line_density * chain.link;
      chain.joint.assign(static_cast<std::size_t>(nodes - 1), p.bending / chain.link);
      chain.joint[0] *= 2;
      chain.gravity = 9.81;
      chain.damping = damping;
      const auto rows = releaseRows(nodes, damping, 0.2);
      std::vector<double> times;
      for (const Row& row : rows) times.push_back(row.at("t"));
      const auto tips = solvePlanarChain(chain, times);
      for (std::size_t i = 0; i < rows.size(); ++i)
        EXPECT_LT(distance(tips[i], rows[i]), 3e-9)
            << nodes << " damping " << damping << " t " << times[i];
    }
}

TEST(Release, NearsTheExactMotionWithTheOrderOfTheScheme) {
  for (const char* scheme : {"backward_euler", "bdf2"})
    for (const double damping : {0.0, 5.0, 20.0}) {
      SCOPED_TRACE(testing::Message() << scheme << " damping " << damping);
      std::vector<double> errors;
      for (const double dt : {4e-5, 2e-5, 1e-5}) {
        ReleaseParameters p;
        p.nodes = 10;
        p.dt = dt;
        p.scheme = scheme;
        p.damping = damping;
        p.duration = 0.1;
        const ReleaseResult result = release(p);
        EXPECT_TRUE(result.converged);
        const auto rows = releaseRows(10, damping, p.duration);
        EXPECT_EQ(rows.size(), result.tip.size());
        double worst = 0;
        for (std::size_t i = 0; i < rows.size(); ++i) {
          EXPECT_DOUBLE_EQ(result.tip[i].t, rows[i].at("t"));
          worst = std::max(worst, distance(result.tip[i], rows[i]));
        }
        EXPECT_NEAR(result.max_error, worst, 3e-9);
        errors.push_back(worst);
      }
      const double order = scheme == std::string("bdf2") ? 2 : 1;
      EXPECT_NEAR(std::log2(errors[0] / errors[1]), order, 0.3);
      EXPECT_NEAR(std::log2(errors[1] / errors[2]), order, 0.1);
    }
}

TEST(Release, ByProjectionIsOfFirstOrderToo) {
  std::vector<double> errors;
  for (const double dt : {4e-5, 2e-5}) {
    ReleaseParameters p;
    p.nodes = 10;
    p.scheme = "projection";
    p.dt = dt;
    p.duration = 0.05;
    errors.push_back(release(p).max_error);
  }
  EXPECT_LT(errors[1], 1e-5);
  EXPECT_NEAR(std::log2(errors[0] / errors[1]), 1.0, 0.3);
}

TEST(Release, OfAnotherRodIsAsAccurate) {
  // Lengths, stiffness and density scaled so that the motion is the same in units of length.
  ReleaseParameters p;
  p.nodes = 10;
  p.duration = 0.1;
  p.dt = 2e-4;
  const double error = release(p).max_error / p.length;
  ReleaseParameters other = p;
  const double scale = 4;
  other.length *= scale;
  other.bending *= scale * scale * scale * 3;
  other.line_density *= 3;
  other.duration *= 2;
  other.dt *= 2;
  EXPECT_NEAR(release(other).max_error / other.length, error, 0.5 * error);
}

TEST(Chain, NearsTheExactMotionWithTheOrderOfTheScheme) {
  const auto rows = readReference("chain");
  for (const char* scheme : {"backward_euler", "bdf2"}) {
    std::vector<std::vector<double>> errors;
    std::vector<double> drifts;
    for (const double dt : {2e-4, 1e-4}) {
      ChainParameters p;
      p.dt = dt;
      p.scheme = scheme;
      const ChainResult result = chain(p);
      EXPECT_TRUE(result.converged);
      std::vector<double> at;
      for (const TipAt& tip : result.tip)
        for (const Row& row : rows)
          if (row.at("t") == tip.t) at.push_back(distance(tip, row));
      ASSERT_EQ(at.size(), 3u);
      errors.push_back(at);
      drifts.push_back(result.energy_drift);
    }
    const double order = scheme == std::string("bdf2") ? 2 : 1;
    for (std::size_t i = 0; i < 3; ++i)
      EXPECT_NEAR(std::log2(errors[0][i] / errors[1][i]), order, 0.15) << scheme << " " << i;
    // Implicit schemes lose energy, here by that much.
    EXPECT_LT(drifts[1], 0);
    EXPECT_GT(drifts[1], order == 1 ? -5e-3 : -5e-7);
  }
}

TEST(Slam, StaysBounded) {
  for (const char* scheme : {"backward_euler", "bdf2"})
    for (const char* precision : {"float", "double"})
      for (const double stiffness_scale : {1e-3, 1.0, 1e3})
        for (const double dt : {5e-5, 1e-3, 1e-2}) {
          SCOPED_TRACE(testing::Message() << scheme << " " << precision << " stiffness "
                                          << stiffness_scale << " dt " << dt);
          SlamParameters p;
          p.stiffness_scale = stiffness_scale;
          p.dt = dt;
          p.scheme = scheme;
          p.precision = precision;
          const SlamResult result = slam(p);
          EXPECT_TRUE(result.finite);
          EXPECT_LT(result.max_stretch, precision == std::string("float") ? 1e-5 : 1e-13);
          EXPECT_LT(result.max_penetration, 1e-3);
          // The handle goes at 1 m/s; a stiff rod that snaps open is faster, as its root frequency is.
          EXPECT_LT(result.max_speed, 20 * std::max(1.0, std::sqrt(stiffness_scale)));
        }
}

TEST(Slam, TuftStaysBoundedDryAndWet) {
  for (const char* scheme : {"backward_euler", "bdf2", "sdirk2"})
    for (const double dt : {1e-3, 5e-3})
      for (const double ink : {0.0, 1.0}) {
        SCOPED_TRACE(testing::Message() << scheme << " dt " << dt << " ink " << ink);
        SlamParameters p;
        p.bundles = true;
        p.scheme = scheme;
        p.dt = dt;
        p.ink = ink;
        const SlamResult result = slam(p);
        EXPECT_TRUE(result.finite);
        EXPECT_LT(result.max_stretch, 1e-5);
        EXPECT_LT(result.max_penetration, 1e-3);
        EXPECT_LT(result.max_speed, 20);
      }
}
