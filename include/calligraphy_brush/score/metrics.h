#pragma once

#include <vector>

#include "calligraphy_brush/score/mask.h"

namespace calligraphy_brush {

/// Intersection over union of two masks of one size, the Jaccard index, in [0, 1]; 1 if both are empty.
/// Throws std::invalid_argument, as all functions here, if sizes or resolutions differ.
double intersectionOverUnion(const Mask& a, const Mask& b);

/// Best likeness that a shift gives.
struct Registration {
  double iou = 0.0;
  double dx_mm = 0.0, dy_mm = 0.0;  ///< by which b is moved, y up
};

/// Largest intersectionOverUnion over all shifts of `b` by whole pixels, up to ±reach_mm along each
/// axis. What is shifted off the picture still counts in the union. Of equal ones the shortest shift.
Registration registered(const Mask& a, const Mask& b, double reach_mm);

/// Cosine of the angle between two pictures as vectors of darkness, 255 − grey: Σab / √(Σa² Σb²), in
/// [0, 1]; 1 if both are white, 0 if one is.
double cosineLikeness(const GreyPicture& a, const GreyPicture& b);

/// Symmetric chamfer distance of the masks' edges [mm]: mean distance of a's edge to b's and of b's to
/// a's, and the mean of the two (Barrow et al. 1977). An edge is ink with a neighbour above, below, left
/// or right that is not, or at the rim. +∞ if one mask is empty, 0 if both are.
double chamferDistance_mm(const Mask& a, const Mask& b);

/// Width of the widest line [mm]: the diameter of the largest disc that lies within the ink, twice the
/// largest value of the exact distance transform; within 1.3 pixels. 0 without ink.
double widestLine_mm(const Mask& mask);

/// Extent of the ink of one column from the lowest to the highest [mm] from the lower edge.
struct ColumnExtent {
  bool inked = false;
  double low_mm = 0.0, high_mm = 0.0;
};
/// Of the column that holds x [mm]; not inked beyond the picture.
ColumnExtent columnExtent(const Mask& mask, double x_mm);

/// Pearson's correlation of two lists of one length; 0 if one of them is constant or has < 2 values.
double correlation(const std::vector<double>& a, const std::vector<double>& b);

/// Value below which the part `p` in [0, 1] of the values is, linear between; NaN for an empty list.
double quantile(std::vector<double> values, double p);

/// Arithmetic mean; NaN for an empty list.
double mean(const std::vector<double>& values);

/// Least-squares line y = slope · x + offset. Throws std::invalid_argument if all x are the same.
struct Line {
  double slope, offset;
};
Line fitLine(const std::vector<double>& x, const std::vector<double>& y);

}  // namespace calligraphy_brush
