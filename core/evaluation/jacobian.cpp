#include "core/evaluation/jacobian.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace saltus {
namespace {

/// Of a plane. Logarithms are taken from one that is common to all planes: what is alike everywhere leaves nothing to
/// cancel.
struct Part {
  double min = std::numeric_limits<double>::infinity(), max = -min;
  std::size_t positive = 0, not_positive = 0;
  double sum = 0, squares = 0;
};

}  // namespace

template <int Dim>
JacobianStatistics jacobian_statistics(const Volume<Dim>& jacobian) {
  const ImageGrid<Dim>& grid = jacobian.grid;
  std::array<int, 3> begin{}, end{1, 1, 1};
  for (int axis = 0; axis < Dim; ++axis) {
    begin[axis] = grid.size[axis] > 2 ? 1 : 0;
    end[axis] = grid.size[axis] - begin[axis];
  }
  const auto first = std::find_if(jacobian.samples.begin(), jacobian.samples.end(), [](float j) { return j > 0; });
  const double start = first == jacobian.samples.end() ? 0 : std::log(static_cast<double>(*first));
  const int last_axis = Dim - 1;
  std::vector<Part> parts(static_cast<std::size_t>(end[last_axis] - begin[last_axis]));
#pragma omp parallel for schedule(static)
  for (int plane = begin[last_axis]; plane < end[last_axis]; ++plane) {
    Part part;
    const int z_begin = Dim == 3 ? plane : 0, y_begin = Dim == 3 ? begin[1] : plane;
    const int y_end = Dim == 3 ? end[1] : plane + 1;
    for (int y = y_begin; y < y_end; ++y) {
      const float* row =
          jacobian.samples.data() + (static_cast<std::size_t>(z_begin) * grid.size[1] + y) * grid.size[0];
      for (int x = begin[0]; x < end[0]; ++x) {
        const double value = row[x];
        part.min = std::min(part.min, value);
        part.max = std::max(part.max, value);
        if (!(value > 0)) {
          ++part.not_positive;
          continue;
        }
        const double log = std::log(value) - start;
        ++part.positive;
        part.sum += log;
        part.squares += log * log;
      }
    }
    parts[static_cast<std::size_t>(plane - begin[last_axis])] = part;
  }
  Part all;
  for (const Part& part : parts) {
    all.min = std::min(all.min, part.min);
    all.max = std::max(all.max, part.max);
    all.positive += part.positive;
    all.not_positive += part.not_positive;
    all.sum += part.sum;
    all.squares += part.squares;
  }
  JacobianStatistics statistics;
  statistics.min = all.min;
  statistics.max = all.max;
  statistics.n = all.positive + all.not_positive;
  statistics.share_not_positive = static_cast<double>(all.not_positive) / static_cast<double>(statistics.n);
  if (all.positive == 0) return statistics;
  const double mean = all.sum / static_cast<double>(all.positive);
  statistics.sd_log = std::sqrt(std::max(0.0, all.squares / static_cast<double>(all.positive) - mean * mean));
  return statistics;
}

template JacobianStatistics jacobian_statistics(const Volume<2>&);
template JacobianStatistics jacobian_statistics(const Volume<3>&);

}  // namespace saltus
