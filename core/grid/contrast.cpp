#include "core/grid/contrast.h"

#include "core/support/reduction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace saltus {

template <int Dim, class T>
double rms_gradient(const Lattice<Dim>& lattice, const T* samples, const T* weights, const IndexBox<Dim>& box) {
  const double finest = *std::min_element(lattice.spacing.begin(), lattice.spacing.end());
  const auto nx = static_cast<std::size_t>(lattice.size[0]);
  const std::size_t rows = lattice.sites() / nx;
  double square = 0;
  bool is_told = false;
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    IndexBox<Dim> firsts = box;  // of four samples along the axis
    firsts.end[axis] -= 3;
    std::vector<double> sums(rows);
    std::vector<std::size_t> counts(rows);
#pragma omp parallel for schedule(static)
    for (std::size_t row = 0; row < rows; ++row) {
      bool is_inside = true;
      for (std::size_t a = 1, rest = row; a < Dim; ++a) {
        const int at = static_cast<int>(rest % static_cast<std::size_t>(lattice.size[a]));
        is_inside = is_inside && at >= firsts.begin[a] && at < firsts.end[a];
        rest /= static_cast<std::size_t>(lattice.size[a]);
      }
      if (!is_inside) continue;
      for (int x = firsts.begin[0]; x < firsts.end[0]; ++x) {
        const std::size_t i = nx * row + static_cast<std::size_t>(x);
        if (weights &&
            !(weights[i] > 0 && weights[i + stride] > 0 && weights[i + 2 * stride] > 0 && weights[i + 3 * stride] > 0))
          continue;
        sums[row] += static_cast<double>(samples[i + 2 * stride] - samples[i]) *
                     static_cast<double>(samples[i + 3 * stride] - samples[i + stride]) / 4;
        ++counts[row];
      }
    }
    std::size_t count = 0;
    for (std::size_t of_row : counts) count += of_row;
    const double sum = ordered_sum(rows, [&](std::size_t row) { return sums[row]; });
    const double per_finest = finest / lattice.spacing[axis];
    if (count > 0) square += per_finest * per_finest * sum / static_cast<double>(count);
    is_told = is_told || count > 0;
    stride *= static_cast<std::size_t>(lattice.size[axis]);
  }
  return is_told ? std::sqrt(std::max(0.0, square)) : std::numeric_limits<double>::infinity();
}

template double rms_gradient(const Lattice<2>&, const float*, const float*, const IndexBox<2>&);
template double rms_gradient(const Lattice<3>&, const float*, const float*, const IndexBox<3>&);
template double rms_gradient(const Lattice<2>&, const double*, const double*, const IndexBox<2>&);
template double rms_gradient(const Lattice<3>&, const double*, const double*, const IndexBox<3>&);

}  // namespace saltus
