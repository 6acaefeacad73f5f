#include "core/evaluation/jacobian.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/support/reduction.h"

namespace saltus {

template <int Dim>
JacobianStatistics jacobian_statistics(const Volume<Dim>& jacobian) {
  JacobianStatistics statistics;
  statistics.min = std::numeric_limits<double>::infinity();
  statistics.max = -statistics.min;
  std::size_t not_positive = 0;
  std::vector<double> logarithms;
  const ImageGrid<Dim>& grid = jacobian.grid;
  logarithms.reserve(grid.voxels());
  std::array<int, 3> begin{}, end{1, 1, 1};
  for (int axis = 0; axis < Dim; ++axis) {
    begin[axis] = grid.size[axis] > 2 ? 1 : 0;
    end[axis] = grid.size[axis] - begin[axis];
  }
  for (int z = begin[2]; z < end[2]; ++z)
    for (int y = begin[1]; y < end[1]; ++y) {
      const float* row = jacobian.samples.data() + (static_cast<std::size_t>(z) * grid.size[1] + y) * grid.size[0];
      for (int x = begin[0]; x < end[0]; ++x) {
        const double value = row[x];
        statistics.min = std::min(statistics.min, value);
        statistics.max = std::max(statistics.max, value);
        if (value > 0) {
          logarithms.push_back(value);
        } else {
          ++not_positive;
        }
      }
    }
  const std::size_t positive = logarithms.size();
  statistics.n = positive + not_positive;
  statistics.share_not_positive = static_cast<double>(not_positive) / static_cast<double>(statistics.n);
  if (positive == 0) return statistics;
#pragma omp parallel for schedule(static)
  for (std::size_t i = 0; i < positive; ++i) logarithms[i] = std::log(logarithms[i]);
  const auto count = static_cast<double>(positive);
  const double mean = ordered_sum(positive, [&](std::size_t i) { return logarithms[i]; }) / count;
  const auto square = [&](std::size_t i) { return (logarithms[i] - mean) * (logarithms[i] - mean); };
  statistics.sd_log = std::sqrt(ordered_sum(positive, square) / count);
  return statistics;
}

template JacobianStatistics jacobian_statistics(const Volume<2>&);
template JacobianStatistics jacobian_statistics(const Volume<3>&);

}  // namespace saltus
