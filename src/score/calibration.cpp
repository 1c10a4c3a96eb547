#include "calligraphy_brush/score/calibration.h"

#include <nlopt.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iomanip>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

template <class Parameters, class Use>
void withParameter(Parameters& parameters, const std::string& name, Use&& use) {
  bool found = false;
  visitParameters(parameters,
                  [&](const std::string& full_name, auto& field, const auto&, const char*, const char*) {
                    if constexpr (std::is_same_v<std::decay_t<decltype(field)>, double>)
                      if (full_name == name) {
                        found = true;
                        use(field);
                      }
                  });
  if (!found) throw std::invalid_argument(name + " is not a parameter that can be fitted");
}

struct FreeOptimiser {
  void operator()(nlopt_opt optimiser) const { nlopt_destroy(optimiser); }
};
using Optimiser = std::unique_ptr<nlopt_opt_s, FreeOptimiser>;

/// What the objective function of NLopt, a C function, is given.
struct Search {
  const SimulatorParameters* base;
  const std::vector<FittedParameter>* fitted;
  const std::function<double(const SimulatorParameters&)>* goodness;
  CalibrationResult best;
  int limit;
  std::chrono::steady_clock::time_point end;
  bool has_end;
  nlopt_opt running = nullptr;
  std::exception_ptr failure;

  SimulatorParameters at(const double* x) const {
    SimulatorParameters parameters = *base;
    for (std::size_t k = 0; k < fitted->size(); ++k) {
      const FittedParameter& p = (*fitted)[k];
      setParameterValue(parameters, p.name, p.low + x[k] * (p.high - p.low));
    }
    // A thicker tuft has more hairs, not thinner bundles.
    const double ratio = parameters.brush.root_diameter / base->brush.root_diameter;
    parameters.brush.hair_count =
        std::max(1, static_cast<int>(std::lround(base->brush.hair_count * ratio * ratio)));
    return parameters;
  }
  double evaluate(const double* x) {
    const SimulatorParameters parameters = at(x);
    double value = -1.0;
    try {
      value = (*goodness)(parameters);
    } catch (const ParameterError&) {
    }
    if (!std::isfinite(value)) value = -1.0;
    ++best.evaluations;
    if (value > best.value) {
      best.value = value;
      best.parameters = parameters;
    }
    if (best.evaluations >= limit || (has_end && std::chrono::steady_clock::now() > end))
      nlopt_force_stop(running);
    return value;
  }
};

// No exception may leave through NLopt's C frames.
double objective(unsigned, const double* x, double*, void* data) {
  auto& search = *static_cast<Search*>(data);
  try {
    return search.evaluate(x);
  } catch (...) {
    search.failure = std::current_exception();
    nlopt_force_stop(search.running);
    return -1.0;
  }
}

void runOptimiser(Search& search, nlopt_algorithm algorithm, std::vector<double> x, int limit,
                  double step) {
  const auto dimension = static_cast<unsigned>(x.size());
  const Optimiser optimiser(nlopt_create(algorithm, dimension));
  if (!optimiser) throw std::bad_alloc();
  nlopt_set_lower_bounds1(optimiser.get(), 0.0);
  nlopt_set_upper_bounds1(optimiser.get(), 1.0);
  nlopt_set_max_objective(optimiser.get(), objective, &search);
  nlopt_set_initial_step1(optimiser.get(), step);
  nlopt_set_xtol_abs1(optimiser.get(), 2e-3);
  search.limit = limit;
  search.running = optimiser.get();
  double value = 0.0;
  nlopt_optimize(optimiser.get(), x.data(), &value);
  if (search.failure) std::rethrow_exception(search.failure);
}

}  // namespace

std::vector<FittedParameter> defaultFittedParameters() {
  return {{"brush/tip_length", 0.025, 0.07},
          {"brush/root_diameter", 0.005, 0.03},
          {"brush/cone", 0.0, 0.6},
          {"brush/convergence", 0.0, 0.8},
          {"brush/hair_taper", 0.1, 1.0},
          {"contact/surface_tension", 0.005, 0.2},
          {"contact/paper_friction", 0.05, 5.0},
          {"ink/coat", 0.0, 0.001}};
}

double parameterValue(const SimulatorParameters& parameters, const std::string& name) {
  double value = 0.0;
  withParameter(parameters, name, [&](const double& field) { value = field; });
  return value;
}

void setParameterValue(SimulatorParameters& parameters, const std::string& name, double value) {
  withParameter(parameters, name, [&](double& field) { field = value; });
}

CalibrationResult calibrate(const SimulatorParameters& parameters,
                            const std::vector<FittedParameter>& fitted,
                            const std::function<double(const SimulatorParameters&)>& goodness,
                            const CalibrationOptions& options) {
  if (fitted.empty()) throw std::invalid_argument("nothing to fit");
  std::vector<double> start;
  for (const FittedParameter& p : fitted) {
    if (!(p.low < p.high) || !std::isfinite(p.low) || !std::isfinite(p.high))
      throw std::invalid_argument(p.name + " is to be fitted within an empty range");
    start.push_back(
        std::clamp((parameterValue(parameters, p.name) - p.low) / (p.high - p.low), 0.0, 1.0));
  }
  Search search{&parameters, &fitted, &goodness, {parameters, -2.0, 0}, options.evaluations, {},
                false,       nullptr, nullptr};
  search.has_end = options.longest_seconds > 0;
  search.end = std::chrono::steady_clock::now() +
               std::chrono::microseconds(std::llround(1e6 * options.longest_seconds));
  nlopt_srand(static_cast<unsigned long>(options.seed));
  const int explore = static_cast<int>(std::lround(options.explore * options.evaluations));
  if (explore > 1) runOptimiser(search, NLOPT_GN_CRS2_LM, start, explore, 0.25);
  std::vector<double> best;
  for (const FittedParameter& p : fitted)
    best.push_back(search.best.evaluations > 0
                       ? (parameterValue(search.best.parameters, p.name) - p.low) / (p.high - p.low)
                       : start[best.size()]);
  if (search.best.evaluations < options.evaluations &&
      !(search.has_end && std::chrono::steady_clock::now() > search.end))
    runOptimiser(search, NLOPT_LN_SBPLX, best, options.evaluations, 0.08);
  return search.best;
}

std::string presetText(const SimulatorParameters& parameters, const std::string& comment,
                       const SimulatorParameters& defaults) {
  std::map<std::string, std::string> usual;
  for (const ParameterRow& row : listParameters(defaults)) usual[row.name] = row.value;
  std::ostringstream text;
  text << "# " << comment << "\n";
  std::string group;
  for (const ParameterRow& row : listParameters(parameters)) {
    const std::string room = row.name.substr(0, row.name.find('/'));
    if ((room != "brush" && room != "contact" && room != "ink") || row.value == usual[row.name])
      continue;
    if (room != group) text << room << ":\n";
    group = room;
    text << "  " << row.name.substr(room.size() + 1) << ": " << row.value;
    if (row.unit != "1") text << "  # [" << row.unit << "]";
    text << "\n";
  }
  return text.str();
}

}  // namespace calligraphy_brush
