#include "core/grid/contrast.h"

#include "core/support/reduction.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace saltus {

template <int Dim, class T>
double rms_gradient(const Lattice<Dim>& lattice, const T* samples, const T* weights) {
  const double finest = *std::min_element(lattice.spacing.begin(), lattice.spacing.end());
  const auto nx = static_cast<std::size_t>(lattice.size[0]);
  const std::size_t rows = lattice.sites() / nx;
  double square = 0;
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const auto length = static_cast<std::size_t>(lattice.size[axis]);
    std::vector<double> sums(rows);
    std::vector<std::size_t> counts(rows);
#pragma omp parallel for schedule(static)
    for (std::size_t row = 0; row < rows; ++row) {
      // Each sample that is the first of four along the axis; along a row either all are or, beside its end, none.
      if (axis > 0 && nx * row / stride % length + 3 >= length) continue;
      for (std::size_t i = nx * row, end = i + (axis > 0 ? nx : nx - std::min<std::size_t>(nx, 3)); i < end; ++i) {
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
    stride *= length;
  }
  return std::sqrt(std::max(0.0, square));
}

template double rms_gradient(const Lattice<2>&, const float*, const float*);
template double rms_gradient(const Lattice<3>&, const float*, const float*);
template double rms_gradient(const Lattice<2>&, const double*, const double*);
template double rms_gradient(const Lattice<3>&, const double*, const double*);

}  // namespace saltus
