#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "calligraphy_brush/common/parameters.h"

/// Reference scenes: each is a plain function from parameters to results, and an entry of scenes().
///
/// Parameters and results are structs with a describe() visitor. From a parameter struct come the
/// parsing of the command line, the range check and the help; from a result struct the JSON and its
/// help. Names on the command line are the fields' with '-' for '_'.
namespace calligraphy_brush {
namespace validate {

/// What every scene takes. Static scenes are in units of the rod's length L, B/L and B/L².
struct SceneParameters {
  static Choices precisions() { return {"float", "double"}; }
  int nodes = 20;
  std::string precision = "double";

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("nodes", self.nodes, Range{4, 2000}, "1", "Nodes of the rod, both ends included.");
    visit("precision", self.precision, Self::precisions(), "1",
          "Numbers in the solver; the tolerances of the tables are for double.");
  }
};

/// What every scene with a clock takes too.
struct DynamicParameters : SceneParameters {
  static constexpr double kLeastStep = 1e-6;
  static Choices schemes() { return {"backward_euler", "bdf2", "projection"}; }
  double dt = 0.001;
  std::string scheme = "bdf2";

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("dt", self.dt, Range{Self::kLeastStep, 0.1}, "s", "Time step.");
    visit("scheme", self.scheme, Self::schemes(), "1",
          "Time integration, as of the node; with projection nothing truly sticks, and dt has to be "
          "near 0.1 ms.");
    SceneParameters::describe(self, visit);
  }
};

/// What every scene gives.
struct SceneResult {
  bool converged = false;
  int iterations = 0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("converged", self.converged, "",
          "Static scenes: came to rest, in double with every step at rest solved; others: every step "
          "solved.");
    visit("iterations", self.iterations, "1", "Newton iterations of all steps.");
  }
};

/// Where a tip was at a time.
struct TipAt {
  double t = 0, x = 0, z = 0;
};

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();  ///< null in the JSON

/// One line of JSON. Numbers that are not finite become null.
template <class Result>
std::string toJson(const Result& result);

/// A scene by its name.
struct Scene {
  std::string name;
  std::string summary;      ///< one sentence
  std::string explanation;  ///< how it is done, and what stands for what

  /// Results as JSON. Throws std::invalid_argument with one line for a bad argument.
  std::function<std::string(const std::vector<std::string>& arguments)> run;
  std::function<std::string()> help;
};

/// All scenes, in the order of --list.
const std::vector<Scene>& scenes();

/// Runs the program on its arguments without its name: 0, or 1 with one line on `error`.
int runValidate(const std::vector<std::string>& arguments, std::ostream& output, std::ostream& error);

// ------------------------------------------------------------------ how a Scene is made

namespace scene_detail {

/// "clamp_angle_deg" as an argument: "--clamp-angle-deg".
std::string toOption(std::string name);

void parse(const std::string& option, const std::string& text, double& field);
void parse(const std::string& option, const std::string& text, int& field);
void parse(const std::string& option, const std::string& text, bool& field);
void parse(const std::string& option, const std::string& text, std::string& field);

void write(std::ostream& out, double value);
void write(std::ostream& out, int value);
void write(std::ostream& out, bool value);
void write(std::ostream& out, const std::string& value);
void write(std::ostream& out, const Eigen::Vector3d& value);
void write(std::ostream& out, const TipAt& value);
template <class Element>
void write(std::ostream& out, const std::vector<Element>& list) {
  out << "[";
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (i > 0) out << ", ";
    write(out, list[i]);
  }
  out << "]";
}

/// Sets the field that `name` names from `text`; false if there is none. A flag needs no text.
template <class Parameters>
bool setField(Parameters& parameters, const std::string& name, const std::string* text,
              bool& used_text) {
  bool found = false;
  visitParameters(parameters,
                  [&](const std::string& full_name, auto& field, const auto&, const char*, const char*) {
                    if (toOption(full_name) != name) return;
                    found = true;
                    if constexpr (std::is_same_v<std::decay_t<decltype(field)>, bool>) {
                      used_text = text && (*text == "true" || *text == "false");
                      parse(name, used_text ? *text : "true", field);
                    } else {
                      if (!text) throw std::invalid_argument(name + " needs a value");
                      used_text = true;
                      parse(name, *text, field);
                    }
                  });
  return found;
}

template <class Parameters>
Parameters parseArguments(const std::vector<std::string>& arguments) {
  Parameters parameters;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& argument = arguments[i];
    const auto equals = argument.find('=');
    const std::string name = argument.substr(0, equals);
    const std::string adjacent = equals == std::string::npos ? "" : argument.substr(equals + 1);
    const std::string* text = nullptr;
    if (equals != std::string::npos)
      text = &adjacent;
    else if (i + 1 < arguments.size() && arguments[i + 1].rfind("--", 0) != 0)
      text = &arguments[i + 1];
    bool used_text = false;
    if (!setField(parameters, name, text, used_text))
      throw std::invalid_argument("unknown argument " + name);
    if (equals != std::string::npos && !used_text)
      throw std::invalid_argument(argument + ": not true or false");
    if (equals == std::string::npos && used_text) ++i;
  }
  std::string problems;
  for (const std::string& problem : findParameterProblems(parameters)) {
    const auto space = problem.find(' ');
    problems +=
        (problems.empty() ? "" : "; ") + toOption(problem.substr(0, space)) + problem.substr(space);
  }
  if (!problems.empty()) throw std::invalid_argument(problems);
  return parameters;
}

template <class Parameters, class Result>
std::string help(const Scene& scene) {
  std::ostringstream out;
  out << scene.name << ": " << scene.summary << "\n\n" << scene.explanation << "\n\nArguments:\n";
  const Parameters defaults;
  for (const ParameterRow& row : listParameters(defaults))
    out << "  " << toOption(row.name) << " " << row.range << (row.unit == "1" ? "" : " " + row.unit)
        << ", default " << row.value << "\n      " << row.description << "\n";
  out << "\nResults:\n";
  const auto print = [&out](const char* name, const auto&, const char* unit, const char* description) {
    out << "  " << name << (*unit ? std::string(" [") + unit + "]" : "") << "\n      " << description
        << "\n";
  };
  const Result result;
  Result::describe(result, print);
  return out.str();
}

}  // namespace scene_detail

template <class Result>
std::string toJson(const Result& result) {
  std::ostringstream out;
  out << "{";
  const auto print = [&](const char* name, const auto& value, const char*, const char*) {
    if (out.tellp() > 1) out << ", ";
    out << '"' << name << "\": ";
    scene_detail::write(out, value);
  };
  Result::describe(result, print);
  out << "}";
  return out.str();
}

template <class Parameters, class Result>
Scene makeScene(const char* name, const char* summary, const char* explanation,
                Result (*function)(const Parameters&)) {
  Scene scene{name, summary, explanation, {}, {}};
  scene.run = [function](const std::vector<std::string>& arguments) {
    return toJson(function(scene_detail::parseArguments<Parameters>(arguments)));
  };
  scene.help = [text = scene_detail::help<Parameters, Result>(scene)] { return text; };
  return scene;
}

}  // namespace validate
}  // namespace calligraphy_brush
