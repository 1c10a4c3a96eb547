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
// Liquid that is less than this has dried [m].
constexpr double kDryThickness = 1e-9;

/// Φ(θ) scale, continued beyond θ = 1 with the slope there; that of films; and pigment over liquid. Loop
/// by loop without branches, so that each is compiled to registers.
template <int count>
__attribute__((always_inline)) inline void potentials(
    const FlowLaw& c, double seconds, const double* __restrict water, const double* __restrict pigment,
    double* __restrict potential, double* __restrict film, double* __restrict ratio) {
  const double slope = c.exponent + 1.0, inverse = c.inverse_capacity;
  const double scale = c.rate * seconds, film_scale = scale * slope * c.film, mobility = c.mobility;
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

/// Where the outermost pixels on a side begin and how far they are from each other.
struct Edge {
  int first, stride;
};
__attribute__((always_inline)) inline Edge edgeOf(FlowSide side) {
  return side == kLeft    ? Edge{0, n}
         : side == kRight ? Edge{n - 1, n}
         : side == kBelow ? Edge{0, 1}
                          : Edge{(n - 1) * n, 1};
}

}  // namespace

bool isWetAlong(const FlowLaw& law, FlowSide side, const double* water) {
  const Edge edge = edgeOf(side);
  for (int i = 0; i < n; ++i)
    if (water[edge.first + i * edge.stride] * law.inverse_capacity >= kLeastFilling) return true;
  return false;
}

CALLIGRAPHY_BRUSH_CLONES
void flowAcross(const FlowLaw& law, double seconds, FlowSide side, const FlowFaces& faces,
                FlowFields low, FlowFields high, FlowAcross& flow) {
  double water[2][n], pigment[2][n], potential[2][n], film[2][n], ratio[2][n];
  const Edge edges[2] = {edgeOf(side == kLeft ? kRight : kAbove), edgeOf(side)};
  const FlowFields fields[2] = {low, high};
  for (int k = 0; k < 2; ++k)
    for (int i = 0; i < n; ++i) {
      water[k][i] = fields[k].water[edges[k].first + i * edges[k].stride];
      pigment[k][i] = fields[k].pigment[edges[k].first + i * edges[k].stride];
    }
  potentials<2 * n>(law, seconds, water[0], pigment[0], potential[0], film[0], ratio[0]);
  const float* permeability = side == kLeft ? faces.x.data() : faces.y.data();
  const int stride = side == kLeft ? n + 1 : 1;
  for (int i = 0; i < n; ++i) {
    const double flux = static_cast<double>(permeability[i * stride]) *
                        (potential[0][i] - potential[1][i] + between(film[0][i], film[1][i]));
    flow.liquid[static_cast<std::size_t>(i)] = flux;
    flow.pigment[static_cast<std::size_t>(i)] = flux * (flux > 0.0 ? ratio[0][i] : ratio[1][i]);
  }
}

FlowChange receive(FlowSide side, const FlowAcross& flow, double* water, double* pigment) {
  const Edge edge = edgeOf(side);
  const double sign = side == kLeft || side == kBelow ? 1.0 : -1.0;
  FlowChange change{0.0, 0.0};
  for (int i = 0; i < n; ++i) {
    const int at = edge.first + i * edge.stride;
    const double liquid = flow.liquid[static_cast<std::size_t>(i)];
    water[at] += sign * liquid;
    pigment[at] += sign * flow.pigment[static_cast<std::size_t>(i)];
    change.largest = std::max(change.largest, std::abs(liquid));
    change.fullest = std::max(change.fullest, water[at]);
  }
  return change;
}

CALLIGRAPHY_BRUSH_CLONES
FlowChange flowInside(const FlowLaw& law, double seconds, const FlowFaces& faces,
                      const std::array<const FlowAcross*, 4>& across, double* __restrict water,
                      double* __restrict pigment) {
  static const FlowAcross kNothing{};
  const FlowAcross& left = across[kLeft] ? *across[kLeft] : kNothing;
  const FlowAcross& right = across[kRight] ? *across[kRight] : kNothing;
  const FlowAcross& below = across[kBelow] ? *across[kBelow] : kNothing;
  const FlowAcross& above = across[kAbove] ? *across[kAbove] : kNothing;

  // A pixel before the first is read, and what it gives replaced.
  constexpr int kPad = 8;
  alignas(64) double potential_pad[kPad + kFlowSize], film_pad[kPad + kFlowSize],
      ratio_pad[kPad + kFlowSize];
  for (double* pad : {potential_pad, film_pad, ratio_pad}) pad[kPad - 1] = 0.0;
  const double *potential = potential_pad + kPad, *film = film_pad + kPad, *ratio = ratio_pad + kPad;
  potentials<kFlowSize>(law, seconds, water, pigment, potential_pad + kPad, film_pad + kPad,
                        ratio_pad + kPad);

  double flux_low[n], pigment_low[n], flux_up[n], pigment_up[n];  // through a row's lower, upper faces
  double flux_x[n + 1], pigment_x[n + 1];                         // through its left faces
  double largest[n] = {}, fullest[n] = {};                        // of a column
  for (int i = 0; i < n; ++i) {
    flux_low[i] = below.liquid[static_cast<std::size_t>(i)];
    pigment_low[i] = below.pigment[static_cast<std::size_t>(i)];
  }
  for (int row = 0; row < n; ++row) {
    const double *p = potential + row * n, *f = film + row * n, *r = ratio + row * n;
    const float* kx = faces.x.data() + row * (n + 1);
    for (int i = 0; i < n; ++i) {
      const double flux = static_cast<double>(kx[i]) * (p[i - 1] - p[i] + between(f[i - 1], f[i]));
      flux_x[i] = flux;
      pigment_x[i] = flux * (flux > 0.0 ? r[i - 1] : r[i]);
    }
    const auto at = static_cast<std::size_t>(row);
    flux_x[0] = left.liquid[at];
    pigment_x[0] = left.pigment[at];
    flux_x[n] = right.liquid[at];
    pigment_x[n] = right.pigment[at];
    if (row + 1 < n) {
      const double *p_up = p + n, *f_up = f + n, *r_up = r + n;
      const float* ky = faces.y.data() + (row + 1) * n;
      for (int i = 0; i < n; ++i) {
        const double flux = static_cast<double>(ky[i]) * (p[i] - p_up[i] + between(f[i], f_up[i]));
        flux_up[i] = flux;
        pigment_up[i] = flux * (flux > 0.0 ? r[i] : r_up[i]);
      }
    } else {
      for (int i = 0; i < n; ++i) {
        flux_up[i] = above.liquid[static_cast<std::size_t>(i)];
        pigment_up[i] = above.pigment[static_cast<std::size_t>(i)];
      }
    }
    double *w = water + row * n, *m = pigment + row * n;
    for (int i = 0; i < n; ++i) {
      const double net = (flux_x[i] - flux_x[i + 1]) + (flux_low[i] - flux_up[i]);
      w[i] += net;
      m[i] += (pigment_x[i] - pigment_x[i + 1]) + (pigment_low[i] - pigment_up[i]);
      const double change = net > 0.0 ? net : -net;
      largest[i] = change > largest[i] ? change : largest[i];
      fullest[i] = w[i] > fullest[i] ? w[i] : fullest[i];
      flux_low[i] = flux_up[i];
      pigment_low[i] = pigment_up[i];
    }
  }
  FlowChange change{0.0, 0.0};
  for (int i = 0; i < n; ++i) {
    change.largest = std::max(change.largest, largest[i]);
    change.fullest = std::max(change.fullest, fullest[i]);
  }
  return change;
}

void findWetAround(const double* water, const std::array<const double*, 4>& around, WetAround& wet) {
  wet.fill(0);
  unsigned char* first = wet.data() + kFramedSide + 1;
  for (int row = 0; row < n; ++row)
    for (int i = 0; i < n; ++i) first[row * kFramedSide + i] = water[row * n + i] > 0.0;
  for (int i = 0; i < n; ++i) {
    if (around[kLeft]) first[i * kFramedSide - 1] = around[kLeft][i * n + n - 1] > 0.0;
    if (around[kRight]) first[i * kFramedSide + n] = around[kRight][i * n] > 0.0;
    if (around[kBelow]) first[i - kFramedSide] = around[kBelow][(n - 1) * n + i] > 0.0;
    if (around[kAbove]) first[n * kFramedSide + i] = around[kAbove][i] > 0.0;
  }
}

CALLIGRAPHY_BRUSH_CLONES
Dried dryInside(const Drying& drying, const WetAround& wet, double* __restrict water,
                double* __restrict pigment, double* __restrict settled) {
  const double loss = drying.loss, rim = drying.rim, part = drying.settled;
  const double dry_thickness = loss > 0.0 ? kDryThickness : 0.0;
  double evaporated[n] = {}, largest[n] = {}, fullest[n] = {};  // of a column
  for (int row = 0; row < n; ++row) {
    const unsigned char* here = wet.data() + (row + 1) * kFramedSide + 1;
    double *w = water + row * n, *m = pigment + row * n, *s = settled + row * n;
    for (int i = 0; i < n; ++i) {
      const int wet_faces = here[i - 1] + here[i + 1] + here[i - kFramedSide] + here[i + kFramedSide];
      const double wanted = loss * (1.0 + rim * (4 - wet_faces));
      const double gone = w[i] - wanted < dry_thickness ? w[i] : wanted;
      const double moved = w[i] > 0.0 ? part * m[i] : 0.0;
      const double lost = w[i] > 0.0 ? wanted : 0.0;
      largest[i] = lost > largest[i] ? lost : largest[i];
      evaporated[i] += gone;
      w[i] -= gone;
      m[i] -= moved;
      s[i] += moved;
      fullest[i] = w[i] > fullest[i] ? w[i] : fullest[i];
    }
  }
  Dried dried{0.0, 0.0, 0.0};
  for (int i = 0; i < n; ++i) {
    dried.evaporated += evaporated[i];
    dried.largest = std::max(dried.largest, largest[i]);
    dried.fullest = std::max(dried.fullest, fullest[i]);
  }
  return dried;
}

}  // namespace calligraphy_brush
