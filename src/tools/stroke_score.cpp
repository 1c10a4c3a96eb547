#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "calligraphy_brush/files/atomic_file.h"
#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/score/calibration.h"
#include "calligraphy_brush/score/glyph_scores.h"
#include "calligraphy_brush/score/stroke_scores.h"
#include "command_line.h"

// Runs handle paths through the simulator and scores the pictures against photographs or outlines.

namespace {

namespace po = boost::program_options;
using namespace calligraphy_brush;

struct Arguments {
  std::string recorded, brush, rows, csv, sheet, preset;
  double px_per_mm = 4.0;
  ArmMotion motion;
  double offset_x = 0.0, offset_y = 0.0;
  int threads = 1;
  bool calibrate = false, footprint = false;
  CalibrationOptions calibration;
  int calibration_strokes = 20;
  std::vector<std::string> glyphs;
  GlyphOptions glyph;
  WritingParameters writing;
};

void writeText(const std::string& path, const std::string& text) {
  AtomicFile file(path);
  std::ofstream out(file.temporaryPath(), std::ios::binary);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(path + ": cannot be written");
  file.commit();
}

void writeSheet(const std::string& path, const std::vector<GreyPicture>& pictures, int columns,
                double px_per_mm) {
  const GreyPicture sheet = contactSheet(pictures, columns);
  writePng(path, sheet.width_px, sheet.height_px, sheet.mono8, px_per_mm);
}

std::string numbers(const char* format, std::initializer_list<double> values) {
  std::string line;
  char text[64];
  for (const double value : values) {
    std::snprintf(text, sizeof text, format, value);
    line += (line.empty() ? "" : ",") + std::string(text);
  }
  return line;
}

// ---------------------------------------------------------------- recorded strokes

std::vector<std::size_t> chosenRows(const RecordedSet& set, const std::string& rows) {
  std::vector<std::size_t> chosen;
  constexpr double kGlance = 1.0;  // [px/mm]
  for (std::size_t k = 0; k < set.strokes.size(); ++k) {
    if (rows != "all" && (set.strokes[k].number % 2 != 0) != (rows == "odd")) continue;
    if (photographOf(set, k, kGlance).area_px() == 0)
      std::fprintf(stderr, "stroke %d: the photograph is blank, left out\n", set.strokes[k].number);
    else
      chosen.push_back(k);
  }
  if (chosen.empty()) throw std::runtime_error("no stroke is chosen by --rows " + rows);
  return chosen;
}

/// `count` of the rows, spread evenly over depth: those of equal ranks.
std::vector<std::size_t> spread(const RecordedSet& set, std::vector<std::size_t> rows, int count) {
  if (count >= static_cast<int>(rows.size())) return rows;
  std::stable_sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
    return set.strokes[a].middleDepth() < set.strokes[b].middleDepth();
  });
  std::vector<std::size_t> chosen;
  for (int k = 0; k < count; ++k)
    chosen.push_back(rows[(2 * static_cast<std::size_t>(k) + 1) * rows.size() /
                          (2 * static_cast<std::size_t>(count))]);
  return chosen;
}

void printSummary(const std::vector<RecordedScore>& scores) {
  const RecordedSummary s = summarise(scores);
  std::printf("strokes                                  %zu\n", scores.size());
  std::printf("IoU raw, mean                            %.3f\n", s.iou);
  std::printf("IoU registered by up to 4 mm, mean       %.3f\n", s.registered);
  std::printf("cosine, mean                             %.3f\n", s.cosine);
  std::printf("chamfer, mean                            %.2f mm\n", s.chamfer_mm);
  std::printf("correlation of width and depth           %.3f (photographs %.3f)\n",
              s.width_depth_simulated, s.width_depth_recorded);
  std::printf("correlation of both widths               %.3f\n", s.width_width);
  std::printf("strongly curved: trace inside the path   %.0f %% of %d (photographs %.0f %%)\n",
              100 * s.inside_simulated, s.curved, 100 * s.inside_recorded);
  std::printf("strongly curved: lag at the apex, median %.1f mm (photographs %.1f mm)\n",
              s.lag_simulated_mm, s.lag_recorded_mm);
  std::printf("median widest line by depth, mm:");
  for (int bin = 0; bin < 6; ++bin) {
    std::vector<double> simulated, recorded;
    for (const RecordedScore& score : scores)
      if (std::min(5, static_cast<int>(score.depth_mm / 3.0)) == bin) {
        simulated.push_back(score.width_simulated_mm);
        recorded.push_back(score.width_recorded_mm);
      }
    if (!simulated.empty())
      std::printf("  %d-%d: %.1f (%.1f)", 3 * bin, 3 * bin + 3, quantile(simulated, 0.5),
                  quantile(recorded, 0.5));
  }
  std::printf("\n");
}

void scoreRecordedStrokes(const Arguments& a, SimulatorParameters parameters) {
  const RecordedSet set = readRecordedSet(a.recorded);
  ArmMotion motion = a.motion;
  motion.offset = {a.offset_x, a.offset_y};
  if (a.calibrate) {
    const std::vector<std::size_t> rows = spread(set, chosenRows(set, "even"), a.calibration_strokes);
    constexpr double kCoarse = 2.0;  // [px/mm]
    const std::vector<FittedParameter> fitted = defaultFittedParameters();
    int count = 0;
    double best = -1.0;
    const CalibrationResult result = calibrate(
        parameters, fitted,
        [&](const SimulatorParameters& tried) {
          std::vector<double> iou;
          for (const RecordedScore& score : scoreRecorded(set, rows, tried, motion, kCoarse, a.threads))
            iou.push_back(score.likeness.iou);
          const double value = mean(iou);
          ++count;
          if (value > best) {
            best = value;
            std::fprintf(stderr, "%4d  %.4f ", count, value);
            for (const FittedParameter& p : fitted)
              std::fprintf(stderr, " %s %.4g", p.name.c_str(), parameterValue(tried, p.name));
            std::fprintf(stderr, "\n");
          }
          return value;
        },
        a.calibration);
    parameters = result.parameters;
    if (!a.preset.empty())
      writeText(a.preset, presetText(parameters,
                                     "Fitted by stroke_score --calibrate to the even rows of recorded "
                                     "strokes of a brush."));
    std::printf("calibrated on %zu even rows: IoU raw %.3f after %d runs\n", rows.size(), result.value,
                result.evaluations);
  }

  const std::vector<RecordedScore> scores =
      scoreRecorded(set, chosenRows(set, a.rows), parameters, motion, a.px_per_mm, a.threads);
  printSummary(scores);
  if (!a.csv.empty()) {
    std::string text =
        "stroke,depth_mm,bend_mm,iou,iou_registered,dx_mm,dy_mm,cosine,chamfer_mm,width_mm,"
        "width_recorded_mm,lag_mm,lag_recorded_mm\n";
    const double none = std::numeric_limits<double>::quiet_NaN();
    for (const RecordedScore& s : scores) {
      const Likeness& l = s.likeness;
      text +=
          std::to_string(s.number) + "," +
          numbers("%.4f", {s.depth_mm, s.bend_mm, l.iou, l.registered.iou, l.registered.dx_mm,
                           l.registered.dy_mm, l.cosine, l.chamfer_mm, s.width_simulated_mm,
                           s.width_recorded_mm, s.lag_simulated.measured ? s.lag_simulated.lag_mm : none,
                           s.lag_recorded.measured ? s.lag_recorded.lag_mm : none}) +
          "\n";
    }
    writeText(a.csv, text);
  }
  if (!a.sheet.empty()) {
    std::vector<GreyPicture> pictures;
    for (const RecordedScore& s : scores) {
      pictures.push_back(s.recorded);
      pictures.push_back(s.simulated);
      pictures.push_back(overlay(s.recorded, s.simulated));
    }
    writeSheet(a.sheet, pictures, 12, a.px_per_mm);
  }
}

// ---------------------------------------------------------------- characters

std::vector<std::string> glyphFiles(const std::vector<std::string>& names) {
  namespace fs = std::filesystem;
  std::vector<std::string> files;
  for (const std::string& name : names) {
    if (!fs::is_directory(name)) {
      files.push_back(name);
      continue;
    }
    for (const auto& entry : fs::directory_iterator(name))
      if (entry.path().extension() == ".json") files.push_back(entry.path().string());
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) throw std::runtime_error("there are no characters (*.json) to score");
  return files;
}

void scoreGlyphs(Arguments a, const SimulatorParameters& parameters) {
  a.glyph.px_per_mm = a.px_per_mm;
  const std::vector<std::string> files = glyphFiles(a.glyphs);
  const BrushCurve curve = measureBrushCurve(parameters, a.writing.lean);
  std::vector<GlyphScore> scores(files.size());
  forEachInParallel(files.size(), a.threads, [&](std::size_t k) {
    scores[k] = scoreGlyph(readGlyph(files[k]), std::filesystem::path(files[k]).stem().string(),
                           parameters, a.writing, curve, a.glyph);
  });
  std::vector<double> iou, cosine, chamfer, disc;
  std::printf("%-10s %9s %6s %10s %7s %10s %9s\n", "character", "width/mm", "IoU", "registered",
              "cosine", "chamfer/mm", "disc IoU");
  std::string csv = "character,width_mm,iou,iou_registered,cosine,chamfer_mm,disc_iou\n";
  for (const GlyphScore& s : scores) {
    const Likeness& l = s.likeness;
    iou.push_back(l.iou);
    cosine.push_back(l.cosine);
    chamfer.push_back(l.chamfer_mm);
    disc.push_back(s.disc_iou);
    std::printf("%-10s %9.2f %6.3f %10.3f %7.3f %10.3f %9.3f\n", s.name.c_str(), 1e3 * s.width, l.iou,
                l.registered.iou, l.cosine, l.chamfer_mm, s.disc_iou);
    csv +=
        s.name + "," +
        numbers("%.4f", {1e3 * s.width, l.iou, l.registered.iou, l.cosine, l.chamfer_mm, s.disc_iou}) +
        "\n";
  }
  std::printf("%-10s %9s %6.3f %10s %7.3f %10.3f %9.3f\n", "mean", "", mean(iou), "", mean(cosine),
              mean(chamfer), mean(disc));
  if (!a.csv.empty()) writeText(a.csv, csv);
  if (!a.sheet.empty()) {
    std::vector<GreyPicture> pictures;
    for (const GlyphScore& s : scores) {
      pictures.push_back(s.wanted);
      pictures.push_back(s.written);
      pictures.push_back(overlay(s.wanted, s.written));
    }
    writeSheet(a.sheet, pictures, 12, a.glyph.px_per_mm);
  }
}

// ---------------------------------------------------------------- footprint

/// Width and drag of the brush over its depth, pressed 0 .. 15 mm and drawn straight, beside the lines
/// that Wang et al. (IROS 2020) measured on a tip of 30 mm.
void measureFootprint(const Arguments& a, const SimulatorParameters& parameters) {
  const double length = parameters.brush.tip_length;
  const std::vector<BrushCurvePoint> points =
      measureBrushPoints(parameters, 0.0, 15, std::min(0.8, 0.015 / length));
  std::vector<double> depth, width, drag;
  std::string csv = "depth_mm,width_mm,drag_mm\n";
  std::printf("%9s %9s %9s\n", "depth/mm", "width/mm", "drag/mm");
  for (const BrushCurvePoint& point : points) {
    depth.push_back(1e3 * point.depth);
    width.push_back(1e3 * point.width);
    drag.push_back(1e3 * point.lag);
    std::printf("%9.2f %9.2f %9.2f\n", depth.back(), width.back(), drag.back());
    csv += numbers("%.4f", {depth.back(), width.back(), drag.back()}) + "\n";
  }
  const Line w = fitLine(depth, width), d = fitLine(depth, drag);
  std::printf("width = %.3f z %+.2f mm (measured on a brush of 30 mm: 1.190 z -0.32 mm)\n", w.slope,
              w.offset);
  std::printf("drag  = %.3f z %+.2f mm (measured on a brush of 30 mm: 0.665 z +1.03 mm)\n", d.slope,
              d.offset);
  if (!a.csv.empty()) writeText(a.csv, csv);
}

// ---------------------------------------------------------------- options

po::options_description describeOptions(Arguments& a) {
  po::options_description options("Options");
  options.add_options()("help", "show this and exit");
  options.add_options()("recorded", po::value(&a.recorded)->value_name("FOLDER"),
                        "recorded strokes with photographs: strokes.csv, strokes.png, meta.json");
  options.add_options()("brush", po::value(&a.brush)->default_value("medium")->value_name("NAME|FILE"),
                        "preset in config/brushes, or a YAML file");
  options.add_options()("rows", po::value(&a.rows)->default_value("odd")->value_name("odd|even|all"),
                        "which recorded strokes are scored");
  options.add_options()("speed",
                        po::value(&a.motion.speed)->default_value(0.02, "0.02")->value_name("M/S"),
                        "of the arm along a recorded stroke");
  options.add_options()("waypoints",
                        po::value(&a.motion.waypoints)->default_value(5)->value_name("N"),
                        "of a recorded curve that the arm goes straight between; 0: along the curve");
  options.add_options()("corner",
                        po::value(&a.motion.corner)->default_value(0.005, "0.005")->value_name("M"),
                        "from a waypoint at which the arm turns to the next");
  options.add_options()("offset-x", po::value(&a.offset_x)->default_value(0.0, "0")->value_name("M"),
                        "of the brush's point from where the arm has it");
  options.add_options()("offset-y", po::value(&a.offset_y)->default_value(0.0, "0")->value_name("M"),
                        "the same along y");
  options.add_options()("px-per-mm",
                        po::value(&a.px_per_mm)->default_value(4.0, "4")->value_name("PX/MM"),
                        "resolution of the pictures that are compared");
  options.add_options()("csv", po::value(&a.csv)->value_name("FILE"), "write a line for each picture");
  options.add_options()("sheet", po::value(&a.sheet)->value_name("FILE"),
                        "write a PNG of all: what was wanted, what was written, both");
  options.add_options()("threads", po::value(&a.threads)->default_value(1)->value_name("N"),
                        "strokes that run at the same time");
  options.add_options()("calibrate", po::bool_switch(&a.calibrate),
                        "fit eight numbers of the brush to the even rows first");
  options.add_options()("preset", po::value(&a.preset)->value_name("FILE"),
                        "write the fitted brush to this YAML file");
  options.add_options()("evaluations",
                        po::value(&a.calibration.evaluations)->default_value(200)->value_name("N"),
                        "brushes that are tried");
  options.add_options()("explore",
                        po::value(&a.calibration.explore)->default_value(0.5, "0.5")->value_name("PART"),
                        "part of them that is tried all over the ranges");
  options.add_options()(
      "seconds", po::value(&a.calibration.longest_seconds)->default_value(0.0, "0")->value_name("S"),
      "stop the fit after this time; 0: no limit");
  options.add_options()("strokes", po::value(&a.calibration_strokes)->default_value(20)->value_name("N"),
                        "even rows that are fitted to, spread over depth");
  options.add_options()("footprint", po::bool_switch(&a.footprint),
                        "print width and drag of the brush over its depth, and their slopes");
  options.add_options()("glyphs", po::value(&a.glyphs)->multitoken()->value_name("FOLDER|FILE..."),
                        "characters of hanzi-writer-data, written and compared with their outlines");
  options.add_options()("size", po::value(&a.glyph.size)->default_value(0.06, "0.06")->value_name("M"),
                        "side of a character's em square [m]");
  options.add_options()("passes",
                        po::value(&a.glyph.correction.passes)->default_value(6)->value_name("N"),
                        "times that each stroke of a character is practised; 1: written as planned");
  options.add_options()(
      "gain", po::value(&a.glyph.correction.gain)->default_value(1.0, "1")->value_name("PART"),
      "part of an error that the next pass takes back");
  options.add_options()(
      "lean", po::value(&a.writing.lean)->default_value(a.writing.lean, "0.2")->value_name("RAD"),
      "tilt the way a character's stroke goes");
  options.add_options()("lead", po::value(&a.writing.lead)->default_value(a.writing.lead, "0.5"),
                        "lead of the handle over the lag of the footprint");
  return options;
}

void check(const Arguments& a) {
  const auto inRange = [](const char* name, double value, double low, double high, const char* unit) {
    if (!(value >= low && value <= high))
      throw std::runtime_error(std::string(name) + " = " + parameters_detail::toText(value) +
                               " is outside " + parameters_detail::rangeText(Range{low, high}) + " " +
                               unit);
  };
  if (a.rows != "odd" && a.rows != "even" && a.rows != "all")
    throw std::runtime_error("--rows = " + a.rows + " is not one of odd | even | all");
  inRange("--speed", a.motion.speed, 1e-3, 1.0, "m/s");
  if (a.motion.waypoints != 0) inRange("--waypoints", a.motion.waypoints, 2, 1000, "");
  inRange("--corner", a.motion.corner, 0.0, 0.1, "m");
  inRange("--offset-x", a.offset_x, -0.05, 0.05, "m");
  inRange("--offset-y", a.offset_y, -0.05, 0.05, "m");
  inRange("--px-per-mm", a.px_per_mm, 0.5, 40.0, "px/mm");
  inRange("--threads", a.threads, 1, 256, "");
  inRange("--evaluations", a.calibration.evaluations, 1, 1e6, "");
  inRange("--explore", a.calibration.explore, 0.0, 1.0, "");
  inRange("--seconds", a.calibration.longest_seconds, 0.0, 1e6, "s");
  inRange("--strokes", a.calibration_strokes, 1, 1e6, "");
  inRange("--size", a.glyph.size, 0.01, 1.0, "m");
  inRange("--passes", a.glyph.correction.passes, 1, 100, "");
  inRange("--gain", a.glyph.correction.gain, 0.01, 1.0, "");
  checkParameters(a.writing);
  // Before the work, not after it.
  for (const std::string& file : {a.csv, a.sheet, a.preset})
    if (!file.empty()) const AtomicFile probe(file);
}

void run(int argc, char** argv) {
  Arguments a;
  const po::options_description options = describeOptions(a);
  const po::variables_map values = parseCommandLine({argv + 1, argv + argc}, options, {});
  if (values.count("help") > 0) {
    std::cout << "Usage: stroke_score --recorded FOLDER [--calibrate --preset brush.yaml] [options]\n"
                 "       stroke_score --glyphs FOLDER|FILE... [options]\n"
                 "       stroke_score --footprint [options]\n"
                 "Scores simulated strokes against photographs, outlines or measured laws.\n\n"
              << options;
    return;
  }
  const SimulatorParameters parameters = loadPresets(a.brush, "plain").simulator;
  if (!a.recorded.empty() + !a.glyphs.empty() + a.footprint != 1)
    throw std::runtime_error(
        "needs one of --recorded FOLDER, --glyphs FOLDER and --footprint (see --help)");
  check(a);
  if (a.footprint)
    measureFootprint(a, parameters);
  else if (!a.recorded.empty())
    scoreRecordedStrokes(a, parameters);
  else
    scoreGlyphs(a, parameters);
}

}  // namespace

int main(int argc, char** argv) {
  return calligraphy_brush::runTool("stroke_score", [&] { run(argc, argv); });
}
