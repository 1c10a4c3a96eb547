#pragma once

#include <string>

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// Which tablet, and what it does not say about itself.
struct TabletDeviceParameters {
  std::string name;
  bool grab = false;
  double width = 0.0;
  double height = 0.0;
  bool even_out = true;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("name", self.name, Choices{}, "1",
          "Tablet to read: a path (/dev/input/...), its name or a part of it; empty is the first one "
          "found.");
    visit("grab", self.grab,
          "Whether nobody else gets its events, so that no pointer moves while writing.");
    visit("width", self.width, Range{0.0, 5.0}, "m",
          "Width of its active area; 0: as the device says by the resolution of its x axis.");
    visit("height", self.height, Range{0.0, 5.0}, "m",
          "Height of its active area; 0: as the device says by the resolution of its y axis.");
    visit("even_out", self.even_out,
          "Whether places are those of evenly measured reports; the kernel's stamps have the jitter of "
          "USB.");
  }
};

/// Which part of the tablet is the sheet.
struct TabletAreaParameters {
  double left = 0.0;
  double right = 1.0;
  double bottom = 0.0;
  double top = 1.0;
  std::string rotation = "0";
  std::string fit = "whole";

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("left", self.left, Range{0.0, 1.0}, "1",
          "Left edge of the part that is used, over the tablet's width.");
    visit("right", self.right, Range{0.0, 1.0}, "1", "Its right edge, over the tablet's width.");
    visit("bottom", self.bottom, Range{0.0, 1.0}, "1", "Its lower edge, over the tablet's height.");
    visit("top", self.top, Range{0.0, 1.0}, "1", "Its upper edge, over the tablet's height.");
    visit("rotation", self.rotation, Choices{"0", "90", "180", "270"}, "deg",
          "How far the tablet is turned on the desk, counterclockwise from above.");
    visit("fit", self.fit, Choices{"whole", "cover", "true_size"}, "1",
          "All of the part lies on the sheet, or it covers the sheet, or a metre is a metre; "
          "the aspect is kept and the middles meet.");
  }
};

/// Pen pressure to pressed depth, pen distance to height.
struct TabletPressureParameters {
  double threshold = 0.01;
  double gamma = 1.0;
  double full_depth = 0.42;
  double touch = 0.06;
  double press_speed = 0.07;
  double settle = 0.025;
  double clearance = 0.005;
  double lift = 1.1;
  double hover_height = 0.015;
  double contact_distance = 0.25;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("threshold", self.threshold, Range{0.0, 0.5}, "1",
          "Pressure that counts as none, over the device's full one; worn pens never report 0.");
    visit("gamma", self.gamma, Range{0.1, 10.0}, "1",
          "Pressed depth is full_depth * pressure^gamma; below 1 a light hand presses deeper.");
    visit("full_depth", self.full_depth, Range{0.0, 0.8}, "1",
          "Pressed depth along the shaft at full pressure, over the length of the tip.");
    visit("touch", self.touch, Range{0.001, 1.0}, "1",
          "Pressure by which the brush has come down from clearance to the sheet.");
    visit("press_speed", self.press_speed, Range{0.001, 100.0}, "m/s",
          "Into the sheet the brush goes no faster than this; a pen hits its hard tablet at once.");
    visit(
        "settle", self.settle, Range{0.001, 1.0}, "s",
        "Time constant in which the brush is set down, half the period of its tuft; one that is thrown "
        "onto the sheet swings and splays.");
    visit("clearance", self.clearance, Range{0.0, 0.1}, "m",
          "Height of the point of the brush above the sheet at zero pressure.");
    visit("lift", self.lift, Range{0.0, 5.0}, "1",
          "How much further it is lifted for a moment, over the depth it had and over 10 ms of its way "
          "in the air: a bent tuft springs down, one that is carried swings.");
    visit("hover_height", self.hover_height, Range{0.0, 0.5}, "m",
          "What the greatest distance that the tablet senses adds to that height.");
    visit("contact_distance", self.contact_distance, Range{0.0, 0.99}, "1",
          "Distance that a touching pen reports, over its full one, until a touch has shown it.");
  }
};

/// Tilt and barrel rotation to the orientation of the handle.
struct TabletTiltParameters {
  double gain = 1.0;
  double max = 1.0;
  double smoothing = 0.08;
  double full_scale = 1.1170107212763709;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("gain", self.gain, Range{0.0, 2.0}, "1",
          "Lean of the handle over that of the pen; 0 keeps the brush upright.");
    visit("max", self.max, Range{0.0, 1.3}, "rad", "The handle leans no further than this.");
    visit("smoothing", self.smoothing, Range{0.0, 1.0}, "s",
          "Time constant of each of the two low-passes that the handle's direction runs through; tilt "
          "is noisy.");
    visit("full_scale", self.full_scale, Range{0.1, 1.5}, "rad",
          "Tilt at the end of an axis that has no resolution; Wacom's is 64 degrees.");
  }
};

/// How the handle is held where the pen does not say.
struct TabletGripParameters {
  double tilt = 0.3;
  double azimuth = -0.8;
  double twist = 0.0;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("tilt", self.tilt, Range{0.0, 1.3}, "rad",
          "Lean of the shaft when the pen reports no tilt; an upright tuft splays.");
    visit("azimuth", self.azimuth, Range{-6.2832, 6.2832}, "rad",
          "Where its upper end then leans to, from the sheet's x axis, counterclockwise.");
    visit("twist", self.twist, Range{-6.2832, 6.2832}, "rad",
          "Turn of the brush about its shaft; added to the barrel rotation of pens that report it.");
  }
};

/// What the buttons of the pen do.
struct TabletButtonParameters {
  std::string dip = "stylus";
  std::string wipe = "none";
  std::string clear = "none";
  bool eraser_wipes = true;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    const Choices buttons{"none", "stylus", "stylus2", "stylus3"};
    visit("dip", self.dip, buttons, "1", "Button that dips the brush.");
    visit("wipe", self.wipe, buttons, "1", "Button that wipes the brush.");
    visit("clear", self.clear, buttons, "1", "Button that clears the sheet.");
    visit("eraser_wipes", self.eraser_wipes, "Whether the brush is wiped when the eraser end touches.");
  }
};

/// From a pen on a tablet to a brush on a sheet.
struct TabletParameters {
  TabletDeviceParameters device;
  TabletAreaParameters area;
  TabletPressureParameters pressure;
  TabletTiltParameters tilt;
  TabletGripParameters grip;
  TabletButtonParameters buttons;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit.group("device", self.device);
    visit.group("area", self.area);
    visit.group("pressure", self.pressure);
    visit.group("tilt", self.tilt);
    visit.group("grip", self.grip);
    visit.group("buttons", self.buttons);
  }
};

}  // namespace calligraphy_brush
