#include "scene.h"

#include <cerrno>
#include <cstdlib>
#include <iomanip>
#include <ostream>

#include "buckling.h"
#include "cohesion.h"
#include "contact.h"
#include "dynamics.h"
#include "porous.h"
#include "sliding.h"
#include "statics.h"
#include "tip.h"

namespace calligraphy_brush {
namespace validate {
namespace scene_detail {

std::string toOption(std::string name) {
  for (char& c : name)
    if (c == '_') c = '-';
  return "--" + name;
}

void parse(const std::string& option, const std::string& text, double& field) {
  char* end = nullptr;
  field = std::strtod(text.c_str(), &end);
  if (text.empty() || *end) throw std::invalid_argument(option + " = " + text + " is not a number");
}

void parse(const std::string& option, const std::string& text, int& field) {
  char* end = nullptr;
  errno = 0;
  const long value = std::strtol(text.c_str(), &end, 10);
  const bool fits =
      errno == 0 && value >= std::numeric_limits<int>::min() && value <= std::numeric_limits<int>::max();
  if (text.empty() || *end || !fits)
    throw std::invalid_argument(option + " = " + text + " is not a whole number");
  field = static_cast<int>(value);
}

void parse(const std::string&, const std::string& text, bool& field) {
  field = text == "true";
}
void parse(const std::string&, const std::string& text, std::string& field) {
  field = text;
}

void write(std::ostream& out, double value) {
  if (std::isfinite(value))
    out << std::setprecision(15) << value;
  else
    out << "null";
}
void write(std::ostream& out, int value) {
  out << value;
}
void write(std::ostream& out, bool value) {
  out << (value ? "true" : "false");
}
void write(std::ostream& out, const std::string& value) {
  out << '"' << value << '"';
}
void write(std::ostream& out, const Eigen::Vector3d& value) {
  out << "{\"x\": ";
  write(out, value.x());
  out << ", \"y\": ";
  write(out, value.y());
  out << ", \"z\": ";
  write(out, value.z());
  out << "}";
}
void write(std::ostream& out, const TipAt& value) {
  out << "{\"t\": ";
  write(out, value.t);
  out << ", \"x\": ";
  write(out, value.x);
  out << ", \"z\": ";
  write(out, value.z);
  out << "}";
}

}  // namespace scene_detail

const std::vector<Scene>& scenes() {
  static const std::vector<Scene> all = {
      makeScene("heavy_cantilever", "A rod clamped at an angle bends under its weight.",
                "The clamp turns from hanging to its angle, so slowly that the rod follows the "
                "equilibrium that is\n"
                "continuous with hanging, and the rod comes to rest. At 180 degrees it stands upright, "
                "and from\n"
                "gamma = 7.84 on has buckled towards +x.",
                heavyCantilever),
      makeScene("tip_load", "A weightless horizontal cantilever bends under a force at its tip.",
                "The load grows from zero and the rod comes to rest. A following load is turned with "
                "the last edge\n"
                "after every step.",
                tipLoad),
      makeScene("press", "A rod is lowered onto the sheet with its handle tilted from the vertical.",
                "The handle goes straight down, slowly and ever more slowly, in a viscous medium, so "
                "that the tip\n"
                "comes to rest from one side. The handle points towards +x. Without --plane it starts "
                "1e-5 L beside\n"
                "the plane y = 0, so that a shape that is not stable in space is left; with it nothing "
                "leaves the\n"
                "plane. A vertical handle starts tilted by 0.001 rad, so that the rod buckles to a "
                "known side.",
                press),
      makeScene("drag", "As press, and then the handle is dragged along x at constant height.",
                "It slows down towards the end of its way, so that what is left there is Coulomb "
                "friction and not\n"
                "that of the medium. direction = -1 lets the hair trail.",
                drag),
      makeScene("stick_slip", "A vertical rod is pressed onto its foot until the foot slips.",
                "As press with --plane and no tilt. slip_depth is where |T|/N, extrapolated over the "
                "last steps\n"
                "before the foot slips, is mu; null where it never slips on the way to 0.4 L.",
                stickSlip),
      makeScene("lateral_buckling",
                "A horizontal strip on edge tips over sideways under its own weight.",
                "For one load after another the rod comes to rest in its plane and is blown at from the "
                "side. The\n"
                "least eigenvalue of its energy's Hessian over the masses, by Rayleigh's quotient of "
                "what is left of\n"
                "the blow after some steps, is 0 at the critical load.",
                lateralBuckling),
      makeScene("bend_twist", "A hanging rod of natural curvature bends in its plane or leaves it.",
                "The clamp points down. The weight of the curled rod is let go slowly; once it is at "
                "rest in the plane\n"
                "y = 0 it is blown at from the side. It is stable if the least eigenvalue, found as "
                "in\n"
                "lateral_buckling, is above 0.",
                bendTwist),
      makeScene("ring", "A straight rod, bent to a ring and twisted, leaves its plane (Michell).",
                "The far clamp is led round to the root and turned. The least eigenvalue, found as in "
                "lateral_buckling,\n"
                "is nearly linear in the square of the twist; its zero is extrapolated from the last "
                "3 %, and 2 %\n"
                "beyond it the ring has to leave its state.",
                ring),
      makeScene("helix", "A rod with twisted and approached ends coils up in its middle.",
                "The far clamp comes nearer by the slack, so that the rod bulges, and is then turned.",
                helix),
      makeScene("modes", "Frequencies of small vibrations of a clamped rod.",
                "Each node in turn carries a small transverse force. The shapes that the rod comes to "
                "rest in are the\n"
                "columns of its flexibility matrix; with the masses they give the frequencies. So they "
                "are those of\n"
                "the energy that the solver minimises.",
                modes),
      makeScene("release",
                "A rod, clamped horizontally and straight at time 0, is let go under gravity.",
                "max_error is the largest distance of the tip, at the times given, from an independent "
                "solution of the\n"
                "same discrete rod: explicit Runge-Kutta in angles, with a step far below that of its "
                "fastest\n"
                "vibration. Its cost grows with nodes to the third power.",
                release),
      makeScene("chain",
                "A horizontal chain of rigid links without bending stiffness is let go under gravity.",
                "Length 1 m, mass 1 kg in equal parts on the nodes but the first, g = 9.81 m/s^2, no "
                "damping. Ten links\n"
                "are 11 nodes.",
                chain),
      makeScene("slide", "A block with a given speed slides on the sheet until friction has stopped it.",
                "The block is the tip node of a rod. All other nodes weigh 1e-9 of it in all, the rod "
                "is so limp that it\n"
                "pushes with less than 1e-8 of the weight, and its handle follows the tip, so that it "
                "is slack.\n"
                "A blow of one time step gives the block its momentum.",
                slide),
      makeScene("incline", "Whether a block slides down an inclined sheet.",
                "The block of slide at rest on the sheet z = 0, with the gravity of the inclined plane: "
                "g cos(angle)\n"
                "into the sheet, and as a force on the block m g sin(angle) along it. Over one second.",
                incline),
      makeScene(
          "slam", "The handle slams 20 mm into the sheet in 20 ms and drags 100 mm in 0.1 s.",
          "The rod of the tables, or a tuft, with the settings that the node has by default. While "
          "dragging, "
          "the handle\n"
          "turns from -5 to 70 degrees against the hair, which bends it by more than 150 degrees.",
          slam),
      makeScene(
          "cohesion_pair", "Two parallel rods are pressed together and cling by the ink between them.",
          "Loads on the nodes press the rods together and are taken away; they come to rest in a "
          "viscous medium.\n"
          "Both are full of ink, and w = 2 (pi - 2) gamma r as in the brush. The curvature of the "
          "free part is a\n"
          "straight line in the depth below the clamp; dry_length is where that line says that the "
          "rod runs along\n"
          "the other.",
          cohesionPair),
      makeScene(
          "cohesion_row", "Rods in a row cling in groups, which are larger for longer rods.",
          "Dry rods are pressed together in groups, as equal as may be, wetted and let go. dry_length "
          "of a "
          "group is that of\n"
          "its widest seam, found as in cohesion_pair for all rods on one side of it against all on the "
          "other, twice\n"
          "the length of the rods where they part. There are as many groups as bring the mean of it "
          "nearest to the\n"
          "length. Larger groups may stay together by their very ends, if these have been brought "
          "together. count\n"
          "should be some times the size of a group.",
          cohesionRow),
      makeScene(
          "tip_shape", "A tuft with ink closes in the air, and is pressed on the sheet.",
          "The straight rods are wetted and come to rest. With a depth the upright handle then goes "
          "down, is dragged\n"
          "a little and held. Contact, friction and ink are those of the simulator, for the brush "
          "preset.",
          tipShape),
      makeScene(
          "strip", "Liquid from a reservoir soaks into a dry strip of the sheet.",
          "The sheet of the simulator with its flow, `nodes` pixels long. Length and time are scaled "
          "to the sheet, so\n"
          "any are as accurate. The front is where the filling goes to 0, between pixels as the q-th "
          "root of a line.",
          strip),
      makeScene(
          "blot", "A blot spreads on the dry sheet from its middle.",
          "As strip, `nodes` pixels from the middle to beyond the front. supply = rate: a brush that "
          "is held still gives\n"
          "a constant flow; saturated: a disc is kept full; drop: a drop of given volume is all. The "
          "front is the radius of\n"
          "the disc that has the area of the blot.",
          blot),
  };
  return all;
}

int runValidate(const std::vector<std::string>& arguments, std::ostream& output, std::ostream& error) {
  const char* usage =
      "usage: validate SCENE [--name value ...] | validate SCENE --help | validate --list";
  if (arguments.empty() || arguments[0] == "--help") {
    (arguments.empty() ? error : output) << usage << "\n";
    return arguments.empty() ? 1 : 0;
  }
  if (arguments[0] == "--list") {
    for (const Scene& scene : scenes()) output << scene.name << ": " << scene.summary << "\n";
    return 0;
  }
  for (const Scene& scene : scenes()) {
    if (scene.name != arguments[0]) continue;
    const std::vector<std::string> rest(arguments.begin() + 1, arguments.end());
    for (const std::string& argument : rest) {
      if (argument != "--help") continue;
      output << scene.help();
      return 0;
    }
    try {
      output << scene.run(rest) << "\n";
      return 0;
    } catch (const std::exception& problem) {
      error << "validate " << scene.name << ": " << problem.what() << "\n";
      return 1;
    }
  }
  error << "validate: unknown scene " << arguments[0] << "; validate --list names them\n";
  return 1;
}

}  // namespace validate
}  // namespace calligraphy_brush
