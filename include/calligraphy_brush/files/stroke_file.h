#pragma once

#include <optional>
#include <string>
#include <vector>

namespace calligraphy_brush {

/// A place that a stroke goes through. Exactly one of depth and width is given.
struct StrokePoint {
  double x = 0.0;               ///< where the point of the undeformed brush is, paper frame [m]
  double y = 0.0;               ///< [m]
  std::optional<double> depth;  ///< how far the handle is below the height at which the tip of the
                                ///< undeformed upright brush just touches; < 0 is in the air [m]
  std::optional<double> width;  ///< width of the line that shall be seen here [m]
  double tilt = 0.0;            ///< angle between shaft and vertical [rad]
  double azimuth = 0.0;         ///< direction in which the upper end leans, from +x towards +y [rad]
  double twist = 0.0;           ///< turn about the shaft, counterclockwise from above [rad]
  double speed = 0.05;          ///< of the handle from here to the next point [m/s]
  std::optional<double> time;   ///< since the stroke's first point [s]
};

/// From touch-down to lift-off. The points have all a depth or all a width: depths are motions of
/// the handle, to be followed exactly; widths are a wanted mark, and the motion is found for them.
struct Stroke {
  std::string name;
  std::vector<StrokePoint> points;
};

/// Reads a stroke file (YAML).
///
///     speed: 0.05            # defaults of the file: speed, tilt, azimuth, twist
///     strokes:
///       - name: dot          # optional; defaults of the stroke as above
///         tilt: 0.1
///         points:
///           - [0.10, 0.20, 0.001]                 # x, y, depth
///           - {x: 0.11, y: 0.19, depth: 0.006, tilt: 0.2, azimuth: 1.0, twist: 0.0, time: 0.4}
///           - {x: 0.12, y: 0.18, width: 0.004}    # or the wanted line width instead of a depth
///       - [[0.10, 0.10, 0.002], [0.15, 0.10, 0.002]]    # a stroke without a name is a list
///
/// The whole file may also be the list of strokes. SI units. A default holds until the innermost
/// place that gives another. Legal: x, y in [−10, 10] m, depth in [−1, 1] m, width in (0, 1] m, tilt
/// in [0, 1.5] rad, azimuth and twist in [−7, 7] rad, speed in [1e-4, 5] m/s, time in [0, 3600] s,
/// rising along the stroke and 0 at its first point; at least one point a stroke and one stroke.
///
/// Throws ParameterError with a line "file:line: what is wrong" for every problem.
std::vector<Stroke> readStrokeFile(const std::string& file);

}  // namespace calligraphy_brush
