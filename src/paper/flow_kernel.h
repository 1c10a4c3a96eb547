#pragma once

#include <array>

namespace calligraphy_brush {

/// One step of the flow in a square of pixels; see Paper::flow().
struct FlowCoefficients {
  double scale;             ///< Δt D₀ c / (Δx² (q + 1)) [m]
  double inverse_capacity;  ///< 1/c [1/m]
  double mobility;          ///< speed of pigment over that of liquid
  int exponent;             ///< q
  double film;              ///< diffusivity between wet pixels besides, over D₀
};

constexpr int kFlowSide = 32;  ///< pixels a side
constexpr int kFlowSize = kFlowSide * kFlowSide;

/// Sides of a square.
enum FlowSide { kLeft, kRight, kBelow, kAbove };

/// Potential, that of films (0 where it is dry) and pigment over liquid in the outermost pixels at the
/// begin of a step, by side.
struct FlowEdges {
  std::array<std::array<double, kFlowSide>, 4> potential{}, film{}, ratio{};
  bool any = false;  ///< a potential is not 0
};

/// Permeability of all faces, those between x − 1 and x first; 0 at the edge of the sheet.
struct FlowFaces {
  std::array<float, kFlowSide*(kFlowSide + 1)> x{}, y{};
};

void saveEdges(const FlowCoefficients& coefficients, const double* water, const double* pigment,
               FlowEdges& edges);

/// Moves liquid and pigment for one step. own: edges of this square, around: those of the squares to the
/// left, to the right, below and above; null where nothing can flow. Squares on two sides of a face find
/// the same flux, bit by bit, so each changes only itself. Returns the largest change of a pixel's
/// liquid [m].
double flowStep(const FlowCoefficients& coefficients, const FlowFaces& faces, const FlowEdges& own,
                const std::array<const FlowEdges*, 4>& around, double* water, double* pigment);

}  // namespace calligraphy_brush
