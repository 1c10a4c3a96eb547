#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calligraphy_brush/sim/simulator_parameters.h"

namespace calligraphy_brush {

/// A number of the simulator that is fitted, and between what.
struct FittedParameter {
  std::string name;  ///< full name of a parameter that is a double: "brush/tip_length"
  double low = 0.0, high = 0.0;
};

/// The eight physical numbers of a brush that decide what its line is like.
std::vector<FittedParameter> defaultFittedParameters();

/// Value of a parameter by its full name. Throws std::invalid_argument if none of that name is a double.
double parameterValue(const SimulatorParameters& parameters, const std::string& name);
void setParameterValue(SimulatorParameters& parameters, const std::string& name, double value);

struct CalibrationOptions {
  int evaluations = 200;         ///< at most
  double explore = 0.5;          ///< part of them that looks all over the box
  double longest_seconds = 0.0;  ///< of wall time after which no other is begun; 0: no limit
  int seed = 1;
};

struct CalibrationResult {
  SimulatorParameters parameters;
  double value = 0.0;
  int evaluations = 0;
};

/// Looks for the values of `fitted` with which `goodness` is largest: controlled random search over the
/// whole box (Kaelo & Ali 2006, CRS2 with local mutation), then a subspace simplex from the best of it
/// (Rowan 1990, Sbplx), both of NLopt. The start is what `parameters` have, brought into the box, and is
/// the result if nothing better is found. What throws ParameterError counts as −1. Equal calls give
/// equal results unless the time runs out. Throws std::invalid_argument for an unknown name or an empty
/// range.
CalibrationResult calibrate(const SimulatorParameters& parameters,
                            const std::vector<FittedParameter>& fitted,
                            const std::function<double(const SimulatorParameters&)>& goodness,
                            const CalibrationOptions& options);

/// YAML text with all parameters of the groups brush, contact and ink that are not as in `defaults`.
std::string presetText(const SimulatorParameters& parameters, const std::string& comment,
                       const SimulatorParameters& defaults = SimulatorParameters());

}  // namespace calligraphy_brush
