#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "calligraphy_brush/common/lane_vectors.h"
#include "calligraphy_brush/common/thread_pool.h"
#include "calligraphy_brush/sim/tuft.h"
#include "tuft_batch.h"

namespace calligraphy_brush {

/// How the rods of a tuft that touch and cling take a stage of a step together.
template <class Real>
class BundleCoupling {
 public:
  /// batches, solver and pool outlive it.
  BundleCoupling(const BrushModel& brush, const RodParameters& rods, const ContactParameters& contact,
                 std::vector<TuftBatch<Real>>& batches, StageSolver<Real>& solver, ThreadPool& pool)
      : batches_(batches),
        solver_(solver),
        pool_(pool),
        rounds_(contact.coupling_rounds),
        tolerance_(contact.coupling_tolerance),
        time_step_(rods.time_step),
        relative_(std::max(std::exp(-rods.time_step / kRelativeTime), kLeastRelative)) {
    std::vector<std::vector<int>> rods_of;
    for (const TuftBatch<Real>& batch : batches_) rods_of.push_back(batch.rods);
    bundles_ = makeBundleContact<Real>(brush, contact, rods_of);
    bundles_.slip = kSlipSpeed * rods.time_step;
    const auto n = static_cast<std::size_t>(bundles_.node_count);
    for (std::size_t i = 0; i < batches_.size(); ++i) {
      TuftBatch<Real>& batch = batches_[i];
      batch.common.assign(n * kCommonRows, Real(0));
      batch.common_scratch.assign(n * kCommonRows * kLanes, Real(0));
      for (std::size_t at = 0; at < n * kLanes; ++at)
        bundles_.batches[i].hold[at] =
            batch.contact.stiffness[at] / static_cast<Real>(contact.stiffness);
    }
    common_.node_count = bundles_.node_count;
    common_.factor.assign((n - 1) * kCommonFactorRows * kLanes, Real(0));
    for (int count = static_cast<int>(batches_.size());; count = (count + kJoined - 1) / kJoined) {
      CommonLevel<Real> level;
      level.count = count;
      const std::size_t rows = n * kLanes * static_cast<std::size_t>((count + kLanes - 1) / kLanes);
      level.sums.assign(rows * kCommonRows, Real(0));
      level.hold.assign(rows, Real(0));
      level.shift.assign(rows * 3, Real(0));
      level.pull.assign(rows * 3, Real(0));
      // Lanes without a group have mass alone, and so stay where they are.
      for (std::size_t at = 0; at < rows; ++at)
        level.sums[(at / kLanes * kCommonRows + kCommonMass) * kLanes + at % kLanes] = Real(1);
      common_.levels.push_back(std::move(level));
      if (count == 1) break;
    }
  }

  const BundleContact<Real>& contact() const { return bundles_; }

  /// What the rods of a batch feel of others; null: nothing.
  const BundleBatch<Real>* bundleOf(int batch) const {
    return bundles_.empty() ? nullptr : &bundles_.batches[static_cast<std::size_t>(batch)];
  }

  /// Of which rods feel each other and how far liquid bridges them; see Tuft::hash.
  std::uint64_t hash(std::uint64_t seed) const {
    for (const std::vector<BundlePair>& of_rod : bundles_.pairs)
      for (const BundlePair& pair : of_rod) {
        seed = hashBytes(&pair.b, sizeof pair.b, seed);
        seed = hashBytes(pair.open.data(), sizeof pair.open, seed);
        seed = hashBytes(pair.shift.data(), sizeof pair.shift, seed);
      }
    return seed;
  }

  /// As if nothing had ever touched.
  void forget() {
    forgetPairs(bundles_);
    letGo();
    since_search_ = 0.0;
    moved_since_search_ = std::numeric_limits<double>::max();
  }

  /// The tuft has been turned as a whole.
  void turn(const Eigen::Matrix3d& turn) {
    // The gradients of NodeSprings.
    for (BundleBatch<Real>& bundle : bundles_.batches)
      changeVectors(
          bundle.springs, [&](const Eigen::Vector3d& pull) { return turn * pull; }, 4);
  }

  /// Ink of the rods, [rod · node count + node]. Returns whether it changed by what matters.
  bool setInk(const std::vector<double>& saturation) {
    if (!takeInk(bundles_, saturation)) return false;
    moved_since_search_ = std::max(moved_since_search_, 2.0 * kLeastMargins * bundles_.margin);
    solver_.kernel.template coupling<Real>().fill(bundles_);
    return true;
  }

  /// A step of rods that touch. Each is solved as if the others did what is believed of them, at first
  /// that they go on as they did, and then that groups of them do what they would do together (see
  /// CommonMotion). The springs that a rod feels lie above the coupled energy (see BundleContact), and
  /// where rods rest they rest whatever is believed of their motion: one such round a step is stable and
  /// ends in the common minimum. With more rounds what rods did is believed of them, and they are solved
  /// again, until beliefs and deeds agree.
  void solve(TuftReport& report) {
    const Coupling<Real>& coupling = solver_.kernel.template coupling<Real>();
    forBatches([&](TuftBatch<Real>& batch, BundleBatch<Real>& bundle) {
      if (rounds_ > 1) batch.keepStart();
      solver_.chooseScheme(batch);
      coupling.extrapolate(solver_.stage->ratio, std::pow(relative_, solver_.stage->part),
                           solver_.has_paper, batch.model, batch.roots, batch.state, bundle);
    });
    since_search_ += solver_.stage->part * time_step_;
    const WaysApart apart = noteWays(bundles_);
    moved_apart_ += apart.of_step;
    const auto moved = [&](double margins) {
      return std::max(moved_since_search_, moved_apart_) > margins * bundles_.margin;
    };
    const bool searches = moved_since_search_ > kSearchMargins * bundles_.margin || moved(kFarMargins) ||
                          ((moved(kLeastMargins) || bundles_.is_flowing) && since_search_ > kSearchTime);
    if (searches) search();
    const bool crosses = apart.largest > kApartMargins * bundles_.margin;
    if (crosses) coupling.findCrossings(bundles_);
    if (searches || crosses) takeCrossings(bundles_);
    if (bundles_.empty()) {
      letGo();
      for (TuftBatch<Real>& batch : batches_) batch.state.guess.clear();
      solveBatches();
      return;
    }
    for (int round = 1;; ++round) {
      report.coupling_rounds = round;
      moveTogether();
      pull(round == 1 && (searches || ++since_ties_ >= kTieSteps));
      solveBatches();
      report.coupling_error = 0.0;
      for (std::size_t i = 0; i < batches_.size(); ++i)
        report.coupling_error =
            std::max(report.coupling_error, disagreement(batches_[i], bundles_.batches[i]));
      if (report.coupling_error < tolerance_ || round == rounds_) break;
      forBatches([&](TuftBatch<Real>& batch, BundleBatch<Real>& bundle) {
        bundle.way = batch.state.displacement;
        bundle.point = batch.state.position;
        batch.backToStart();
      });
      for (const TuftBatch<Real>& batch : batches_) report.iterations += batch.report.iterations;
    }
    Real most = 0;
    for (const BundleTie<Real>& tie : bundles_.ties) most = std::max(most, tie.most_relative);
    moved_since_search_ += std::sqrt(double(most));
  }

 private:
  /// Relative speed of touching rods at which friction is fully there [m/s].
  static constexpr double kSlipSpeed = 1e-3;
  /// A list of pairs serves for so long [s] while rods or liquid move; when those of it have moved by so
  /// many margins relative to each other, or rods anywhere, it is done at once. One that comes up from
  /// where it was not listed is noticed when it overlaps, and pushed off. Where next to nothing moves
  /// nobody looks, and rods come to rest. By the clock rather than by how far they have come: what
  /// differs by a rounding then goes on alike.
  static constexpr double kLeastMargins = 0.02, kSearchMargins = 2.0, kFarMargins = 6.0;
  static constexpr double kSearchTime = 15.5e-3;
  /// Time for which a rod is believed to go on with what it does by itself [s]. Believed for too long,
  /// small shocks of pairs that come and go add up; the shorter, the more rounds until rods know what
  /// their neighbours do.
  static constexpr double kRelativeTime = 10e-3, kLeastRelative = 0.3;
  /// How groups of rods are tied hardly changes from step to step: it is summed up again after so many,
  /// and after a search.
  static constexpr int kTieSteps = 4;
  /// How far a common motion is trusted in a step, in margins.
  static constexpr double kTrustInMargins = 2.0;

  void solveBatches() {
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int thread) {
      solver_.solve(batches_[static_cast<std::size_t>(index)], thread, bundleOf(index));
    });
  }

  /// What pulled until now does not any more.
  void letGo() {
    for (BundleBatch<Real>& bundle : bundles_.batches) {
      std::fill(bundle.springs.begin(), bundle.springs.end(), Real(0));
      for (auto* field : {&bundle.turns, &bundle.kinks, &bundle.anchors})
        std::fill(field->begin(), field->end(), Real(0));
    }
    since_ties_ = kTieSteps;
    for (CommonLevel<Real>& level : common_.levels) {
      level.tie_count = 0;
      std::fill(level.hold.begin(), level.hold.end(), Real(0));
    }
  }

  void search() {
    const Coupling<Real>& coupling = solver_.kernel.template coupling<Real>();
    coupling.find(bundles_);
    takeHits(bundles_, since_search_);
    since_search_ = 0.0;
    coupling.fill(bundles_);
    moved_since_search_ = moved_apart_ = 0.0;
  }

  /// What the pairs pull, into the springs, and how groups are tied.
  void pull(bool with_ties) {
    const Coupling<Real>& coupling = solver_.kernel.template coupling<Real>();
    const int batches = static_cast<int>(batches_.size());
    pool_.run(batches, [&](int batch, int) { coupling.spread(bundles_, batch); });
    for (const std::vector<int>& ties : bundles_.phases)
      pool_.run(static_cast<int>(ties.size()), [&](int i, int) {
        coupling.push(bundles_, ties[static_cast<std::size_t>(i)], with_ties);
      });
    pool_.run(batches, [&](int batch, int) { coupling.gather(bundles_, batch); });
    coupling.cross(bundles_);
    if (!with_ties) return;
    tieGroups();
    since_ties_ = 0;
  }

  /// The ties of batches, and those of larger groups by them.
  void tieGroups() {
    const int n = bundles_.node_count;
    const auto join = [](CommonLevel<Real>& level, int a, int b, const std::vector<Real>& stiffness) {
      if (a == b) return;
      for (int i = 0; i < level.tie_count; ++i) {
        auto& tie = level.ties[static_cast<std::size_t>(i)];
        if (tie.a != a || tie.b != b) continue;
        for (std::size_t k = 0; k < stiffness.size(); ++k) tie.stiffness[k] += stiffness[k];
        return;
      }
      const auto next = static_cast<std::size_t>(level.tie_count++);
      if (next == level.ties.size()) level.ties.emplace_back();
      level.ties[next].a = a;
      level.ties[next].b = b;
      level.ties[next].stiffness = stiffness;
    };
    for (CommonLevel<Real>& level : common_.levels) level.tie_count = 0;
    for (const auto& tie : bundles_.ties) join(common_.levels.front(), tie.a, tie.b, tie.stiffness);
    for (std::size_t i = 1; i < common_.levels.size(); ++i)
      for (int k = 0; k < common_.levels[i - 1].tie_count; ++k) {
        const auto& tie = common_.levels[i - 1].ties[static_cast<std::size_t>(k)];
        join(common_.levels[i], tie.a / kJoined, tie.b / kJoined, tie.stiffness);
      }
    for (CommonLevel<Real>& level : common_.levels) {
      std::fill(level.hold.begin(), level.hold.end(), Real(0));
      for (int i = 0; i < level.tie_count; ++i) {
        const auto& tie = level.ties[static_cast<std::size_t>(i)];
        for (const int group : {tie.a, tie.b})
          for (int place = 1; place < n; ++place)
            level.hold[static_cast<std::size_t>((group / kLanes * n + place) * kLanes +
                                                group % kLanes)] +=
                Real(2) * tie.stiffness[static_cast<std::size_t>(place)];
      }
    }
  }

  /// Stiffness of inertia where a group has no rods, which keeps its place there [N/m].
  static constexpr Real kLeastMass = Real(1e-6);

  /// Moves what is believed by what groups of rods do together.
  void moveTogether() {
    const Coupling<Real>& coupling = solver_.kernel.template coupling<Real>();
    const int n = bundles_.node_count;
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int thread) {
      TuftBatch<Real>& batch = batches_[static_cast<std::size_t>(index)];
      const BundleBatch<Real>& bundle = bundles_.batches[static_cast<std::size_t>(index)];
      if (batch.framed) return;
      if (!batch.push.empty()) solver_.putPushIn(batch);
      coupling.sumUp(solver_.stepOf(batch, thread, &bundle), bundle.present.data(), bundle.places,
                     batch.common_scratch.data(), batch.common.data());
      for (int place = 0; place < n; ++place) {
        Real* sums = batch.common.data() + place * kCommonRows;
        sums[kCommonTurn] += bundle.turns[static_cast<std::size_t>(place)];
        // Of the joint before the edge that ends here.
        if (place > 0) sums[kCommonBend] += bundle.kinks[static_cast<std::size_t>(place - 1)];
        for (int i = 0; i < 3; ++i)
          sums[kCommonContact + i] += bundle.anchors[static_cast<std::size_t>(place)];
      }
      if (!batch.push.empty()) batch.state.velocity = batch.before;
    });
    CommonLevel<Real>& level = common_.levels.front();
    const auto at = [&](std::size_t batch, int node, int rows) {
      return (batch / kLanes * static_cast<std::size_t>(n) + static_cast<std::size_t>(node)) *
                 static_cast<std::size_t>(rows) * kLanes +
             batch % kLanes;
    };
    for (std::size_t i = 0; i < batches_.size(); ++i) {
      // Rods with frames do not take part; what has next to no mass does not weigh on its larger group.
      if (batches_[i].framed) {
        for (int node = 1; node < n; ++node)
          level.sums[at(i, node, kCommonRows) + kCommonMass * kLanes] = kLeastMass;
        continue;
      }
      const Real* sums = batches_[i].common.data();
      for (int node = 1; node < n; ++node)
        for (std::size_t row = 0; row < kCommonRows; ++row)
          level.sums[at(i, node, kCommonRows) + row * kLanes] =
              sums[static_cast<std::size_t>(node * kCommonRows) + row] +
              (row == kCommonMass ? kLeastMass : Real(0));
    }
    coupling.solveCommon(common_);
    Real square = 0;
    for (std::size_t row = 0; row < level.shift.size(); row += 3 * kLanes)
      for (std::size_t k = row; k < row + kLanes; ++k) {
        const Real x = level.shift[k], y = level.shift[k + kLanes], z = level.shift[k + 2 * kLanes];
        square = std::max(square, x * x + y * y + z * z);
      }
    const Real largest = std::sqrt(square);
    const Real scale = std::min(Real(1), static_cast<Real>(kTrustInMargins * bundles_.margin) /
                                             std::max(largest, std::numeric_limits<Real>::min()));
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int) {
      TuftBatch<Real>& batch = batches_[static_cast<std::size_t>(index)];
      if (batch.framed) return;
      for (int place = 0; place < n; ++place)
        for (std::size_t row = 0; row < 3; ++row)
          batch.common[static_cast<std::size_t>(3 * place) + row] =
              scale * level.shift[at(static_cast<std::size_t>(index), place, 3) + row * kLanes];
      coupling.shift(solver_.has_paper, batch.model, batch.roots, batch.state,
                     bundles_.batches[static_cast<std::size_t>(index)], batch.common.data());
    });
  }

  /// Of what every processor has.
  using Register = Lanes<Real, 16 / static_cast<int>(sizeof(Real))>;
  static constexpr std::size_t kRegister = 16 / sizeof(Real);

  /// Largest distance between what was believed of a batch's nodes and what they did [m].
  static double disagreement(const TuftBatch<Real>& batch, const BundleBatch<Real>& bundle) {
    Register largest{};
    const Real *did = batch.state.displacement.data(), *believed = bundle.way.data();
    for (std::size_t row = 0; row < bundle.way.size(); row += 3 * kLanes)
      for (std::size_t lane = row; lane < row + kLanes; lane += kRegister)
        largest = max(largest, squaredNorm(Vec3<Register>::loadFrom(did + lane) -
                                           Vec3<Register>::loadFrom(believed + lane)));
    double square = 0.0;
    for (std::size_t k = 0; k < kRegister; ++k) square = std::max(square, double(largest[k]));
    return std::sqrt(square);
  }

  /// Calls task(batch, its bundles_) for all of them, in parallel.
  template <class Task>
  void forBatches(Task&& task) {
    pool_.run(static_cast<int>(batches_.size()), [&](int index, int) {
      task(batches_[static_cast<std::size_t>(index)], bundles_.batches[static_cast<std::size_t>(index)]);
    });
  }

  std::vector<TuftBatch<Real>>& batches_;
  StageSolver<Real>& solver_;
  ThreadPool& pool_;
  int rounds_;
  double tolerance_;
  double time_step_;
  double relative_;  // part of what a rod does by itself that is believed to go on
  BundleContact<Real> bundles_;
  CommonMotionState<Real> common_;
  int since_ties_ = 0;               // steps since groups were tied
  double since_search_ = 0.0;        // time [s]
  double moved_apart_ = 0.0;         // rods anywhere, since the search [m]
  double moved_since_search_ = 0.0;  // neighbours, relative to each other [m]
};

}  // namespace calligraphy_brush
