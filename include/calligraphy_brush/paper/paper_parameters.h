#pragma once

#include "calligraphy_brush/common/parameters.h"

namespace calligraphy_brush {

/// The sheet, how liquid moves in it, and its picture.
struct PaperParameters {
  double width = 0.3;
  double height = 0.3;
  double px_per_mm = 4.0;
  int seed = 1;
  double thickness = 80e-6;
  double porosity = 0.6;
  double roughness = 20e-6;
  double fibre_length = 1.5e-3;
  double fibre_width = 30e-6;
  double asperity_pressure = 2000.0;
  double diffusivity = 1e-7;
  int flow_exponent = 3;
  double film_flow = 0.01;
  double unevenness = 0.3;
  double soak_time = 0.2;
  double evaporation = 1e-7;
  double evaporation_rim = 2e-3;
  double settling_rate = 0.05;
  double pigment_mobility = 0.9;
  double dark_thickness = 1.3e-6;
  double scattering = 1.5;
  double absorption_exponent = 1.0;
  double red = 0.88;
  double green = 0.86;
  double blue = 0.80;

  template <class Self, class Visit>
  static void describe(Self& self, Visit& visit) {
    visit("width", self.width, Range{0.005, 2.0}, "m", "Extent of the sheet along x.");
    visit("height", self.height, Range{0.005, 2.0}, "m", "Extent of the sheet along y.");
    visit("px_per_mm", self.px_per_mm, Range{0.5, 40.0}, "px/mm",
          "Resolution of the sheet and of its picture.");
    visit("seed", self.seed, Range{0, 2147483647}, "1", "Seed of the fibres.");
    visit("thickness", self.thickness, Range{5e-6, 2e-3}, "m", "Thickness of the sheet.");
    visit("porosity", self.porosity, Range{0.05, 0.95}, "1",
          "Part of the sheet that is room for liquid.");
    visit("roughness", self.roughness, Range{0.0, 2e-4}, "m",
          "Standard deviation of the height of the surface.");
    visit("fibre_length", self.fibre_length, Range{1e-4, 5e-3}, "m",
          "Length of the fibres in the relief.");
    visit("fibre_width", self.fibre_width, Range{5e-6, 2e-4}, "m", "Width of the fibres in the relief.");
    visit("asperity_pressure", self.asperity_pressure, Range{1.0, 1e7}, "Pa",
          "Pressure that brings dry hair down to the mean plane of the relief; has no measured source.");
    visit("diffusivity", self.diffusivity, Range{0.0, 1e-4}, "m^2/s",
          "D of Washburn's law: a front from a reservoir is at sqrt(2 D t); k p_c / (mu porosity).");
    visit("flow_exponent", self.flow_exponent, Range{1, 8}, "1",
          "q of the diffusivity D_0 theta^q of a sheet that is filled to the part theta.");
    visit("film_flow", self.film_flow, Range{0.0, 1.0}, "1",
          "Diffusivity by films along fibres that are wet already, over D_0; has no measured source.");
    visit("unevenness", self.unevenness, Range{0.0, 1.0}, "1",
          "Standard deviation of the logarithm of the sheet's permeability from place to place.");
    visit("soak_time", self.soak_time, Range{1e-4, 100.0}, "s",
          "Time constant at which a touching bundle and the sheet come to balance; has no measured "
          "source.");
    visit("evaporation", self.evaporation, Range{0.0, 1e-4}, "m/s",
          "Liquid that evaporates from a wet area, as volume per area and time.");
    visit("evaporation_rim", self.evaporation_rim, Range{0.0, 0.01}, "m",
          "The rim of a wet area evaporates as much more as a strip of this width.");
    visit("settling_rate", self.settling_rate, Range{0.0, 100.0}, "1/s",
          "Rate at which pigment in wet paper settles on the fibres for good.");
    visit("pigment_mobility", self.pigment_mobility, Range{0.0, 1.0}, "1",
          "Speed of pigment over that of the liquid that carries it between the fibres.");
    visit("dark_thickness", self.dark_thickness, Range{1e-8, 1e-3}, "m",
          "Volume per area of undiluted ink whose Kubelka-Munk absorption is 1; 1.3 um is soot of 7.5 "
          "m^2/g (Bond and Bergstrom 2006) at 50 kg/m^3.");
    visit("scattering", self.scattering, Range{0.01, 100.0}, "1",
          "Kubelka-Munk scattering of the layer of the sheet that the ink is in.");
    visit("absorption_exponent", self.absorption_exponent, Range{-4.0, 4.0}, "1",
          "Absorption goes as wavelength to minus this; 1 for soot, which makes thin ink brownish.");
    visit("red", self.red, Range{0.05, 0.999}, "1", "Reflectance of the bare sheet at 610 nm.");
    visit("green", self.green, Range{0.05, 0.999}, "1", "Reflectance of the bare sheet at 550 nm.");
    visit("blue", self.blue, Range{0.05, 0.999}, "1", "Reflectance of the bare sheet at 465 nm.");
  }
};

}  // namespace calligraphy_brush
