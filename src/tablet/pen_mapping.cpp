#include "calligraphy_brush/tablet/pen_mapping.h"

#include <algorithm>
#include <cmath>

namespace calligraphy_brush {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;
constexpr std::int64_t kMillisecond_ns = 1'000'000;
constexpr std::int64_t kLeastInterval_ns = kMillisecond_ns;
constexpr std::int64_t kPause_ns = 50 * kMillisecond_ns;  // tablets report every 2 to 16 ms
constexpr std::int64_t kHold_ns = 8 * kMillisecond_ns;    // a usual interval
constexpr std::int64_t kLeavingStep_ns = 4 * kMillisecond_ns;
constexpr std::int64_t kLongestRest_ns = 1000 * kMillisecond_ns;
constexpr std::int64_t kClockStep_ns = 1000 * kMillisecond_ns;
constexpr double kLift = 0.015;              // [s]: until the lift after a touch is highest
constexpr double kBend = 0.05;               // [s]: in which a tuft forgets how far it was bent
constexpr double kSwing = 0.01;              // [s]: what a tuft swings by over its speed
constexpr double kSwingMemory = 0.1;         // [s]: how long it swings
constexpr double kRise = 0.004;              // [s]: time constant of the end of the way up
constexpr double kRiseAcceleration = 100.0;  // [m/s²]: the ink of a wet tuft holds it together at it
constexpr double kBraking = 90.0;            // [m/s²]: the place to stop at comes towards it
constexpr double kFallAcceleration = 5.0;    // [m/s²]: by it a tuft hangs back 0.5 mm
constexpr double kFallStep = 1e-3;           // [s]
constexpr double kLongestFall = 1.0;         // [s]
constexpr double kStillWay = 1e-6;           // [m]: of a brush at rest in 8 ms
constexpr double kStillTurn = 1e-3;          // [rad]: from where it shall point
constexpr double kThere = 1e-4;              // [m]: of a brush that is lifted from where it shall be
constexpr double kTopSpeed = 4.0;            // [m/s]: of the brush; a hand reaches 3
constexpr double kHoldSpeed = 1.0;           // [m/s]: after a pause the brush moves on no faster

double wrapped(double angle) {
  return std::remainder(angle, 2.0 * kPi);
}

Vector3d shaftOf(double tilt, double azimuth) {
  return {std::sin(tilt) * std::cos(azimuth), std::sin(tilt) * std::sin(azimuth), std::cos(tilt)};
}

}  // namespace

PenMapping::PenMapping(const TabletParameters& parameters, const TabletSize& size,
                       const BrushOnSheet& brush)
    : parameters_(parameters), size_(size), brush_(brush) {
  checkParameters(parameters);
  const TabletAreaParameters& area = parameters.area;
  std::vector<std::string> problems;
  const auto text = [](double value) { return parameters_detail::toText(value); };
  if (!(area.left < area.right))
    problems.push_back("area/left = " + text(area.left) +
                       " is not below area/right = " + text(area.right));
  if (!(area.bottom < area.top))
    problems.push_back("area/bottom = " + text(area.bottom) +
                       " is not below area/top = " + text(area.top));
  if (area.fit == "true_size" && !size.is_known)
    problems.push_back(
        "area/fit = true_size needs device/width or device/height: the tablet does not say how large it "
        "is");
  if (!problems.empty()) throw ParameterError(problems);

  const int quarter_turns = area.rotation == "90"    ? 1
                            : area.rotation == "180" ? 2
                            : area.rotation == "270" ? 3
                                                     : 0;
  turn_ = 0.5 * kPi * quarter_turns;
  // Whole numbers: a quarter turn by cosines would leave 1e-17.
  constexpr int cosine[] = {1, 0, -1, 0};
  const int c = cosine[quarter_turns], s = cosine[(quarter_turns + 3) % 4];
  turning_ << c, -s, s, c;
  middle_ = {0.5 * (area.left + area.right) * size.width, 0.5 * (area.bottom + area.top) * size.height};
  const Vector2d used((area.right - area.left) * size.width, (area.top - area.bottom) * size.height);
  const Vector2d turned = (turning_ * used).cwiseAbs();
  const double by_width = brush.width / turned.x(), by_height = brush.height / turned.y();
  scale_ = area.fit == "whole"   ? std::min(by_width, by_height)
           : area.fit == "cover" ? std::max(by_width, by_height)
                                 : 1.0;
  contact_.fill(parameters.pressure.contact_distance);
  posture_.level = -parameters.pressure.clearance;
  posture_.shaft = shaft_target_ = shaftOf(parameters.grip.tilt, parameters.grip.azimuth);
  posture_.twist = parameters.grip.twist;
  half_way_ = {posture_.shaft, posture_.twist};
}

Vector2d PenMapping::placeOnSheet(double x, double y) const {
  return Vector2d(0.5 * brush_.width, 0.5 * brush_.height) +
         scale_ * (turning_ * (Vector2d(x, y) - middle_));
}

double PenMapping::pressedLevel(double pressure) const {
  const TabletPressureParameters& p = parameters_.pressure;
  const double q = std::clamp((pressure - p.threshold) / (1.0 - p.threshold), 0.0, 1.0);
  const double x = std::min(1.0, q / p.touch);
  return p.full_depth * brush_.tip_length * std::pow(q, p.gamma) -
         p.clearance * (1.0 - x * x * (3.0 - 2.0 * x));
}

double PenMapping::hoverLevel(double distance, double contact) const {
  const TabletPressureParameters& p = parameters_.pressure;
  const double beyond = contact < 1.0 ? std::max(0.0, (distance - contact) / (1.0 - contact)) : 0.0;
  return -p.clearance - p.hover_height * beyond;
}

/// Level after a time [s] in which it shall become `target`, as a tuft bears it.
double PenMapping::levelAfter(double seconds, double target) {
  const TabletPressureParameters& p = parameters_.pressure;
  // In short steps, so that it does not depend on the rate of the reports.
  const double time = std::min(seconds, kLongestFall);
  const int count = std::max(1, static_cast<int>(std::ceil(time / kFallStep)));
  const double step = time / count;
  double level = posture_.level;
  if (level < target) speed_ = std::max(speed_, 0.0);
  for (int k = 0; k < count && level < target; ++k) {
    const double into = p.press_speed + std::max(0.0, -level) / p.settle;
    speed_ = std::min({speed_ + kFallAcceleration * step, into, (target - level) / p.settle});
    level += speed_ * step;
  }
  if (level < target) return level;
  speed_ = std::min(speed_, 0.0);
  if (!has_posed_) return target;
  for (int k = 0; k < count; ++k) {
    // As fast as it can brake, at last with the time constant.
    const double way = level - target, slow = kBraking * kRise * kRise;
    const double most = way < slow ? way / kRise : std::sqrt(kBraking * (2.0 * way - slow));
    speed_ = std::max(speed_ - kRiseAcceleration * step, -most);
    level += speed_ * step;
  }
  return level;
}

/// How deep the tuft was bent in the last touch, as far as it has not forgotten it [m].
double PenMapping::bendAt(std::int64_t stamp_ns) const {
  return bend_ * std::exp(-std::max(0.0, 1e-9 * static_cast<double>(stamp_ns - touch_ns_)) / kBend);
}

Vector3d PenMapping::wantedShaft(const PenSample& sample) const {
  if (!sample.tilt_x || !sample.tilt_y) return shaft_target_;
  // Short of a right angle, where the tangent has no value.
  constexpr double limit = 1.5;
  const Vector2d lean(std::tan(std::clamp(*sample.tilt_x, -limit, limit)),
                      -std::tan(std::clamp(*sample.tilt_y, -limit, limit)));
  const double tilt = std::min(parameters_.tilt.gain * std::atan(lean.norm()), parameters_.tilt.max);
  const Vector2d turned = turning_ * lean;
  return shaftOf(tilt, std::atan2(turned.y(), turned.x()));
}

double PenMapping::wantedTwist(const PenSample& sample) const {
  // Clockwise in a tablet that is itself turned counterclockwise.
  return parameters_.grip.twist + (sample.rotation ? turn_ - *sample.rotation : 0.0);
}

double PenMapping::wantedLevel(const PenSample& sample, const Vector2d& place, std::int64_t stamp_ns) {
  const bool is_pen = sample.tool == PenTool::kPen;
  const double interval = 1e-9 * static_cast<double>(std::max(kLeastInterval_ns, stamp_ns - stamp_ns_));
  const double swing = has_posed_ ? kSwing * (place - posture_.place).norm() / interval : 0.0;
  swing_ += -std::expm1(-interval / (swing > swing_ ? kSwing : kSwingMemory)) * (swing - swing_);
  double& contact = contact_[is_pen ? 0 : 1];
  if (!sample.touching) {
    // 0 at once, 1 after kLift, and gone after some of it.
    const double since = 1e-9 * static_cast<double>(stamp_ns - touch_ns_);
    const double x = std::clamp(since / kLift, 0.0, 50.0);
    return hoverLevel(sample.distance.value_or(0.0), contact) -
           parameters_.pressure.lift * (swing_ + bend_ * x * std::exp(1.0 - x));
  }
  if (sample.distance) contact = *sample.distance;
  if (!is_pen || is_away_) return pressedLevel(0.0);
  bend_ = std::max(bendAt(stamp_ns), std::max(0.0, posture_.level));
  touch_ns_ = stamp_ns;
  return pressedLevel(sample.pressure);
}

std::int64_t PenMapping::nextStamp(std::int64_t stamp_ns) {
  stamp_ns += clock_offset_ns_;
  if (!has_posed_) return stamp_ns;
  if (stamp_ns < stamp_ns_ - kClockStep_ns) {
    const std::int64_t next_ns = stamp_ns_ + kHold_ns;
    clock_offset_ns_ += next_ns - stamp_ns;
    stamp_ns = next_ns;
  }
  return std::max(stamp_ns, stamp_ns_ + kLeastInterval_ns);
}

/// The stamp, or as much later as the brush needs for the way: two reports may be stamped 1 ms apart,
/// and a lift in that time is a jump.
std::int64_t PenMapping::afterWay(std::int64_t stamp_ns, const Posture& wanted) const {
  const double way = (wanted.place - posture_.place).norm() + std::abs(wanted.level - posture_.level);
  return std::max(stamp_ns, stamp_ns_ + static_cast<std::int64_t>(1e9 * std::min(way / kTopSpeed, 1.0)));
}

HandlePose PenMapping::poseOf(const Posture& posture, std::int64_t stamp_ns) const {
  const double length = brush_.tip_length;
  const double depth = std::max(0.0, posture.level), height = std::max(0.0, -posture.level);
  const Vector3d& u = posture.shaft;
  HandlePose pose;
  pose.stamp_ns = stamp_ns;
  pose.position = Vector3d(posture.place.x(), posture.place.y(), height) + (length - depth) * u -
                  brush_.sag * length * (u.z() * u - Vector3d::UnitZ());
  pose.orientation = Quaterniond::FromTwoVectors(Vector3d::UnitZ(), u) *
                     Quaterniond(Eigen::AngleAxisd(posture.twist, Vector3d::UnitZ()));
  pose.orientation.normalize();
  return pose;
}

/// A pose of the brush on its way to where the sample sends it.
void PenMapping::follow(const PenSample& sample, const Vector2d& place, std::int64_t stamp_ns,
                        PenActions& actions) {
  Posture wanted;
  wanted.place = place;
  wanted.level = wantedLevel(sample, place, stamp_ns);
  shaft_target_ = wantedShaft(sample);
  const double twist_target = wantedTwist(sample);
  const double since = 1e-9 * static_cast<double>(std::max(kLeastInterval_ns, stamp_ns - stamp_ns_));
  wanted.level = levelAfter(since, wanted.level);
  // Exact for a target that is constant between two reports, so it does not depend on their rate.
  const double share = has_posed_ && parameters_.tilt.smoothing > 0.0
                           ? -std::expm1(-since / parameters_.tilt.smoothing)
                           : 1.0;
  const auto approach = [share](auto& from, const Vector3d& shaft, double twist) {
    from.shaft = (from.shaft + share * (shaft - from.shaft)).normalized();
    from.twist += share * wrapped(twist - from.twist);
  };
  approach(half_way_, shaft_target_, twist_target);
  wanted.shaft = posture_.shaft;
  wanted.twist = posture_.twist;
  approach(wanted, half_way_.shaft, half_way_.twist);
  const auto isFar = [&wanted](const auto& other) {
    return (other.shaft - wanted.shaft).norm() + std::abs(other.twist - wanted.twist) > kStillTurn;
  };
  is_still_ =
      std::abs(wanted.level - posture_.level) <= kStillWay && !isFar(half_way_) && !isFar(posture_);
  if (has_posed_) stamp_ns = afterWay(stamp_ns, wanted);
  posture_ = wanted;
  stamp_ns_ = stamp_ns;
  has_posed_ = true;
  actions.poses.push_back(poseOf(posture_, stamp_ns_));
}

/// Poses of a brush that nobody has reported on and that goes on to where the last report sent it, up to
/// a time by the clock of the poses.
void PenMapping::rest(std::int64_t until_ns, PenActions& actions) {
  if (!has_posed_) return;
  if (is_away_) {
    // Its tuft straightens.
    if (is_still_ || until_ns - stamp_ns_ <= kPause_ns) return;
    is_still_ = true;
    stamp_ns_ += kPause_ns;
    actions.poses.push_back(poseOf(posture_, stamp_ns_));
    return;
  }
  // The first ends the motion before the pause.
  const std::int64_t last_ns = std::min(until_ns - kPause_ns, reported_ns_ + kLongestRest_ns);
  while ((!is_still_ || stamp_ns_ == reported_ns_) && stamp_ns_ < last_ns)
    follow(sample_, placeOnSheet(sample_.x, sample_.y), stamp_ns_ + kHold_ns, actions);
}

/// The same up to the end of a pause; way: to the next place [m].
void PenMapping::hold(std::int64_t until_ns, double way, PenActions& actions) {
  rest(until_ns, actions);
  if (!has_posed_ || is_away_ || until_ns - reported_ns_ <= kPause_ns) return;
  const auto leaves_ns =
      until_ns - std::max(kHold_ns, static_cast<std::int64_t>(1e9 * std::min(way / kHoldSpeed, 60.0)));
  if (leaves_ns < stamp_ns_ + kLeastInterval_ns) return;
  stamp_ns_ = leaves_ns;
  actions.poses.push_back(poseOf(posture_, stamp_ns_));
}

PenActions PenMapping::rest(std::int64_t now_ns) {
  PenActions actions;
  rest(now_ns + clock_offset_ns_, actions);
  return actions;
}

PenActions PenMapping::take(const PenSample& sample) {
  PenActions actions;
  if (sample.tool == PenTool::kNone) {
    buttons_ = {};
    eraser_touched_ = false;
    return leave(sample.stamp_ns);
  }

  const std::array<bool, 3> buttons{sample.stylus, sample.stylus2, sample.stylus3};
  const char* const names[] = {"stylus", "stylus2", "stylus3"};
  for (std::size_t k = 0; k < buttons.size(); ++k) {
    if (!buttons[k] || buttons_[k]) continue;
    actions.dips = actions.dips || parameters_.buttons.dip == names[k];
    actions.wipes = actions.wipes || parameters_.buttons.wipe == names[k];
    actions.clears = actions.clears || parameters_.buttons.clear == names[k];
  }
  buttons_ = buttons;
  const bool eraser_touches = sample.tool == PenTool::kEraser && sample.touching;
  if (eraser_touches && !eraser_touched_ && parameters_.buttons.eraser_wipes) actions.wipes = true;
  eraser_touched_ = eraser_touches;
  if (!sample.has_position) return actions;

  const std::int64_t stamp_ns = nextStamp(sample.stamp_ns);
  if (is_away_) path_.restart();
  Vector2d place = placeOnSheet(sample.x, sample.y);
  if (parameters_.device.even_out) place = path_.take(stamp_ns, place);
  hold(stamp_ns, (place - posture_.place).norm(), actions);
  follow(sample, place, stamp_ns, actions);
  sample_ = sample;
  reported_ns_ = stamp_ns_;
  is_away_ = false;
  return actions;
}

PenActions PenMapping::leave(std::int64_t stamp_ns) {
  PenActions actions;
  if (is_away_) return actions;
  const std::int64_t leaving_ns = nextStamp(stamp_ns);
  hold(leaving_ns, 0.0, actions);
  // Where it stays, so that its tuft comes to rest in the air.
  const double target =
      std::min(posture_.level,
               -parameters_.pressure.clearance - parameters_.pressure.lift * bendAt(leaving_ns));
  for (std::int64_t next_ns = leaving_ns; !is_away_; next_ns += kLeavingStep_ns) {
    const double level = levelAfter(1e-9 * static_cast<double>(next_ns - stamp_ns_), target);
    is_away_ = level - target <= kThere;
    posture_.level = is_away_ ? target : level;
    stamp_ns_ = next_ns;
    actions.poses.push_back(poseOf(posture_, stamp_ns_));
  }
  is_still_ = false;
  return actions;
}

}  // namespace calligraphy_brush
