#include "calligraphy_brush/paper/paper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "calligraphy_brush/paper/unsaturated_flow.h"
#include "flow_kernel.h"

namespace calligraphy_brush {
namespace {

// Liquid that is less than this has dried [m].
constexpr double kDryThickness = 1e-9;
// Drying is slow: it is done this often [s].
constexpr double kDryingInterval = 0.25;
// A tile in which no pixel's filling changes faster than this is still [1/s]; it is looked at again
// every so many calls of flow().
constexpr double kStillRate = 1e-3;
constexpr std::uint64_t kLookInterval = 64;
// Where steps of the flow may be longer than the calls of flow(), up to so much is done at once [s].
constexpr double kLongestFlow = 0.064;

std::uint64_t hashOf(const void* data, std::size_t size, std::uint64_t seed) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) seed = (seed ^ bytes[i]) * 1099511628211ULL;
  return seed;
}

float clamp01(float value) {
  return std::min(1.0F, std::max(0.0F, value));
}

}  // namespace

/// 32 × 32 pixels, row by row from below.
struct Paper::Tile {
  static constexpr int kSize = kTile * kTile;
  static_assert(kTile == kFlowSide, "a tile is the kernel's square");

  int column = 0, row = 0;    // of the tile
  int columns = 0, rows = 0;  // that are on the sheet
  bool wet = false;           // has liquid
  bool moving = false;        // and it moves
  bool drying = false;        // the last of it has just gone
  std::uint64_t listed = 0;   // the tick at which it was last among moving_
  std::array<double, kSize> water{}, pigment{}, settled{};  // pigment: what is not settled
  std::array<float, kSize> height;
  std::array<std::uint32_t, kSize> exposure{};  // last contact << 8 | part of its time, in 255ths
  std::array<unsigned char, kSize> was_wet;     // scratch
  FlowFaces faces;
  double permeability = 0.0;  // largest mean of a pixel's four faces
  FlowEdges edges;            // scratch

  /// As when it came into being.
  void empty() {
    wet = moving = drying = false;
    listed = 0;
    for (auto* field : {&water, &pigment, &settled}) field->fill(0.0);
    exposure.fill(0);
  }
};

Paper::Paper(const PaperParameters& parameters)
    : parameters_((checkParameters(parameters), parameters)),
      pixel_size_(1e-3 / parameters.px_per_mm),
      relief_(parameters, pixel_size_) {
  width_px_ = std::max(1, static_cast<int>(std::lround(parameters.width / pixel_size_)));
  height_px_ = std::max(1, static_cast<int>(std::lround(parameters.height / pixel_size_)));
  constexpr double kMostPixels = 4e8;  // inked all over they would take 14 GB
  if (static_cast<double>(width_px_) * static_cast<double>(height_px_) > kMostPixels)
    throw ParameterError(
        {"paper/width x paper/height x (paper/px_per_mm)^2 = " + std::to_string(width_px_) + " x " +
         std::to_string(height_px_) + " pixels is more than 4e8: make the sheet smaller or coarser"});
  full_diffusivity_ = fullDiffusivity(parameters.diffusivity, parameters.flow_exponent);
  tile_columns_ = (width_px_ + kTile - 1) / kTile;
  tile_rows_ = (height_px_ + kTile - 1) / kTile;
  places_.assign(static_cast<std::size_t>(tile_columns_) * static_cast<std::size_t>(tile_rows_), -1);
}

Paper::Paper(const Paper& other)
    : parameters_(other.parameters_),
      width_px_(other.width_px_),
      height_px_(other.height_px_),
      pixel_size_(other.pixel_size_),
      relief_(other.relief_),
      full_diffusivity_(other.full_diffusivity_),
      tile_columns_(other.tile_columns_),
      tile_rows_(other.tile_rows_),
      places_(other.places_),
      wet_tiles_(other.wet_tiles_),
      since_drying_(other.since_drying_),
      since_flow_(other.since_flow_),
      flow_interval_(other.flow_interval_),
      evaporated_(other.evaporated_),
      tick_(other.tick_),
      contact_(other.contact_),
      revision_(other.revision_) {
  for (const auto& tile : other.tiles_) tiles_.push_back(std::make_unique<Tile>(*tile));
}
Paper& Paper::operator=(const Paper& other) {
  Paper copy(other);
  return *this = std::move(copy);
}
Paper::Paper(Paper&&) noexcept = default;
Paper& Paper::operator=(Paper&&) noexcept = default;
Paper::~Paper() = default;

// ---------------------------------------------------------------- tiles

Paper::Tile* Paper::find(int tile_column, int tile_row) const {
  if (tile_column < 0 || tile_row < 0 || tile_column >= tile_columns_ || tile_row >= tile_rows_)
    return nullptr;
  const std::int32_t place = places_[static_cast<std::size_t>(tile_row * tile_columns_ + tile_column)];
  return place < 0 ? nullptr : tiles_[static_cast<std::size_t>(place)].get();
}

Paper::Tile& Paper::make(int tile_column, int tile_row) {
  if (Tile* tile = find(tile_column, tile_row)) return *tile;
  const auto place = static_cast<std::size_t>(tile_row * tile_columns_ + tile_column);
  places_[place] = static_cast<std::int32_t>(tiles_.size());
  if (place < cleared_.size() && cleared_[place]) {
    tiles_.push_back(std::move(cleared_[place]));
    tiles_.back()->empty();
    return *tiles_.back();
  }
  auto tile = std::make_unique<Tile>();
  tile->column = tile_column;
  tile->row = tile_row;
  tile->columns = std::min(kTile, width_px_ - tile_column * kTile);
  tile->rows = std::min(kTile, height_px_ - tile_row * kTile);
  relief_.sampleHeight(tile_column * kTile, tile_row * kTile, kTile, tile->height.data());
  constexpr int kPadded = kTile + 2;
  std::array<float, kPadded * kPadded> permeability;
  relief_.samplePermeability(tile_column * kTile - 1, tile_row * kTile - 1, kPadded,
                             permeability.data());
  const auto at = [&](int column, int row) {  // 0 off the sheet
    const int x = tile_column * kTile + column, y = tile_row * kTile + row;
    const bool is_on = x >= 0 && y >= 0 && x < width_px_ && y < height_px_;
    return is_on ? permeability[static_cast<std::size_t>((row + 1) * kPadded + column + 1)] : 0.0F;
  };
  for (int j = 0; j < kTile; ++j)
    for (int i = 0; i <= kTile; ++i) {
      tile->faces.x[static_cast<std::size_t>(j * (kTile + 1) + i)] = std::sqrt(at(i - 1, j) * at(i, j));
      tile->faces.y[static_cast<std::size_t>(i * kTile + j)] = std::sqrt(at(j, i - 1) * at(j, i));
    }
  for (std::size_t j = 0; j < kTile; ++j)
    for (std::size_t i = 0; i < kTile; ++i) {
      const float* x = &tile->faces.x[j * (kTile + 1) + i];
      const double sum = double(x[0]) + double(x[1]) + double(tile->faces.y[j * kTile + i]) +
                         double(tile->faces.y[(j + 1) * kTile + i]);
      tile->permeability = std::max(tile->permeability, 0.25 * sum);
    }
  tiles_.push_back(std::move(tile));
  moving_.reserve(tiles_.capacity());
  return *tiles_.back();
}

void Paper::setWet(Tile& tile, bool wet) {
  wet_tiles_ += int(wet) - int(tile.wet);
  tile.wet = wet;
}

const Paper::Tile* Paper::tileOf(int column, int row) const {
  return find(column / kTile, row / kTile);
}

float Paper::ink(int column, int row) const {
  const Tile* tile = tileOf(column, row);
  if (!tile) return 0.0F;
  const auto at = static_cast<std::size_t>(row % kTile * kTile + column % kTile);
  return static_cast<float>(tile->pigment[at] + tile->settled[at]);
}
float Paper::water(int column, int row) const {
  const Tile* tile = tileOf(column, row);
  return tile ? static_cast<float>(
                    tile->water[static_cast<std::size_t>(row % kTile * kTile + column % kTile)])
              : 0.0F;
}
float Paper::height(int column, int row) const {
  float height = 0.0F;
  relief_.sampleHeight(column, row, 1, &height);
  return height;
}

double Paper::inkVolume() const {
  double sum = 0.0;
  for (const auto& tile : tiles_) {
    double part = 0.0;
    for (std::size_t i = 0; i < Tile::kSize; ++i) part += tile->pigment[i] + tile->settled[i];
    sum += part;
  }
  return sum * pixel_size_ * pixel_size_;
}
double Paper::waterVolume() const {
  double sum = 0.0;
  for (const auto& tile : tiles_) {
    double part = 0.0;
    for (const double water : tile->water) part += water;
    sum += part;
  }
  return sum * pixel_size_ * pixel_size_;
}
double Paper::evaporatedVolume() const {
  return evaporated_ * pixel_size_ * pixel_size_;
}

int Paper::movingTileCount() const {
  return static_cast<int>(std::count_if(tiles_.begin(), tiles_.end(),
                                        [](const auto& tile) { return tile->wet && tile->moving; }));
}

void Paper::clear() {
  cleared_.resize(places_.size());
  for (auto& tile : tiles_)
    cleared_[static_cast<std::size_t>(tile->row * tile_columns_ + tile->column)] = std::move(tile);
  std::fill(places_.begin(), places_.end(), -1);
  tiles_.clear();
  wet_tiles_ = 0;
  contact_ = 1;
  since_drying_ = since_flow_ = flow_interval_ = evaporated_ = 0.0;
  tick_ = 0;
  ++revision_;
}

std::uint64_t Paper::hash(std::uint64_t seed) const {
  seed = hashOf(&since_drying_, sizeof since_drying_, seed);
  seed = hashOf(&since_flow_, sizeof since_flow_, seed);
  seed = hashOf(&flow_interval_, sizeof flow_interval_, seed);
  seed = hashOf(&evaporated_, sizeof evaporated_, seed);
  seed = hashOf(&tick_, sizeof tick_, seed);
  for (const auto& tile : tiles_) {
    const std::int32_t place[3] = {tile->column, tile->row, tile->moving};
    seed = hashOf(place, sizeof place, seed);
    for (const auto* field : {&tile->water, &tile->pigment, &tile->settled})
      seed = hashOf(field->data(), sizeof(double) * field->size(), seed);
  }
  return seed;
}

// ---------------------------------------------------------------- exchange with a bundle

InkExchange Paper::exchange(const TouchingPiece& piece) {
  InkExchange sum;
  const TouchingPiece::End &a = piece.a, &b = piece.b;
  // All that the piece swept lies this far around its ends.
  const auto reachOf = [this](const TouchingPiece::End& end) {
    return std::max(end.half_width, end.beyond) +
           std::sqrt(end.way_x * end.way_x + end.way_y * end.way_y) + pixel_size_;
  };
  const double reach_a = reachOf(a), reach_b = reachOf(b);
  if (!(reach_a < 1.0 && reach_b < 1.0 && std::isfinite(a.x + a.y + b.x + b.y))) return sum;
  const auto pixelOf = [this](double place, int size) {
    return static_cast<int>(
        std::floor(std::clamp(place / pixel_size_, -1.0, static_cast<double>(size))));
  };
  const int left = std::max(0, pixelOf(std::min(a.x - reach_a, b.x - reach_b), width_px_));
  const int right = std::min(width_px_ - 1, pixelOf(std::max(a.x + reach_a, b.x + reach_b), width_px_));
  const int low = std::max(0, pixelOf(std::min(a.y - reach_a, b.y - reach_b), height_px_));
  const int high = std::min(height_px_ - 1, pixelOf(std::max(a.y + reach_a, b.y + reach_b), height_px_));
  for (int tile_row = low / kTile; tile_row * kTile <= high; ++tile_row)
    for (int tile_column = left / kTile; tile_column * kTile <= right; ++tile_column) {
      const int column = tile_column * kTile, row = tile_row * kTile;
      exchangeInTile(piece, make(tile_column, tile_row), std::max(left - column, 0),
                     std::min(right - column, kTile - 1), std::max(low - row, 0),
                     std::min(high - row, kTile - 1), sum);
    }
  if (sum.volume != 0.0 || sum.pigment != 0.0) ++revision_;
  sum.volume *= pixel_size_ * pixel_size_;
  sum.pigment *= pixel_size_ * pixel_size_;
  return sum;
}

void Paper::exchangeInTile(const TouchingPiece& piece, Tile& tile, int first_column, int last_column,
                           int first_row, int last_row, InkExchange& sum) {
  // In pixels of the tile, pixel (0, 0) having its middle at 0.
  const double scale = 1.0 / pixel_size_;
  const auto toPixels = [&](double place, int tile_index) {
    return place * scale - tile_index * kTile - 0.5;
  };
  const double ax = toPixels(piece.a.x, tile.column), ay = toPixels(piece.a.y, tile.row);
  const double ex = piece.along_x, ey = piece.along_y;
  const double length =
      ((piece.b.x - piece.a.x) * piece.along_x + (piece.b.y - piece.a.y) * piece.along_y) * scale;
  // Half of what each end swept sideways, and along at the ends of what touches.
  const double side_a = std::abs(piece.a.way_y * ex - piece.a.way_x * ey) * scale;
  const double side_b = std::abs(piece.b.way_y * ex - piece.b.way_x * ey) * scale;
  const double from = -piece.a.beyond * scale, to = length + piece.b.beyond * scale;
  const double half_a = piece.a.half_width * scale, half_b = piece.b.half_width * scale;

  // A place that a chord of half width w sweeps by ±s is touched for w / (w + s) of the time.
  const double half = 0.5 * (half_a + half_b), side = 0.5 * (side_a + side_b);
  const double touched = half / (half + side + 1e-12);
  const auto exposed = static_cast<std::uint32_t>(1.0 + 254.0 * touched);
  const std::uint32_t contact = contact_ & 0xFFFFFFU;
  const double soaked = 1.0 - std::exp(-piece.duration * touched / parameters_.soak_time);
  const double balance = capacity() * std::min(1.0, piece.filling) + piece.film;
  // However much the sheet wants, no more goes than there is.
  const double area = 2.0 * (half + side + 1.0) * (to - from + 1.0) * pixel_size_ * pixel_size_;
  const auto most = [](double has, double wanted) {
    return wanted > 0.0 ? std::min(1.0, 0.5 * has / wanted) : 1.0;
  };
  const double give = most(piece.volume, area * balance);
  const double take = soaked * most(piece.room, area * 2.0 * capacity());

  const auto spread = static_cast<float>(std::max(relief_.spreadInPixel() * std::sqrt(3.0), 1e-7));
  const float steepness = 0.5F / spread;
  const float gap = static_cast<float>(piece.gap);
  // Hairs seen through a sweep sideways are blurred.
  const auto comb = static_cast<float>(touched);
  const auto fex = static_cast<float>(ex), fey = static_cast<float>(ey);
  const auto f_from = static_cast<float>(from), f_to = static_cast<float>(to);
  const auto inverse_length = static_cast<float>(1.0 / std::max(length, 1e-6));
  const auto f_half_a = static_cast<float>(half_a), f_half_ab = static_cast<float>(half_b - half_a);
  const auto f_side_a = static_cast<float>(side_a), f_side_ab = static_cast<float>(side_b - side_a);
  const float widest = static_cast<float>(std::max(half_a + side_a, half_b + side_b)) + 0.5F;
  constexpr float kLastHair = TouchingPiece::kUnderside - 1.001F;

  double volume = 0.0, pigment = 0.0;
  for (int row = first_row; row <= last_row; ++row) {
    const auto dy = static_cast<float>(row - ay);
    // Columns of this row within the strip |across| ≤ widest, from − ½ ≤ along ≤ to + ½.
    float low = static_cast<float>(first_column), high = static_cast<float>(last_column);
    const auto fax = static_cast<float>(ax);
    if (std::abs(fey) > 1e-3F) {  // across = dy ex − dx ey
      const float p = (dy * fex - widest) / fey, q = (dy * fex + widest) / fey;
      low = std::max(low, fax + std::min(p, q));
      high = std::min(high, fax + std::max(p, q));
    }
    if (std::abs(fex) > 1e-3F) {  // along = dx ex + dy ey
      const float p = (f_from - 0.5F - dy * fey) / fex, q = (f_to + 0.5F - dy * fey) / fex;
      low = std::max(low, fax + std::min(p, q));
      high = std::min(high, fax + std::max(p, q));
    }
    if (!(low <= high)) continue;
    const int end = static_cast<int>(std::floor(high));
    for (int column = static_cast<int>(std::ceil(low)); column <= end; ++column) {
      const auto at = static_cast<std::size_t>(row * kTile + column);
      const std::uint32_t exposure = tile.exposure[at];
      const std::uint32_t before = exposure >> 8 == contact ? exposure & 255U : 0U;
      if (before + exposed / 2U >= 255U) continue;
      const auto dx = static_cast<float>(column) - fax;
      const float along = dx * fex + dy * fey;
      const float across = dy * fex - dx * fey;
      const float t = clamp01(along * inverse_length);
      const float chord = f_half_a + t * f_half_ab, way = f_side_a + t * f_side_ab;
      const float breadth = chord + way, distance = std::abs(across);
      const float covered = (std::min(distance + 0.5F, breadth) - std::max(distance - 0.5F, -breadth)) *
                            clamp01(0.5F + std::min(along - f_from, f_to - along));
      if (!(covered > 0.0F)) continue;
      // Which hair: across the chord, seen from its own middle.
      const float inner = std::max(0.0F, distance - way) / std::max(chord, 1e-3F);
      const float place = 0.5F * kLastHair * (1.0F + std::copysign(std::min(1.0F, inner), across));
      const int hair = static_cast<int>(place);
      const float s = place - static_cast<float>(hair);
      const float hairs =
          piece.underside[hair] + s * (piece.underside[hair + 1] - piece.underside[hair]);
      const float reached = clamp01(0.5F + (tile.height[at] - gap - comb * hairs) * steepness);
      const float touching = reached * std::min(1.0F, covered);
      if (!(touching > 0.0F)) continue;
      if (reached > 0.5F) tile.exposure[at] = contact << 8 | std::min(255U, before + exposed);
      const auto alpha = static_cast<double>(touching);
      const double water = tile.water[at];
      const double wetted = std::max(water, alpha * piece.film);
      const double wanted = alpha * balance;
      if (wanted > wetted) {
        const double gain = give * (wetted - water + (wanted - wetted) * soaked);
        tile.water[at] = water + gain;
        tile.pigment[at] += gain * piece.concentration;
        volume += gain;
        pigment += gain * piece.concentration;
      } else if (water > balance) {
        const double part = take * alpha * (1.0 - balance / water);
        volume -= water * part;
        pigment -= tile.pigment[at] * part;
        tile.water[at] -= water * part;
        tile.pigment[at] -= tile.pigment[at] * part;
      }
    }
  }
  if (volume == 0.0 && pigment == 0.0) return;
  sum.volume += volume;
  sum.pigment += pigment;
  setWet(tile, true);
  tile.moving = true;
}

double Paper::addDisc(double x, double y, double radius, double thickness) {
  if (!(thickness > 0.0 && radius >= 0.0 && radius < 1.0 && std::isfinite(x + y + thickness)))
    return 0.0;
  const double cx = x / pixel_size_ - 0.5, cy = y / pixel_size_ - 0.5, r = radius / pixel_size_;
  const auto clampTo = [](double value, int size) {
    return static_cast<int>(std::clamp(value, -1.0, static_cast<double>(size)));
  };
  double added = 0.0;
  const int last_row = std::min(height_px_ - 1, clampTo(std::floor(cy + r + 0.5), height_px_));
  const int last_column = std::min(width_px_ - 1, clampTo(std::floor(cx + r + 0.5), width_px_));
  for (int row = std::max(0, clampTo(std::ceil(cy - r - 0.5), height_px_)); row <= last_row; ++row)
    for (int column = std::max(0, clampTo(std::ceil(cx - r - 0.5), width_px_)); column <= last_column;
         ++column) {
      const double covered = std::clamp(0.5 + r - std::hypot(column - cx, row - cy), 0.0, 1.0);
      if (!(covered > 0.0)) continue;
      Tile& tile = make(column / kTile, row / kTile);
      const auto at = static_cast<std::size_t>(row % kTile * kTile + column % kTile);
      tile.water[at] += thickness * covered;
      tile.pigment[at] += thickness * covered;
      added += thickness * covered;
      setWet(tile, true);
      tile.moving = true;
    }
  if (added > 0.0) ++revision_;
  return added * pixel_size_ * pixel_size_;
}

void Paper::setInk(int column, int row, double water, double pigment) {
  if (!(column >= 0 && row >= 0 && column < width_px_ && row < height_px_ && water >= 0.0 &&
        water < 1.0 && pigment >= 0.0 && pigment < 1.0))
    throw std::invalid_argument("ink at pixel " + std::to_string(column) + ", " + std::to_string(row) +
                                ": not on the sheet or not from 0 to 1 m");
  Tile& tile = make(column / kTile, row / kTile);
  const auto at = static_cast<std::size_t>(row % kTile * kTile + column % kTile);
  tile.water[at] = water;
  tile.pigment[at] = pigment;
  setWet(tile, tile.wet || water > 0.0);
  tile.moving = true;
  ++revision_;
}

// ---------------------------------------------------------------- flow

/// Lists the tiles that take part in a flow of `seconds` and returns how many equal steps it needs.
int Paper::findMoving(double seconds) {
  moving_.clear();
  const bool look = tick_ % kLookInterval == 0;
  const auto add = [this](Tile& tile) {
    if (tile.listed == tick_) return;
    tile.listed = tick_;
    moving_.push_back(&tile);
  };
  for (const auto& tile : tiles_)
    if (tile->wet && (tile->moving || look)) add(*tile);

  // No pixel gets fuller by flow than the fullest is, so its diffusivity decides.
  double most = 0.0, permeability = 0.0;
  const auto fullest = [&](const Tile& tile) {
    std::array<double, kTile> columns{};  // one by one, so that it is compiled to registers
    for (std::size_t row = 0; row < kTile; ++row)
      for (std::size_t i = 0; i < kTile; ++i) {
        const double water = tile.water[row * kTile + i];
        columns[i] = water > columns[i] ? water : columns[i];
      }
    most = std::max(most, *std::max_element(columns.begin(), columns.end()));
    permeability = std::max(permeability, tile.permeability);
  };
  for (const Tile* tile : moving_) {
    fullest(*tile);
    for (const Tile* other : {find(tile->column - 1, tile->row), find(tile->column + 1, tile->row),
                              find(tile->column, tile->row - 1), find(tile->column, tile->row + 1)})
      if (other && other->wet && other->listed != tick_) fullest(*other);
  }
  const double largest =
      full_diffusivity_ * permeability *
      (parameters_.film_flow +
       std::pow(std::min(1.0, most / capacity()), static_cast<double>(parameters_.flow_exponent)));
  constexpr double kStable = 0.24;  // of Δx²/D; a quarter is the limit in two dimensions
  const double longest = kStable * pixel_size_ * pixel_size_ / std::max(largest, 1e-30);
  const int steps = std::max(1, static_cast<int>(std::ceil(seconds / longest)));
  flow_interval_ = std::min(longest, kLongestFlow);

  // Liquid gets on by one pixel a step, so tiles that it may reach take part.
  const int ring = std::min(kTile, steps + 1);
  for (std::size_t k = 0, count = moving_.size(); k < count; ++k) {
    const Tile& tile = *moving_[k];
    for (int side = 0; side < 4; ++side) {
      const int column = tile.column + (side == kRight) - (side == kLeft);
      const int row = tile.row + (side == kAbove) - (side == kBelow);
      if (column < 0 || row < 0 || column >= tile_columns_ || row >= tile_rows_) continue;
      Tile* other = find(column, row);
      if (other && (other->wet || other->listed == tick_)) {
        add(*other);
        continue;
      }
      bool reached = false;
      for (int i = 0; i < kTile && !reached; ++i)
        for (int j = 0; j < ring && !reached; ++j) {
          const int x = side == kLeft ? j : side == kRight ? kTile - 1 - j : i;
          const int y = side == kBelow ? j : side == kAbove ? kTile - 1 - j : i;
          reached = tile.water[static_cast<std::size_t>(y * kTile + x)] > 0.0;
        }
      if (reached) add(make(column, row));
    }
  }
  return steps;
}

void Paper::flow(double seconds) {
  if (!(seconds > 0.0)) return;
  since_drying_ += seconds;
  since_flow_ += seconds;
  // What the next call can do as well is left to it.
  if (full_diffusivity_ > 0.0 && wet_tiles_ > 0 && since_flow_ + seconds > flow_interval_) {
    ++tick_;
    const double interval = since_flow_;
    const int steps = findMoving(interval);
    const FlowCoefficients coefficients{
        interval / steps * full_diffusivity_ * capacity() /
            (pixel_size_ * pixel_size_ * (parameters_.flow_exponent + 1)),
        1.0 / capacity(), parameters_.pigment_mobility, parameters_.flow_exponent,
        parameters_.film_flow};
    const double still = kStillRate * capacity() * interval / steps;
    for (int step = 0; step < steps; ++step) {
      for (Tile* tile : moving_)
        saveEdges(coefficients, tile->water.data(), tile->pigment.data(), tile->edges);
      for (Tile* tile : moving_) {
        std::array<const FlowEdges*, 4> around{};
        const std::array<const Tile*, 4> tiles{
            find(tile->column - 1, tile->row), find(tile->column + 1, tile->row),
            find(tile->column, tile->row - 1), find(tile->column, tile->row + 1)};
        bool reached = tile->wet;
        for (std::size_t side = 0; side < 4; ++side)
          if (tiles[side] && tiles[side]->listed == tick_) {
            around[side] = &tiles[side]->edges;
            reached = reached || around[side]->any;
          }
        if (!reached) continue;
        const double change = flowStep(coefficients, tile->faces, tile->edges, around,
                                       tile->water.data(), tile->pigment.data());
        tile->moving = change > still;
        setWet(*tile, tile->wet || change > 0.0);
      }
    }
    if (!moving_.empty()) ++revision_;
    since_flow_ = 0.0;
  }
  if (wet_tiles_ == 0) since_flow_ = 0.0;
  if (since_drying_ >= kDryingInterval) {
    dry(since_drying_);
    since_drying_ = 0.0;
  }
}

void Paper::dry(double seconds) {
  const double loss = parameters_.evaporation * seconds;
  const double rim = parameters_.evaporation_rim / pixel_size_;
  const double settled = -std::expm1(-parameters_.settling_rate * seconds);
  constexpr int kPadded = kTile + 2;
  std::array<unsigned char, kPadded * kPadded> wet;  // with what is around the tile
  // All tiles are looked at before one changes, so the order of them does not matter.
  for (const auto& tile : tiles_)
    if (tile->wet)
      for (std::size_t i = 0; i < Tile::kSize; ++i) tile->was_wet[i] = tile->water[i] > 0.0;
  for (const auto& tile : tiles_) {
    if (!tile->wet) continue;
    wet.fill(0);
    const auto copy = [&](const Tile* from, int column, int row, int columns, int rows, int to_column,
                          int to_row) {
      if (!from || !from->wet) return;
      for (int j = 0; j < rows; ++j)
        for (int i = 0; i < columns; ++i)
          wet[static_cast<std::size_t>((to_row + j) * kPadded + to_column + i)] =
              from->was_wet[static_cast<std::size_t>((row + j) * kTile + column + i)];
    };
    copy(tile.get(), 0, 0, kTile, kTile, 1, 1);
    copy(find(tile->column - 1, tile->row), kTile - 1, 0, 1, kTile, 0, 1);
    copy(find(tile->column + 1, tile->row), 0, 0, 1, kTile, kPadded - 1, 1);
    copy(find(tile->column, tile->row - 1), 0, kTile - 1, kTile, 1, 1, 0);
    copy(find(tile->column, tile->row + 1), 0, 0, kTile, 1, 1, kPadded - 1);
    double evaporated = 0.0;
    bool some = false;
    for (int row = 0; row < kTile; ++row)
      for (int column = 0; column < kTile; ++column) {
        const auto at = static_cast<std::size_t>(row * kTile + column);
        double& water = tile->water[at];
        if (!(water > 0.0)) continue;
        const unsigned char* here = &wet[static_cast<std::size_t>((row + 1) * kPadded + column + 1)];
        const int dry_faces = 4 - here[-1] - here[1] - here[-kPadded] - here[kPadded];
        double gone = loss * (1.0 + rim * dry_faces);
        if (loss > 0.0 && water - gone < kDryThickness) gone = water;
        evaporated += gone;
        water -= gone;
        const double moved = settled * tile->pigment[at];
        tile->pigment[at] -= moved;
        tile->settled[at] += moved;
        some = some || water > 0.0;
      }
    evaporated_ += evaporated;
    tile->drying = !some;
  }
  for (const auto& tile : tiles_)
    if (tile->drying) {
      setWet(*tile, false);
      tile->moving = tile->drying = false;
    }
}

// ---------------------------------------------------------------- picture

namespace {

/// Reflectance of ink on the sheet by Kubelka and Munk, thick enough for the backing not to show.
class InkOptics {
 public:
  InkOptics(const PaperParameters& p, double bare, double wavelength)
      : bare_(static_cast<float>(bare)),
        base_(static_cast<float>(1.0 + (1.0 - bare) * (1.0 - bare) / (2.0 * bare))),
        absorption_(static_cast<float>(std::pow(550e-9 / wavelength, p.absorption_exponent) /
                                       (p.dark_thickness * p.scattering))) {}
  /// Of `ink` [m] of undiluted ink.
  float reflectance(float ink) const {
    const float a = base_ + absorption_ * ink;
    return 1.0F / (a + std::sqrt(a * a - 1.0F));
  }
  /// Over that of the bare sheet.
  float relative(float ink) const { return std::min(1.0F, reflectance(ink) / bare_); }

 private:
  float bare_, base_, absorption_;
};

std::array<InkOptics, 3> colours(const PaperParameters& p) {
  return {InkOptics(p, p.red, 610e-9), InkOptics(p, p.green, 550e-9), InkOptics(p, p.blue, 465e-9)};
}
InkOptics grey(const PaperParameters& p) {
  return {p, p.green, 550e-9};
}

/// Linear light to the value that a screen wants, 0..1.
float encodeSrgb(float linear) {
  return linear <= 0.0031308F ? 12.92F * linear : 1.055F * std::pow(linear, 1.0F / 2.4F) - 0.055F;
}

template <class Value>
Value toValue(float part) {
  constexpr auto kMost = static_cast<float>(std::numeric_limits<Value>::max());
  return static_cast<Value>(std::lround(kMost * clamp01(part)));
}

}  // namespace

/// Calls function(index of the pixel in a picture, ink) where there may be ink.
template <class Function>
void Paper::forEachPixel(Function&& function) const {
  for (const auto& tile : tiles_)
    for (int row = 0; row < tile->rows; ++row) {
      const std::size_t first = static_cast<std::size_t>(height_px_ - 1 - tile->row * kTile - row) *
                                    static_cast<std::size_t>(width_px_) +
                                static_cast<std::size_t>(tile->column * kTile);
      for (int column = 0; column < tile->columns; ++column) {
        const auto at = static_cast<std::size_t>(row * kTile + column);
        const double ink = tile->pigment[at] + tile->settled[at];
        if (ink > 0.0) function(first + static_cast<std::size_t>(column), static_cast<float>(ink));
      }
    }
}

void Paper::render(std::vector<std::uint8_t>& mono8) const {
  mono8.assign(pixelCount(), 255);
  const InkOptics optics = grey(parameters_);
  forEachPixel(
      [&](std::size_t pixel, float ink) { mono8[pixel] = toValue<std::uint8_t>(optics.relative(ink)); });
}

void Paper::render(std::vector<std::uint16_t>& mono16) const {
  mono16.assign(pixelCount(), 65535);
  const InkOptics optics = grey(parameters_);
  forEachPixel([&](std::size_t pixel, float ink) {
    mono16[pixel] = toValue<std::uint16_t>(optics.relative(ink));
  });
}

void Paper::renderColour(std::vector<std::uint8_t>& rgb8) const {
  rgb8.resize(3 * pixelCount());
  const auto optics = colours(parameters_);
  std::uint8_t bare[3];
  for (std::size_t i = 0; i < 3; ++i)
    bare[i] = toValue<std::uint8_t>(encodeSrgb(optics[i].reflectance(0.0F)));
  for (std::size_t pixel = 0; pixel < pixelCount(); ++pixel) std::copy(bare, bare + 3, &rgb8[3 * pixel]);
  forEachPixel([&](std::size_t pixel, float ink) {
    for (std::size_t i = 0; i < 3; ++i)
      rgb8[3 * pixel + i] = toValue<std::uint8_t>(encodeSrgb(optics[i].reflectance(ink)));
  });
}

void Paper::renderTransparent(std::vector<std::uint8_t>& rgba8) const {
  rgba8.assign(4 * pixelCount(), 0);
  const auto optics = colours(parameters_);
  forEachPixel([&](std::size_t pixel, float ink) {
    float seen[3];
    for (std::size_t i = 0; i < 3; ++i) seen[i] = encodeSrgb(optics[i].relative(ink));
    // As opaque as the darkest channel asks for, the others shining through by their own colour.
    const float clear = std::min({seen[0], seen[1], seen[2]});
    const float opacity = 1.0F - clear;
    for (std::size_t i = 0; i < 3; ++i)
      rgba8[4 * pixel + i] =
          opacity > 0.0F ? toValue<std::uint8_t>((seen[i] - clear) / opacity) : std::uint8_t{0};
    rgba8[4 * pixel + 3] = toValue<std::uint8_t>(opacity);
  });
}

void Paper::renderAdded(const Paper& before, std::vector<std::uint8_t>& mono8) const {
  if (before.width_px_ != width_px_ || before.height_px_ != height_px_)
    throw std::invalid_argument("sheets of different sizes cannot be compared");
  std::vector<float> old(pixelCount(), 0.0F);
  before.forEachPixel([&](std::size_t pixel, float ink) { old[pixel] = ink; });
  mono8.assign(pixelCount(), 255);
  const InkOptics optics = grey(parameters_);
  forEachPixel([&](std::size_t pixel, float ink) {
    mono8[pixel] = toValue<std::uint8_t>(optics.relative(std::max(0.0F, ink - old[pixel])));
  });
}

}  // namespace calligraphy_brush
