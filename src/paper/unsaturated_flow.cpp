#include "calligraphy_brush/paper/unsaturated_flow.h"

#include <cmath>

namespace calligraphy_brush {

double frontFactor(int q) {
  // With η = x / √t, D₀ = 1, a front at η = 1 and v = u^q: the flux φ = −v u' obeys φ' = ½ η u'. Near
  // the front v = q (1 − η) / 2 to first order, and φ = ½ u. In steps of y = ln(1 − η), since there u
  // has no slope.
  constexpr double kStart = -21.0;  // 1 − η = 7.6e-10
  constexpr int kSteps = 4000;
  double v = 0.5 * q * std::exp(kStart);
  double u = std::pow(v, 1.0 / q);
  double flux = 0.5 * u;
  const auto slope = [q](double y, double vv, double f, double& dv, double& df) {
    const double to_front = std::exp(y);
    dv = to_front * q * f / std::pow(vv, 1.0 / q);
    df = to_front * 0.5 * (1.0 - to_front) * f / vv;
  };
  const double h = -kStart / kSteps;
  for (int k = 0; k < kSteps; ++k) {
    const double y = kStart + k * h;
    double a[4], b[4];
    slope(y, v, flux, a[0], b[0]);
    slope(y + 0.5 * h, v + 0.5 * h * a[0], flux + 0.5 * h * b[0], a[1], b[1]);
    slope(y + 0.5 * h, v + 0.5 * h * a[1], flux + 0.5 * h * b[1], a[2], b[2]);
    slope(y + h, v + h * a[2], flux + h * b[2], a[3], b[3]);
    v += h / 6.0 * (a[0] + 2 * a[1] + 2 * a[2] + a[3]);
    flux += h / 6.0 * (b[0] + 2 * b[1] + 2 * b[2] + b[3]);
  }
  u = std::pow(v, 1.0 / q);
  // u / u(0) solves the equation with D₀ u(0)^q in place of D₀.
  return 1.0 / std::sqrt(std::pow(u, q));
}

double fullDiffusivity(double diffusivity, int q) {
  const double lambda = frontFactor(q);
  return 2.0 * diffusivity / (lambda * lambda);
}

}  // namespace calligraphy_brush
