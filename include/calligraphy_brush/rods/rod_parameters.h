#pragma once

#include <string>

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// The elastic rods and the solver of their time step.
struct RodParameters {
  double time_step = 0.001;
  std::string scheme = "bdf2";
  std::string precision = "float";
  std::string bending_law = "arc";
  std::string clamp = "corrected";
  double damping = 20.0;
  double gravity = 9.81;
  double tolerance = 1e-6;
  int max_iterations = 50;
  double sleep = 1e-7;
  double wet_stiffness = 0.4;
  double wet_memory = 0.2;
  double wet_memory_time = 5.0;
  int threads = 1;
  std::string instruction_set = "best";

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("time_step", self.time_step, Range{1e-6, 0.1}, "s",
          "Length of one time step, rounded to whole nanoseconds.");
    visit("scheme", self.scheme, Choices{"backward_euler", "bdf2", "sdirk2", "projection"}, "1",
          "Time integration: backward Euler (first order, calms everything), BDF2 or SDIRK2 (second "
          "order, "
          "one or two solutions a step), or the original method's explicit step with projection, which "
          "needs a time_step near 0.1 ms and has a bending law and a clamp of its own.");
    visit("precision", self.precision, Choices{"float", "double"}, "1",
          "Numbers in the solver; float is as accurate for steps of 0.5 ms and longer.");
    visit("bending_law", self.bending_law, Choices{"tangent", "arc", "sine"}, "1",
          "Discrete curvature of a turn by phi: 2 tan(phi/2) as published by Bergou 2008, about phi, 2 "
          "sin(phi/2).");
    visit(
        "clamp", self.clamp, Choices{"half", "corrected"}, "1",
        "Length that the joints next to a clamp stand for: half an edge, or Gregory's end correction.");
    visit("damping", self.damping, Range{0.0, 1e6}, "1/s",
          "Viscous damping c of the force -c m v on a node of mass m; has no measured source.");
    visit("gravity", self.gravity, Range{0.0, 1000.0}, "m/s^2", "Acceleration along -z of the paper.");
    visit("tolerance", self.tolerance, Range{1e-15, 0.1}, "rad",
          "Error of an edge's direction at which a step's Newton iteration ends.");
    visit("max_iterations", self.max_iterations, Range{1, 10000}, "1",
          "Newton iterations after which a step is taken as it is and reported as not converged.");
    visit("sleep", self.sleep, Range{0.0, 1e-3}, "m",
          "Rods rest unsolved, 16 together, once none of their nodes has moved so far in 32 steps under "
          "a handle at rest, until anything changes; 0: never.");
    visit("wet_stiffness", self.wet_stiffness, Range{0.01, 1.0}, "1",
          "Stiffness of hair full of ink over that of dry hair; Young's modulus of keratin is about 0.4 "
          "of the dry one in water (Feughelman 1959), synthetic hair has 1.");
    visit("wet_memory", self.wet_memory, Range{0.0, 0.9}, "1",
          "Part of its bend that wet hair takes on when it is held bent for long; 0: none. No measured "
          "source.");
    visit("wet_memory_time", self.wet_memory_time, Range{0.01, 1e6}, "s",
          "Time constant of that in hair full of ink; most of what hair in water relaxes in minutes it "
          "does in its first 10 s.");
    visit("threads", self.threads, Range{1, 256}, "1",
          "Threads that solve rods; the result does not depend on it.");
    visit("instruction_set", self.instruction_set, Choices{"best", "baseline", "avx2", "avx512"}, "1",
          "Which kernel runs; best is the widest that the processor has.");
  }
};

}  // namespace calligraphy_brush
