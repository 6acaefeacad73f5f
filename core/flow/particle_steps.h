#pragma once

#include "core/flow/scatter.h"
#include "core/grid/block_mask.h"
#include "core/grid/cell_lanes.h"
#include "core/support/thread_count.h"

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
#pragma omp parallel for schedule(static) if (is_worth_threads(points.sites()))
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab) {
    CellLanes<Dim, T> cells(velocity_lattice);
    where.visit_pieces(points, slab, cells.kLanes, [&](const Index<Dim>& index, std::size_t site, int count) {
      cells.find(placed<Dim, T>(place, index, at ? lanes_of<Dim, T>(at + Dim * site, count) : LanePoints<Dim, T>{}));
      for (int lane = 0; lane < count; ++lane) {
        const std::array<T, Dim> v = cells.cell(lane).template value<Dim>(velocity);
        const std::size_t first = Dim * (site + static_cast<std::size_t>(lane));
        for (int c = 0; c < Dim; ++c) out[first + c] = (a ? a[first + c] : T(0)) + factor * v[c];
      }
    });
  }
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
  const auto all = BlockMask<Dim>::all(points);
#pragma omp parallel for schedule(static) if (is_worth_threads(points.sites()))
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab) {
    CellLanes<Dim, T> cells(velocity_lattice);
    const auto sample = [&](const Index<Dim>& index, int count, const LanePoints<Dim, T>& at, const T* velocity) {
      LanePoints<Dim, T> values{};
      cells.find(placed<Dim, T>(place, index, at));
      for (int lane = 0; lane < count; ++lane) {
        const std::array<T, Dim> v = cells.cell(lane).template value<Dim>(velocity);
        for (int c = 0; c < Dim; ++c) values[c][lane] = v[c];
      }
      return values;
    };
    all.visit_pieces(points, slab, cells.kLanes, [&](const Index<Dim>& index, std::size_t site, int count) {
      const LanePoints<Dim, T> from = d ? lanes_of<Dim, T>(d + Dim * site, count) : LanePoints<Dim, T>{};
      LanePoints<Dim, T> v =
          on_samples ? lanes_of<Dim, T>(first + Dim * site, count) : sample(index, count, from, first);
      LanePoints<Dim, T> predicted, middle;
      for (int c = 0; c < Dim; ++c)
#pragma omp simd
        for (int lane = 0; lane < cells.kLanes; ++lane) {
          predicted[c][lane] = from[c][lane] + step * v[c][lane];
          middle[c][lane] = from[c][lane] + step / 2 * v[c][lane];
        }
      v = sample(index, count, predicted, second);
      for (int lane = 0; lane < count; ++lane)
        for (int c = 0; c < Dim; ++c)
          out[Dim * (site + static_cast<std::size_t>(lane)) + c] = middle[c][lane] + step / 2 * v[c][lane];
    });
  }
}

/// Adjoint of `advance` with respect to the velocity and to `at`: with the dual of `out`,
/// velocity_dual += transpose of the sampling, at_dual += (gradient of v)^T factor * dual. `at_dual` may be null, and
/// is not `dual`.
template <int Dim, class T>
void advance_adjoint(const Lattice<Dim>& points, const BlockMask<Dim>& where, const T* at,
                     const Lattice<Dim>& velocity_lattice, const T* velocity, T factor, const T* dual, T* velocity_dual,
                     T* at_dual) {
  if (!at && !at_dual && points == velocity_lattice) {
    where.for_runs(points, [&](std::size_t begin, std::size_t count) {
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) velocity_dual[i] += factor * dual[i];
    });
    return;
  }
  const MovedPoints<Dim, T> moved(points, where, at, velocity_lattice);
  const auto scaled_dual = scaled_values<Dim, T>(dual, factor);
  if (!at_dual) return scatter<Dim, Dim, T>(moved, velocity_lattice, scaled_dual, velocity_dual);
  std::array<T, Dim> per_mm;
  for (int c = 0; c < Dim; ++c) per_mm[c] = static_cast<T>(1 / velocity_lattice.spacing[c]);
  scatter<Dim, Dim, T>(moved, velocity_lattice, scaled_dual, velocity_dual,
                       [&](std::size_t site, const LinearCell<Dim, T>& cell, const std::array<T, Dim>& value) {
                         const std::array<T, Dim> gradient = cell.template pulled_back_gradient<Dim>(velocity, value);
                         for (int c = 0; c < Dim; ++c) at_dual[Dim * site + c] += gradient[c] * per_mm[c];
                       });
}

/// Of all sites.
template <int Dim, class T>
void advance_adjoint(const Lattice<Dim>& points, const T* at, const Lattice<Dim>& velocity_lattice, const T* velocity,
                     T factor, const T* dual, T* velocity_dual, T* at_dual) {
  advance_adjoint<Dim, T>(points, BlockMask<Dim>::all(points), at, velocity_lattice, velocity, factor, dual,
                          velocity_dual, at_dual);
}

}  // namespace saltus
