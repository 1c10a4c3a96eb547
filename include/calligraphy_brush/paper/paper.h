#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "calligraphy_brush/paper/paper_parameters.h"
#include "calligraphy_brush/paper/relief.h"

namespace calligraphy_brush {

/// A straight piece of a bundle that lay on the sheet for a while, and what it swept meanwhile.
struct TouchingPiece {
  struct End {
    double x, y;          ///< middle of its way, in the paper frame [m]
    double way_x, way_y;  ///< half of its way [m]
    double half_width;    ///< of the chord that is close enough to touch [m]
  };
  End a, b;
  double along_x, along_y;  ///< unit, from a to b; anyhow where they are at one place
  double duration;          ///< [s]
  double gap;               ///< height of the hairs, or of the liquid on them, over the mean plane [m]
  double film;              ///< liquid left at first touch, where all of a place is touched [m]
  double filling;           ///< part of the sheet's pores that is in balance with the bundle, 0..1
  double concentration;     ///< pigment over volume of the bundle's ink
  double volume, room;      ///< liquid in the bundle, and how much more it can take [m³]
  const float* underside;   ///< heights of its hairs across it, kUnderside values [m]

  static constexpr int kUnderside = 16;
};

// Of the kernel that moves liquid.
enum FlowSide : int;
struct FlowAcross;
struct FlowLaw;

/// What went from a bundle to the sheet; negative what came back.
struct InkExchange {
  double volume = 0.0;   ///< [m³]
  double pigment = 0.0;  ///< [m³]
};

/// The sheet: liquid and pigment on a grid of square pixels over a relief of fibres, and its picture.
///
/// Liquid is volume per area [m]; a sheet is full at thickness · porosity. Pigment is measured by the
/// volume per area of undiluted ink that carries as much [m]; what has settled stays, the rest goes
/// where liquid takes it.
///
/// Row 0 of the grid is the lowest (y = 0); row 0 of a picture is the highest, as in any image. The grid
/// is in tiles that come into being where there is ink. Where a tile is dry, or nothing moves in it,
/// nothing is computed. Copies are deep. Not thread-safe.
class Paper {
 public:
  /// Throws ParameterError.
  explicit Paper(const PaperParameters& parameters);
  Paper(const Paper& other);
  Paper& operator=(const Paper& other);
  Paper(Paper&&) noexcept;
  Paper& operator=(Paper&&) noexcept;
  ~Paper();

  const PaperParameters& parameters() const { return parameters_; }
  int width_px() const { return width_px_; }
  int height_px() const { return height_px_; }
  double pixelSize() const { return pixel_size_; }                                  ///< [m]
  double capacity() const { return parameters_.thickness * parameters_.porosity; }  ///< [m]
  /// Standard deviation of the relief [m].
  double roughness() const { return parameters_.roughness; }

  /// The pieces from now on were on the sheet at the same time, after those before. What lies over
  /// each other does not touch for longer: a place is touched for no more than all of the time.
  void beginContact() { ++contact_; }

  /// Lets a piece of a bundle and the sheet under it exchange ink, both ways.
  ///
  /// The part α of a pixel that is touched is what of its relief reaches over the gap. At first touch
  /// the film wets it; then the sheet goes to the filling θ that balances the bundle's as
  /// 1 − exp(−t / soak_time), t being the time that a place was touched. A sheet that is fuller than
  /// that gives back likewise, with the pigment that is not yet settled.
  InkExchange exchange(const TouchingPiece& piece);

  /// Puts a disc of undiluted ink on the sheet, `thickness` [m] more than there is. Returns its volume
  /// [m³]: off the sheet nothing happens.
  double addDisc(double x, double y, double radius, double thickness);

  /// Sets what a pixel holds, rows from below: liquid and unsettled pigment per area [m], ≥ 0. For
  /// reference scenes: it makes or takes ink.
  void setInk(int column, int row, double water, double pigment);

  /// Moves liquid and pigment and dries the sheet for a time [s].
  ///
  ///   c ∂θ/∂t = ∇ · (c D₀ K θ^q ∇θ) − evaporation
  ///
  /// θ: liquid over capacity c; D₀: fullDiffusivity(); K: permeability() from place to place. Explicit
  /// finite volumes on Φ = θ^(q+1) / (q + 1), the Kirchhoff transform. Each tile goes at the longest
  /// step that is stable for it and the four around it, up to a quarter of a second, and so does each
  /// side between two: several calls at once, or several steps in one (local time stepping, Osher and
  /// Sanders, Math. Comp. 41, 1983). Pigment goes upwind. What flows out of a pixel flows into its
  /// neighbour, so nothing is lost. Films on fibres that are wet add film_flow · D₀ to the diffusivity
  /// between wet pixels, so that the rim of a blot is fed while it dries. Source: Crank, The Mathematics
  /// of Diffusion, ch. 7; Bear, Dynamics of Fluids in Porous Media, 9.4. The rim of a wet area
  /// evaporates more (Deegan et al., Nature 389, 1997).
  void flow(double seconds);

  /// Removes all ink.
  void clear();

  /// Pigment at a pixel, settled or not, rows from below [m].
  float ink(int column, int row) const;
  /// Liquid at a pixel, rows from below [m].
  float water(int column, int row) const;
  /// Height of the relief at a pixel over the mean plane [m].
  float height(int column, int row) const;

  double inkVolume() const;         ///< pigment on the whole sheet [m³]
  double waterVolume() const;       ///< liquid on the whole sheet [m³]
  double evaporatedVolume() const;  ///< liquid that left the sheet since construction or clear() [m³]

  int tileCount() const { return static_cast<int>(tiles_.size()); }  ///< tiles that have been inked
  int wetTileCount() const { return wet_tiles_; }                    ///< of them, those with liquid
  int movingTileCount() const;                                       ///< of them, those that flow
  std::uint64_t flowCount() const { return flow_count_; }            ///< steps of a tile since clear()

  /// Grows with every change of the picture.
  std::uint64_t revision() const { return revision_; }
  /// FNV-1a hash of the state, continued from `seed`.
  std::uint64_t hash(std::uint64_t seed) const;

  /// The picture: 255 is paper, 0 is black ink, one byte a pixel, top row first.
  ///
  /// Grey is what the pixel reflects over what bare paper does, by Kubelka and Munk: R = a − √(a² − 1),
  /// a = 1 + K/S, S: scattering, K = K₀ + ink / dark_thickness, K₀ that of the bare sheet.
  /// Source: Kubelka and Munk 1931; for ink: Curtis et al., SIGGRAPH 1997.
  void render(std::vector<std::uint8_t>& mono8) const;
  /// The same in 16 bits.
  void render(std::vector<std::uint16_t>& mono16) const;
  /// In colour: red, green, blue, as seen, with the gamma of sRGB (IEC 61966-2-1).
  void renderColour(std::vector<std::uint8_t>& rgb8) const;
  /// Ink without paper: red, green, blue, opacity. Laid over white paper it looks as the ink does.
  void renderTransparent(std::vector<std::uint8_t>& rgba8) const;
  /// mono8 of what the sheet has more of than `before`, which has as many pixels.
  void renderAdded(const Paper& before, std::vector<std::uint8_t>& mono8) const;

 private:
  static constexpr int kTile = 32;  // pixels a side
  struct Tile;
  /// What the flow asks of all tiles, by place: a tile that has nothing to do is not looked at.
  struct Pace {
    double done = 0.0;  // the clock up to which it has flowed, and dried [s]
    double dried = 0.0;
    double step = 1e9;    // longest stable one for its fullest pixel; 0: that is not known [s]
    double drying = 0.0;  // from one drying to the next [s]
    bool wet = false;     // has liquid
    bool moving = false;  // and it moves
  };
  /// Liquid that a pixel wants of a bundle; negative what it would give back [m].
  struct Wish {
    Tile* tile;
    std::size_t pixel;
    double liquid;
  };
  /// What came across one side of a tile that does not flow now itself.
  struct Received {
    Tile* tile;
    FlowSide side;
    const FlowAcross* flow;
    double seconds;
  };

  Tile* find(int tile_column, int tile_row) const;
  Tile& make(int tile_column, int tile_row);
  Tile& tileAt(std::size_t place) const { return *tiles_[static_cast<std::size_t>(places_[place])]; }
  std::size_t placeOf(const Tile& tile) const;
  const Tile* tileOf(int column, int row) const;
  std::size_t pixelCount() const {
    return static_cast<std::size_t>(width_px_) * static_cast<std::size_t>(height_px_);
  }
  void findWishes(const TouchingPiece& piece, Tile& tile, int first_column, int last_column,
                  int first_row, int last_row);
  FlowLaw flowLaw() const;
  double stableStep(double fullest) const;
  double stepAround(std::size_t place) const;
  void setMoving(Tile& tile);
  void catchUp(Tile& tile);
  void setInked(Tile& tile);
  void findDue(double round, bool may_look);
  void moveOn();
  void dry();
  template <class Function>
  void forEachPixel(Function&& function) const;

  PaperParameters parameters_;
  int width_px_, height_px_;
  double pixel_size_;
  Relief relief_;
  double full_diffusivity_ = 0.0;
  int tile_columns_ = 0, tile_rows_ = 0;
  std::vector<std::int32_t> places_;  // index into tiles_, −1 where there is none
  std::vector<Pace> paces_;           // by place
  std::vector<std::unique_ptr<Tile>> tiles_;
  std::vector<std::size_t> tile_places_;        // their places
  std::vector<std::unique_ptr<Tile>> cleared_;  // by place: their relief is kept
  std::vector<Tile*> due_;                      // scratch
  std::vector<Received> received_;              // scratch
  std::vector<Wish> wishes_;                    // scratch
  int wet_tiles_ = 0;
  double clock_ = 0.0;              // how long there was liquid to flow [s]
  double looked_for_drying_ = 0.0;  // on that clock
  double evaporated_ = 0.0;         // [m], over one pixel
  std::uint64_t tick_ = 0, pass_ = 0, flow_count_ = 0;
  std::uint32_t contact_ = 1;
  std::uint64_t revision_ = 0;
};

}  // namespace calligraphy_brush
