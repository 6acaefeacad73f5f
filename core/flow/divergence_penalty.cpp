#include "core/flow/divergence_penalty.h"

#include "core/support/planes.h"

#include <algorithm>
#include <array>
#include <vector>

namespace saltus {

/// The cells of a row share the rows of sites at their edges along x; with r their weighted sum, component by
/// component,
///
///     divergence(x) = -r_0(x) + r_0(x + 1) + sum over c > 0 of r_c(x) + r_c(x + 1),
///
/// so that all but this sum runs over whole rows of interleaved values, and so does its adjoint.
template <int Dim, class T>
double add_divergence_penalty(const Lattice<Dim>& lattice, const T* velocity, double factor, T* dual) {
  constexpr int rows = 1 << (Dim - 1), corners = 2 * rows;
  const auto width = static_cast<std::size_t>(lattice.size[0]), values = Dim * width;
  std::array<std::size_t, rows> row_step{};  // from the lowest row of a cell, in values
  std::array<std::vector<T>, rows> weights;  // of a row's values in r; 0 for the component along an axis of one sample
  std::array<std::size_t, Dim> stride;
  std::size_t sites = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    stride[axis] = sites;
    sites *= static_cast<std::size_t>(lattice.size[axis]);
  }
  for (int row = 0; row < rows; ++row) {
    for (int axis = 1; axis < Dim; ++axis)
      if ((row >> (axis - 1) & 1) && lattice.size[axis] > 1) row_step[row] += Dim * stride[axis];
    weights[row].resize(values);
    for (std::size_t i = 0; i < values; ++i) {
      const auto axis = i % Dim;
      // Mean over the cell's edges along this axis.
      const double slope = lattice.size[axis] > 1 ? 2.0 / (corners * lattice.spacing[axis]) : 0.0;
      weights[row][i] = static_cast<T>(axis == 0 || (row >> (axis - 1) & 1) ? slope : -slope);
    }
  }
  Lattice<Dim> cells = lattice;
  for (int& extent : cells.size) extent = extent > 1 ? extent - 1 : 1;
  const std::size_t upper = width > 1 ? Dim : 0;  // from a cell's lower site along x to its upper one, in values
  const int rows_a_slab = Dim == 3 ? cells.size[1] : 1;
  const T weight = static_cast<T>(factor * lattice.cell_volume());
  std::vector<double> energy(static_cast<std::size_t>(cells.size[Dim - 1]), 0.0);
  for_planes_apart<2>(cells.size[Dim - 1], [&](int slab) {
    std::vector<T> r(values), pull(width + 1), spread(values);  // pull(x) of cell x - 1, with 0 at both ends
    for (int y = 0; y < rows_a_slab; ++y) {
      const std::size_t first = Dim * (stride[Dim - 1] * static_cast<std::size_t>(slab) +
                                       (Dim == 3 ? stride[1] * static_cast<std::size_t>(y) : 0));
      std::fill(r.begin(), r.end(), T(0));
      for (int row = 0; row < rows; ++row) {
        const T *from = velocity + first + row_step[row], *w = weights[row].data();
#pragma omp simd
        for (std::size_t i = 0; i < values; ++i) r[i] += w[i] * from[i];
      }
      double sum = 0;
      for (std::size_t x = 0; x < static_cast<std::size_t>(cells.size[0]); ++x) {
        T divergence = r[Dim * x + upper] - r[Dim * x];
        for (std::size_t c = 1; c < Dim; ++c) divergence += r[Dim * x + c] + r[Dim * x + upper + c];
        sum += static_cast<double>(divergence) * divergence;
        pull[x + 1] = weight * divergence;
      }
      energy[static_cast<std::size_t>(slab)] += sum;
      if (width == 1) {
        for (std::size_t c = 0; c < Dim; ++c) spread[c] = 2 * pull[1];
      } else {
        pull[0] = pull[width] = 0;
        for (std::size_t x = 0; x < width; ++x) {
          spread[Dim * x] = pull[x] - pull[x + 1];
          for (std::size_t c = 1; c < Dim; ++c) spread[Dim * x + c] = pull[x] + pull[x + 1];
        }
      }
      for (int row = 0; row < rows; ++row) {
        T* to = dual + first + row_step[row];
        const T* w = weights[row].data();
#pragma omp simd
        for (std::size_t i = 0; i < values; ++i) to[i] += w[i] * spread[i];
      }
    }
  });
  double total = 0;
  for (double sum : energy) total += sum;
  return 0.5 * factor * lattice.cell_volume() * total;
}

template double add_divergence_penalty<2, float>(const Lattice<2>&, const float*, double, float*);
template double add_divergence_penalty<3, float>(const Lattice<3>&, const float*, double, float*);
template double add_divergence_penalty<2, double>(const Lattice<2>&, const double*, double, double*);
template double add_divergence_penalty<3, double>(const Lattice<3>&, const double*, double, double*);

}  // namespace saltus
