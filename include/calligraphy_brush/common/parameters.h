#pragma once

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

/// One table of parameters for everything.
///
/// A group of parameters is a plain struct with a static `describe(self, visit)` that names each
/// field once: name, member, legal range, unit, one sentence. From that one list come the range
/// check, the YAML and ROS loaders, the README tables and the tests; nothing is typed twice.
namespace calligraphy_brush {

/// Legal closed interval [low, high] of a number.
template <class Number>
struct Range {
  Number low;
  Number high;
};
template <class Number>
Range(Number, Number) -> Range<Number>;

/// Legal values of a string. An empty list allows any string.
using Choices = std::vector<std::string>;

/// One or more parameters are outside their range. what() has one line for each.
class ParameterError : public std::invalid_argument {
 public:
  explicit ParameterError(const std::vector<std::string>& problems)
      : std::invalid_argument(join(problems)), problems_(problems) {}
  const std::vector<std::string>& problems() const { return problems_; }

 private:
  static std::string join(const std::vector<std::string>& lines) {
    std::string all;
    for (const auto& line : lines) all += (all.empty() ? "" : "\n") + line;
    return all;
  }
  std::vector<std::string> problems_;
};

/// One row of the table of a parameter struct, as text.
struct ParameterRow {
  std::string name;         ///< full name, groups joined by '/': "brush/tip_length"
  std::string value;        ///< the value now
  std::string range;        ///< "[low, high]" or "a | b | c"
  std::string unit;         ///< SI, "1" where it has none
  std::string description;  ///< one sentence
};

namespace parameters_detail {

template <class Value>
std::string toText(const Value& value) {
  std::ostringstream text;
  text << std::boolalpha << value;
  return text.str();
}

template <class Number>
std::string rangeText(const Range<Number>& range) {
  return "[" + toText(range.low) + ", " + toText(range.high) + "]";
}

inline std::string rangeText(const Choices& choices) {
  std::string text;
  for (const auto& choice : choices) text += (text.empty() ? "" : " | ") + choice;
  return text.empty() ? "any" : text;
}

// Written so that NaN is outside every range.
template <class Number>
bool isLegal(const Number& value, const Range<Number>& range) {
  return value >= range.low && value <= range.high;
}

inline bool isLegal(const std::string& value, const Choices& choices) {
  for (const auto& choice : choices)
    if (value == choice) return true;
  return choices.empty();
}

/// Walks a parameter struct and its groups, calling
/// leaf(full_name, field, range_or_choices, unit, description) for each field.
template <class Leaf>
class Walker {
 public:
  Walker(std::string prefix, Leaf& leaf) : prefix_(std::move(prefix)), leaf_(leaf) {}

  template <class Field, class Legal>
  void operator()(const char* name, Field& field, const Legal& legal, const char* unit,
                  const char* description) {
    leaf_(prefix_ + name, field, legal, unit, description);
  }
  void operator()(const char* name, bool& field, const char* description) {
    leaf_(prefix_ + name, field, Choices{"true", "false"}, "1", description);
  }
  void operator()(const char* name, const bool& field, const char* description) {
    leaf_(prefix_ + name, field, Choices{"true", "false"}, "1", description);
  }
  template <class Group>
  void group(const char* name, Group& parameters) {
    Walker<Leaf> inner(prefix_ + name + "/", leaf_);
    std::remove_const_t<Group>::describe(parameters, inner);
  }

 private:
  std::string prefix_;
  Leaf& leaf_;
};

}  // namespace parameters_detail

/// Calls leaf(full_name, field, range_or_choices, unit, description) for every field of
/// `parameters`, in the order of the table. The field is a reference: const if `parameters` is.
template <class Parameters, class Leaf>
void visitParameters(Parameters& parameters, Leaf&& leaf, const std::string& prefix = "") {
  parameters_detail::Walker<std::remove_reference_t<Leaf>> walker(prefix, leaf);
  std::remove_const_t<Parameters>::describe(parameters, walker);
}

/// The table as text: one row a field.
template <class Parameters>
std::vector<ParameterRow> listParameters(const Parameters& parameters) {
  using namespace parameters_detail;
  std::vector<ParameterRow> rows;
  visitParameters(parameters, [&](const std::string& name, const auto& field, const auto& legal,
                                  const char* unit, const char* description) {
    rows.push_back({name, toText(field), rangeText(legal), unit, description});
  });
  return rows;
}

/// One line for each field that is outside its range: full name, value, range and unit.
template <class Parameters>
std::vector<std::string> findParameterProblems(const Parameters& parameters) {
  using namespace parameters_detail;
  std::vector<std::string> problems;
  visitParameters(parameters, [&](const std::string& name, const auto& field, const auto& legal,
                                  const char* unit, const char*) {
    if constexpr (!std::is_same_v<std::decay_t<decltype(field)>, bool>)
      if (!isLegal(field, legal))
        problems.push_back(name + " = " + toText(field) + " is outside " + rangeText(legal) +
                           (std::string(unit) == "1" ? "" : " " + std::string(unit)));
  });
  return problems;
}

/// Throws ParameterError naming every field that is outside its range.
template <class Parameters>
void checkParameters(const Parameters& parameters) {
  const auto problems = findParameterProblems(parameters);
  if (!problems.empty()) throw ParameterError(problems);
}

}  // namespace calligraphy_brush
