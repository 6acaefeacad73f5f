#pragma once

#include "core/flow/scatter.h"

#include <vector>

namespace saltus {

/// What particle_steps.h does for the sites of a lattice, for points anywhere: Dim coordinates each, mm in the frame.

/// Index coordinates of a point on a lattice.
template <int Dim, class T>
std::array<T, Dim> index_of(const Lattice<Dim>& lattice, const T* point) {
  std::array<T, Dim> at;
  for (int a = 0; a < Dim; ++a)
    at[a] = static_cast<T>((static_cast<double>(point[a]) - lattice.offset[a]) / lattice.spacing[a]);
  return at;
}

/// out = a + factor * v(at), point by point; `out` may be any of the others.
template <int Dim, class T>
void advance_points(const std::vector<T>& a, const std::vector<T>& at, const Lattice<Dim>& velocity_lattice,
                    const T* velocity, T factor, std::vector<T>& out) {
  const std::size_t count = at.size() / Dim;
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < count; ++p) {
    const LinearCell<Dim, T> cell(velocity_lattice, index_of<Dim, T>(velocity_lattice, at.data() + Dim * p));
    const std::array<T, Dim> v = cell.template value<Dim>(velocity);
    for (int c = 0; c < Dim; ++c) out[Dim * p + c] = a[Dim * p + c] + factor * v[c];
  }
}

/// Its adjoint with respect to the velocity and to `at`: velocity_dual += transpose of the sampling of factor * dual,
/// at_dual += (gradient of v)^T factor * dual (null: not).
template <int Dim, class T>
void advance_points_adjoint(const std::vector<T>& at, const Lattice<Dim>& velocity_lattice, const T* velocity, T factor,
                            const std::vector<T>& dual, T* velocity_dual, std::vector<T>* at_dual) {
  const auto points = listed_points<Dim, T>(
      at.size() / Dim, [&](std::size_t p) { return index_of<Dim, T>(velocity_lattice, at.data() + Dim * p); });
  const auto scaled_dual = scaled_values<Dim, T>(dual.data(), factor);
  if (!at_dual) return scatter<Dim, T>(points, velocity_lattice, scaled_dual, velocity_dual);
  scatter<Dim, T>(points, velocity_lattice, scaled_dual, velocity_dual,
                  [&](std::size_t first, int count, const CellLanes<Dim, T>& cells, const LaneVectors<T>& given,
                      const LaneMask& own) {
                    cells.visit_gradients(velocity, given, count, [&](int lane, const auto&, const auto& gradient) {
                      T* to = at_dual->data() + Dim * (first + static_cast<std::size_t>(lane));
                      for (int c = 0; c < Dim && own[lane]; ++c)
                        to[c] += gradient[c] / static_cast<T>(velocity_lattice.spacing[c]);
                    });
                  });
}

}  // namespace saltus
