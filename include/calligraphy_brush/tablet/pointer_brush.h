#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <vector>

#include "calligraphy_brush/common/parameters.h"
#include "calligraphy_brush/tablet/pen_mapping.h"
#include "calligraphy_brush/tablet/tablet_parameters.h"

namespace calligraphy_brush {

/// How a mouse becomes a pen.
struct PointerMotionParameters {
  double rate = 200.0;
  double delay = 0.05;
  double smoothing = 0.012;
  double press_time = 0.03;
  double max_speed = 3.0;
  double idle_after = 1.0;
  double margin = 0.03;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("rate", self.rate, Range{20.0, 1000.0}, "Hz", "Poses a second while the brush is in use.");
    visit(
        "delay", self.delay, Range{0.0, 0.5}, "s",
        "How far the brush is behind the mouse; gaps between its events up to this are filled evenly.");
    visit(
        "smoothing", self.smoothing, Range{0.0, 0.5}, "s",
        "Time constant of each of the two low-passes that the place runs through; a mouse has corners.");
    visit("press_time", self.press_time, Range{0.001, 0.5}, "s",
          "Time constant of each of the two low-passes that the pressure runs through; a button has no "
          "way.");
    visit("max_speed", self.max_speed, Range{0.01, 4.0}, "m/s",
          "The brush follows no faster than this; a fast hand reaches 3.");
    visit("idle_after", self.idle_after, Range{0.1, 60.0}, "s",
          "After this time without an event, and in the air, there are no more poses.");
    visit("margin", self.margin, Range{0.0, 0.5}, "m", "How far beyond the sheet the brush goes.");
  }
};

/// From a mouse on a sheet to a brush. Unlike a pen's, the grip leans: a mouse is pressed before it
/// moves, and a tuft pressed straight down splays to all sides. Nor does it press so deep: its full
/// pressure is asked for, not reached now and then.
struct PointerBrushParameters {
  PointerBrushParameters() {
    grip.tilt = 0.4;
    pressure.full_depth = 0.3;
    pressure.press_speed = 0.06;
    pressure.lift = 1.5;
  }

  PointerMotionParameters motion;
  TabletPressureParameters pressure;
  TabletGripParameters grip;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit.group("motion", self.motion);
    visit.group("pressure", self.pressure);
    visit.group("grip", self.grip);
  }
};

/// A mouse, which has places and a button at uneven times, as the handle of a brush.
///
/// It is made a pen without tilt that reports at a steady rate, and PenMapping makes poses of that, as
/// of a tablet's. Sample k, at t_k = k / rate since the first event, has
///   place = L_s L_s x(t_k − delay),   pressure = L_p L_p q(t_k − delay),
/// x: the polygon through the places of the events, where after a pause longer than the delay the way
/// begins `delay` before the event that ends it; q: the pressure asked for while the button is down,
/// else 0; L: exact low-pass of first order, so that x and q are twice smoothed: a place has no corners
/// and a pressure no jumps. The place goes no faster than max_speed. The pen touches while pressure is
/// asked for or left.
///
/// Time is an argument: equal events give equal poses. Not thread-safe.
class PointerBrush {
 public:
  /// Throws ParameterError naming each parameter out of range.
  PointerBrush(const PointerBrushParameters& parameters, const BrushOnSheet& brush);

  /// The mouse is at a place of the sheet [m], cut to the margin around it, and asks for a pressure,
  /// 0..1 over the full one; 0 or below: the button is up. False, and nothing is changed, if a number is
  /// not finite. Events earlier than the one before count as at its time.
  bool point(std::int64_t now_ns, const Eigen::Vector2d& place, double pressure);

  /// The button counts as up from now on, wherever the mouse is.
  void release(std::int64_t now_ns);

  /// Poses [paper frame] of all times up to now that are due and were not given yet, evenly spaced. More
  /// than 0.25 s late, the brush is lifted where it is: what follows is written where the mouse is then.
  std::vector<HandlePose> advanceTo(std::int64_t now_ns);

  /// Lifts the brush where it is, and forgets the events.
  std::vector<HandlePose> leave(std::int64_t now_ns);

  bool isInUse() const { return is_in_use_; }
  const BrushOnSheet& brush() const { return brush_; }

 private:
  struct Event {
    std::int64_t stamp_ns;
    Eigen::Vector2d place;
    double pressure;
  };
  struct Aim {
    Eigen::Vector2d place;
    double pressure;
  };
  Aim aimAt(std::int64_t time_ns);
  void follow(const Aim& aim);

  PointerBrushParameters parameters_;
  BrushOnSheet brush_;
  PenMapping mapping_;
  std::int64_t period_ns_;
  std::int64_t delay_ns_;

  bool is_in_use_ = false;
  std::deque<Event> events_;                    // the first is the one before the time last read
  std::int64_t event_ns_ = 0;                   // of the newest that the mouse sent
  std::int64_t next_ns_ = 0;                    // of the next pose
  Aim half_way_{Eigen::Vector2d::Zero(), 0.0};  // between the two low-passes
  Aim reached_{Eigen::Vector2d::Zero(), 0.0};
};

}  // namespace calligraphy_brush
