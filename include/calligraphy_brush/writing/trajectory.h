#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "calligraphy_brush/files/glyph.h"
#include "calligraphy_brush/files/stroke_file.h"
#include "calligraphy_brush/motion/pose_track.h"
#include "calligraphy_brush/writing/brush_curve.h"
#include "calligraphy_brush/writing/writing_parameters.h"

namespace calligraphy_brush {

/// Stamp of the first pose of a written trajectory [ns]: fixed, so that a bag of it is always the same.
constexpr std::int64_t kWritingEpoch_ns = 1'000'000'000;

/// Orientation R_PH of a handle whose upper end leans by `tilt` [rad] from the vertical towards
/// `azimuth` [rad, from +x towards +y] and that is then turned by `twist` [rad] about its shaft.
/// No tilt and no twist give the identity, whatever the azimuth.
Eigen::Quaterniond handleOrientation(double tilt, double azimuth, double twist);

/// Pose of the handle for a stroke point: the point of the undeformed brush is over (x, y), and the
/// handle's origin at the height tip_length − depth. tip_length [m] is BrushModel::tip_length.
/// The stamp is 0; a point without a depth counts as depth 0.
HandlePose handlePoseAt(const StrokePoint& point, double tip_length);

/// Poses of the handle, at a constant rate, that write the strokes.
///
/// The handle follows a C1 curve through the points: a centripetal Catmull–Rom spline (Yuksel,
/// Schaefer & Keyser 2011) with tangents limited so that depth and lean do not overshoot and a point
/// given twice is a stop. Its speed is the wanted one, less in turns and near the ends of the whole
/// motion, under WritingParameters::acceleration. Where times are given the points are reached at those
/// times, and a point whose time is a multiple of 1/rate is one of the poses.
///
/// A stroke that does not begin (end) in the air, depth < 0, gets an approach (lift-off): from (to)
/// `clearance` above the sheet, along the stroke by `run` × the height difference.
///
/// Strokes given by width need `curve`, and the inverse of it gives the depth (+ what a tilt lifts the
/// tip). With lag_compensation the handle goes to p + a t, where p is the place on the mark, t its
/// direction averaged over turn_length, and
///   a = min(lag(depth) (lead + (1 − lead) exp(−s / lag(depth))), L − s),
/// s: length of the mark up to p, L: of all of it. So the tuft lies on the mark from the start, trails
/// behind the handle in turns as a trailer does, and the handle ends over the end of the mark. At both
/// ends the brush is pressed and raised with p in place. Wider than curve->maxWidth() is written with
/// that.
///
/// Throws ParameterError (parameters out of range) and std::invalid_argument: no strokes, a stroke by
/// width without a curve, a stroke without points, a time that would need more than 5 m/s.
std::vector<HandlePose> planHandlePoses(const std::vector<Stroke>& strokes,
                                        const WritingParameters& parameters, double tip_length,
                                        const BrushCurve* curve = nullptr);

/// Strokes by width of a character, from measureStroke. size: side of the em square [m]; origin: place
/// of its lower left corner in the paper frame [m]; the other fields of the points are as in `defaults`.
std::vector<Stroke> strokesOfGlyph(const Glyph& glyph, double size, const Eigen::Vector2d& origin,
                                   const StrokePoint& defaults);

}  // namespace calligraphy_brush
