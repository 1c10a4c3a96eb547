#include "contact.h"

#include <cmath>

#include "reference_table.h"

using namespace calligraphy_brush::validate;

namespace {

template <class Parameters>
Parameters parametersOf(const Row& row, int nodes, bool plane) {
  Parameters p;
  p.tilt_deg = row.at("tilt_deg");
  p.mu = std::abs(row.count("mu") ? row.at("mu") : row.at("mu_signed"));
  p.gamma = row.at("gamma");
  p.depth = row.at("depth");
  p.nodes = nodes;
  p.plane = plane;
  return p;
}

std::string nameOf(const Row& row) {
  std::ostringstream name;
  for (const auto& cell : row) name << cell.first << " " << cell.second << ", ";
  return name.str();
}

void expectOnTheCone(const PressResult& result, double mu) {
  EXPECT_NEAR(std::abs(result.tangential_force), mu * result.normal_force, 1e-9 * result.normal_force);
}

}  // namespace

TEST(Press, IsTheEquilibriumOfTheDiscreteRod) {
  const auto rows = readReference("press_discrete");
  for (std::size_t i = 0; i < rows.size(); i += 7) {
    const Row& row = rows[i];
    // A tip that sticks while it is pressed would have to be dragged far.
    if (std::abs(row.at("mu_signed")) >= std::tan(row.at("tilt_deg") * 3.14159265358979 / 180)) continue;
    SCOPED_TRACE(nameOf(row));
    const int nodes = static_cast<int>(row.at("nodes"));
    PressResult result;
    if (row.at("mu_signed") < 0) {
      auto p = parametersOf<DragParameters>(row, nodes, true);
      p.direction = -1;
      result = drag(p);
    } else {
      result = press(parametersOf<PressParameters>(row, nodes, true));
    }
    EXPECT_TRUE(result.converged);
    EXPECT_NEAR(result.normal_force, row.at("normal_force"), 1e-7 * row.at("normal_force"));
    EXPECT_NEAR(result.tip_offset, row.at("tip_offset"), 1e-7);
    EXPECT_EQ(result.state, row.at("mu_signed") < 0 ? "drag-x" : "slip");
    expectOnTheCone(result, std::abs(row.at("mu_signed")));
  }
}

TEST(Press, IsWithinAPercentOfTheContinuousRod) {
  const auto rows = readReference("press");
  for (std::size_t i = 0; i < rows.size(); i += 7) {
    const Row& row = rows[i];
    SCOPED_TRACE(nameOf(row));
    const PressResult result = press(parametersOf<PressParameters>(row, 32, false));
    EXPECT_TRUE(result.converged);
    // The flat part leaves so little of the rod that 32 nodes are not many.
    const double tolerance = row.at("flat_length") < 0.7 ? 0.01 : 0.03;
    EXPECT_NEAR(result.normal_force, row.at("normal_force"), tolerance * row.at("normal_force"));
    EXPECT_NEAR(result.tangential_force, row.at("tangential_force"), tolerance * row.at("normal_force"));
    EXPECT_NEAR(result.tip_offset, row.at("tip_offset"), 0.005);
    EXPECT_NEAR(result.flat_length, row.at("flat_length"), 0.005);
    EXPECT_EQ(result.state, "slip");
    EXPECT_LT(result.out_of_plane, 1e-4);
    expectOnTheCone(result, row.at("mu"));
  }
}

TEST(Press, NearsTheContinuousRodWithOrderTwo) {
  // 30 degrees, no friction, point contact; N by theory.
  for (const auto& [depth, normal] : {std::pair<double, double>{0.1, 0.77062162}, {0.3, 1.51185419}}) {
    std::vector<double> errors;
    for (const int nodes : {20, 39, 77}) {
      PressParameters p;
      p.mu = 0;
      p.depth = depth;
      p.nodes = nodes;
      p.plane = true;
      errors.push_back(std::abs(press(p).normal_force - normal));
    }
    EXPECT_NEAR(std::log2(errors[0] / errors[1]), 2.0, 0.5) << depth;
    EXPECT_NEAR(std::log2(errors[1] / errors[2]), 2.0, 0.3) << depth;
  }
}

TEST(Press, TellsStickingFromSlidingAndFromNotTouching) {
  PressParameters p;
  p.mu = 1.0;
  p.depth = 0.02;
  p.nodes = 16;
  p.plane = true;
  const PressResult stuck = press(p);
  EXPECT_EQ(stuck.state, "stick");
  EXPECT_NEAR(stuck.tip_offset, 0.5, 1e-5);  // where it first touched
  p.depth = 0;
  const PressResult free = press(p);
  EXPECT_EQ(free.state, "free");
  EXPECT_EQ(free.normal_force, 0);
}

TEST(Press, LeavesThePlaneWhereThatIsUnstableUnlessItIsHeld) {
  PressParameters p;
  p.mu = 1.0;
  p.depth = 0.3;
  p.gamma = 5;
  EXPECT_GT(press(p).out_of_plane, 0.01);
  p.plane = true;
  EXPECT_EQ(press(p).out_of_plane, 0.0);
}

TEST(Drag, IsWithinAPercentOfTheContinuousRod) {
  const auto rows = readReference("drag");
  for (std::size_t i = 0; i < rows.size(); i += 9) {
    const Row& row = rows[i];
    SCOPED_TRACE(nameOf(row));
    auto p = parametersOf<DragParameters>(row, 32, false);
    p.direction = static_cast<int>(row.at("direction"));
    const PressResult result = drag(p);
    EXPECT_TRUE(result.converged);
    EXPECT_NEAR(result.normal_force, row.at("normal_force"), 0.01 * row.at("normal_force"));
    EXPECT_NEAR(result.tip_offset, row.at("tip_offset"), 0.005);
    EXPECT_NEAR(result.flat_length, row.at("flat_length"), 0.005);
    EXPECT_EQ(result.state, p.direction < 0 ? "drag-x" : "drag+x");
    EXPECT_GT(-p.direction * result.tangential_force, 0);
    expectOnTheCone(result, p.mu);
  }
}

TEST(Drag, RefusesNoDirection) {
  DragParameters p;
  p.direction = 0;
  EXPECT_THROW(drag(p), std::invalid_argument);
}

TEST(StickSlip, SlipsWhereTheContinuousRodDoes) {
  for (const Row& row : readReference("stick_slip")) {
    SCOPED_TRACE(nameOf(row));
    StickSlipParameters p;
    p.mu = row.at("mu");
    p.gamma = row.at("gamma");
    p.nodes = 32;
    const StickSlipResult result = stickSlip(p);
    EXPECT_TRUE(result.converged);
    EXPECT_NEAR(result.slip_depth, row.at("slip_depth"), 0.01 * row.at("slip_depth"));
    EXPECT_NEAR(result.normal_force_before, row.at("normal_force_before"),
                0.01 * row.at("normal_force_before"));
  }
}

TEST(StickSlip, SlipsWhereTheDiscreteRodDoes) {
  for (const Row& row : readReference("stick_slip_discrete")) {
    if (row.at("depth") < 0.01) continue;
    SCOPED_TRACE(nameOf(row));
    StickSlipParameters p;
    p.mu = row.at("ratio");
    p.nodes = static_cast<int>(row.at("nodes"));
    const StickSlipResult result = stickSlip(p);
    EXPECT_NEAR(result.slip_depth, row.at("depth"), 0.005 * row.at("depth"));
    EXPECT_NEAR(result.normal_force_before, row.at("normal_force"), 0.002 * row.at("normal_force"));
  }
}

TEST(StickSlip, NeverSlipsWithMoreFrictionThanTheLargestRatio) {
  StickSlipParameters p;
  p.nodes = 32;
  p.mu = 0.354;
  EXPECT_TRUE(std::isfinite(stickSlip(p).slip_depth));
  p.mu = 0.359;
  const StickSlipResult result = stickSlip(p);
  EXPECT_TRUE(std::isnan(result.slip_depth));
  EXPECT_NEAR(result.largest_ratio, 0.356370020, 0.0015);
}
