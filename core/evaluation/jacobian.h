#pragma once

#include <cstddef>

#include "core/grid/jacobian_determinant.h"
#include "core/grid/volume.h"

namespace saltus {

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
