#pragma once

#include "core/flow/scatter_plan.h"
#include "core/grid/block_mask.h"
#include "core/grid/interpolation.h"

namespace saltus {

/// Moving points with a sampled velocity, and the adjoint. Points are the sites of a lattice with a displacement each
/// (mm, interleaved); velocities (mm per unit time) are sampled linearly, constant beyond their lattice.

/// out(x) = a(x) + factor * v(x + at(x)) for the sites x of `points` in `where`; `out` may be `a`. A null `a` or `at`
/// means 0.
template <int Dim, class T>
void advance(const Lattice<Dim>& points, const BlockMask<Dim>& where, const T* a, const T* at,
             const Lattice<Dim>& velocity_lattice, const T* velocity, T factor, T* out) {
  const SitePlacement<Dim, T> place(points, velocity_lattice);
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab)
    where.visit_sites(points, slab, [&](const Index<Dim>& index, std::size_t site) {
      static constexpr T none[Dim] = {};
      const LinearCell<Dim, T> cell(velocity_lattice, place(index, at ? at + Dim * site : none));
      const std::array<T, Dim> v = cell.template value<Dim>(velocity);
      for (int c = 0; c < Dim; ++c) out[Dim * site + c] = (a ? a[Dim * site + c] : T(0)) + factor * v[c];
    });
}

/// Of all sites.
template <int Dim, class T>
void advance(const Lattice<Dim>& points, const T* a, const T* at, const Lattice<Dim>& velocity_lattice,
             const T* velocity, T factor, T* out) {
  advance<Dim, T>(points, BlockMask<Dim>::all(points), a, at, velocity_lattice, velocity, factor, out);
}

/// Adjoint of `advance` with respect to the velocity and to `at`: with the dual of `out`,
/// velocity_dual += transpose of the sampling, at_dual += (gradient of v)^T factor * dual. `at_dual` may be null.
template <int Dim, class T>
void advance_adjoint(const Lattice<Dim>& points, const BlockMask<Dim>& where, const T* at,
                     const Lattice<Dim>& velocity_lattice, const T* velocity, T factor, const T* dual,
                     ScatterPlan<Dim, T>& plan, T* velocity_dual, T* at_dual) {
  plan.place_sites(points, where, at, velocity_lattice);
  plan.template add<Dim>(
      [&](std::size_t point, std::array<T, Dim>& out) {
        const T* given = dual + Dim * plan.site(point);
        bool any = false;
        for (int c = 0; c < Dim; ++c) {
          out[c] = factor * given[c];
          any = any || out[c] != T(0);
        }
        return any;
      },
      velocity_dual);
  if (!at_dual) return;
  const std::size_t count = plan.size();
#pragma omp parallel for schedule(static)
  for (std::size_t point = 0; point < count; ++point) {
    const std::size_t site = plan.site(point);
    std::array<T, Dim> value;
    for (int c = 0; c < Dim; ++c) value[c] = factor * dual[Dim * site + c];
    const std::array<T, Dim> gradient = plan.cell(point).template pulled_back_gradient<Dim>(velocity, value);
    for (int c = 0; c < Dim; ++c) at_dual[Dim * site + c] += gradient[c] / static_cast<T>(velocity_lattice.spacing[c]);
  }
}

/// Of all sites.
template <int Dim, class T>
void advance_adjoint(const Lattice<Dim>& points, const T* at, const Lattice<Dim>& velocity_lattice, const T* velocity,
                     T factor, const T* dual, ScatterPlan<Dim, T>& plan, T* velocity_dual, T* at_dual) {
  advance_adjoint<Dim, T>(points, BlockMask<Dim>::all(points), at, velocity_lattice, velocity, factor, dual, plan,
                          velocity_dual, at_dual);
}

}  // namespace saltus
