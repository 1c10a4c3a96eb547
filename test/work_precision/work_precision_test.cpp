#include "work_precision.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <string>
#include <vector>

using namespace calligraphy_brush::work_precision;

namespace {

Grid tinyGrid() {
  Grid grid;
  grid.scenes = {"release"};
  grid.schemes = {"backward_euler", "bdf2", "sdirk2", "projection"};
  grid.precisions = {"double"};
  grid.nodes = {10};
  grid.time_steps = {2e-5, 1e-5};
  grid.explicit_time_steps = {1e-4, 5e-5};
  grid.least_seconds = 0;
  grid.reference_step = 1e-3;
  return grid;
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

}  // namespace

TEST(WorkPrecision, ErrorFallsWithTheOrderOfTheScheme) {
  std::ostringstream log;
  std::map<std::string, std::vector<double>> errors;
  for (const Cell& cell : run(tinyGrid(), log)) {
    errors[cell.scheme].push_back(cell.error);
    EXPECT_EQ(cell.unconverged, 0) << cell.scheme;
    EXPECT_GT(cell.us_per_rod_step, 0) << cell.scheme;
    EXPECT_NEAR(cell.us_per_rod_ms * 1e3 * cell.time_step, cell.us_per_rod_step,
                1e-9 * cell.us_per_rod_step);
    EXPECT_EQ(cell.reference, "table");
  }
  ASSERT_EQ(errors.size(), 4u);
  // SDIRK2 loses an order in the end: edges of fixed length make a problem of index 3, and its stages
  // are of order 1 (Hairer, Lubich, Roche 1989, Differential-Algebraic Systems by Runge-Kutta Methods).
  const std::map<std::string, double> orders{
      {"backward_euler", 1}, {"bdf2", 2}, {"sdirk2", 1}, {"projection", 1}};
  for (const auto& [scheme, error] : errors) {
    ASSERT_EQ(error.size(), 2u) << scheme;
    EXPECT_NEAR(std::log2(error[0] / error[1]), orders.at(scheme), 0.35) << scheme;
  }
  EXPECT_LT(errors["sdirk2"][0], errors["bdf2"][0]);
}

TEST(WorkPrecision, FindsTheStaticShapesOfPressAndDrag) {
  Grid grid = tinyGrid();
  grid.scenes = {"press", "drag"};
  grid.schemes = {"bdf2"};
  grid.nodes = {20};
  grid.time_steps = {1e-3};
  std::ostringstream log;
  const std::vector<Cell> cells = run(grid, log);
  ASSERT_EQ(cells.size(), 2u);
  for (const Cell& cell : cells) {
    EXPECT_LT(cell.error, 1e-5) << cell.scene;
    EXPECT_LT(cell.force_error, 2e-3) << cell.scene;
  }
}

TEST(WorkPrecision, WritesATableWithAColumnForEveryValue) {
  std::ostringstream log, out;
  Grid grid = tinyGrid();
  grid.scenes = {"slam"};
  grid.schemes = {"bdf2"};
  grid.time_steps = {1e-3, 5e-4};
  const std::vector<Cell> cells = run(grid, log);
  writeCsv(cells, out);
  std::istringstream lines(out.str());
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  const std::vector<std::string> columns = split(line);
  for (const char* name : {"scene", "scheme", "precision", "nodes", "dt_ms", "us_per_rod_step",
                           "us_per_rod_ms", "error_mm", "force_error", "unconverged", "reference"})
    EXPECT_EQ(std::count(columns.begin(), columns.end(), name), 1) << name;
  std::size_t rows = 0;
  for (; std::getline(lines, line); ++rows) {
    const std::vector<std::string> values = split(line);
    ASSERT_EQ(values.size(), columns.size()) << line;
    EXPECT_EQ(values[0], "slam");
    EXPECT_EQ(values[4], rows == 0 ? "1" : "0.5");
    EXPECT_NEAR(std::stod(values[7]), 1e3 * cells[rows].error, 1e-4);
    EXPECT_EQ(values[10], "backward_euler");
  }
  EXPECT_EQ(rows, 2u);
}

TEST(WorkPrecision, RefusesAnUnknownScene) {
  Grid grid = tinyGrid();
  grid.scenes = {"nothing"};
  std::ostringstream log;
  EXPECT_THROW(run(grid, log), std::invalid_argument);
}
