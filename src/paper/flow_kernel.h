#pragma once

#include <array>

namespace calligraphy_brush {

/// Coefficients of the flow; see Paper::flow().
struct FlowLaw {
  double rate;              ///< D₀ c / (Δx² (q + 1)) [m/s]
  double inverse_capacity;  ///< 1/c [1/m]
  double mobility;          ///< speed of pigment over that of liquid
  int exponent;             ///< q
  double film;              ///< diffusivity between wet pixels besides, over D₀
};

constexpr int kFlowSide = 32;  ///< pixels a side of a square
constexpr int kFlowSize = kFlowSide * kFlowSide;

/// Sides of a square.
enum FlowSide : int { kLeft, kRight, kBelow, kAbove };

/// Permeability of all faces of a square, those between x − 1 and x first; 0 at the edge of the sheet.
struct FlowFaces {
  std::array<float, kFlowSide*(kFlowSide + 1)> x{}, y{};
};

/// What goes through the faces between two squares, positive towards +x or +y [m].
struct FlowAcross {
  std::array<double, kFlowSide> liquid{}, pigment{};
};

/// Liquid and pigment of a square [m], row by row from below.
struct FlowFields {
  const double *water, *pigment;
};

/// Whether liquid that can flow is in the outermost pixels of a square on one side.
bool isWetAlong(const FlowLaw& law, FlowSide side, const double* water);

/// Flow for a time [s] between the square `low` and the one to the right of or above it, `high`; `side`
/// is that of `high`, kLeft or kBelow, and `faces` are those of `high`.
void flowAcross(const FlowLaw& law, double seconds, FlowSide side, const FlowFaces& faces,
                FlowFields low, FlowFields high, FlowAcross& flow);

/// Of liquid in some pixels: its largest change and its largest value afterwards [m].
struct FlowChange {
  double largest, fullest;
};

/// Adds what came across one side of a square; of the pixels there.
FlowChange receive(FlowSide side, const FlowAcross& flow, double* water, double* pigment);

/// Moves liquid and pigment inside a square for a time [s], and adds what came across its sides: left,
/// right, below, above; null where nothing did.
FlowChange flowInside(const FlowLaw& law, double seconds, const FlowFaces& faces,
                      const std::array<const FlowAcross*, 4>& across, double* water, double* pigment);

/// Which pixels of a square are wet, with a frame of those around it.
constexpr int kFramedSide = kFlowSide + 2;
using WetAround = std::array<unsigned char, kFramedSide * kFramedSide>;

/// around: the liquid of the squares to the left, to the right, below and above; null where it is dry.
void findWetAround(const double* water, const std::array<const double*, 4>& around, WetAround& wet);

/// What drying does.
struct Drying {
  double loss;     ///< liquid of a pixel [m]
  double rim;      ///< how much more for each dry pixel beside it, over loss
  double settled;  ///< part of the pigment in wet pixels that settles
};

/// evaporated: over one pixel [m]; largest: what a pixel may have lost; fullest: what is left at most
/// [m].
struct Dried {
  double evaporated, largest, fullest;
};

Dried dryInside(const Drying& drying, const WetAround& wet, double* water, double* pigment,
                double* settled);

}  // namespace calligraphy_brush
