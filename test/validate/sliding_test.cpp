#include "sliding.h"

#include <gtest/gtest.h>

#include <cmath>

using namespace calligraphy_brush::validate;

namespace {

constexpr double kGravity = 9.81;
constexpr double kPi = 3.14159265358979323846;

}  // namespace

TEST(Slide, StopsWhereCoulombSaysToTheOrderOfTheStep) {
  for (const char* scheme : {"backward_euler", "bdf2"})
    for (const double speed : {0.05, 0.3, 2.0})
      for (const double mu : {0.1, 0.35, 1.0, 3.0})
        for (const double dt : {1e-3, 1e-4}) {
          SCOPED_TRACE(testing::Message()
                       << scheme << " speed " << speed << " mu " << mu << " dt " << dt);
          SlideParameters p;
          p.speed = speed;
          p.mu = mu;
          p.dt = dt;
          p.scheme = scheme;
          const SlideResult result = slide(p);
          EXPECT_TRUE(result.converged);
          EXPECT_NEAR(result.distance, speed * speed / (2 * mu * kGravity), speed * dt);
          EXPECT_NEAR(result.time, speed / (mu * kGravity), 3 * dt);
        }
}

TEST(Incline, SlidesFromTheAngleOfFrictionOn) {
  for (const char* scheme : {"backward_euler", "bdf2"})
    for (const double mu : {0.05, 0.3, 0.77, 2.0, 5.0})
      for (const double dt : {1e-2, 1e-3}) {
        SCOPED_TRACE(testing::Message() << scheme << " mu " << mu << " dt " << dt);
        InclineParameters p;
        p.mu = mu;
        p.dt = dt;
        p.scheme = scheme;
        p.angle_deg = std::atan(mu * (1 - 1e-6)) * 180 / kPi;
        const InclineResult below = incline(p);
        EXPECT_FALSE(below.slides);
        EXPECT_LT(std::abs(below.distance), 1e-12);
        p.angle_deg = std::atan(mu * (1 + 1e-6)) * 180 / kPi;
        const InclineResult above = incline(p);
        EXPECT_TRUE(above.slides);
        EXPECT_TRUE(below.converged && above.converged);
      }
}

TEST(Incline, SlidesAsFastAsCoulombSays) {
  for (const char* scheme : {"backward_euler", "bdf2"})
    for (const double mu : {0.0, 0.2, 1.0})
      for (const double excess_deg : {3.0, 20.0}) {
        InclineParameters p;
        p.mu = mu;
        p.scheme = scheme;
        p.angle_deg = std::atan(mu) * 180 / kPi + excess_deg;
        const double angle = p.angle_deg * kPi / 180;
        const double acceleration = kGravity * (std::sin(angle) - mu * std::cos(angle));
        EXPECT_NEAR(incline(p).distance, 0.5 * acceleration, 0.002 * acceleration)
            << scheme << mu << excess_deg;
      }
}
