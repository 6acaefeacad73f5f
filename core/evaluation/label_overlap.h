#pragma once

#include <cstddef>
#include <vector>

#include "core/grid/volume.h"

namespace saltus {

/// Dice coefficient 2 |A and B| / (|A| + |B|) of one label.
struct LabelOverlap {
  int label = 0;
  std::size_t voxels_a = 0;
  std::size_t voxels_b = 0;
  double dice = 0;
};

/// Every label other than 0 that is in `a` or in `b`, in ascending order; samples are rounded to the nearest integer.
/// Throws InvalidInput when the grids differ or neither image has a label.
template <int Dim>
std::vector<LabelOverlap> label_overlaps(const Volume<Dim>& a, const Volume<Dim>& b);

}  // namespace saltus
