#include "flow_kernel.h"

#include <algorithm>
#include <cmath>

// The compiler makes one version an instruction set. They differ in speed alone: without contraction
// (see CMakeLists.txt) each sum and product is rounded the same way in all of them.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define CALLIGRAPHY_BRUSH_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CALLIGRAPHY_BRUSH_CLONES
#endif

namespace calligraphy_brush {
namespace {

constexpr int n = kFlowSide;
// Below this filling liquid does not hang together and stays where it is: fronts are sharp.
constexpr double kLeastFilling = 1e-4;

/// Φ(θ) scale, continued beyond θ = 1 with the slope there; that of films; and pigment over liquid. Loop
/// by loop without branches, so that each is compiled to registers.
template <int count>
__attribute__((always_inline)) inline void potentials(
    const FlowCoefficients& c, const double* __restrict water, const double* __restrict pigment,
    double* __restrict potential, double* __restrict film, double* __restrict ratio) {
  const double slope = c.exponent + 1.0, inverse = c.inverse_capacity;
  const double scale = c.scale, film_scale = c.scale * slope * c.film, mobility = c.mobility;
  for (int i = 0; i < count; ++i) {
    const double filling = water[i] * inverse;
    potential[i] = filling < 1.0 ? filling : 1.0;
  }
  for (int i = 0; i < count; ++i) film[i] = potential[i];
  for (int k = 0; k < c.exponent; ++k)
    for (int i = 0; i < count; ++i) potential[i] *= film[i];
  for (int i = 0; i < count; ++i) {
    const double filling = water[i] * inverse;
    const double hangs_together = filling < kLeastFilling ? 0.0 : 1.0;
    potential[i] = hangs_together * scale * (potential[i] + slope * (filling - film[i]));
    film[i] = hangs_together * film_scale * filling;
    const double positive = water[i] > 1e-30 ? water[i] : 1e-30;
    ratio[i] = hangs_together * mobility * pigment[i] / positive;
  }
}

/// Films are there only where both sides are wet: they feed a front but do not make it advance.
__attribute__((always_inline)) inline double between(double a, double b) {
  const double least = a < b ? a : b;
  return least > 0.0 ? a - b : 0.0;
}

}  // namespace

CALLIGRAPHY_BRUSH_CLONES
void saveEdges(const FlowCoefficients& coefficients, const double* water, const double* pigment,
               FlowEdges& edges) {
  double w[4][n], p[4][n];
  for (int i = 0; i < n; ++i) {
    const int at[4] = {i * n, i * n + n - 1, i, (n - 1) * n + i};
    for (int side = 0; side < 4; ++side) {
      w[side][i] = water[at[side]];
      p[side][i] = pigment[at[side]];
    }
  }
  potentials<4 * n>(coefficients, w[0], p[0], edges.potential[0].data(), edges.film[0].data(),
                    edges.ratio[0].data());
  edges.any = false;
  for (const auto& side : edges.potential)
    for (const double value : side) edges.any = edges.any || value > 0.0;
}

CALLIGRAPHY_BRUSH_CLONES
double flowStep(const FlowCoefficients& coefficients, const FlowFaces& faces, const FlowEdges& own,
                const std::array<const FlowEdges*, 4>& around, double* __restrict water,
                double* __restrict pigment) {
  double potential[kFlowSize], film[kFlowSize], ratio[kFlowSize];
  potentials<kFlowSize>(coefficients, water, pigment, potential, film, ratio);

  // Nothing flows where both sides of a face have the same potential.
  const auto edge = [&](FlowSide mine, FlowSide others) -> std::array<const double*, 3> {
    const FlowEdges& edges = around[mine] ? *around[mine] : own;
    const auto side = static_cast<std::size_t>(around[mine] ? others : mine);
    return {edges.potential[side].data(), edges.ratio[side].data(), edges.film[side].data()};
  };
  const auto below = edge(kBelow, kAbove), above = edge(kAbove, kBelow);
  const auto left = edge(kLeft, kRight), right = edge(kRight, kLeft);

  double net[n], carried[n];               // into a row
  double flux_low[n], pigment_low[n];      // through its lower faces
  double flux_x[n + 1], pigment_x[n + 1];  // through its left faces
  double row_potential[n + 2], row_film[n + 2], row_ratio[n + 2];
  double most[n] = {};  // change in a column
  for (int i = 0; i < n; ++i) {
    flux_low[i] = static_cast<double>(faces.y[static_cast<std::size_t>(i)]) *
                  (below[0][i] - potential[i] + between(below[2][i], film[i]));
    pigment_low[i] = flux_low[i] * (flux_low[i] > 0.0 ? below[1][i] : ratio[i]);
  }
  for (int row = 0; row < n; ++row) {
    const double* p = potential + row * n;
    const double* r = ratio + row * n;
    const double* p_up = row + 1 < n ? p + n : above[0];
    const double* f = film + row * n;
    const double* f_up = row + 1 < n ? f + n : above[2];
    const double* r_up = row + 1 < n ? r + n : above[1];
    const float* ky = faces.y.data() + (row + 1) * n;
    const float* kx = faces.x.data() + row * (n + 1);
    row_potential[0] = left[0][row];
    row_ratio[0] = left[1][row];
    row_film[0] = left[2][row];
    row_potential[n + 1] = right[0][row];
    row_ratio[n + 1] = right[1][row];
    row_film[n + 1] = right[2][row];
    for (int i = 0; i < n; ++i) {
      row_potential[i + 1] = p[i];
      row_ratio[i + 1] = r[i];
      row_film[i + 1] = f[i];
    }
    for (int i = 0; i <= n; ++i) {
      const double flux = static_cast<double>(kx[i]) * (row_potential[i] - row_potential[i + 1] +
                                                        between(row_film[i], row_film[i + 1]));
      flux_x[i] = flux;
      pigment_x[i] = flux * (flux > 0.0 ? row_ratio[i] : row_ratio[i + 1]);
    }
    for (int i = 0; i < n; ++i) {
      const double flux = static_cast<double>(ky[i]) * (p[i] - p_up[i] + between(f[i], f_up[i]));
      const double with = flux * (flux > 0.0 ? r[i] : r_up[i]);
      net[i] = (flux_x[i] - flux_x[i + 1]) + (flux_low[i] - flux);
      carried[i] = (pigment_x[i] - pigment_x[i + 1]) + (pigment_low[i] - with);
      flux_low[i] = flux;
      pigment_low[i] = with;
    }
    double* w = water + row * n;
    double* m = pigment + row * n;
    for (int i = 0; i < n; ++i) {
      w[i] += net[i];
      m[i] += carried[i];
      const double change = net[i] > 0.0 ? net[i] : -net[i];
      most[i] = change > most[i] ? change : most[i];
    }
  }
  double largest = 0.0;
  for (const double change : most) largest = change > largest ? change : largest;
  return largest;
}

}  // namespace calligraphy_brush
