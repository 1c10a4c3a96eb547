#include "chain_reference.h"

#include <algorithm>

namespace calligraphy_brush {
namespace validate {
namespace {

class Motion {
 public:
  explicit Motion(const PlanarChain& chain) : chain_(chain), links_(chain.joint.size()) {
    for (auto* field : {&c_, &s_, &moment_, &upper_, &tension_}) field->resize(links_ + 1);
    for (auto* field : {&vx_, &vz_, &fx_, &fz_}) field->resize(links_ + 1);
  }

  /// rate = (ω, ω') of the state (θ, ω): θ the angle of a link from +x towards +z.
  void evaluate(const std::vector<double>& state, std::vector<double>& rate) {
    const std::size_t m = links_;
    const double l = chain_.link;
    for (std::size_t e = 0; e < m; ++e) {
      c_[e] = std::cos(state[e]);
      s_[e] = std::sin(state[e]);
      const double half = 0.5 * (state[e] - (e > 0 ? state[e - 1] : 0.0));
      const double t = std::tan(half);
      moment_[e] = 2 * chain_.joint[e] * t * (1 + t * t);  // dE/d(turn)
    }
    moment_[m] = 0;
    // Forces on nodes over their mass; a link's torque is a couple of forces at its ends.
    vx_[0] = vz_[0] = fx_[0] = fz_[0] = 0;
    for (std::size_t i = 1; i <= m; ++i) {
      const std::size_t e = i - 1;
      vx_[i] = vx_[i - 1] - l * state[m + e] * s_[e];
      vz_[i] = vz_[i - 1] + l * state[m + e] * c_[e];
      double force = (moment_[e + 1] - moment_[e]) / l;
      fx_[i] = -force * s_[e];
      fz_[i] = force * c_[e];
      if (i < m) {
        force = (moment_[e + 2] - moment_[e + 1]) / l;
        fx_[i] += force * s_[i];
        fz_[i] -= force * c_[i];
      }
      fx_[i] = fx_[i] / chain_.mass[i] - chain_.damping * vx_[i];
      fz_[i] = fz_[i] / chain_.mass[i] - chain_.damping * vz_[i] - chain_.gravity;
    }
    // Tensions λ, which keep each link's length: (a_{e+1} − a_e)·t_e = −l ω_e².
    const auto cosine = [&](std::size_t a, std::size_t b) { return c_[a] * c_[b] + s_[a] * s_[b]; };
    for (std::size_t e = 0; e < m; ++e) {
      const double inverse_left = e > 0 ? 1 / chain_.mass[e] : 0.0,
                   inverse_right = 1 / chain_.mass[e + 1];
      const double w = state[m + e];
      double b = l * w * w + (fx_[e + 1] - fx_[e]) * c_[e] + (fz_[e + 1] - fz_[e]) * s_[e];
      double d = inverse_left + inverse_right;
      if (e > 0) {
        const double lower = -cosine(e - 1, e) * inverse_left;
        d -= lower * upper_[e - 1];
        b -= lower * tension_[e - 1];
      }
      upper_[e] = e + 1 < m ? -cosine(e, e + 1) * inverse_right / d : 0.0;
      tension_[e] = b / d;
    }
    for (std::size_t e = m - 1; e-- > 0;) tension_[e] -= upper_[e] * tension_[e + 1];
    double ax = 0, az = 0;
    for (std::size_t e = 0; e < m; ++e) {
      const std::size_t i = e + 1;
      double nx = -tension_[e] * c_[e], nz = -tension_[e] * s_[e];
      if (i < m) {
        nx += tension_[i] * c_[i];
        nz += tension_[i] * s_[i];
      }
      nx = fx_[i] + nx / chain_.mass[i];
      nz = fz_[i] + nz / chain_.mass[i];
      rate[e] = state[m + e];
      rate[m + e] = (-(nx - ax) * s_[e] + (nz - az) * c_[e]) / l;
      ax = nx;
      az = nz;
    }
  }

 private:
  const PlanarChain& chain_;
  std::size_t links_;
  std::vector<double> c_, s_, moment_, upper_, tension_, vx_, vz_, fx_, fz_;
};

}  // namespace

std::vector<TipAt> solvePlanarChain(const PlanarChain& chain, const std::vector<double>& times) {
  const std::size_t m = chain.joint.size(), size = 2 * m;
  // The fastest vibration has neighbours moving against each other: ω² ≤ 16 K/(m l²); links that swing
  // as pendulums are slower than sqrt(n g/l).
  double fastest_squared = static_cast<double>(m) * chain.gravity / chain.link;
  for (std::size_t j = 0; j < m; ++j)
    fastest_squared =
        std::max(fastest_squared,
                 16 * chain.joint[j] / (chain.mass[j + (j + 1 < m ? 1 : 0)] * chain.link * chain.link));
  const double longest = 0.4 / std::sqrt(fastest_squared);
  if (!times.empty() && static_cast<double>(m) * times.back() / longest > 3e8) return {};

  Motion motion(chain);
  std::vector<double> state(size, 0.0), trial(size), k1(size), k2(size), k3(size), k4(size);
  std::vector<TipAt> tips;
  double now = 0;
  for (const double time : times) {
    const auto steps = static_cast<long>(std::ceil((time - now) / longest));
    const double h = steps > 0 ? (time - now) / static_cast<double>(steps) : 0;
    const auto towards = [&](const std::vector<double>& k, double factor) -> const std::vector<double>& {
      for (std::size_t i = 0; i < size; ++i) trial[i] = state[i] + factor * k[i];
      return trial;
    };
    for (long step = 0; step < steps; ++step) {
      motion.evaluate(state, k1);
      motion.evaluate(towards(k1, h / 2), k2);
      motion.evaluate(towards(k2, h / 2), k3);
      motion.evaluate(towards(k3, h), k4);
      for (std::size_t i = 0; i < size; ++i) state[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
    now = time;
    TipAt tip{time, 0, 0};
    for (std::size_t e = 0; e < m; ++e) {
      tip.x += chain.link * std::cos(state[e]);
      tip.z += chain.link * std::sin(state[e]);
    }
    tips.push_back(tip);
  }
  return tips;
}

}  // namespace validate
}  // namespace calligraphy_brush
