#pragma once

#include <array>
#include <cstdint>

#include "calligraphy_brush/paper/paper.h"
#include "flow_kernel.h"

namespace calligraphy_brush {

/// 32 × 32 pixels, row by row from below.
struct Paper::Tile {
  static constexpr int kSize = kTile * kTile;
  static_assert(kTile == kFlowSide, "a tile is the kernel's square");

  int column = 0, row = 0;                                  // of the tile
  int columns = 0, rows = 0;                                // that are on the sheet
  std::array<double, kSize> water{}, pigment{}, settled{};  // pigment: what is not settled
  std::array<float, kSize> height;
  std::array<std::uint32_t, kSize> exposure{};  // last contact << 8 | part of its time, in 255ths
  FlowFaces faces;
  /// Its left and its lower side: the clock up to which liquid has gone across, what did at last, and in
  /// which pass.
  struct Side {
    double done = 0.0;
    FlowAcross flow;         // scratch
    std::uint64_t pass = 0;  // scratch
  };
  Side left, below;
  // Scratch.
  std::uint64_t pass = 0;  // of the flow that it last took part in
  double seconds = 0.0;    // for which
  WetAround wet_around;

  /// As when it came into being.
  void empty() {
    for (auto* field : {&water, &pigment, &settled}) field->fill(0.0);
    exposure.fill(0);
    left = below = Side{};
    pass = 0;
  }
};

}  // namespace calligraphy_brush
