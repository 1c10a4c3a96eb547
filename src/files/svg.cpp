#include "calligraphy_brush/files/svg.h"

#include <array>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <unordered_map>

#include "calligraphy_brush/files/atomic_file.h"

namespace calligraphy_brush {

std::vector<Outline> traceOutlines(int width_px, int height_px, const std::vector<std::uint8_t>& mono8,
                                   double threshold) {
  if (width_px < 1 || height_px < 1 ||
      mono8.size() != static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px))
    throw std::invalid_argument("a picture of " + std::to_string(width_px) + " x " +
                                std::to_string(height_px) + " pixels cannot have " +
                                std::to_string(mono8.size()) + " values");
  const auto grey = [&](int column, int row) {
    const bool is_on = column >= 0 && row >= 0 && column < width_px && row < height_px;
    return is_on ? double(mono8[static_cast<std::size_t>(row) * static_cast<std::size_t>(width_px) +
                                static_cast<std::size_t>(column)])
                 : 255.0;
  };
  // A line crosses the way between two neighbouring pixels at most once, in one direction. Ways are
  // numbered: that to the right of pixel (i, j) is even, that below it odd; from one crossing leads
  // one piece of line to the next.
  const std::int64_t stride = width_px + 2;
  const auto wayRight = [&](int i, int j) { return 2 * ((j + 1) * stride + i + 1); };
  const auto wayDown = [&](int i, int j) { return 2 * ((j + 1) * stride + i + 1) + 1; };
  std::unordered_map<std::int64_t, std::int64_t> next;
  std::vector<std::int64_t> begins;
  for (int j = -1; j < height_px; ++j)
    for (int i = -1; i < width_px; ++i) {
      // Corners clockwise from the upper left, and the ways between each and the next.
      const std::array<bool, 4> dark{grey(i, j) < threshold, grey(i + 1, j) < threshold,
                                     grey(i + 1, j + 1) < threshold, grey(i, j + 1) < threshold};
      const std::array<std::int64_t, 4> way{wayRight(i, j), wayDown(i + 1, j), wayRight(i, j + 1),
                                            wayDown(i, j)};
      // Ink on the right: a piece comes in where, clockwise, light turns dark, and leaves where the same
      // run of dark corners ends.
      for (std::size_t k = 0; k < 4; ++k) {
        if (dark[k] || !dark[(k + 1) % 4]) continue;
        std::size_t end = (k + 1) % 4;
        while (dark[(end + 1) % 4]) end = (end + 1) % 4;
        next[way[end]] = way[k];
        begins.push_back(way[end]);
      }
    }
  const auto place = [&](std::int64_t way) {
    const std::int64_t pixel = way / 2;
    const int i = static_cast<int>(pixel % stride) - 1, j = static_cast<int>(pixel / stride) - 1;
    const bool down = way % 2 != 0;
    const double a = grey(i, j), b = down ? grey(i, j + 1) : grey(i + 1, j);
    const double s = (threshold - a) / (b - a);
    return OutlinePoint{i + 0.5 + (down ? 0.0 : s), j + 0.5 + (down ? s : 0.0)};
  };
  std::vector<Outline> outlines;
  for (const std::int64_t begin : begins) {
    auto at = next.find(begin);
    if (at == next.end()) continue;  // belongs to a line that has been taken
    Outline outline;
    while (at != next.end()) {
      outline.push_back(place(at->first));
      const std::int64_t to = at->second;
      next.erase(at);
      at = next.find(to);
    }
    outlines.push_back(std::move(outline));
  }
  return outlines;
}

void writeSvg(const std::string& path, int width_px, int height_px, double px_per_mm,
              const std::vector<std::pair<std::string, std::vector<Outline>>>& shapes) {
  const double scale = px_per_mm > 0.0 ? 1.0 / px_per_mm : 1.0;
  std::string text;
  char buffer[200];
  std::snprintf(buffer, sizeof buffer,
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.6gmm\" height=\"%.6gmm\" "
                "viewBox=\"0 0 %.6g %.6g\">\n",
                width_px * scale, height_px * scale, width_px * scale, height_px * scale);
  text += buffer;
  for (const auto& [name, outlines] : shapes) {
    text += "<path id=\"" + name + "\" fill=\"black\" fill-rule=\"evenodd\" d=\"";
    for (const Outline& outline : outlines) {
      for (std::size_t i = 0; i < outline.size(); ++i) {
        std::snprintf(buffer, sizeof buffer, "%s%.4f %.4f",
                      i == 0   ? "M"
                      : i == 1 ? "L"
                               : " ",
                      outline[i].x * scale, outline[i].y * scale);
        text += buffer;
      }
      text += "Z";
    }
    text += "\"/>\n";
  }
  text += "</svg>\n";
  AtomicFile output(path);
  std::ofstream file(output.temporaryPath(), std::ios::binary);
  file << text;
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path);
  output.commit();
}

}  // namespace calligraphy_brush
