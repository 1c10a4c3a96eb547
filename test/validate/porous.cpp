#include "porous.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "calligraphy_brush/paper/paper.h"
#include "calligraphy_brush/paper/unsaturated_flow.h"

namespace calligraphy_brush {
namespace validate {
namespace {

constexpr double kPixel = 1e-3 / 8.0;  // of the sheet that stands for the strip [m]
constexpr int kTimes = 10;
constexpr double kFirstTime = 1.0 / 10.0;  // over the duration

double washburnDiffusivity(const PorousParameters& p) {
  return p.permeability * p.capillary_pressure / (p.viscosity * p.porosity);
}

/// A sheet that is even and does not dry.
PaperParameters evenSheet(const PorousParameters& p, int width_px, int height_px) {
  PaperParameters sheet;
  sheet.px_per_mm = 8.0;
  sheet.width = std::max(0.005, width_px * kPixel);
  sheet.height = std::max(0.005, height_px * kPixel);
  sheet.porosity = std::min(p.porosity, 0.95);
  sheet.diffusivity = 1e-5;  // so fast that no tile is ever taken for still
  sheet.flow_exponent = p.exponent;
  sheet.unevenness = sheet.evaporation = sheet.evaporation_rim = sheet.settling_rate = 0.0;
  sheet.film_flow = 0.0;
  return sheet;
}

/// Runs a sheet for a time in which Washburn's front would come `front_px` far, and asks `measure` at
/// all times. `hold` is called before each step with the step's part of the time.
template <class Measure>
void run(Paper& paper, double duration, double front_px, const std::function<void(double)>& hold,
         const PorousParameters& p, const Measure& measure, PorousResult& result) {
  const double front = front_px * kPixel;
  const double sheet_duration = front * front / (2.0 * paper.parameters().diffusivity);
  const double full = fullDiffusivity(paper.parameters().diffusivity, p.exponent);
  const auto steps = static_cast<long>(std::ceil(sheet_duration * full / (0.2 * kPixel * kPixel)));
  int next = 0;
  for (long step = 1; step <= steps; ++step) {
    hold(1.0 / static_cast<double>(steps));
    paper.flow(sheet_duration / static_cast<double>(steps));
    const double part = static_cast<double>(step) / static_cast<double>(steps);
    for (; next < kTimes && part >= std::pow(kFirstTime, 1.0 - next / (kTimes - 1.0)) * (1.0 - 1e-12);
         ++next) {
      result.times.push_back(part * duration);
      result.front.push_back(measure());
    }
  }
  // Least squares of the logarithms.
  double x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < result.times.size(); ++i) {
    const double a = std::log(result.times[i]), b = std::log(result.front[i]);
    x += a;
    y += b;
    xx += a * a;
    xy += a * b;
  }
  const auto n = static_cast<double>(result.times.size());
  result.exponent = (n * xy - x * y) / (n * xx - x * x);
  result.iterations = static_cast<int>(std::min<long>(steps, 2000000000L));
  result.converged = true;
}

/// Where the filling goes to 0, in pixels from the middle of pixel 0. Towards the front θ^q is a line;
/// it is drawn through two pixels far enough behind the last one, which holds next to nothing.
double frontOf(const std::function<double(int)>& fill, int last, int q) {
  constexpr int kBehind = 2, kApart = 2;
  const int near = last - kBehind, far = near - kApart;
  if (far < 0) return last;
  const double a = std::pow(fill(near), q), b = std::pow(fill(far), q);
  return b > a ? near + kApart * a / (b - a) : last;
}

}  // namespace

PorousResult strip(const StripParameters& p) {
  const double front_px = p.nodes / 1.25;
  Paper paper(evenSheet(p, p.nodes, 1));
  const double full = paper.capacity();
  const auto fill = [&](int column) { return double(paper.water(column, 0)) / full; };
  // Pixels of Washburn's front to metres.
  const double expected = std::sqrt(2.0 * washburnDiffusivity(p) * p.duration);
  const double scale = expected / front_px;
  double put_in = 0.0;
  const double area = kPixel * kPixel * paper.height_px();
  PorousResult result;
  run(
      paper, p.duration, front_px,
      [&](double) {
        put_in += (full - double(paper.water(0, 0))) * area;
        for (int row = 0; row < paper.height_px(); ++row) paper.setInk(0, row, full, 0.0);
      },
      p,
      [&] {
        int last = 0;
        while (last + 1 < paper.width_px() && fill(last + 1) > 0.0) ++last;
        return scale * frontOf(fill, last, p.exponent);
      },
      result);
  for (int column = 0; column < paper.width_px(); ++column) result.filling.push_back(fill(column));
  result.reference = expected;
  result.mass_error = paper.waterVolume() / put_in - 1.0;
  return result;
}

PorousResult blot(const BlotParameters& p) {
  const int q = p.exponent;
  const double washburn = washburnDiffusivity(p);
  const double full_diffusivity = fullDiffusivity(washburn, q);
  // Radius at the end, to choose the scale by, and the reference where there is one.
  PorousResult result;
  double radius = 0.0;
  if (p.supply == "saturated") {
    // Sharp front of liquid that is fed at R₀: R²(ln(R/R₀) − ½) + R₀²/2 = 2 D t.
    double low = p.radius, high = p.radius + std::sqrt(4.0 * washburn * p.duration) + p.radius;
    for (int k = 0; k < 200; ++k) {
      const double r = 0.5 * (low + high);
      (r * r * (std::log(r / p.radius) - 0.5) + 0.5 * p.radius * p.radius < 2.0 * washburn * p.duration
           ? low
           : high) = r;
    }
    result.reference = radius = low;
  } else if (p.supply == "drop") {
    // Barenblatt in the plane: θ_t = D₀/m ∇²θ^m, m = q + 1, mass M = π R₀² θ₀:
    // R² = C (4 m² / (m − 1)) τ^(1/m), C^(m/(m−1)) = M / (4 π m), τ = D₀ t / m.
    const double m = q + 1.0, mass = M_PI * p.radius * p.radius * p.filling;
    const double c = std::pow(mass / (4.0 * M_PI * m), (m - 1.0) / m);
    const double tau = full_diffusivity * p.duration / m;
    result.reference = radius = std::sqrt(c * 4.0 * m * m / (m - 1.0) * std::pow(tau, 1.0 / m));
    radius = std::max(radius, p.radius);
  } else {
    radius = std::sqrt(2.0 * washburn * p.duration);
    result.reference = kNone;
  }
  const double radius_px = p.nodes / 1.25;
  const double scale = radius / radius_px;  // [m] a pixel
  const int side = 2 * p.nodes;
  Paper paper(evenSheet(p, side, side));
  const double full = paper.capacity();
  // The middle is a corner of pixels.
  const double middle = 0.5 * paper.width_px();
  const auto distance = [&](int column, int row) {
    return std::hypot(column + 0.5 - middle, row + 0.5 - middle);
  };
  const double held_px = p.supply == "rate" ? 0.04 * radius_px : p.radius / scale;
  double put_in = 0.0;
  const double pixel_area = kPixel * kPixel;
  const int first = std::max(0, static_cast<int>(middle - held_px - 1.0));
  const int last = paper.width_px() - 1 - first;
  // A filling of θ in the middle of a blot with R = √(2 D t) takes about π R² θ / 2.
  const double rate = p.filling * 0.5 * radius_px * radius_px / (held_px * held_px);
  const auto setDisc = [&](bool adds, double amount) {
    for (int row = first; row <= last; ++row)
      for (int column = first; column <= last; ++column) {
        const double part = std::clamp(held_px + 0.5 - distance(column, row), 0.0, 1.0);
        if (part <= 0.0) continue;
        const double old = double(paper.water(column, row));
        const double now = adds ? old + amount * full * part : std::max(old, amount * full * part);
        put_in += (now - old) * pixel_area;
        paper.setInk(column, row, now, 0.0);
      }
  };
  if (p.supply == "drop") setDisc(false, p.filling);
  const double front_px = std::sqrt(2.0 * washburn * p.duration) / scale;
  run(
      paper, p.duration, front_px,
      [&](double part) {
        if (p.supply == "rate") setDisc(true, rate * part);
        if (p.supply == "saturated") setDisc(false, 1.0);
      },
      p,
      [&] {
        // Along the four axes and diagonals the front is found between pixels; their mean counts.
        double sum = 0.0;
        const int centre = static_cast<int>(middle);
        for (int direction = 0; direction < 8; ++direction) {
          const int dx = direction < 4 ? (direction == 0) - (direction == 1) : (direction & 1 ? 1 : -1);
          const int dy = direction < 4 ? (direction == 2) - (direction == 3) : (direction & 2 ? 1 : -1);
          const auto at = [&](int i) {
            const int column = (dx < 0 ? centre - 1 : centre) + i * dx;
            const int row = (dy < 0 ? centre - 1 : centre) + i * dy;
            return std::make_pair(column, row);
          };
          const auto isOn = [&](int i) {
            const auto [column, row] = at(i);
            return column >= 0 && row >= 0 && column < paper.width_px() && row < paper.height_px();
          };
          const auto fill = [&](int i) {
            const auto [column, row] = at(i);
            return double(paper.water(column, row)) / full;
          };
          int i = 0;
          while (isOn(i + 1) && fill(i + 1) > 0.0) ++i;
          const auto [column, row] = at(0);
          sum += distance(column, row) + std::hypot(dx, dy) * frontOf(fill, i, q);
        }
        return scale * sum / 8.0;
      },
      result);
  const int row = static_cast<int>(middle);
  for (int column = row; column < paper.width_px(); ++column)
    result.filling.push_back(double(paper.water(column, row)) / full);
  result.mass_error = paper.waterVolume() / put_in - 1.0;
  return result;
}

}  // namespace validate
}  // namespace calligraphy_brush
