#include "calligraphy_brush/tablet/pointer_brush.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;

constexpr std::int64_t kLate_ns = 250'000'000;

std::int64_t toNanoseconds(double seconds) {
  return std::llround(1e9 * seconds);
}

/// A tablet as large as the sheet and on it.
TabletParameters makeTablet(const PointerBrushParameters& parameters) {
  checkParameters(parameters);
  TabletParameters tablet;
  tablet.device.even_out = false;  // they are even
  tablet.area.fit = "true_size";
  tablet.pressure = parameters.pressure;
  tablet.grip = parameters.grip;
  return tablet;
}

}  // namespace

PointerBrush::PointerBrush(const PointerBrushParameters& parameters, const BrushOnSheet& brush)
    : parameters_(parameters),
      brush_(brush),
      mapping_(makeTablet(parameters), {brush.width, brush.height, true}, brush),
      period_ns_(toNanoseconds(1.0 / parameters.motion.rate)),
      delay_ns_(toNanoseconds(parameters.motion.delay)) {}

bool PointerBrush::point(std::int64_t now_ns, const Vector2d& place, double pressure) {
  if (!place.allFinite() || !std::isfinite(pressure)) return false;
  const double margin = parameters_.motion.margin;
  const Vector2d on_sheet(std::clamp(place.x(), -margin, brush_.width + margin),
                          std::clamp(place.y(), -margin, brush_.height + margin));
  if (!is_in_use_) {
    events_ = {{now_ns, on_sheet, 0.0}};
    next_ns_ = now_ns;
    half_way_ = reached_ = {on_sheet, 0.0};
    is_in_use_ = true;
  }
  now_ns = std::max(now_ns, events_.back().stamp_ns);
  // Until now it lay where it was.
  if (now_ns - events_.back().stamp_ns > delay_ns_)
    events_.push_back({now_ns - delay_ns_, events_.back().place, events_.back().pressure});
  events_.push_back({now_ns, on_sheet, std::clamp(pressure, 0.0, 1.0)});
  event_ns_ = now_ns;
  return true;
}

void PointerBrush::release(std::int64_t now_ns) {
  if (is_in_use_ && events_.back().pressure > 0.0) point(now_ns, events_.back().place, 0.0);
}

/// Where the mouse was, between two events; its button is as the earlier one has it.
PointerBrush::Aim PointerBrush::aimAt(std::int64_t time_ns) {
  while (events_.size() > 1 && events_[1].stamp_ns <= time_ns) events_.pop_front();
  const Event& from = events_.front();
  if (events_.size() == 1 || time_ns <= from.stamp_ns) return {from.place, from.pressure};
  const Event& to = events_[1];
  const double share =
      static_cast<double>(time_ns - from.stamp_ns) / static_cast<double>(to.stamp_ns - from.stamp_ns);
  return {from.place + share * (to.place - from.place), from.pressure};
}

void PointerBrush::follow(const Aim& aim) {
  const double period = 1e-9 * static_cast<double>(period_ns_);
  const PointerMotionParameters& motion = parameters_.motion;
  const double nearer = motion.smoothing > 0.0 ? -std::expm1(-period / motion.smoothing) : 1.0;
  const double harder = -std::expm1(-period / motion.press_time);
  half_way_.place += nearer * (aim.place - half_way_.place);
  half_way_.pressure += harder * (aim.pressure - half_way_.pressure);
  Vector2d way = nearer * (half_way_.place - reached_.place);
  const double longest = motion.max_speed * period;
  if (way.norm() > longest) way *= longest / way.norm();
  reached_.place += way;
  reached_.pressure += harder * (half_way_.pressure - reached_.pressure);
}

std::vector<HandlePose> PointerBrush::advanceTo(std::int64_t now_ns) {
  std::vector<HandlePose> poses;
  if (!is_in_use_) return poses;
  if (now_ns - next_ns_ > kLate_ns || now_ns < next_ns_ - kLate_ns) return leave(now_ns);
  for (; next_ns_ <= now_ns; next_ns_ += period_ns_) {
    const Aim aim = aimAt(next_ns_ - delay_ns_);
    follow(aim);
    PenSample sample;
    sample.stamp_ns = next_ns_;
    sample.tool = PenTool::kPen;
    sample.has_position = true;
    sample.x = reached_.place.x();
    sample.y = reached_.place.y();
    sample.pressure = reached_.pressure;
    sample.touching = aim.pressure > 0.0 || reached_.pressure > parameters_.pressure.threshold;
    const bool is_idle = !sample.touching && events_.size() == 1 &&
                         next_ns_ - event_ns_ > toNanoseconds(parameters_.motion.idle_after);
    if (is_idle) {
      const auto last = leave(next_ns_);
      poses.insert(poses.end(), last.begin(), last.end());
      break;
    }
    const PenActions actions = mapping_.take(sample);
    poses.insert(poses.end(), actions.poses.begin(), actions.poses.end());
  }
  return poses;
}

std::vector<HandlePose> PointerBrush::leave(std::int64_t now_ns) {
  events_.clear();
  is_in_use_ = false;
  return mapping_.leave(now_ns).poses;
}

}  // namespace calligraphy_brush
