#pragma once

#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// A stage of a time integration as one minimisation.
///
/// With d the way of a node in the stage, a stage turns m a + c m v = m g − ∂E/∂x into the minimum
/// over d of
///
///   Σ ½ m inertia |d − target|² + E,
///   and then   v = from_way d + from_displacement d₋ + from_velocity v₋
///
/// target = displacement d₋ + velocity v₋ + previous_velocity v₋₋ + gravity g, where − marks values
/// one stage old and −− two. Gravity is part of the target, so damping leaves the static shape alone.
///
/// V: double, or lanes where rods take their step by different schemes.
template <class V>
struct StepCoefficientsOf {
  V inertia;            ///< [1/s²]
  V displacement;       ///< [1]
  V velocity;           ///< [s]
  V previous_velocity;  ///< [s]
  V gravity;            ///< [s²]
  V from_way;           ///< [1/s]
  V from_displacement;  ///< [1/s]
  V from_velocity;      ///< [1]
  V restart;            ///< 1: v₋ becomes v as well, so that BDF2 goes on with this step's momentum; 0

  /// d is near guess_displacement d₋ + guess_velocity v₋ where the motion is smooth.
  V guess_displacement;  ///< [1]
  V guess_velocity;      ///< [s]
};
using StepCoefficients = StepCoefficientsOf<double>;

/// Those of `calm` where the mask is set, else of `usual`.
template <class V, class Mask>
StepCoefficientsOf<V> laneCoefficients(const StepCoefficients& usual, const StepCoefficients& calm,
                                       Mask is_calm) {
  const auto pick = [&](double StepCoefficients::*member) {
    return select(is_calm, broadcast<V>(static_cast<RealOf<V>>(calm.*member)),
                  broadcast<V>(static_cast<RealOf<V>>(usual.*member)));
  };
  return {pick(&StepCoefficients::inertia),           pick(&StepCoefficients::displacement),
          pick(&StepCoefficients::velocity),          pick(&StepCoefficients::previous_velocity),
          pick(&StepCoefficients::gravity),           pick(&StepCoefficients::from_way),
          pick(&StepCoefficients::from_displacement), pick(&StepCoefficients::from_velocity),
          pick(&StepCoefficients::restart),           pick(&StepCoefficients::guess_displacement),
          pick(&StepCoefficients::guess_velocity)};
}

/// Backward Euler over h [s] > 0 with damping c [1/s] ≥ 0: v = d/h, a = (v − v₋)/h. First order.
inline StepCoefficients backwardEuler(double h, double damping) {
  StepCoefficients k{};
  const double rate = 1.0 / h;
  k.inertia = rate * (rate + damping);
  k.velocity = rate / k.inertia;
  k.gravity = 1.0 / k.inertia;
  k.from_way = rate;
  k.guess_velocity = h;
  return k;
}

/// Backward Euler in between steps of BDF2. What BDF2 takes for momentum is m (3v − v₋)/2.
inline StepCoefficients calmStep(double h, double damping) {
  StepCoefficients k = backwardEuler(h, damping);
  k.restart = 1.0;
  return k;
}

/// BDF2: v = (3d − d₋)/(2h), a = (3v − 4v₋ + v₋₋)/(2h). Second order, and L-stable. Needs the history
/// of two steps, so the first step after a start is backward Euler's.
inline StepCoefficients bdf2(double h, double damping) {
  StepCoefficients k{};
  const double rate = 1.5 / h;
  k.inertia = rate * (rate + damping);
  k.displacement = (rate + damping) * (0.5 / h) / k.inertia;
  k.velocity = (2.0 / h) / k.inertia;
  k.previous_velocity = -(0.5 / h) / k.inertia;
  k.gravity = 1.0 / k.inertia;
  k.from_way = rate;
  k.from_displacement = -0.5 / h;
  // 2d₋ − d₋₋, since v₋ = (3d₋ − d₋₋)/(2h)
  k.guess_displacement = -1.0;
  k.guess_velocity = 2.0 * h;
  return k;
}

/// SDIRK2 of Alexander 1977 (Diagonally Implicit Runge–Kutta Methods for Stiff ODEs, theorem 5): two
/// stages, at γh and h with γ = 1 − 1/√2. Second order, L-stable, and starts by itself.
constexpr double kSdirk2Gamma = 0.29289321881345247560;

/// Its first stage is backward Euler over γh. In the second, with r = 1/(γh), s = (1 − γ)/γ and the
/// first stage's d₋, v₋ and the step's v₋₋:
///
///   v = r (d + d₋) − s v₋,   a = r (v − (1 − s) v₋₋ − s v₋)
inline StepCoefficients sdirk2SecondStage(double h, double damping) {
  StepCoefficients k{};
  const double rate = 1.0 / (kSdirk2Gamma * h), s = (1.0 - kSdirk2Gamma) / kSdirk2Gamma;
  k.inertia = rate * (rate + damping);
  k.displacement = -1.0;
  k.velocity = s / rate + s / (rate + damping);
  k.previous_velocity = (1.0 - s) / (rate + damping);
  k.gravity = 1.0 / k.inertia;
  k.from_way = rate;
  k.from_displacement = rate;
  k.from_velocity = -s;
  k.guess_velocity = (1.0 - kSdirk2Gamma) * h;
  return k;
}

}  // namespace calligraphy_brush
