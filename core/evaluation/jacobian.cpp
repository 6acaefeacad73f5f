#include "core/evaluation/jacobian.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace saltus {
namespace {

/// Of a plane or of several.
struct Part {
  double min = std::numeric_limits<double>::infinity(), max = -min;
  std::size_t not_positive = 0;
  // Of logarithms: how many, their mean, and the squares of what they are off it.
  double count = 0, mean = 0, squares = 0;

  void take_logarithms(const std::vector<double>& logarithms) {
    count = static_cast<double>(logarithms.size());
    if (logarithms.empty()) return;
    for (double log : logarithms) mean += log;
    mean /= count;
    for (double log : logarithms) squares += (log - mean) * (log - mean);
  }
  void join(const Part& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
    not_positive += other.not_positive;
    if (other.count == 0) return;
    const double both = count + other.count, apart = other.mean - mean;
    squares += other.squares + apart * apart * (count * other.count / both);
    mean += apart * (other.count / both);
    count = both;
  }
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
  constexpr std::size_t last_axis = Dim - 1;
  std::vector<Part> parts(static_cast<std::size_t>(end[last_axis] - begin[last_axis]));
#pragma omp parallel
  {
    std::vector<double> logarithms;
#pragma omp for schedule(static)
    for (int plane = begin[last_axis]; plane < end[last_axis]; ++plane) {
      Part part;
      logarithms.clear();
      const int z = Dim == 3 ? plane : 0;
      for (int y = Dim == 3 ? begin[1] : plane; y < (Dim == 3 ? end[1] : plane + 1); ++y) {
        const float* row = jacobian.samples.data() + (static_cast<std::size_t>(z) * grid.size[1] + y) * grid.size[0];
        for (int x = begin[0]; x < end[0]; ++x) {
          const double value = row[x];
          part.min = std::min(part.min, value);
          part.max = std::max(part.max, value);
          if (value > 0)
            logarithms.push_back(std::log(value));
          else
            ++part.not_positive;
        }
      }
      part.take_logarithms(logarithms);
      parts[static_cast<std::size_t>(plane - begin[last_axis])] = part;
    }
  }
  Part all;
  for (const Part& part : parts) all.join(part);
  JacobianStatistics statistics;
  statistics.min = all.min;
  statistics.max = all.max;
  statistics.n = static_cast<std::size_t>(all.count) + all.not_positive;
  statistics.share_not_positive = static_cast<double>(all.not_positive) / static_cast<double>(statistics.n);
  if (all.count > 0) statistics.sd_log = std::sqrt(all.squares / all.count);
  return statistics;
}

template JacobianStatistics jacobian_statistics(const Volume<2>&);
template JacobianStatistics jacobian_statistics(const Volume<3>&);

}  // namespace saltus
