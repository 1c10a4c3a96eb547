#pragma once

namespace calligraphy_brush {

enum class Scheme { kBackwardEuler, kBdf2 };

/// A linear multistep scheme as one minimisation.
///
/// With d the displacement of a node in the step, every such scheme turns
/// m a + c m v = m g − ∂E/∂x into the minimum over d of
///
///   Σ ½ m inertia |d − target|² + E,   and then   v = from_way d + from_displacement d₋
///
/// target = displacement d₋ + velocity v₋ + previous_velocity v₋₋ + gravity g, where − marks values
/// one step old and −− two. Gravity is part of the target, so damping leaves the static shape alone.
struct StepCoefficients {
  double inertia;            ///< [1/s²]
  double displacement;       ///< [1]
  double velocity;           ///< [s]
  double previous_velocity;  ///< [s]
  double gravity;            ///< [s²]
  double from_way;           ///< [1/s]
  double from_displacement;  ///< [1/s]
};

/// h: time step [s] > 0; damping: c [1/s] ≥ 0.
///
/// Backward Euler: v = d/h, a = (v − v₋)/h.
/// BDF2: v = (3d − d₋)/(2h), a = (3v − 4v₋ + v₋₋)/(2h); needs two steps of history, so the first
/// step after a start is backward Euler's.
inline StepCoefficients stepCoefficients(Scheme scheme, double h, double damping) {
  StepCoefficients k{};
  const bool bdf2 = scheme == Scheme::kBdf2;
  const double rate = bdf2 ? 1.5 / h : 1.0 / h;  // of v by d, and of a by v
  k.inertia = rate * (rate + damping);
  k.from_way = rate;
  k.gravity = 1.0 / k.inertia;
  if (bdf2) {
    k.from_displacement = -0.5 / h;
    k.displacement = (rate + damping) * (0.5 / h) / k.inertia;
    k.velocity = (2.0 / h) / k.inertia;
    k.previous_velocity = -(0.5 / h) / k.inertia;
  } else {
    k.velocity = (1.0 / h) / k.inertia;
  }
  return k;
}

}  // namespace calligraphy_brush
