#include "calligraphy_brush/score/stroke_scores.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "calligraphy_brush/sim/simulator.h"

namespace calligraphy_brush {

GreyPicture simulatePicture(const SimulatorParameters& parameters,
                            const std::vector<HandlePose>& poses) {
  Simulator simulator(parameters);
  for (const HandlePose& pose : poses) {
    if (simulator.addPose(pose) != PoseVerdict::kAccepted)
      throw std::runtime_error("the simulator refuses a pose, that at " +
                               std::to_string(1e-9 * static_cast<double>(pose.stamp_ns)) + " s");
    simulator.advance();
  }
  GreyPicture picture{simulator.paper().width_px(), simulator.paper().height_px(), {}};
  simulator.paper().render(picture.mono8);
  return picture;
}

void forEachInParallel(std::size_t count, int threads, const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex mutex;
  const auto run = [&] {
    for (std::size_t k = next++; k < count; k = next++) {
      try {
        work(k);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!failure) failure = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::thread> workers;
  for (int k = 1; k < threads; ++k) workers.emplace_back(run);
  run();
  for (std::thread& worker : workers) worker.join();
  if (failure) std::rethrow_exception(failure);
}

Likeness compare(const GreyPicture& wanted, const GreyPicture& written, double px_per_mm,
                 double reach_mm) {
  const Mask a = maskOf(wanted, px_per_mm), b = maskOf(written, px_per_mm);
  return {intersectionOverUnion(a, b), registered(a, b, reach_mm), cosineLikeness(wanted, written),
          chamferDistance_mm(a, b)};
}

ApexLag apexLag(const RecordedStroke& stroke, const Mask& trace, const Eigen::Vector2d& origin_mm) {
  // The curves start and end on the x axis: their apex is where they are furthest from it.
  double apex_t = 0.5, furthest = -1.0;
  constexpr int kSamples = 200;
  for (int k = 0; k <= kSamples; ++k) {
    const double t = static_cast<double>(k) / kSamples;
    const double away = std::abs(stroke.placeAt(t).y());
    if (away > furthest) {
      furthest = away;
      apex_t = t;
    }
  }
  const Eigen::Vector2d apex_mm = origin_mm + 1e3 * stroke.placeAt(apex_t);
  const ColumnExtent extent = columnExtent(trace, apex_mm.x());
  if (!extent.inked) return {};
  const double outwards = apex_mm.y() > origin_mm.y() ? 1.0 : -1.0;
  return {true, outwards * (apex_mm.y() - 0.5 * (extent.low_mm + extent.high_mm))};
}

std::vector<RecordedScore> scoreRecorded(const RecordedSet& set, const std::vector<std::size_t>& indices,
                                         SimulatorParameters parameters, const ArmMotion& motion,
                                         double px_per_mm, int threads) {
  constexpr double kReach_mm = 4.0;
  parameters.paper.width = set.width();
  parameters.paper.height = set.height();
  parameters.paper.px_per_mm = px_per_mm;
  const double tip_length = makeBrush(parameters.brush).tip_length;
  std::vector<RecordedScore> scores(indices.size());
  forEachInParallel(indices.size(), threads, [&](std::size_t k) {
    const RecordedStroke& stroke = set.strokes.at(indices[k]);
    RecordedScore& score = scores[k];
    score.number = stroke.number;
    score.depth_mm = 1e3 * stroke.middleDepth();
    score.bend_mm = 1e3 * stroke.bend();
    score.strongly_curved = std::abs(score.bend_mm) >= kStrongBend_mm;
    score.simulated =
        simulatePicture(parameters, posesOf(stroke, motion, set.origin(), 0.0, tip_length));
    const Mask photograph = photographOf(set, indices[k], px_per_mm);
    // Sides differ by a pixel where the tile is not a whole number of them: both from below left.
    score.recorded = {score.simulated.width_px, score.simulated.height_px,
                      std::vector<std::uint8_t>(score.simulated.mono8.size(), 255)};
    const int rows = std::min(photograph.height_px, score.recorded.height_px);
    for (int y = 0; y < rows; ++y)
      for (int x = 0; x < std::min(photograph.width_px, score.recorded.width_px); ++x)
        if (photograph.at(x, photograph.height_px - 1 - y))
          score.recorded.mono8[static_cast<std::size_t>(score.recorded.height_px - 1 - y) *
                                   static_cast<std::size_t>(score.recorded.width_px) +
                               static_cast<std::size_t>(x)] = 0;
    score.likeness = compare(score.recorded, score.simulated, px_per_mm, kReach_mm);
    const Mask simulated = maskOf(score.simulated, px_per_mm),
               recorded = maskOf(score.recorded, px_per_mm);
    score.width_recorded_mm = widestLine_mm(recorded);
    score.width_simulated_mm = widestLine_mm(withoutHoles(simulated));
    score.lag_recorded = apexLag(stroke, recorded, 1e3 * set.origin());
    score.lag_simulated = apexLag(stroke, simulated, 1e3 * set.origin());
  });
  return scores;
}

RecordedSummary summarise(const std::vector<RecordedScore>& scores) {
  std::vector<double> iou, registered_iou, cosine, chamfer, depth, recorded, simulated, lag_recorded,
      lag_simulated;
  RecordedSummary sum;
  int inside_recorded = 0, inside_simulated = 0;
  for (const RecordedScore& score : scores) {
    iou.push_back(score.likeness.iou);
    registered_iou.push_back(score.likeness.registered.iou);
    cosine.push_back(score.likeness.cosine);
    if (std::isfinite(score.likeness.chamfer_mm)) chamfer.push_back(score.likeness.chamfer_mm);
    depth.push_back(score.depth_mm);
    recorded.push_back(score.width_recorded_mm);
    simulated.push_back(score.width_simulated_mm);
    if (!score.strongly_curved) continue;
    ++sum.curved;
    if (score.lag_recorded.measured) lag_recorded.push_back(score.lag_recorded.lag_mm);
    if (score.lag_simulated.measured) lag_simulated.push_back(score.lag_simulated.lag_mm);
    inside_recorded += score.lag_recorded.measured && score.lag_recorded.lag_mm > 0;
    inside_simulated += score.lag_simulated.measured && score.lag_simulated.lag_mm > 0;
  }
  sum.iou = mean(iou);
  sum.registered = mean(registered_iou);
  sum.cosine = mean(cosine);
  sum.chamfer_mm = mean(chamfer);
  sum.width_depth_recorded = correlation(depth, recorded);
  sum.width_depth_simulated = correlation(depth, simulated);
  sum.width_width = correlation(recorded, simulated);
  sum.inside_recorded = sum.curved > 0 ? double(inside_recorded) / sum.curved : 0.0;
  sum.inside_simulated = sum.curved > 0 ? double(inside_simulated) / sum.curved : 0.0;
  sum.lag_recorded_mm = quantile(lag_recorded, 0.5);
  sum.lag_simulated_mm = quantile(lag_simulated, 0.5);
  return sum;
}

GreyPicture contactSheet(const std::vector<GreyPicture>& pictures, int columns) {
  if (pictures.empty() || columns < 1) throw std::invalid_argument("a contact sheet needs a picture");
  const int width = pictures.front().width_px, height = pictures.front().height_px;
  const int count = static_cast<int>(pictures.size());
  columns = std::min(columns, count);
  const int rows = (count + columns - 1) / columns;
  constexpr int kLine = 2;
  GreyPicture sheet{columns * (width + kLine) + kLine, rows * (height + kLine) + kLine, {}};
  sheet.mono8.assign(
      static_cast<std::size_t>(sheet.width_px) * static_cast<std::size_t>(sheet.height_px), 128);
  const std::vector<std::uint8_t> blank(pictures.front().mono8.size(), 255);
  for (int k = 0; k < rows * columns; ++k) {
    const GreyPicture& picture = k < count ? pictures[static_cast<std::size_t>(k)] : pictures.front();
    const std::vector<std::uint8_t>& grey = k < count ? picture.mono8 : blank;
    if (picture.width_px != width || picture.height_px != height)
      throw std::invalid_argument("pictures of a contact sheet have different sizes");
    const int left = kLine + k % columns * (width + kLine), top = kLine + k / columns * (height + kLine);
    for (int row = 0; row < height; ++row)
      std::copy_n(grey.begin() + static_cast<std::ptrdiff_t>(row) * width, width,
                  sheet.mono8.begin() + static_cast<std::ptrdiff_t>(top + row) * sheet.width_px + left);
  }
  return sheet;
}

GreyPicture overlay(const GreyPicture& first, const GreyPicture& second) {
  if (first.width_px != second.width_px || first.mono8.size() != second.mono8.size())
    throw std::invalid_argument("pictures of different sizes are laid over each other");
  GreyPicture both = first;
  for (std::size_t k = 0; k < both.mono8.size(); ++k) {
    const bool a = first.mono8[k] < 128, b = second.mono8[k] < 128;
    both.mono8[k] = a && b ? 0 : a ? 100 : b ? 190 : 255;
  }
  return both;
}

}  // namespace calligraphy_brush
