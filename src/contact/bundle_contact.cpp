#include "calligraphy_brush/contact/bundle_contact.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
/// Of nodes at which the search looks there are about so many.
constexpr int kUsualLevels = 6;
/// The search sees at a level the ends of rods that end so little before it, in edges.
constexpr double kEndsBefore = 1.25;
/// Until the next search the nearest come from within so many times their distance.
constexpr float kCrowd = 1.25f;
/// Where a third rod is so far inside the ball between two, as |c|²/(c·d), liquid does not bridge them;
/// on its surface, where this is 1, it does not matter. In between the pair counts in part, so that what
/// moves a little changes little.
constexpr float kClosed = 0.7f;
/// Gap at which a third rod may stand between two, over the distance of their axes.
constexpr float kNextTo = 0.25f;
/// Time constant with which liquid comes between two rods, or goes [s]: rods that it moves change how
/// much there is to be, and go to and fro for ever where it follows them at once.
constexpr double kLiquidTime = 0.05;
constexpr float kFlows = 0.01f;  // of the liquid: less has come already
constexpr float kTrace = 1e-3f;  // less is none
/// Ink is known to this.
constexpr double kInkStep = 1.0 / 256.0;
/// Saturated neighbours whose hulls together are a rod's perimeter: π/(π/2 − 1).
constexpr double kMostNeighbours = 2.0 * kPi / (kPi - 2.0);

double cohesionAtAngle(double alpha, double& liquid) {
  const double radius = 1.0 / std::cos(alpha) - 1.0, rest = 0.5 * kPi - alpha;
  liquid = 2.0 * (std::tan(alpha) - alpha - radius * radius * rest);
  return 4.0 * alpha - 4.0 * radius * rest;
}

template <class Real>
std::size_t fieldSize(const BundleContact<Real>& contact, int rows) {
  return static_cast<std::size_t>(rows * contact.node_count * kLanes);
}

void takeNeighbour(BundleNeighbours& near, std::size_t rod, float x, float y, float z, float square) {
  const std::size_t first = rod * kNearest;
  std::size_t place;
  if (near.count[rod] < kNearest) {
    place = first + static_cast<std::size_t>(near.count[rod]++);
  } else {
    if (square >= near.reach[rod]) return;
    place = first;
    while (near.square[place] != near.reach[rod]) ++place;
  }
  near.x[place] = x, near.y[place] = y, near.z[place] = z, near.square[place] = square;
  if (near.count[rod] < kNearest) return;
  float farthest = 0.0f;
  for (std::size_t i = first; i < first + kNearest; ++i) farthest = std::max(farthest, near.square[i]);
  near.reach[rod] = farthest;
}

/// Keeps the nearest of the hits around every rod, all of one level, and how far they reach.
template <class Real>
void takeNear(const typename BundleContact<Real>::Hit* first,
              const typename BundleContact<Real>::Hit* last, std::size_t level,
              BundleContact<Real>& contact) {
  BundleNeighbours& near = contact.near;
  const std::size_t rods = contact.batches.size() * kLanes;
  for (auto* field : {&near.x, &near.y, &near.z}) field->assign(rods * kNearest, 0.0f);
  near.square.assign(rods * kNearest, 1.0f);
  near.count.assign(rods, 0);
  near.reach.assign(rods, std::numeric_limits<float>::max());
  for (const auto* hit = first; hit != last; ++hit) {
    const auto x = static_cast<float>(hit->x), y = static_cast<float>(hit->y),
               z = static_cast<float>(hit->z);
    const float square = x * x + y * y + z * z;
    takeNeighbour(near, static_cast<std::size_t>(hit->a), x, y, z, square);
    takeNeighbour(near, static_cast<std::size_t>(hit->b), -x, -y, -z, square);
  }
  for (std::size_t rod = 0; rod < rods; ++rod)
    contact.batches[rod / kLanes].crowd[level * kLanes + rod % kLanes] =
        near.count[rod] < kNearest ? std::numeric_limits<Real>::max()
                                   : static_cast<Real>(kCrowd * kCrowd * near.reach[rod]);
}

/// How far nobody stands between a rod and another at (x, y, z), 0..1, by |c|²/(c·d) of the neighbour
/// that is most between them; see kClosed.
float openness(const BundleNeighbours& near, std::size_t rod, float x, float y, float z, float square) {
  using V = Lanes<float, 4>;
  // The other itself is on the surface, too.
  const V nearer = broadcast<V>(0.999f * square), zero{}, tiny = broadcast<V>(1e-20f);
  V least = broadcast<V>(1.0f);
  for (std::size_t i = rod * kNearest; i < (rod + 1) * kNearest; i += 4) {
    const V c = load<V>(near.square.data() + i);
    const V product =
        load<V>(near.x.data() + i) * x + load<V>(near.y.data() + i) * y + load<V>(near.z.data() + i) * z;
    least = min(least, c / max(tiny, select(c < nearer, product, zero)));
  }
  const float most = std::min(std::min(least[0], least[1]), std::min(least[2], least[3]));
  return std::max(0.0f, (most - kClosed) / (1.0f - kClosed));
}

/// The pairs of every rod a with those after it, and how many neighbours a rod has at a level,
/// [level][rod]. Of the liquid that is to come between rods, or to go, `part` does.
template <class Real>
void findPairs(BundleContact<Real>& contact, float part, std::vector<std::vector<float>>& neighbours) {
  const std::size_t rods = contact.batches.size() * kLanes;
  contact.pairs.resize(rods);
  for (auto& of_rod : contact.pairs)
    for (BundlePair& pair : of_rod) pair.near = pair.acts = pair.seen = 0;
  contact.is_flowing = false;
  neighbours.resize(contact.levels.size());
  for (auto& count : neighbours) count.assign(rods, 0.0f);
  BundleNeighbours& near = contact.near;
  const auto* const hits_end = contact.hits.data() + contact.hits.size();
  for (const auto *first = contact.hits.data(), *last = first; first != hits_end; first = last) {
    while (last != hits_end && last->level == first->level) ++last;
    const auto level = static_cast<std::size_t>(first->level);
    takeNear<Real>(first, last, level, contact);
    for (const auto* hit = first; hit != last; ++hit) {
      const auto a = static_cast<std::size_t>(hit->a), b = static_cast<std::size_t>(hit->b);
      const auto x = static_cast<float>(hit->x), y = static_cast<float>(hit->y),
                 z = static_cast<float>(hit->z), gap = static_cast<float>(hit->gap);
      const float square = x * x + y * y + z * z;
      const bool near_a = square <= near.reach[a];
      if (!near_a && !(square <= near.reach[b])) continue;
      // Whoever stands between is near the one or the other.
      float open = openness(near, a, x, y, z, square);
      if (open > 0.0f) open = std::min(open, openness(near, b, -x, -y, -z, square));
      // Nor does anybody stand between rods that touch.
      const float distance = std::sqrt(square) - gap;
      open = static_cast<float>(hit->within) *
             std::max(open, std::min(1.0f, 1.0f - gap / (kNextTo * distance)));
      auto& of_rod = contact.pairs[std::min(a, b)];
      const auto second = static_cast<std::int32_t>(std::max(a, b));
      auto pair = std::find_if(of_rod.begin(), of_rod.end(),
                               [&](const BundlePair& known) { return known.b == second; });
      const float before = pair == of_rod.end() ? 0.0f : pair->open[level];
      contact.is_flowing = contact.is_flowing || std::abs(open - before) > kFlows;
      open = before + part * (open - before);
      if (open < kTrace) open = 0.0f;
      // What soon may touch: as near as rods move until the next time, and no second neighbours.
      const float soon =
          static_cast<float>(kSoon) * std::min(static_cast<float>(contact.margin), distance);
      const bool is_near = open > 0.0f || gap <= soon;
      if (pair == of_rod.end()) {
        if (!is_near) continue;
        pair = of_rod.insert(of_rod.end(), {second, 0, 0, 0, {}, {}});
      }
      pair->seen |= 1u << level;
      if (is_near) pair->near |= 1u << level;
      if (open > 0.0f || gap < 0.0f) pair->acts |= 1u << level;
      pair->open[level] = open;
      pair->shift[level] = static_cast<float>(a < b ? hit->shift : -hit->shift);
      for (const std::size_t rod : {a, b}) neighbours[level][rod] += open;
    }
  }
  for (auto& of_rod : contact.pairs) {
    of_rod.erase(std::remove_if(of_rod.begin(), of_rod.end(),
                                [](const BundlePair& pair) { return pair.near == 0; }),
                 of_rod.end());
    // Up to where they are too far apart it is the gap that counts.
    for (BundlePair& pair : of_rod)
      for (std::size_t level = 0; level < contact.levels.size(); ++level) {
        if ((pair.seen >> level & 1u) != 0) continue;
        const std::uint32_t above = pair.seen >> level << level;
        const auto nearest =
            static_cast<std::size_t>(above != 0 ? __builtin_ctz(above) : 31 - __builtin_clz(pair.seen));
        pair.open[level] += part * (pair.open[nearest] - pair.open[level]);
        pair.shift[level] = pair.shift[nearest];
      }
  }
}

/// Places that all rods have in common are nodes of a rod as long as the longest, by the length along
/// the rods.
template <class Real>
void findPlaces(const BrushModel& brush, BundleContact<Real>& contact) {
  double longest = 0.0;
  for (const RodModel& rod : brush.rods) longest = std::max(longest, rod.length);
  const int n = contact.node_count;
  for (BundleBatch<Real>& batch : contact.batches) {
    CommonPlaces<Real>& places = batch.places;
    places.place.resize(fieldSize(contact, 1));
    places.joint.resize(kLanes);
    std::array<double, kLanes> scale;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      scale[lane] = double(batch.length[lane]) * (n - 1) / longest;
      places.joint[lane] = static_cast<Real>(std::pow(scale[lane], 4.0));
    }
    const auto [low, high] = std::minmax_element(scale.begin(), scale.end());
    for (int node = 0; node < n; ++node) {
      for (std::size_t lane = 0; lane < kLanes; ++lane)
        places.place[static_cast<std::size_t>(node * kLanes) + lane] =
            static_cast<Real>(scale[lane] * node);
      places.first.push_back(static_cast<int>(*low * node));
      places.last.push_back(std::min(n - 1, static_cast<int>(*high * node) + 1));
    }
  }
}

/// Where the levels are on the rods.
template <class Real>
void findSections(BundleContact<Real>& contact) {
  const int last = contact.node_count - 1;
  for (BundleBatch<Real>& batch : contact.batches) {
    batch.sections.resize(contact.levels.size());
    for (std::size_t level = 0; level < contact.levels.size(); ++level)
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        BundleSection<Real>& section = batch.sections[level];
        const double spacing = double(batch.places.spacing(lane));
        const double at = contact.levels[level] / spacing, node = std::min<double>(at, last);
        const double before = std::ceil(node) - 1.0;
        const bool is_there = batch.rod[lane] >= 0 && at < last + kEndsBefore;
        section.node[lane] = is_there ? static_cast<std::int32_t>(before) : -1;
        section.part[lane] = static_cast<Real>(node - before);
        section.place[lane] = static_cast<Real>(node * spacing);
      }
  }
}

/// The stretches of a batch with another into packs, and a tie of those.
template <class Real>
void pack(BundleContact<Real>& contact, int a, int b,
          const std::vector<typename BundleContact<Real>::Stretch>& stretches) {
  BundleTie<Real> tie;
  if (!contact.spare_ties.empty()) {
    tie = std::move(contact.spare_ties.back());
    contact.spare_ties.pop_back();
  }
  tie.a = a;
  tie.b = b;
  tie.stiffness.resize(static_cast<std::size_t>(contact.node_count));
  tie.turns.resize(static_cast<std::size_t>(contact.node_count));
  tie.first_pack = static_cast<int>(contact.packs.size());
  for (std::size_t first = 0; first < stretches.size(); first += kLanes) {
    BundlePack<Real>& pack = contact.packs.emplace_back();
    pack.count = static_cast<int>(std::min<std::size_t>(kLanes, stretches.size() - first));
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const bool counts = lane < static_cast<std::size_t>(pack.count);
      const auto& stretch = stretches[counts ? first + lane : first];
      pack.one[lane] = stretch.one;
      pack.two[lane] = stretch.two;
      pack.level[lane] = stretch.level;
      pack.shift[lane] = stretch.shift;
      pack.ahead[lane] = static_cast<Real>(stretch.ahead);
      pack.before[lane] = static_cast<Real>(counts ? stretch.before : 0.0f);
      pack.here[lane] = static_cast<Real>(counts ? stretch.here : 0.0f);
    }
  }
  tie.last_pack = static_cast<int>(contact.packs.size());
  const auto at = static_cast<int>(contact.ties.size());
  contact.ties_of[static_cast<std::size_t>(b)].push_back(at);
  // In a phase a batch meets that with which its number has a given sum.
  contact.phases[static_cast<std::size_t>(a + b) % contact.phases.size()].push_back(at);
  contact.ties.push_back(std::move(tie));
}

/// The stretch of a pair that ends at a level of the rod `a`, or of the other if it swaps them. Whether
/// there is one, and whether they touch there or are bridged.
template <class Real>
bool makeStretch(const BundleContact<Real>& contact, int a, const BundlePair& pair, bool swaps,
                 int level, typename BundleContact<Real>::Stretch& stretch, bool& acts) {
  int one = a, two = pair.b;
  if (swaps) std::swap(one, two);
  const auto spacingOf = [&](int rod) {
    return float(contact.batches[static_cast<std::size_t>(rod / kLanes)].places.spacing(
        static_cast<std::size_t>(rod % kLanes)));
  };
  const float spacing = spacingOf(one), stride = static_cast<float>(contact.stride);
  const int last_node = contact.levels[static_cast<std::size_t>(level)];
  // Levels count from the root here: the first is at levels.front(), and so on.
  const auto levelOf = [&](float node) {
    return std::max(0.0f, (node * spacing - static_cast<float>(contact.levels.front())) / stride);
  };
  const float from = levelOf(static_cast<float>(last_node) - stride),
              to = levelOf(static_cast<float>(last_node));
  const int top = static_cast<int>(contact.levels.size()) - 1;
  const int lowest = static_cast<int>(from), highest = std::min(top, static_cast<int>(std::ceil(to)));
  std::uint32_t around = 0;
  for (int at = lowest; at <= highest; ++at) around |= 1u << at;
  if ((pair.near & around) == 0) return false;
  acts = (pair.acts & around) != 0;
  const auto at = [&](float where, const auto& value) {
    const auto below = static_cast<int>(where);
    const float low = value(below), high = value(std::min(top, below + 1));
    return low + (where - static_cast<float>(below)) * (high - low);
  };
  const auto share = [&](int of) {
    const auto& count = contact.neighbours[static_cast<std::size_t>(of)];
    const float most =
        std::max(count[static_cast<std::size_t>(one)], count[static_cast<std::size_t>(two)]);
    return pair.open[static_cast<std::size_t>(of)] *
           std::min(1.0f, static_cast<float>(kMostNeighbours) / std::max(most, 1.0f));
  };
  const float middle = static_cast<float>(last_node) - 0.5f * (stride - 1.0f);
  const float ahead = (swaps ? -1.0f : 1.0f) * at(levelOf(middle), [&](int of) {
                        return pair.shift[static_cast<std::size_t>(of)];
                      });
  const float beside = (middle * spacing + ahead) / spacingOf(two);
  const int first = std::max(1, last_node - contact.stride + 1);
  const int shift = std::max(-first, static_cast<int>(std::lround(beside - middle)));
  if (first + shift >= contact.node_count) return false;
  stretch = {one % kLanes, two % kLanes, level, shift, ahead, at(from, share), at(to, share)};
  return true;
}

template <class Real>
void clearPacks(BundleContact<Real>& contact) {
  for (BundleTie<Real>& tie : contact.ties) contact.spare_ties.push_back(std::move(tie));
  contact.packs.clear();
  contact.ties.clear();
  for (auto* lists : {&contact.ties_of, &contact.phases})
    for (auto& list : *lists) list.clear();
}

}  // namespace

double cohesionEnergy(double saturation) {
  const double wanted = std::clamp(saturation, 0.0, 1.0) * (4.0 - kPi);
  if (!(wanted > 0.0)) return 0.0;
  if (wanted >= 4.0 - kPi) return 2.0 * (kPi - 2.0);
  double low = 0.0, high = 0.5 * kPi - 1e-9, liquid = 0.0;
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    cohesionAtAngle(middle, liquid);
    (liquid < wanted ? low : high) = middle;
  }
  return cohesionAtAngle(0.5 * (low + high), liquid);
}

double pairEnergy(double gap, double distance, double stiffness, double cohesion, double range) {
  if (gap >= range) return 0.0;
  const double open = 1.0 - std::max(gap, 0.0) / range;
  if (gap >= 0.0) return -cohesion * open * open;
  return -cohesion + 2.0 * cohesion / range * gap + 0.5 * stiffness * gap * gap / (1.0 + gap / distance);
}

template <class Real>
BundleContact<Real> makeBundleContact(const BrushModel& brush, const ContactParameters& parameters,
                                      const std::vector<std::vector<int>>& batches) {
  BundleContact<Real> contact;
  contact.rod_count = static_cast<int>(brush.rods.size());
  contact.node_count = brush.rods.front().nodeCount();
  const int n = contact.node_count;
  contact.friction = parameters.bundle_friction;
  contact.stiffness = parameters.bundle_stiffness;
  contact.modulus = parameters.bundle_modulus;
  contact.cohesion_range = parameters.cohesion_range;
  contact.surface_tension = parameters.surface_tension;
  contact.stride = std::max(1, (n + kUsualLevels - 1) / kUsualLevels);
  for (int node = n - 1; node >= 1; node -= contact.stride) contact.levels.push_back(node);
  std::reverse(contact.levels.begin(), contact.levels.end());

  double sum_radius = 0.0;
  for (const std::vector<int>& rods : batches) {
    BundleBatch<Real> batch;
    batch.rod.fill(-1);
    for (auto* field : {&batch.present, &batch.length}) field->assign(kLanes, Real(0));
    for (auto* field : {&batch.rest, &batch.along}) field->assign(3 * kLanes, Real(0));
    for (auto* field : {&batch.radius, &batch.hold, &batch.saturation, &batch.cling, &batch.bridge})
      field->assign(fieldSize(contact, 1), Real(0));
    for (auto* field : {&batch.point, &batch.way}) field->assign(fieldSize(contact, 3), Real(0));
    batch.springs.assign(fieldSize(contact, 4), Real(0));
    for (auto* field : {&batch.turns, &batch.kinks, &batch.anchors})
      field->assign(static_cast<std::size_t>(n), Real(0));
    batch.scratch.assign(fieldSize(contact, 6), Real(0));
    batch.crowd.assign(contact.levels.size() * kLanes, std::numeric_limits<Real>::max());
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const bool present = lane < rods.size();
      const RodModel& rod = brush.rods[static_cast<std::size_t>(present ? rods[lane] : rods.back())];
      batch.length[lane] = static_cast<Real>(rod.length / (n - 1));
      for (std::size_t i = 0; i < 3; ++i) {
        batch.rest[i * kLanes + lane] = static_cast<Real>(rod.root_H[static_cast<Eigen::Index>(i)]);
        batch.along[i * kLanes + lane] =
            static_cast<Real>(rod.length * rod.direction_H[static_cast<Eigen::Index>(i)]);
      }
      if (!present) continue;
      batch.rod[lane] = rods[lane];
      batch.present[lane] = Real(1);
      for (std::size_t node = 0; node < static_cast<std::size_t>(n); ++node) {
        batch.radius[node * kLanes + lane] = static_cast<Real>(rod.node_radius[node]);
        sum_radius += rod.node_radius[node];
      }
    }
    contact.batches.push_back(std::move(batch));
  }
  // Long enough for few searches, short enough for few pairs that feel nothing.
  contact.margin = 0.75 * sum_radius / (contact.rod_count * n);
  findPlaces(brush, contact);
  findSections(contact);
  contact.ties_of.resize(batches.size());
  contact.phases.resize(batches.size());
  contact.moved_apart.assign(batches.size() * batches.size(), std::numeric_limits<double>::max());
  contact.acting.resize(batches.size());
  contact.idle.resize(batches.size());
  contact.nodes_before = contact.stride + 1;
  contact.records = n + 2 * contact.nodes_before;
  for (auto* field : {&contact.points, &contact.ways, &contact.pulls})
    field->assign(batches.size() * kLanes * static_cast<std::size_t>(4 * contact.records), Real(0));
  return contact;
}

template <class Real>
bool takeInk(BundleContact<Real>& contact, const std::vector<double>& saturation) {
  bool changed = false;
  const auto n = static_cast<std::size_t>(contact.node_count);
  for (BundleBatch<Real>& batch : contact.batches)
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (batch.rod[lane] < 0) continue;
      const double widest = double(batch.radius[lane]);
      for (std::size_t node = 0; node < n; ++node) {
        const std::size_t at = node * kLanes + lane;
        const double exact =
            std::clamp(saturation[static_cast<std::size_t>(batch.rod[lane]) * n + node], 0.0, 1.0);
        // In whole steps, so that it does not matter how it came; a trace is a trace.
        const double ink = exact < 0.5 * kInkStep ? exact : kInkStep * std::round(exact / kInkStep);
        if (batch.saturation[at] == static_cast<Real>(ink)) continue;
        changed = true;
        batch.saturation[at] = static_cast<Real>(ink);
        batch.cling[at] =
            static_cast<Real>(contact.surface_tension * cohesionEnergy(ink) * double(batch.radius[at]));
        batch.bridge[at] = static_cast<Real>(contact.cohesion_range * widest * std::sqrt(ink));
      }
    }
  return changed;
}

template <class Real>
void takeCrossings(BundleContact<Real>& contact) {
  // Neighbours push each other off by their nodes: at the crowded point of a wet tip, where they lie
  // across each other at every angle, their edges would only shake them.
  contact.crossings.clear();
  for (const BundleCrossing& crossing : contact.all_crossings) {
    const auto& of_rod = contact.pairs[static_cast<std::size_t>(std::min(crossing.a, crossing.b))];
    const std::int32_t other = std::max(crossing.a, crossing.b);
    if (std::none_of(of_rod.begin(), of_rod.end(), [&](const auto& pair) { return pair.b == other; }))
      contact.crossings.push_back(crossing);
  }
}

template <class Real>
WaysApart noteWays(BundleContact<Real>& contact) {
  // The mean way of a batch at a level, and how far others are from it: the same however it is turned.
  struct Ways {
    std::array<float, 3> mean;
    float spread;
  };
  thread_local std::vector<Ways> ways;  // scratch: it keeps its memory
  const std::size_t batches = contact.batches.size(), levels = contact.levels.size();
  ways.resize(batches * levels);
  for (std::size_t batch = 0; batch < batches; ++batch)
    for (std::size_t level = 0; level < levels; ++level) {
      const Real* way = contact.batches[batch].way.data() +
                        static_cast<std::size_t>(contact.levels[level]) * 3 * kLanes;
      const Real* present = contact.batches[batch].present.data();
      Ways& own = ways[batch * levels + level];
      float rods = 0.0f;
      own.mean.fill(0.0f);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        rods += static_cast<float>(present[lane]);
        for (std::size_t i = 0; i < 3; ++i)
          own.mean[i] += static_cast<float>(present[lane] * way[i * kLanes + lane]);
      }
      for (float& mean : own.mean) mean /= rods;
      float most = 0.0f;
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        float square = 0.0f;
        for (std::size_t i = 0; i < 3; ++i) {
          const float off = static_cast<float>(way[i * kLanes + lane]) - own.mean[i];
          square += off * off;
        }
        most = std::max(most, static_cast<float>(present[lane]) * square);
      }
      own.spread = std::sqrt(most);
    }
  WaysApart apart{0.0, 0.0};
  for (std::size_t a = 0; a < batches; ++a)
    for (std::size_t b = a; b < batches; ++b) {
      float most = 0.0f;
      for (std::size_t level = 0; level < levels; ++level) {
        const Ways &one = ways[a * levels + level], &two = ways[b * levels + level];
        float square = 0.0f;
        for (std::size_t i = 0; i < 3; ++i)
          square += (one.mean[i] - two.mean[i]) * (one.mean[i] - two.mean[i]);
        most = std::max(most, std::sqrt(square) + one.spread + two.spread);
      }
      double& moved = contact.moved_apart[a * batches + b];
      moved += double(most);
      apart.of_step = std::max(apart.of_step, double(most));
      apart.largest = std::max(apart.largest, moved);
    }
  return apart;
}

template <class Real>
void forgetPairs(BundleContact<Real>& contact) {
  clearPacks(contact);
  contact.crossings.clear();
  contact.all_crossings.clear();
  std::fill(contact.moved_apart.begin(), contact.moved_apart.end(), std::numeric_limits<double>::max());
  for (auto& of_rod : contact.pairs) of_rod.clear();
  for (BundleBatch<Real>& batch : contact.batches)
    std::fill(batch.crowd.begin(), batch.crowd.end(), std::numeric_limits<Real>::max());
  contact.is_flowing = false;
}

template <class Real>
void takeHits(BundleContact<Real>& contact, double elapsed) {
  findPairs(contact, static_cast<float>(-std::expm1(-elapsed / kLiquidTime)), contact.neighbours);
  clearPacks(contact);
  const int levels = static_cast<int>(contact.levels.size());
  const int batches = static_cast<int>(contact.batches.size());
  for (int a = 0; a < batches; ++a) {
    for (auto* lists : {&contact.acting, &contact.idle})
      for (auto& list : *lists) list.clear();
    // By level, so that the nodes of a pack are about as far along their rods.
    for (int level = 0; level < levels; ++level)
      for (int lane = 0; lane < kLanes; ++lane)
        for (const BundlePair& pair : contact.pairs[static_cast<std::size_t>(a * kLanes + lane)]) {
          const int b = pair.b / kLanes, other = pair.b % kLanes;
          // So that within a batch all have about as many on either side.
          const bool swaps = a == b && (lane + other) % 2 != 0;
          bool acts = false;
          typename BundleContact<Real>::Stretch stretch;
          if (makeStretch(contact, a * kLanes + lane, pair, swaps, level, stretch, acts))
            (acts ? contact.acting : contact.idle)[static_cast<std::size_t>(b)].push_back(stretch);
        }
    for (int b = a; b < batches; ++b) {
      auto &all = contact.acting[static_cast<std::size_t>(b)],
           &idle = contact.idle[static_cast<std::size_t>(b)];
      // Together, so that packs of them are soon done.
      all.insert(all.end(), idle.begin(), idle.end());
      if (!all.empty()) pack(contact, a, b, all);
    }
  }
}

#define CALLIGRAPHY_INSTANTIATE(Real)                                                         \
  template BundleContact<Real> makeBundleContact(const BrushModel&, const ContactParameters&, \
                                                 const std::vector<std::vector<int>>&);       \
  template bool takeInk(BundleContact<Real>&, const std::vector<double>&);                    \
  template void takeCrossings(BundleContact<Real>&);                                          \
  template WaysApart noteWays(BundleContact<Real>&);                                          \
  template void forgetPairs(BundleContact<Real>&);                                            \
  template void takeHits(BundleContact<Real>&, double);
CALLIGRAPHY_INSTANTIATE(float)
CALLIGRAPHY_INSTANTIATE(double)
#undef CALLIGRAPHY_INSTANTIATE

}  // namespace calligraphy_brush
