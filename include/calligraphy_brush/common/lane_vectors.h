#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "calligraphy_brush/common/aligned.h"
#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Changes every vector v of a field [..][rows][lane], whose components are the first three rows, to
/// change(v); change takes and gives an Eigen::Vector3d.
template <class Real, class Change>
void changeVectors(AlignedVector<Real>& field, Change&& change, std::size_t rows = 3) {
  for (std::size_t row = 0; row < field.size(); row += rows * kLanes)
    for (std::size_t at = row; at < row + kLanes; ++at) {
      const Eigen::Vector3d changed = change(Eigen::Vector3d(
          double(field[at]), double(field[at + kLanes]), double(field[at + 2 * kLanes])));
      for (std::size_t i = 0; i < 3; ++i)
        field[at + i * kLanes] = static_cast<Real>(changed[static_cast<Eigen::Index>(i)]);
    }
}

}  // namespace calligraphy_brush
