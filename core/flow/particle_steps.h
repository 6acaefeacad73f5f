#pragma once

#include "core/flow/scatter_plan.h"
#include "core/grid/block_mask.h"
#include "core/grid/interpolation.h"

#include <algorithm>

namespace saltus {

/// Moving points with a sampled velocity, and the adjoint. Points are the sites of a lattice with a displacement each
/// (mm, interleaved); velocities (mm per unit time) are sampled linearly, constant beyond their lattice.

/// out(x) = a(x) + factor * v(x + at(x)) for the sites x of `points` in `where`; `out` may be `a`. A null `a` or `at`
/// means 0.
template <int Dim, class T>
void advance(const Lattice<Dim>& points, const BlockMask<Dim>& where, const T* a, const T* at,
             const Lattice<Dim>& velocity_lattice, const T* velocity, T factor, T* out) {
  if (!at && points == velocity_lattice) {  // no site lies between the samples
    where.for_runs(points, [&](std::size_t begin, std::size_t count) {
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i)
        out[i] = (a ? a[i] : T(0)) + factor * velocity[i];
    });
    return;
  }
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

/// One step of Heun's rule: out(x) = d(x) + step/2 (first(x + d(x)) + second(x + d(x) + step * first(x + d(x)))), for
/// all sites. A null `d` means 0; `out` may be `d`.
template <int Dim, class T>
void advance_heun(const Lattice<Dim>& points, const T* d, const Lattice<Dim>& velocity_lattice, const T* first,
                  const T* second, T step, T* out) {
  const SitePlacement<Dim, T> place(points, velocity_lattice);
  const bool on_samples = !d && points == velocity_lattice;
  const auto sample = [&](const Index<Dim>& index, const T* at, const T* velocity) {
    return LinearCell<Dim, T>(velocity_lattice, place(index, at)).template value<Dim>(velocity);
  };
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab)
    visit_slab<Dim>(points, slab, [&](const Index<Dim>& index, std::size_t site) {
      T from[Dim] = {}, predicted[Dim], middle[Dim];
      if (d) std::copy_n(d + Dim * site, Dim, from);
      std::array<T, Dim> v;
      if (on_samples)
        std::copy_n(first + Dim * site, Dim, v.begin());
      else
        v = sample(index, from, first);
      for (int c = 0; c < Dim; ++c) {
        predicted[c] = from[c] + step * v[c];
        middle[c] = from[c] + step / 2 * v[c];
      }
      v = sample(index, predicted, second);
      for (int c = 0; c < Dim; ++c) out[Dim * site + c] = middle[c] + step / 2 * v[c];
    });
}

/// Adjoint of `advance` with respect to the velocity and to `at`: with the dual of `out`,
/// velocity_dual += transpose of the sampling, at_dual += (gradient of v)^T factor * dual. `at_dual` may be null.
template <int Dim, class T>
void advance_adjoint(const Lattice<Dim>& points, const BlockMask<Dim>& where, const T* at,
                     const Lattice<Dim>& velocity_lattice, const T* velocity, T factor, const T* dual,
                     ScatterPlan<Dim, T>& plan, T* velocity_dual, T* at_dual) {
  if (!at && !at_dual && points == velocity_lattice) {
    where.for_runs(points, [&](std::size_t begin, std::size_t count) {
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) velocity_dual[i] += factor * dual[i];
    });
    return;
  }
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
