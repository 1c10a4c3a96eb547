#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>

#include "calligraphy_brush/tablet/tablet_description.h"
#include "calligraphy_brush/tablet/tablet_parameters.h"

namespace calligraphy_brush {

enum class PenTool { kNone, kPen, kEraser };

/// What a pen tablet said in one report, in SI units.
///
/// Axes of the tablet: x to the right and y up (away from the writer), from the lower left corner of its
/// active area. While the tool is kNone everything but the stamp is as it was before.
struct PenSample {
  std::int64_t stamp_ns = 0;
  PenTool tool = PenTool::kNone;
  bool has_position = false;  ///< false until the device has said where the pen is
  double x = 0.0;             ///< [m]
  double y = 0.0;             ///< [m]
  bool touching = false;
  double pressure = 0.0;           ///< over the full one, 0..1
  std::optional<double> distance;  ///< over the full one, 0..1; if the device senses it
  /// Lean of the shaft from the vertical in the x-z plane: its upper end is to the right where positive;
  /// in the y-z plane: towards the writer where positive [rad]. Both or none.
  std::optional<double> tilt_x, tilt_y;
  std::optional<double> rotation;  ///< of the barrel, clockwise from above; 0: buttons point up [rad]
  std::optional<double> wheel;     ///< of an airbrush, 0..1
  bool stylus = false;             ///< the pen's buttons
  bool stylus2 = false;
  bool stylus3 = false;
  std::uint32_t serial = 0;  ///< of the tool; 0 where it has none
};

/// Size of the active area [m].
struct TabletSize {
  double width = 0.0;
  double height = 0.0;
  bool is_known = false;  ///< false where neither device nor parameters say: 0.2 m wide, square units
};

/// The size given, or from the resolutions, or a guess.
TabletSize findTabletSize(const TabletDescription& description,
                          const TabletDeviceParameters& parameters);

/// Events of a pen tablet to samples: state machine over the kernel's protocol (Documentation/input/
/// event-codes.rst). Conversions of tilt and rotation are those of libinput (evdev-tablet.c): an axis
/// with a resolution and a centre in units per radian, any other over full_scale; rotation a full turn
/// over the axis, with the buttons to the right at its minimum.
///
/// Tilt, rotation and wheel count as unknown until the device reports them after a tool has come near:
/// on leaving, Wacom's driver sets every axis to 0, which is a full lean on some, and pens that lack an
/// axis share their device with those that have it.
class TabletDecoder {
 public:
  /// Throws ParameterError (parameters out of range) and std::invalid_argument: not a pen tablet.
  TabletDecoder(const TabletDescription& description, const TabletParameters& parameters);

  /// Takes the next event; a sample for each report (SYN_REPORT).
  ///
  /// After SYN_DROPPED all events up to the next report are part of a report that has lost some: they
  /// are ignored, without sample. The source then tells the state anew, as TabletDevice does; of a
  /// recording, the state is as it was until the next change of each axis.
  std::optional<PenSample> take(const InputEvent& event);

  const TabletSize& size() const { return size_; }
  std::int64_t dropCount() const { return drop_count_; }  ///< SYN_DROPPED so far

 private:
  PenSample report(std::int64_t stamp_ns);
  PenTool tool() const;
  bool isDown(std::uint16_t key) const { return keys_.count(key) != 0; }
  const TabletAxis* axis(std::uint16_t code) const;
  std::optional<double> partOfAxis(std::uint16_t code) const;
  double tilt(std::uint16_t code) const;

  TabletDescription description_;
  TabletParameters parameters_;
  TabletSize size_;
  bool has_tools_ = false;
  bool is_dropping_ = false;
  std::int64_t drop_count_ = 0;
  std::map<std::uint16_t, std::int32_t> values_;  // of the axes, since the start
  std::set<std::uint16_t> fresh_;                 // axes reported since the tool came near
  std::set<std::uint16_t> keys_;                  // that are down
  PenSample sample_;
};

}  // namespace calligraphy_brush
