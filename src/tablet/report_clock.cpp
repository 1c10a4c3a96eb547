#include "calligraphy_brush/tablet/report_clock.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

constexpr int kMemory = 40;                       // reports
constexpr std::int64_t kLongest_ns = 50'000'000;  // interval
constexpr double kMargin_ns = 1e6;
constexpr std::int64_t kShortest_ns = 100'000;  // interval that is given out
constexpr double kDelayMemory = 200.0;          // reports in which the delay falls by 1/e
constexpr std::size_t kKnots = 8;               // the delay is less than so many intervals

}  // namespace

std::int64_t ReportClock::take(std::int64_t stamp_ns) {
  const std::int64_t since_ns = stamp_ns - last_ns_;
  last_ns_ = stamp_ns;
  if (count_ == 0 || since_ns <= 0 || since_ns > kLongest_ns) {
    count_ = 1;
    return time_ns_ = stamp_ns;
  }
  if (count_ == 1) interval_ = static_cast<double>(since_ns);
  const double late = static_cast<double>(stamp_ns - time_ns_) - interval_;
  if (std::abs(late) > interval_ + kMargin_ns) {
    count_ = 1;
    return time_ns_ = std::max(stamp_ns, time_ns_ + kShortest_ns);
  }
  count_ = std::min(count_ + 1, kMemory);
  const double k = count_;
  const double alpha = 2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)), beta = 6.0 / (k * (k + 1.0));
  const double forward = interval_ + alpha * late;
  interval_ = std::max(static_cast<double>(kShortest_ns), interval_ + beta * late);
  return time_ns_ += std::max(kShortest_ns, static_cast<std::int64_t>(std::llround(forward)));
}

void EvenPath::restart() {
  clock_.restart();
  knots_.clear();
}

Eigen::Vector2d EvenPath::take(std::int64_t stamp_ns, const Eigen::Vector2d& place) {
  const std::int64_t time_ns = clock_.take(stamp_ns);
  knots_.push_back({time_ns, place});
  if (knots_.size() > kKnots) knots_.pop_front();
  const double early = static_cast<double>(stamp_ns - time_ns);
  delay_ns_ = std::max(early, delay_ns_ * (1.0 - 1.0 / kDelayMemory));

  const double at = early - delay_ns_;  // from the newest knot, ≤ 0 [ns]
  for (std::size_t k = knots_.size() - 1; k > 0; --k) {
    const double begin = static_cast<double>(knots_[k - 1].time_ns - time_ns);
    const double end = static_cast<double>(knots_[k].time_ns - time_ns);
    if (at < begin) continue;
    const double s = std::min(1.0, (at - begin) / (end - begin));
    return knots_[k - 1].place + s * (knots_[k].place - knots_[k - 1].place);
  }
  return knots_.front().place;
}

}  // namespace calligraphy_brush
