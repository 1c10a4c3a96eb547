#include "calligraphy_brush/paper/paper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "calligraphy_brush/paper/unsaturated_flow.h"
#include "paper_tile.h"

namespace calligraphy_brush {
namespace {

std::uint64_t hashOf(const void* data, std::size_t size, std::uint64_t seed) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) seed = (seed ^ bytes[i]) * 1099511628211ULL;
  return seed;
}

float clamp01(float value) {
  return std::min(1.0F, std::max(0.0F, value));
}

}  // namespace

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
  paces_.resize(places_.size());
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
      paces_(other.paces_),
      tile_places_(other.tile_places_),
      wet_tiles_(other.wet_tiles_),
      clock_(other.clock_),
      looked_for_drying_(other.looked_for_drying_),
      evaporated_(other.evaporated_),
      tick_(other.tick_),
      pass_(other.pass_),
      flow_count_(other.flow_count_),
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
  tile_places_.push_back(place);
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
  tiles_.push_back(std::move(tile));
  due_.reserve(tiles_.capacity());
  received_.reserve(4 * tiles_.capacity());
  wishes_.reserve(4 * Tile::kSize);  // more than a piece of a bundle covers
  return *tiles_.back();
}

std::size_t Paper::placeOf(const Tile& tile) const {
  return static_cast<std::size_t>(tile.row) * static_cast<std::size_t>(tile_columns_) +
         static_cast<std::size_t>(tile.column);
}

/// Liquid moves in the tile from now on.
void Paper::setMoving(Tile& tile) {
  Pace& pace = paces_[placeOf(tile)];
  if (!pace.wet) {
    ++wet_tiles_;
    pace = Pace{};
    pace.wet = true;
    pace.dried = clock_;
    pace.step = 0.0;
  }
  if (!pace.moving) pace.done = clock_;
  pace.moving = true;
}

/// Before a tile gets ink: what it had flows up to now, at its own step.
void Paper::catchUp(Tile& tile) {
  const Pace& pace = paces_[placeOf(tile)];
  if (!(pace.wet && pace.moving && pace.done < clock_)) return;
  due_.assign(1, &tile);
  moveOn();
}

/// After it got ink.
void Paper::setInked(Tile& tile) {
  setMoving(tile);
  paces_[placeOf(tile)].step = 0.0;
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
  return static_cast<int>(std::count_if(paces_.begin(), paces_.end(),
                                        [](const Pace& pace) { return pace.wet && pace.moving; }));
}

void Paper::clear() {
  cleared_.resize(places_.size());
  for (auto& tile : tiles_)
    cleared_[static_cast<std::size_t>(tile->row * tile_columns_ + tile->column)] = std::move(tile);
  std::fill(places_.begin(), places_.end(), -1);
  std::fill(paces_.begin(), paces_.end(), Pace{});
  tiles_.clear();
  tile_places_.clear();
  wet_tiles_ = 0;
  contact_ = 1;
  clock_ = looked_for_drying_ = evaporated_ = 0.0;
  tick_ = flow_count_ = 0;
  ++revision_;
}

std::uint64_t Paper::hash(std::uint64_t seed) const {
  const double state[3] = {clock_, looked_for_drying_, evaporated_};
  seed = hashOf(state, sizeof state, seed);
  seed = hashOf(&tick_, sizeof tick_, seed);
  for (const auto& tile : tiles_) {
    const Pace& pace = paces_[placeOf(*tile)];
    const std::int32_t place[4] = {tile->column, tile->row, pace.wet, pace.moving};
    seed = hashOf(place, sizeof place, seed);
    const double times[6] = {pace.done,   pace.dried,      pace.step,
                             pace.drying, tile->left.done, tile->below.done};
    seed = hashOf(times, sizeof times, seed);
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
    return end.half_width + std::sqrt(end.way_x * end.way_x + end.way_y * end.way_y) + pixel_size_;
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
  wishes_.clear();
  for (int tile_row = low / kTile; tile_row * kTile <= high; ++tile_row)
    for (int tile_column = left / kTile; tile_column * kTile <= right; ++tile_column) {
      const int column = tile_column * kTile, row = tile_row * kTile;
      Tile& tile = make(tile_column, tile_row);
      catchUp(tile);
      findWishes(piece, tile, std::max(left - column, 0), std::min(right - column, kTile - 1),
                 std::max(low - row, 0), std::min(high - row, kTile - 1));
    }
  // However much the sheet wants, no more goes than there is.
  double wanted = 0.0, offered = 0.0;
  for (const Wish& wish : wishes_) (wish.liquid > 0.0 ? wanted : offered) += wish.liquid;
  const double area = pixel_size_ * pixel_size_;
  const auto most = [area](double has, double liquid) {
    return liquid != 0.0 ? std::min(1.0, 0.5 * has / (area * std::abs(liquid))) : 1.0;
  };
  const double give = most(piece.volume, wanted), take = most(piece.room, offered);
  const Tile* inked = nullptr;
  for (const Wish& wish : wishes_) {
    double &water = wish.tile->water[wish.pixel], &pigment = wish.tile->pigment[wish.pixel];
    const double liquid = (wish.liquid > 0.0 ? give : take) * wish.liquid;
    const double carried = liquid > 0.0 ? liquid * piece.concentration : pigment * (liquid / water);
    water += liquid;
    pigment += carried;
    sum.volume += liquid;
    sum.pigment += carried;
    if (wish.tile != inked) setInked(*wish.tile);
    inked = wish.tile;
  }
  if (!wishes_.empty()) ++revision_;
  sum.volume *= area;
  sum.pigment *= area;
  return sum;
}

/// Adds what the pixels of a tile want of a piece to wishes_, and marks where it touched.
void Paper::findWishes(const TouchingPiece& piece, Tile& tile, int first_column, int last_column,
                       int first_row, int last_row) {
  // In pixels of the tile, pixel (0, 0) having its middle at 0.
  const double scale = 1.0 / pixel_size_;
  const auto toPixels = [&](double place, int tile_index) {
    return place * scale - tile_index * kTile - 0.5;
  };
  const double ax = toPixels(piece.a.x, tile.column), ay = toPixels(piece.a.y, tile.row);
  const double ex = piece.along_x, ey = piece.along_y;
  const double length =
      ((piece.b.x - piece.a.x) * piece.along_x + (piece.b.y - piece.a.y) * piece.along_y) * scale;
  // Half of what each end swept sideways, and along.
  const auto sidewaysOf = [&](const TouchingPiece::End& end) {
    return (end.way_y * ex - end.way_x * ey) * scale;
  };
  const auto alongOf = [&](const TouchingPiece::End& end) {
    return (end.way_x * ex + end.way_y * ey) * scale;
  };
  const double swept_a = sidewaysOf(piece.a), swept_b = sidewaysOf(piece.b);
  const double along_a = alongOf(piece.a), along_b = alongOf(piece.b);
  const double side_a = std::abs(swept_a), side_b = std::abs(swept_b);
  // What it swept in succession leaves no seam.
  const auto endOf = [](double swept_along) {
    return std::abs(swept_along) + std::min(0.25, std::abs(swept_along));
  };
  const double from = -endOf(along_a), to = length + endOf(along_b);
  const double half_a = piece.a.half_width * scale, half_b = piece.b.half_width * scale;

  // A convex piece that sweeps in a straight line stays between the two lines along it that touch it,
  // too: places with left ≤ cross · across − slope · along ≤ right.
  const double sideways = 0.5 * (swept_a + swept_b), forwards = 0.5 * (along_a + along_b);
  const double swept = std::hypot(sideways, forwards);
  const double cross = swept > 0.0 ? forwards / swept : 0.0,
               slope = swept > 0.0 ? sideways / swept : 0.0;
  const double turned = 0.5 * std::abs(cross * (swept_b - swept_a) - slope * (along_b - along_a));
  const double end_a = std::abs(cross) * half_a, end_b = std::abs(cross) * half_b;
  const double at_b = -slope * length;  // of the end b, that of the end a being 0
  const double most_left = swept > 0.0 ? std::min(-end_a, at_b - end_b) - turned : -1e6;
  const double most_right = swept > 0.0 ? std::max(end_a, at_b + end_b) + turned : 1e6;

  // A place that a chord of half width w sweeps by ±s is touched for w / (w + s) of the time.
  const double half = 0.5 * (half_a + half_b), side = 0.5 * (side_a + side_b);
  const double touched = half / (half + side + 1e-12);
  const auto exposed = static_cast<float>(1.0 + 254.0 * touched);
  const std::uint32_t contact = contact_ & 0xFFFFFFU;
  const double soaked = 1.0 - std::exp(-piece.duration * touched / parameters_.soak_time);
  const double balance = capacity() * std::min(1.0, piece.filling) + piece.film;

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
  // A place is swept by the widest that passes it.
  const auto f_widening = static_cast<float>(std::copysign(forwards, half_b - half_a));
  const auto f_cross = static_cast<float>(cross), f_slope = static_cast<float>(slope);
  const auto f_left = static_cast<float>(most_left), f_right = static_cast<float>(most_right);
  const float widest = static_cast<float>(std::max(half_a + side_a, half_b + side_b)) + 0.5F;
  constexpr float kLastHair = TouchingPiece::kUnderside - 1.001F;

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
      const auto time_before = exposure >> 8 == contact ? static_cast<float>(exposure & 255U) : 0.0F;
      if (time_before + 0.5F * exposed >= 255.0F) continue;
      const auto dx = static_cast<float>(column) - fax;
      const float along = dx * fex + dy * fey;
      const float across = dy * fex - dx * fey;
      const float between = f_cross * across - f_slope * along;
      const float t = clamp01((along + f_widening) * inverse_length);
      const float chord = f_half_a + t * f_half_ab, way = f_side_a + t * f_side_ab;
      const float breadth = chord + way, distance = std::abs(across);
      const float covered =
          (std::min(distance + 0.5F, breadth) - std::max(distance - 0.5F, -breadth)) *
          clamp01(0.5F + std::min(along - f_from, f_to - along)) *
          clamp01(std::min(between + 0.5F, f_right) - std::max(between - 0.5F, f_left));
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
      if (reached > 0.5F)
        tile.exposure[at] =
            contact << 8 | static_cast<std::uint32_t>(std::min(255.0F, time_before + exposed));
      const auto alpha = static_cast<double>(touching);
      const double water = tile.water[at];
      const double wetted = std::max(water, alpha * piece.film);
      const double wanted = alpha * balance;
      if (wanted > wetted) {
        wishes_.push_back({&tile, at, wetted - water + (wanted - wetted) * soaked});
      } else if (water > balance) {
        wishes_.push_back({&tile, at, soaked * static_cast<double>(touching) * (balance - water)});
      }
    }
  }
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
      catchUp(tile);
      tile.water[at] += thickness * covered;
      tile.pigment[at] += thickness * covered;
      added += thickness * covered;
      setInked(tile);
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
  catchUp(tile);
  tile.water[at] = water;
  tile.pigment[at] = pigment;
  if (paces_[placeOf(tile)].wet || water > 0.0) setInked(tile);
  ++revision_;
}

}  // namespace calligraphy_brush
