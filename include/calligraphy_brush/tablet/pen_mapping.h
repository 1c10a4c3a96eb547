#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/tablet/report_clock.h"
#include "calligraphy_brush/tablet/tablet_decoder.h"
#include "calligraphy_brush/tablet/tablet_parameters.h"

namespace calligraphy_brush {

/// What the pen writes with and on.
struct BrushOnSheet {
  double tip_length = 0.045;  ///< from the handle's origin to the point of the tuft [m]
  /// How far the tuft's own weight lowers its point when the shaft is level, over tip_length.
  double sag = 0.0;
  double width = 0.3;   ///< of the sheet [m]
  double height = 0.3;  ///< of the sheet [m]
};

/// What follows from one sample.
struct PenActions {
  std::vector<HandlePose> poses;  ///< in the paper frame, later than all before; mostly one
  bool dips = false;              ///< the brush shall be dipped after these poses
  bool wipes = false;
  bool clears = false;
};

/// From a pen on a tablet to a brush on a sheet.
///
/// The place (x, y) on the sheet is that of the pen's tip: the part of the tablet that is used, turned
/// as the tablet is, scaled by one number. u: direction up the shaft, from the tilts
///   u ∝ (tan t_x, −tan t_y, 1),
/// since the tilts are the angles of its projections (W3C Pointer Events 3, section 4.1.3), turned as
/// the tablet is and twice low-passed: tablets report whole degrees, and some err by tens of them for a
/// report. With L the tip's length, d the pressed depth and h the height, one of them 0,
///   p_PH = (x, y, h) + (L − d) u − s L (u_z u − e_z),
/// R_PH = the shortest rotation from e_z to u after a turn about e_z. The last term is what the weight
/// of a thin tuft at rest does to its point: normal to the shaft by s L sin(tilt).
///
/// Height and depth are one number, the level d − h. With the pressure q over the threshold, 0..1, S(x)
/// = x² (3 − 2 x) up to 1 beyond x = 1, and the distance D it is
///   full_depth L q^gamma − clearance (1 − S(q / touch))   of a touching pen,
///   −clearance − hover_height max(0, (D − contact) / (1 − contact))   of one in the air.
/// So it is continuous: q → 0 and distance → contact meet at −clearance, and a tablet without distance
/// stays there. `contact` is what the tablet reported in the last touch.
///
/// That is the target l*. Up the level l goes to it at 100 m/s² at most, brakes as gently where the
/// target rests, and ends with a time constant of 4 ms: a tuft that is jerked up, or stopped, is flung
/// apart by its inertia, and rods that ink holds hang in knots for long after. One that is thrown down
/// hangs back, swings through, hits the sheet splayed and leaves it again; so down it goes at a speed
/// v ≥ 0 that grows by 5 m/s² at most, with
///   v ≤ (l* − l) / settle,   v ≤ press_speed + max(0, −l) / settle:
/// it is slowed on the way to the sheet and to its depth, and in the sheet never faster than
/// press_speed. From the clearance to the sheet that takes about 55 ms; the place is not delayed.
///
/// In the air the level lies further up by lift (w + b x e^(1 − x)): b, how deep the tuft was in the
/// last touch (fading in 50 ms), x, the time since in 15 ms: it springs down as it straightens; w, what
/// it swings by when it is carried, 10 ms of the speed of the place, low-passed.
///
/// The eraser never writes; nor does the first report of a pen that arrives touching: it would draw a
/// line through the air. A pen that leaves is lifted from where it was, at the x = 1 of its touch, by a
/// pose every 4 ms until it is up. In a pause of more than 50 ms, which a tablet makes that has nothing
/// new to say, the brush goes on to where the last report sent it, by a pose every 8 ms until it is
/// there, and stays to the end of the pause; that of a pen that has left gets one more pose, after 50 ms
/// in which its tuft straightens. Poses are at least 1 ms apart: reports that the kernel got at once
/// would be a jump. A clock set back by more than a second goes on from where it was.
class PenMapping {
 public:
  /// Throws ParameterError: parameters out of range, an area without extent, true size of a tablet whose
  /// size is not known.
  PenMapping(const TabletParameters& parameters, const TabletSize& size, const BrushOnSheet& brush);

  /// A sample without a position gives no pose, nor do those after the one with which the pen left.
  PenActions take(const PenSample& sample);

  /// The tablet is gone: lifts the brush if there was one on it.
  PenActions leave(std::int64_t stamp_ns);

  /// Poses of a pause so far, for those who wait: nothing, or what the next take() would begin with. Time
  /// in the clock of the samples [ns].
  PenActions rest(std::int64_t now_ns);

  /// Where a place on the tablet is on the sheet [m].
  Eigen::Vector2d placeOnSheet(double x, double y) const;

  /// Level [m] of a touching pen; continuous, rising, −clearance for none, full_depth · L for 1.
  double pressedLevel(double pressure) const;
  /// Level [m] of a pen in the air, at the distance that a touching pen reports.
  double hoverLevel(double distance, double contact) const;

 private:
  struct Posture {
    Eigen::Vector2d place = Eigen::Vector2d::Zero();   // on the sheet [m]
    double level = 0.0;                                // [m]
    Eigen::Vector3d shaft = Eigen::Vector3d::UnitZ();  // u
    double twist = 0.0;                                // [rad]
  };
  /// Between the two low-passes.
  struct Lean {
    Eigen::Vector3d shaft = Eigen::Vector3d::UnitZ();
    double twist = 0.0;
  };

  Eigen::Vector3d wantedShaft(const PenSample& sample) const;
  double wantedTwist(const PenSample& sample) const;
  double wantedLevel(const PenSample& sample, const Eigen::Vector2d& place, std::int64_t stamp_ns);
  double levelAfter(double seconds, double target);
  double bendAt(std::int64_t stamp_ns) const;
  std::int64_t nextStamp(std::int64_t stamp_ns);
  std::int64_t afterWay(std::int64_t stamp_ns, const Posture& wanted) const;
  HandlePose poseOf(const Posture& posture, std::int64_t stamp_ns) const;
  void follow(const PenSample& sample, const Eigen::Vector2d& place, std::int64_t stamp_ns,
              PenActions& actions);
  void rest(std::int64_t until_ns, PenActions& actions);
  void hold(std::int64_t until_ns, double way, PenActions& actions);

  TabletParameters parameters_;
  TabletSize size_;
  BrushOnSheet brush_;
  double turn_ = 0.0;                                      // of the tablet [rad]
  double scale_ = 1.0;                                     // sheet over tablet
  Eigen::Matrix2d turning_ = Eigen::Matrix2d::Identity();  // by turn_
  Eigen::Vector2d middle_ = Eigen::Vector2d::Zero();       // of the part that is used [m]

  EvenPath path_;
  Posture posture_;
  Lean half_way_;
  Eigen::Vector3d shaft_target_ = Eigen::Vector3d::UnitZ();
  std::array<double, 2> contact_{};  // of pen and eraser
  std::array<bool, 3> buttons_{};    // stylus, stylus2, stylus3
  bool eraser_touched_ = false;
  double speed_ = 0.0;         // at which the brush goes down [m/s]
  double swing_ = 0.0;         // height for the swing of a tuft that is carried fast [m]
  double bend_ = 0.0;          // depth of the last touch, fading from report to report [m]
  std::int64_t touch_ns_ = 0;  // when it was
  bool has_posed_ = false;
  bool is_away_ = true;
  bool is_still_ = false;             // a brush that is where it shall be
  PenSample sample_;                  // the last one that had a position
  std::int64_t reported_ns_ = 0;      // of its pose
  std::int64_t stamp_ns_ = 0;         // of the newest pose
  std::int64_t clock_offset_ns_ = 0;  // added to all stamps
};

}  // namespace calligraphy_brush
