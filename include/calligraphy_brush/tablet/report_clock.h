#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>

namespace calligraphy_brush {

/// When the reports of a tablet were measured, from when the kernel got them.
///
/// A tablet measures at even intervals; a USB host asks for it at even intervals of its own: an Intuos4
/// that measures every 5 ms is stamped 4, 4, 4, 8 ms apart. Taken as they are, such stamps make of an
/// even motion one whose speed doubles and halves 50 times a second, and the tuft answers to that.
///
/// The time of report k is tracked by an α-β filter: the prediction is one interval T after the report
/// before, e is by how much the stamp is later,
///   t ← prediction + α e,   T ← T + β e,   α = 2 (2k − 1) / (k (k + 1)),   β = 6 / (k (k + 1)),
/// the gains of the least-squares line through k stamps (Brookner 1998, Tracking and Kalman Filtering
/// Made Easy, section 1.2.10), k held at 40: 0.2 s of most tablets. Stamps that are even come out as
/// they are.
class ReportClock {
 public:
  /// Time at which the report with this stamp was measured [ns], later than that before it. After an
  /// interval of more than 50 ms, or when |e| > T + 1 ms since reports were left out, it starts anew at
  /// the stamp.
  std::int64_t take(std::int64_t stamp_ns);
  void restart() { count_ = 0; }

 private:
  int count_ = 0;             // stamps in the fit
  std::int64_t last_ns_ = 0;  // the stamp before
  std::int64_t time_ns_ = 0;  // of the report before
  double interval_ = 0.0;     // [s]
};

/// Places of the pen at the kernel's stamps: the polygon through the places at the times of ReportClock,
/// read a delay before each stamp. The delay is the most by which a stamp came early for its report, so
/// it is a part of an interval, and 0 with even stamps: then places stay as they are.
class EvenPath {
 public:
  /// Place at the stamp, given what the report with that stamp says [m].
  Eigen::Vector2d take(std::int64_t stamp_ns, const Eigen::Vector2d& place);
  void restart();

 private:
  struct Knot {
    std::int64_t time_ns;
    Eigen::Vector2d place;
  };
  ReportClock clock_;
  std::deque<Knot> knots_;
  double delay_ns_ = 0.0;
};

}  // namespace calligraphy_brush
