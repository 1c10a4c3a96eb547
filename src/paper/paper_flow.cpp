#include <algorithm>
#include <cmath>

#include "calligraphy_brush/paper/paper.h"
#include "paper_tile.h"

namespace calligraphy_brush {
namespace {

// A tile in which no pixel's filling changes faster than this is still [1/s]; it is looked at again
// every so many calls of flow().
constexpr double kStillRate = 1e-3;
constexpr std::uint64_t kLookInterval = 64;
// Of Δx²/D; a quarter is the limit in two dimensions.
constexpr double kStable = 0.24;
// Drying is slow: tiles are dried no more often than this, and so often that the fullest pixel does not
// lose more than a part of its liquid at once [s].
constexpr double kShortestDrying = 0.25;
constexpr double kLongestDrying = 1.0;
constexpr double kDriedPart = 0.02;
// Steps are no longer than this, so that drying and flow take turns [s].
constexpr double kLongestStep = kShortestDrying;

double fullestOf(const std::array<double, kFlowSize>& water) {
  std::array<double, kFlowSide> columns{};  // one by one, so that it is compiled to registers
  for (std::size_t row = 0; row < kFlowSide; ++row)
    for (std::size_t i = 0; i < kFlowSide; ++i)
      columns[i] = std::max(columns[i], water[row * kFlowSide + i]);
  return *std::max_element(columns.begin(), columns.end());
}

constexpr FlowSide opposite(FlowSide side) {
  return side == kLeft ? kRight : side == kRight ? kLeft : side == kBelow ? kAbove : kBelow;
}

}  // namespace

FlowLaw Paper::flowLaw() const {
  return {full_diffusivity_ * capacity() / (pixel_size_ * pixel_size_ * (parameters_.flow_exponent + 1)),
          1.0 / capacity(), parameters_.pigment_mobility, parameters_.flow_exponent,
          parameters_.film_flow};
}

/// Longest stable step where no pixel has more liquid than `fullest` [m]. Flow alone never makes the
/// fullest pixel fuller.
double Paper::stableStep(double fullest) const {
  const double filling = std::min(1.0, fullest / capacity());
  const double largest = full_diffusivity_ * relief_.mostPermeability() *
                         (parameters_.film_flow + std::pow(filling, parameters_.flow_exponent));
  return std::min(kLongestStep, kStable * pixel_size_ * pixel_size_ / std::max(largest, 1e-30));
}

/// Of a tile and the four around it.
double Paper::stepAround(std::size_t place) const {
  const auto columns = static_cast<std::size_t>(tile_columns_);
  const std::size_t column = place % columns;
  double step = paces_[place].step;
  if (column > 0) step = std::min(step, paces_[place - 1].step);
  if (column + 1 < columns) step = std::min(step, paces_[place + 1].step);
  if (place >= columns) step = std::min(step, paces_[place - columns].step);
  if (place + columns < paces_.size()) step = std::min(step, paces_[place + columns].step);
  return step;
}

void Paper::flow(double seconds) {
  if (!(seconds > 0.0) || wet_tiles_ == 0) return;
  if (full_diffusivity_ > 0.0) {
    ++tick_;
    double shortest = kLongestStep;
    for (const std::size_t place : tile_places_) {
      Pace& pace = paces_[place];
      if (pace.step == 0.0) pace.step = stableStep(fullestOf(tileAt(place).water));
      shortest = std::min(shortest, pace.step);
    }
    const double begin = clock_;
    const auto rounds = static_cast<long>(std::max(1.0, std::ceil(seconds / shortest)));
    for (long round = 1; round <= rounds; ++round) {
      clock_ = begin + seconds * (static_cast<double>(round) / static_cast<double>(rounds));
      findDue(seconds / static_cast<double>(rounds), round == 1);
      moveOn();
    }
  } else {
    clock_ += seconds;
  }
  if (clock_ - looked_for_drying_ >= kShortestDrying) {
    looked_for_drying_ = clock_;
    dry();
  }
}

/// Lists the tiles that are to flow now: those which cannot wait for the next round.
void Paper::findDue(double round, bool may_look) {
  due_.clear();
  for (const std::size_t place : tile_places_) {
    Pace& pace = paces_[place];
    const bool looks = may_look && (tick_ + place) % kLookInterval == 0;
    if (!pace.wet || !(pace.moving || looks)) continue;
    const double step = stepAround(place);
    // What it has missed while it was still is left out.
    if (!pace.moving) pace.done = std::max(pace.done, clock_ - step);
    if (pace.moving && clock_ - pace.done + round <= step) continue;
    due_.push_back(&tileAt(place));
  }
}

/// Lets the tiles of due_ flow up to the clock.
void Paper::moveOn() {
  if (due_.empty()) return;
  const FlowLaw law = flowLaw();
  const double still = kStillRate * capacity();
  ++pass_;
  for (Tile* tile : due_) {
    tile->pass = pass_;
    tile->seconds = clock_ - paces_[placeOf(*tile)].done;
  }
  // First all that goes from tile to tile, before one changes. Both sides of a face get the same, once:
  // a tile that flows more seldom than its neighbour is told each time that one flows.
  received_.clear();
  for (std::size_t k = 0; k < due_.size(); ++k) {  // by index: new tiles make room in the list
    Tile* const tile = due_[k];
    for (const FlowSide side : {kLeft, kRight, kBelow, kAbove}) {
      const bool is_low = side == kRight || side == kAbove;  // the tile, of the two
      const int column = tile->column + (side == kRight) - (side == kLeft);
      const int row = tile->row + (side == kAbove) - (side == kBelow);
      if (column < 0 || row < 0 || column >= tile_columns_ || row >= tile_rows_) continue;
      Tile* other = find(column, row);
      const bool other_flows = other && other->pass == pass_;
      if (other_flows && is_low) continue;  // its turn
      if (!(other && paces_[placeOf(*other)].wet)) {
        if (!isWetAlong(law, side, tile->water.data())) continue;
        other = &make(column, row);
      }
      Tile& high = is_low ? *other : *tile;
      const Tile& low = is_low ? *tile : *other;
      Tile::Side& face = side == kLeft || side == kRight ? high.left : high.below;
      double seconds = std::min(clock_ - face.done, tile->seconds);
      if (other_flows) seconds = std::min(seconds, other->seconds);
      if (!(seconds > 0.0)) continue;
      face.done = clock_;
      face.pass = pass_;
      flowAcross(law, seconds, is_low ? opposite(side) : side, high.faces,
                 {low.water.data(), low.pigment.data()}, {high.water.data(), high.pigment.data()},
                 face.flow);
      if (!other_flows) received_.push_back({other, opposite(side), &face.flow, seconds});
    }
  }
  for (Tile* tile : due_) {
    const auto across = [&](const Tile* high, Tile::Side Tile::*side) {
      return high && (high->*side).pass == pass_ ? &(high->*side).flow : nullptr;
    };
    const FlowChange change =
        flowInside(law, tile->seconds, tile->faces,
                   {across(tile, &Tile::left), across(find(tile->column + 1, tile->row), &Tile::left),
                    across(tile, &Tile::below), across(find(tile->column, tile->row + 1), &Tile::below)},
                   tile->water.data(), tile->pigment.data());
    Pace& pace = paces_[placeOf(*tile)];
    pace.done = clock_;
    pace.moving = change.largest > still * tile->seconds;
    pace.step = stableStep(change.fullest);
  }
  for (const Received& got : received_) {
    const FlowChange change =
        receive(got.side, *got.flow, got.tile->water.data(), got.tile->pigment.data());
    Pace& pace = paces_[placeOf(*got.tile)];
    if (!(change.largest > 0.0)) continue;
    pace.step = std::min(pace.step, stableStep(change.fullest));
    if (!pace.wet || (!pace.moving && change.largest > still * got.seconds)) setMoving(*got.tile);
  }
  flow_count_ += due_.size();
  ++revision_;
}

void Paper::dry() {
  const double loss = parameters_.evaporation;
  const double rim = parameters_.evaporation_rim / pixel_size_;
  if (loss == 0.0 && parameters_.settling_rate == 0.0) return;
  due_.clear();
  for (const std::size_t place : tile_places_) {
    const Pace& pace = paces_[place];
    const double seconds = clock_ - pace.dried;
    if (pace.wet && seconds > 0.0 && seconds >= pace.drying) due_.push_back(&tileAt(place));
  }
  // All tiles are looked at before one changes, so the order of them does not matter.
  for (Tile* tile : due_) {
    const auto waterOf = [&](int column, int row) -> const double* {
      const Tile* other = find(tile->column + column, tile->row + row);
      return other ? other->water.data() : nullptr;
    };
    findWetAround(tile->water.data(), {waterOf(-1, 0), waterOf(1, 0), waterOf(0, -1), waterOf(0, 1)},
                  tile->wet_around);
  }
  for (Tile* tile : due_) {
    Pace& pace = paces_[placeOf(*tile)];
    const double seconds = clock_ - pace.dried;
    const Drying drying{loss * seconds, rim, -std::expm1(-parameters_.settling_rate * seconds)};
    const Dried dried = dryInside(drying, tile->wet_around, tile->water.data(), tile->pigment.data(),
                                  tile->settled.data());
    evaporated_ += dried.evaporated;
    pace.dried = clock_;
    pace.drying = std::clamp(kDriedPart * dried.fullest / std::max(dried.largest / seconds, 1e-30),
                             kShortestDrying, kLongestDrying);
    if (dried.fullest > 0.0) continue;
    pace.wet = pace.moving = false;
    pace.step = kLongestStep;
    --wet_tiles_;
  }
  if (!due_.empty()) ++revision_;
}

}  // namespace calligraphy_brush
