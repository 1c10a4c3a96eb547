#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <sstream>

#include "calligraphy_brush/files/glyph.h"
#include "temporary_folder.h"

namespace calligraphy_brush {
namespace {

using Eigen::Vector2d;
constexpr double kPi = 3.14159265358979323846;
const std::string kSource = CALLIGRAPHY_BRUSH_SOURCE_DIR;

std::string messageOf(const std::string& glyph_file) {
  try {
    readGlyph(glyph_file);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  ADD_FAILURE() << glyph_file << " was taken";
  return "";
}

Outline arcOutline(double inner, double outer, double from, double to) {
  Outline outline(1);
  constexpr int kParts = 100;
  for (int k = 0; k <= kParts; ++k) {
    const double a = from + (to - from) * k / kParts;
    outline[0].emplace_back(outer * std::cos(a), outer * std::sin(a));
  }
  for (int k = kParts; k >= 0; --k) {
    const double a = from + (to - from) * k / kParts;
    outline[0].emplace_back(inner * std::cos(a), inner * std::sin(a));
  }
  return outline;
}

TEST(SvgPath, FlattensCurvesToWithinTheTolerance) {
  // A quarter of a circle of radius 100 by the usual cubic, off by 0.03 %.
  const double c = 55.228475;
  std::ostringstream path;
  path << "M 100 0 C 100 " << c << " " << c << " 100 0 100 L 0 0 Z";
  const Outline outline = parseSvgPath(path.str(), 0.1);
  ASSERT_EQ(outline.size(), 1u);
  const auto& points = outline[0];
  for (std::size_t k = 0; k + 2 < points.size(); ++k)
    EXPECT_NEAR(((points[k] + points[k + 1]) / 2).norm(), 100.0, 0.15);
  EXPECT_EQ(points.back(), Vector2d(0, 0));
}

TEST(SvgPath, UnderstandsQuadraticsRepetitionAndCommas) {
  const Outline outline = parseSvgPath("M0,0Q50 100,100,0L-5-3Z", 10.0);
  ASSERT_EQ(outline.size(), 1u);
  EXPECT_EQ(parseSvgPath("M 0 0 10 0 10 10 Z M 20 20 L 30 20 30 30 Z").size(), 2u);
  EXPECT_EQ(parseSvgPath("M 0 0 10 0 10 10 Z")[0].size(), 3u);
}

TEST(SvgPath, NamesWhatItDoesNotUnderstand) {
  for (const char* path :
       {"M 0 0 A 5 5 0 0 0 1 1 Z", "m 0 0 l 1 1 Z", "L 0 0", "M 0", "M 0 0 L 1 x", "3 4", "",
        "M 0 0 L 1 1 Z", "M 0 0 L 1e999 1 L 2 2 Z", "M 0 0 L 5 5 L 0 5 Z 3 3"})
    EXPECT_THROW(parseSvgPath(path), std::runtime_error) << path;
  try {
    parseSvgPath("M 0 0 A 5 5 0 0 0 1 1 Z");
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("'A'"), std::string::npos) << error.what();
  }
}

TEST(InsideDistance, IsTheSignedDistanceToTheOutline) {
  const Outline square{{{0, 0}, {10, 0}, {10, 10}, {0, 10}}};
  EXPECT_DOUBLE_EQ(insideDistance(square, {5, 5}), 5.0);
  EXPECT_DOUBLE_EQ(insideDistance(square, {2, 5}), 2.0);
  EXPECT_DOUBLE_EQ(insideDistance(square, {-3, 5}), -3.0);
  EXPECT_DOUBLE_EQ(insideDistance(square, {13, 14}), -5.0);
}

TEST(MeasureStroke, ABarHasItsWidthWhereverTheMedianRuns) {
  // The median is off the middle, slanted, and stops short of both ends.
  const GlyphStroke bar{{{{0, 0}, {400, 0}, {400, 60}, {0, 60}}}, {{60, 45}, {200, 30}, {340, 14}}};
  const auto measured = measureStroke(bar, 8.0);
  ASSERT_GT(measured.size(), 30u);
  for (const MedialPoint& point : measured) {
    EXPECT_NEAR(point.position.y(), 30.0, 1.5);
    // The last sample may be up to half a spacing beyond the last whole disc.
    EXPECT_NEAR(point.radius, 30.0,
                &point == &measured.front() || &point == &measured.back() ? 4.0 : 1.0);
  }
  // At a blunt end the last whole disc touches the outline.
  EXPECT_NEAR(measured.front().position.x(), 30.0, 10.0);
  EXPECT_NEAR(measured.back().position.x(), 370.0, 10.0);
}

TEST(MeasureStroke, AWedgeTapersToItsPoint) {
  const GlyphStroke wedge{{{{0, -50}, {400, 0}, {0, 50}}}, {{70, 10}, {200, -5}, {300, 2}}};
  const double sine = std::sin(std::atan2(50.0, 400.0));
  const auto measured = measureStroke(wedge, 8.0);
  for (const MedialPoint& point : measured) {
    EXPECT_NEAR(point.position.y(), 0.0, 1.5);
    if (point.position.x() > 70) {
      EXPECT_NEAR(point.radius, (400.0 - point.position.x()) * sine, 1.5);
    }
  }
  EXPECT_GT(measured.back().position.x(), 380.0);
  EXPECT_LT(measured.back().radius, 2.5);
}

TEST(MeasureStroke, ARingArcKeepsItsWidthInTheTurn) {
  const GlyphStroke arc{arcOutline(160, 220, 0.0, 0.75 * kPi),
                        {{201, 20}, {140, 130}, {10, 200}, {-120, 150}}};
  const auto measured = measureStroke(arc, 8.0);
  double swept = 0.0;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    const bool near_end = k < 3 || k + 3 >= measured.size();
    EXPECT_NEAR(measured[k].position.norm(), 190.0, near_end ? 6.0 : 1.5);
    EXPECT_NEAR(measured[k].radius, 30.0, near_end ? 6.0 : 1.5);
    if (k > 0) swept += (measured[k].position - measured[k - 1].position).norm();
  }
  EXPECT_NEAR(swept, 190.0 * 0.75 * kPi - 60.0, 25.0);
}

TEST(MeasureStroke, SurvivesMediansThatAreNoLine) {
  const Outline square{{{0, 0}, {10, 0}, {10, 10}, {0, 10}}};
  EXPECT_EQ(measureStroke({square, {{5, 5}}}, 2.0).size(), 1u);
  EXPECT_EQ(measureStroke({square, {{5, 5}, {5, 5}}}, 2.0).size(), 1u);
  for (const MedialPoint& point : measureStroke({square, {{50, 50}, {60, 50}}}, 2.0))
    EXPECT_EQ(point.radius, 0.0);
}

TEST(Glyph, DamageGivesOneClearLine) {
  const TemporaryFolder folder;
  const std::string outline = "\"M 0 0 L 9 0 L 9 9 Z\"";
  const struct {
    const char* what;
    std::string text;
  } cases[] = {
      {"not the JSON", "[]"},
      {"not the JSON", ""},
      {"strokes", "{\"medians\": []}"},
      {"medians", "{\"strokes\": [" + outline + "]}"},
      {"no strokes", "{\"strokes\": [], \"medians\": []}"},
      {"2 strokes but 1", "{\"strokes\": [" + outline + "," + outline + "], \"medians\": [[[1, 1]]]}"},
      {"median", "{\"strokes\": [" + outline + "], \"medians\": [7]}"},
      {"median", "{\"strokes\": [" + outline + "], \"medians\": [[[1, \"a\"]]]}"},
      {"median", "{\"strokes\": [" + outline + "], \"medians\": [[[1, .nan]]]}"},
      {"stroke 1", "{\"strokes\": [\"M 0 0 H 3 Z\"], \"medians\": [[[1, 1]]]}"},
      {"stroke 1", "{\"strokes\": [[1]], \"medians\": [[[1, 1]]]}"},
      {":1:", "{\"strokes\": [" + outline},
  };
  for (const auto& c : cases) {
    const std::string message = messageOf(folder.write("g.json", c.text));
    EXPECT_NE(message.find(c.what), std::string::npos) << message << " for " << c.text;
    EXPECT_NE(message.find("g.json"), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
  EXPECT_NE(messageOf(folder.path("none.json")).find("cannot be read"), std::string::npos);
}

/// Area of the union of discs and of the outlines, on a grid of 4 units: intersection over union.
double likeness(const Glyph& glyph) {
  std::vector<MedialPoint> discs;
  for (const GlyphStroke& stroke : glyph.strokes) {
    const auto measured = measureStroke(stroke, 8.0);
    for (std::size_t k = 0; k + 1 < measured.size(); ++k)
      for (const double t : {0.0, 0.5})
        discs.push_back({measured[k].position + t * (measured[k + 1].position - measured[k].position),
                         measured[k].radius + t * (measured[k + 1].radius - measured[k].radius)});
    discs.push_back(measured.back());
  }
  long both = 0, either = 0;
  for (double y = kGlyphBottom; y < kGlyphBottom + kGlyphEm; y += 4)
    for (double x = 0; x < kGlyphEm; x += 4) {
      const Vector2d p(x, y);
      const bool written =
          std::any_of(glyph.strokes.begin(), glyph.strokes.end(),
                      [&](const GlyphStroke& s) { return insideDistance(s.outline, p) > 0; });
      const bool covered = std::any_of(discs.begin(), discs.end(), [&](const MedialPoint& d) {
        return (d.position - p).squaredNorm() < d.radius * d.radius;
      });
      both += written && covered;
      either += written || covered;
    }
  return static_cast<double>(both) / static_cast<double>(either);
}

TEST(Glyph, MeasuredDiscsCoverRealCharacters) {
  const std::string folder = kSource + "/../shared/data/hanzi/";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no character data in " << folder;
  double sum = 0.0;
  const std::vector<std::string> names{"u06c38", "u05927", "u06728", "u05fc3", "u04e59", "u098a8"};
  for (const std::string& name : names) {
    const double value = likeness(readGlyph(folder + name + ".json"));
    std::cout << name << ": likeness of discs and outline " << value << "\n";
    EXPECT_GT(value, 0.75) << name;
    sum += value;
  }
  EXPECT_GT(sum / static_cast<double>(names.size()), 0.85);
}

TEST(Glyph, AllRealCharactersAreRead) {
  const std::string folder = kSource + "/../shared/data/hanzi/";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no character data in " << folder;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".json") continue;
    Glyph glyph;
    ASSERT_NO_THROW(glyph = readGlyph(entry.path().string())) << entry.path();
    for (const GlyphStroke& stroke : glyph.strokes)
      for (const MedialPoint& point : measureStroke(stroke, 16.0)) {
        EXPECT_TRUE(point.position.allFinite()) << entry.path();
        EXPECT_LT(point.radius, 200.0) << entry.path();
      }
  }
}

}  // namespace
}  // namespace calligraphy_brush
