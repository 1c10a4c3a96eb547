#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace calligraphy_brush {
namespace validate {

/// One row of a table, by column.
using Row = std::map<std::string, double>;

/// All rows of test/reference/NAME.csv; lines that begin with # say what it is.
inline std::vector<Row> readReference(const std::string& name) {
  std::ifstream file(std::string(CALLIGRAPHY_BRUSH_SOURCE_DIR) + "/test/reference/" + name + ".csv");
  std::vector<Row> rows;
  std::vector<std::string> columns;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream cells(line);
    Row row;
    std::size_t column = 0;
    for (std::string cell; std::getline(cells, cell, ','); ++column)
      if (rows.empty() && columns.size() <= column)
        columns.push_back(cell);
      else
        row[columns[column]] = std::stod(cell);
    if (!row.empty()) rows.push_back(row);
  }
  EXPECT_FALSE(rows.empty()) << name;
  return rows;
}

}  // namespace validate
}  // namespace calligraphy_brush
