#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calligraphy_brush/score/metrics.h"
#include "calligraphy_brush/score/recorded_strokes.h"
#include "calligraphy_brush/sim/simulator_parameters.h"

namespace calligraphy_brush {

/// Runs poses through a new simulator and returns the picture. parameters.paper is the sheet. Throws
/// std::runtime_error if a pose is refused.
GreyPicture simulatePicture(const SimulatorParameters& parameters, const std::vector<HandlePose>& poses);

/// Calls work(k) for k = 0 .. count − 1 on up to `threads` threads, in any order. What it throws is
/// thrown again, once all threads have ended.
void forEachInParallel(std::size_t count, int threads, const std::function<void(std::size_t)>& work);

/// How like a picture is to the one wanted.
struct Likeness {
  double iou = 0.0;
  Registration registered;
  double cosine = 0.0;
  double chamfer_mm = 0.0;
};

/// All of it, for pictures of one size; `wanted` is the one that `written` is shifted on, by ±reach_mm.
Likeness compare(const GreyPicture& wanted, const GreyPicture& written, double px_per_mm,
                 double reach_mm);

/// Where the trace is against the path at its apex, the middle of a curve that is bent.
struct ApexLag {
  bool measured = false;
  double lag_mm = 0.0;  ///< of the middle of the ink, at the apex's x, to the inside of the path
};

/// Of a recorded stroke's trace; x and y of the picture from its lower left corner. Not measured where
/// there is no ink at the apex's x.
ApexLag apexLag(const RecordedStroke& stroke, const Mask& trace, const Eigen::Vector2d& origin_mm);

/// A recorded stroke beside the one that was simulated.
struct RecordedScore {
  int number = 0;
  double depth_mm = 0.0, bend_mm = 0.0;
  bool strongly_curved = false;  ///< |bend| ≥ kStrongBend_mm
  Likeness likeness;
  double width_recorded_mm = 0.0, width_simulated_mm = 0.0;  ///< widestLine_mm without holes
  ApexLag lag_recorded, lag_simulated;
  GreyPicture recorded, simulated;
};

/// A path whose middle is at least this far from the line through its ends is strongly curved.
constexpr double kStrongBend_mm = 9.0;

/// Simulates strokes of a set and compares. indices into set.strokes; the sheet is as large as a tile.
std::vector<RecordedScore> scoreRecorded(const RecordedSet& set, const std::vector<std::size_t>& indices,
                                         SimulatorParameters parameters, const ArmMotion& motion,
                                         double px_per_mm, int threads);

/// Means and shares over strokes, the recorded column of what has no simulation beside it.
struct RecordedSummary {
  double iou = 0.0, registered = 0.0, cosine = 0.0, chamfer_mm = 0.0;
  double width_depth_recorded = 0.0, width_depth_simulated = 0.0;  ///< correlations
  double width_width = 0.0;                                        ///< of recorded and simulated widths
  int curved = 0;                                                  ///< strokes strongly curved
  double inside_recorded = 0.0, inside_simulated = 0.0;            ///< share of them
  double lag_recorded_mm = 0.0, lag_simulated_mm = 0.0;            ///< medians over them
};
RecordedSummary summarise(const std::vector<RecordedScore>& scores);

/// Pictures side by side, `columns` a row, with a grey line between them; each is 255 · (paper) and they
/// have one size. Throws std::invalid_argument if not.
GreyPicture contactSheet(const std::vector<GreyPicture>& pictures, int columns);

/// Two pictures over each other: ink of both 0, of the first alone 100, of the second alone 190.
GreyPicture overlay(const GreyPicture& first, const GreyPicture& second);

}  // namespace calligraphy_brush
