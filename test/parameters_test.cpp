#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "calligraphy_brush/ros/brush_simulator_parameters.h"
#include "calligraphy_brush/ros/ros_parameters.h"
#include "calligraphy_brush/sim/simulator.h"

namespace calligraphy_brush {
namespace {

/// A legal set of parameters with one field spoilt.
struct SpoiltParameters {
  std::string name;   // full name of the field
  std::string value;  // the illegal value as text
  BrushSimulatorParameters parameters;
  XmlRpc::XmlRpcValue tree;  // the same as it would lie on the parameter server
};

template <class Field>
std::vector<Field> illegalValues(const Range<Field>& range) {
  std::vector<Field> values;
  if constexpr (std::is_same_v<Field, int>) {
    if (range.low > std::numeric_limits<int>::min()) values.push_back(range.low - 1);
    if (range.high < std::numeric_limits<int>::max()) values.push_back(range.high + 1);
  } else {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    values = {std::nextafter(range.low, -infinity), std::nextafter(range.high, infinity),
              std::numeric_limits<double>::quiet_NaN(), infinity, -infinity};
  }
  return values;
}

std::vector<std::string> illegalValues(const Choices& choices) {
  return choices.empty() ? std::vector<std::string>() : std::vector<std::string>{"no such choice", ""};
}

XmlRpc::XmlRpcValue makeTree(const std::string& name, const XmlRpc::XmlRpcValue& value) {
  XmlRpc::XmlRpcValue tree;
  XmlRpc::XmlRpcValue* place = &tree;
  std::size_t begin = 0;
  for (std::size_t end = name.find('/'); end != std::string::npos; end = name.find('/', begin)) {
    place = &(*place)[name.substr(begin, end - begin)];
    begin = end + 1;
  }
  (*place)[name.substr(begin)] = value;
  return tree;
}

/// Every field of the table with every kind of illegal value, one at a time.
std::vector<SpoiltParameters> spoilEveryField() {
  std::vector<SpoiltParameters> all;
  BrushSimulatorParameters defaults;
  visitParameters(
      defaults, [&](const std::string& name, auto& field, const auto& legal, const char*, const char*) {
        using Field = std::remove_reference_t<decltype(field)>;
        if constexpr (!std::is_same_v<Field, bool>) {
          const Field legal_value = field;
          for (const Field& value : illegalValues(legal)) {
            field = value;
            all.push_back({name, parameters_detail::toText(value), defaults, makeTree(name, value)});
          }
          field = legal_value;
        }
      });
  return all;
}

TEST(Parameters, DefaultsAreLegal) {
  EXPECT_NO_THROW(checkParameters(BrushSimulatorParameters()));
}

TEST(Parameters, EveryIllegalValueIsNamedAndNothingElse) {
  const auto all = spoilEveryField();
  ASSERT_GT(all.size(), 100U);
  for (const auto& spoilt : all) {
    const auto problems = findParameterProblems(spoilt.parameters);
    ASSERT_EQ(problems.size(), 1U) << spoilt.name << " = " << spoilt.value;
    EXPECT_EQ(problems[0].rfind(spoilt.name + " = " + spoilt.value + " is outside ", 0), 0U)
        << problems[0];
  }
}

TEST(Parameters, SimulatorRefusesEveryIllegalValueByName) {
  for (const auto& spoilt : spoilEveryField()) {
    if (spoilt.name.rfind("ros/", 0) == 0) continue;
    try {
      const Simulator simulator(spoilt.parameters.simulator);
      ADD_FAILURE() << spoilt.name << " = " << spoilt.value << " was taken";
    } catch (const ParameterError& error) {
      EXPECT_NE(std::string(error.what()).find(spoilt.name), std::string::npos) << error.what();
    }
  }
}

TEST(RosParameters, EveryIllegalValueIsRefusedByFullName) {
  for (const auto& spoilt : spoilEveryField()) {
    try {
      readParameters<BrushSimulatorParameters>(spoilt.tree, "/some/node");
      ADD_FAILURE() << spoilt.name << " = " << spoilt.value << " was taken";
    } catch (const ParameterError& error) {
      ASSERT_EQ(error.problems().size(), 1U);
      EXPECT_EQ(error.problems()[0].rfind("/some/node/" + spoilt.name + " = ", 0), 0U) << error.what();
    }
  }
}

TEST(RosParameters, EveryFieldIsReadFromItsOwnName) {
  BrushSimulatorParameters expected;
  visitParameters(expected, [&](const std::string& name, auto& field, const auto& legal, const char*,
                                const char*) {
    using Field = std::remove_reference_t<decltype(field)>;
    const Field default_value = field;
    if constexpr (std::is_arithmetic_v<Field> && !std::is_same_v<Field, bool>)
      field = field == legal.low ? legal.high : legal.low;
    else if constexpr (std::is_same_v<Field, std::string>)
      field = legal.empty() ? "something else" : (field == legal.front() ? legal.back() : legal.front());
    const auto read = readParameters<BrushSimulatorParameters>(makeTree(name, field), "/n");
    const auto read_rows = listParameters(read);
    const auto expected_rows = listParameters(expected);
    for (std::size_t row = 0; row < read_rows.size(); ++row)
      EXPECT_EQ(read_rows[row].value, expected_rows[row].value)
          << read_rows[row].name << " set " << name;
    field = default_value;
  });
}

TEST(RosParameters, WholeNumbersAndYaml11NumbersAreTakenForRealOnes) {
  XmlRpc::XmlRpcValue tree;
  tree["motion"]["max_speed"] = 3;
  tree["brush"]["hair_radius"] = "30e-6";
  const auto parameters = readParameters<BrushSimulatorParameters>(tree, "/n");
  EXPECT_EQ(parameters.simulator.motion.max_speed, 3.0);
  EXPECT_EQ(parameters.simulator.brush.hair_radius, 30e-6);
}

/// One of each kind of field, so that the texts below do not change with the simulator.
struct HandleParameters {
  double length = 0.2;
  int facets = 8;
  std::string wood = "bamboo";
  bool hanging = true;
  double width = 0.01;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("length", self.length, Range{0.1, 0.5}, "m", "Length.");
    visit("facets", self.facets, Range{3, 12}, "1", "Facets.");
    visit("wood", self.wood, Choices{"bamboo", "ebony"}, "1", "Wood.");
    visit("hanging", self.hanging, "Whether it has a loop to hang it up by.");
    visit("width", self.width, Range{0.001, 0.1}, "m", "Width.");
  }
};

struct GroupedParameters {
  HandleParameters handle;
  HandleParameters spare;
  HandleParameters third;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit.group("handle", self.handle);
    visit.group("spare", self.spare);
    visit.group("third", self.third);
  }
};

TEST(RosParameters, AllProblemsAreReportedAtOnce) {
  XmlRpc::XmlRpcValue tree;
  tree["handle"]["length"] = 7;             // out of range
  tree["handle"]["facets"] = 6.5;           // wrong type
  tree["handle"]["lenght"] = 0.3;           // unknown
  tree["handle"]["width"]["top"] = 0.5;     // a group where a number should be
  tree["handle"]["wood"] = 3;               // wrong type
  tree["handle"]["hanging"] = "yes";        // wrong type
  tree["spare"] = "none";                   // a value where a group should be
  tree["third"]["facets"] = "many";         // wrong type
  tree["third"]["length"] = "0.3 m";        // wrong type
  tree["third"]["wood"] = "plastic";        // out of range
  tree["diagnostic_period"] = 1.0;          // belongs to others
  tree["stroke_image"]["format"] = "jpeg";  // belongs to others
  try {
    readParameters<GroupedParameters>(tree, "/n");
    FAIL() << "taken";
  } catch (const ParameterError& error) {
    EXPECT_EQ(error.problems(),
              (std::vector<std::string>{
                  "/n/handle/facets = 6.5 is not a whole number, legal are [3, 12]",
                  "/n/handle/hanging = yes is not true or false, legal are true | false",
                  "/n/handle/lenght = 0.3 is not a known parameter",
                  "/n/handle/length = 7 is outside [0.1, 0.5] m",
                  "/n/handle/width/top = 0.5 is not a known parameter",
                  "/n/handle/wood = 3 is not text, legal are bamboo | ebony",
                  "/n/spare = none is not a group of parameters",
                  "/n/third/facets = many is not a whole number, legal are [3, 12]",
                  "/n/third/length = 0.3 m is not a number, legal are [0.1, 0.5] m",
                  "/n/third/wood = plastic is outside bamboo | ebony",
              }));
  }
}

}  // namespace
}  // namespace calligraphy_brush
