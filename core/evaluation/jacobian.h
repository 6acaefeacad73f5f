#pragma once

#include <cstddef>

#include "core/grid/volume.h"

namespace saltus {

/// det D(x + u(x)) at each voxel from central differences of u, one-sided at the border; an axis of one voxel counts
/// as constant. Across a sliding interface the differences bridge the jump: the value there says nothing about a fold.
template <int Dim>
Volume<Dim> jacobian_determinant(const VectorVolume<Dim>& displacement);

/// Over the interior: without the outermost voxels of each axis that has more than two.
struct JacobianStatistics {
  std::size_t n = 0;
  double min = 0;
  double max = 0;
  double share_not_positive = 0;  ///< J <= 0
  double sd_log = 0;              ///< of log J where J > 0; of the population
};

template <int Dim>
JacobianStatistics jacobian_statistics(const Volume<Dim>& jacobian);

}  // namespace saltus
