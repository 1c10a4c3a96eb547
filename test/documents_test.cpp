#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/sim/simulator.h"
#include "parameter_table.h"

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;

const fs::path kSource = CALLIGRAPHY_BRUSH_SOURCE_DIR;

TEST(Readme, ParameterTableIsThatOfTheCode) {
  std::ifstream file(kSource / "README.md");
  ASSERT_TRUE(file) << "no README.md";
  std::stringstream text;
  text << file.rdbuf();
  const std::string readme = text.str();
  const std::string begin = "<!-- parameters:begin -->\n", end = "<!-- parameters:end -->";
  ASSERT_NE(readme.find(begin), std::string::npos);
  const std::size_t first = readme.find(begin) + begin.size();
  const std::size_t last = readme.find(end, first);
  ASSERT_NE(last, std::string::npos);
  EXPECT_EQ(readme.substr(first, last - first), makeParameterTable())
      << "put the output of parameter_table between the markers";
}

TEST(Readme, TableOfTabletParametersIsThatOfTheCode) {
  std::ifstream file(kSource / "README.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_NE(text.str().find("<!-- tablet parameters:begin -->\n" + makeTabletParameterTable() +
                            "<!-- tablet parameters:end -->"),
            std::string::npos)
      << "put the output of parameter_table --tablet between the markers";
}

TEST(Presets, EachTabletLoadsAndMakesAMapping) {
  int count = 0;
  for (const auto& entry : fs::directory_iterator(kSource / "config" / "tablets")) {
    SCOPED_TRACE(entry.path());
    ++count;
    EXPECT_EQ(entry.path().extension(), ".yaml");
    TabletDriverParameters parameters;
    EXPECT_NO_THROW(loadYamlParameters(entry.path().string(), parameters));
    EXPECT_NO_THROW(PenMapping(parameters.tablet, {0.2, 0.1, true}, {}));
  }
  EXPECT_GT(count, 0);
}

TEST(Presets, EachLoadsAndMakesASimulator) {
  for (const char* kind : {"brushes", "papers"}) {
    int count = 0;
    for (const auto& entry : fs::directory_iterator(kSource / "config" / kind)) {
      SCOPED_TRACE(entry.path());
      ++count;
      EXPECT_EQ(entry.path().extension(), ".yaml");
      SimulatorParameters parameters;
      EXPECT_NO_THROW(loadYamlParameters(entry.path().string(), parameters));
      EXPECT_NO_THROW(Simulator{parameters});
    }
    EXPECT_GT(count, 0) << kind;
  }
}

}  // namespace
}  // namespace calligraphy_brush
