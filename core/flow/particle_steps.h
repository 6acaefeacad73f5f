#pragma once

#include "core/flow/scatter.h"
#include "core/grid/block_mask.h"
#include "core/grid/field_lanes.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace saltus {

/// Moving points with a sampled velocity, and the adjoint. Points are the sites of a lattice with a displacement each
/// (mm, interleaved); velocities (mm per unit time) are sampled linearly, constant beyond their lattice.

/// out = a + factor * v for `count` sites with these cells; a null `a` means 0.
template <int Dim, class T>
[[gnu::noinline]] void advance_piece(const CellLanes<Dim, T>& cells, const T* velocity, T factor, int count, const T* a,
                                     T* out) {
  const LaneVectors<T> from = a ? vectors_of<Dim, T>(a, count) : LaneVectors<T>{};
  cells.visit_vectors(velocity, count,
                      [&](int lane, const auto& v) { put<Dim>(from[lane] + factor * v, out + Dim * lane); });
}

/// What a field is in these cells.
template <int Dim, class T>
[[gnu::noinline]] void sample_piece(const CellLanes<Dim, T>& cells, const T* field, int count, LaneVectors<T>& values) {
  cells.visit_vectors(field, count, [&](int lane, const auto& value) { values[lane] = value; });
}

/// Its gradient there for these duals, by axis and mm.
template <int Dim, class T>
[[gnu::noinline]] void gradient_piece(const CellLanes<Dim, T>& cells, const T* field, const LaneVectors<T>& dual,
                                      const std::array<T, Dim>& per_mm, int count, LaneVectors<T>& gradients) {
  typename CellLanes<Dim, T>::Vector scale{};
  for (int axis = 0; axis < Dim; ++axis) scale[axis] = per_mm[axis];
  cells.visit_gradients(field, dual, count,
                        [&](int lane, const auto&, const auto& gradient) { gradients[lane] = gradient * scale; });
}

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
      advance_piece<Dim, T>(cells, velocity, factor, count, a ? a + Dim * site : nullptr, out + Dim * site);
    });
  }
}

/// Of all sites.
template <int Dim, class T>
void advance(const Lattice<Dim>& points, const T* a, const T* at, const Lattice<Dim>& velocity_lattice,
             const T* velocity, T factor, T* out) {
  advance<Dim, T>(points, BlockMask<Dim>::all(points), a, at, velocity_lattice, velocity, factor, out);
}

/// By axis.
template <class T, int Dim>
std::array<T, Dim> samples_per_mm(const Lattice<Dim>& lattice) {
  std::array<T, Dim> per_mm;
  for (int axis = 0; axis < Dim; ++axis) per_mm[axis] = static_cast<T>(1 / lattice.spacing[axis]);
  return per_mm;
}

/// to += factor * values
template <int Dim, class T>
[[gnu::always_inline]] inline void add_scaled(T factor, const LanePoints<Dim, T>& values, LanePoints<Dim, T>& to) {
  for (int c = 0; c < Dim; ++c)
#pragma omp simd
    for (int lane = 0; lane < CellLanes<Dim, T>::kLanes; ++lane) to[c][lane] += factor * values[c][lane];
}

/// What a step of Heun's rule begins with at `count` sites from `site` on: `first` in these cells, or, where points are
/// at rest at its own samples (no cells), there. Moves `at`, their displacements by component, by step times that.
template <int Dim, class T>
[[gnu::always_inline]] inline LaneVectors<T> predict_piece(const CellLanes<Dim, T>* cells, const T* first,
                                                           std::size_t site, int count, T step,
                                                           LanePoints<Dim, T>& at) {
  LaneVectors<T> v{};
  if (cells)
    sample_piece<Dim, T>(*cells, first, count, v);
  else
    v = vectors_of<Dim, T>(first + Dim * site, count);
  add_scaled<Dim, T>(step, by_component<Dim, T>(v), at);
  return v;
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
    all.visit_pieces(points, slab, cells.kLanes, [&](const Index<Dim>& index, std::size_t site, int count) {
      const LaneVectors<T> from = d ? vectors_of<Dim, T>(d + Dim * site, count) : LaneVectors<T>{};
      LanePoints<Dim, T> at = by_component<Dim, T>(from);
      if (!on_samples) cells.find(placed<Dim, T>(place, index, at));
      const LaneVectors<T> v = predict_piece<Dim, T>(on_samples ? nullptr : &cells, first, site, count, step, at);
      cells.find(placed<Dim, T>(place, index, at));
      const T half = step / 2;
      T* to = out + Dim * site;
      cells.visit_vectors(second, count, [&](int lane, const auto& w) {
        put<Dim>(from[lane] + half * (v[lane] + w), to + Dim * lane);
      });
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
  if (!at_dual) return scatter<Dim, T>(moved, velocity_lattice, scaled_dual, velocity_dual);
  const std::array<T, Dim> per_mm = samples_per_mm<T>(velocity_lattice);
  scatter<Dim, T>(moved, velocity_lattice, scaled_dual, velocity_dual,
                  [&](std::size_t first, int count, const CellLanes<Dim, T>& cells, const LaneVectors<T>& given,
                      const LaneMask& own) {
                    LaneVectors<T> gradients;
                    gradient_piece<Dim, T>(cells, velocity, given, per_mm, count, gradients);
                    T* to = at_dual + Dim * first;  // other threads write those of others
                    for (int lane = 0; lane < count; ++lane)
                      for (int c = 0; c < Dim && own[lane]; ++c) to[Dim * lane + c] += gradients[lane][c];
                  });
}

/// Of all sites.
template <int Dim, class T>
void advance_adjoint(const Lattice<Dim>& points, const T* at, const Lattice<Dim>& velocity_lattice, const T* velocity,
                     T factor, const T* dual, T* velocity_dual, T* at_dual) {
  advance_adjoint<Dim, T>(points, BlockMask<Dim>::all(points), at, velocity_lattice, velocity, factor, dual,
                          velocity_dual, at_dual);
}

/// For each plane (last axis), how fast the field of its sites goes along that axis; infinite where it is not a number.
template <int Dim, class T>
std::vector<T> fastest_across(const Lattice<Dim>& lattice, const T* velocity) {
  const std::size_t planes = static_cast<std::size_t>(lattice.size[Dim - 1]), sites = lattice.sites() / planes;
  std::vector<T> fastest(planes);
#pragma omp parallel for schedule(static)
  for (std::size_t plane = 0; plane < planes; ++plane) {
    const T* across = velocity + Dim * sites * plane + Dim - 1;
    T most = 0;
    int odd = 0;
#pragma omp simd reduction(max : most) reduction(+ : odd)
    for (std::size_t i = 0; i < sites; ++i) {
      const T speed = std::abs(across[Dim * i]);
      most = speed > most ? speed : most;
      odd += speed != speed;
    }
    fastest[plane] = odd > 0 ? std::numeric_limits<T>::infinity() : most;
  }
  return fastest;
}

/// Whether all displacements of a slab are numbers: a point that is nowhere along one axis has no velocity, and a step
/// takes it out of the planes that it seems to reach.
template <int Dim, class T>
bool is_somewhere(const Lattice<Dim>& points, const T* displacement, int slab) {
  const std::size_t count = Dim * points.sites() / static_cast<std::size_t>(points.size[Dim - 1]);
  const T* of_slab = displacement + count * static_cast<std::size_t>(slab);
  int odd = 0;
#pragma omp simd reduction(+ : odd)
  for (std::size_t i = 0; i < count; ++i) odd += of_slab[i] != of_slab[i];
  return odd == 0;
}

/// Where the points of a slab may come to in a step, along the last axis.
struct SlabReach {
  std::array<int, 2> planes;  ///< first and last
  int way;                    ///< planes between where a point is and where it may come to
};

/// Of points in `planes`, with the velocity there, which is `step` times `fastest` at most; one plane more for what
/// rounding adds, and all of them where that is not a number.
template <class T>
SlabReach widened(const std::array<int, 2>& planes, const std::vector<T>& fastest, T step) {
  const int count = static_cast<int>(fastest.size());
  T most = 0;
  for (int plane = std::max(0, planes[0]); plane <= std::min(count - 1, planes[1]); ++plane)
    most = std::max(most, step * fastest[static_cast<std::size_t>(plane)]);
  const int way = most < static_cast<T>(count) ? static_cast<int>(most) + 2 : count;
  return {{std::max(0, planes[0] - way), std::min(count, planes[1] + way)}, way};
}

/// Adjoint of advance_heun with respect to both velocities and to `d`: with the dual of `out`, adds to the duals of the
/// velocities and writes that of `d` (null: not), which is not `dual`. As in `scatter` a thread owns a range of planes
/// of the velocities, and besides its share of the slabs of points, whose duals it writes. Where `dual` is 0 nothing is
/// looked at: it may be no number.
template <int Dim, class T>
void advance_heun_adjoint(const Lattice<Dim>& points, const T* d, const Lattice<Dim>& velocity_lattice, const T* first,
                          const T* second, T step, const T* dual, T* first_dual, T* second_dual, T* d_dual) {
  const SitePlacement<Dim, T> place(points, velocity_lattice);
  const bool on_samples = !d && points == velocity_lattice;
  const auto all = BlockMask<Dim>::all(points);
  const std::array<T, Dim> per_mm = samples_per_mm<T>(velocity_lattice);
  const int planes = velocity_lattice.size[Dim - 1], slabs = points.size[Dim - 1];
  const int parts = std::max(1, std::min(planes, threads_of_loop(points.sites())));
  std::vector<SlabReach> reach(static_cast<std::size_t>(slabs), SlabReach{{0, planes}, planes});
  if (parts > 1) {
    const MovedPoints<Dim, T> moved(points, all, d, velocity_lattice);
    const std::vector<T> fastest = fastest_across<Dim, T>(velocity_lattice, first);
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < slabs; ++slab)
      if (!d || is_somewhere<Dim, T>(points, d, slab))
        reach[static_cast<std::size_t>(slab)] =
            widened(moved.reach(slab, velocity_lattice), fastest, std::abs(step) * per_mm[Dim - 1]);
  }
#pragma omp parallel for schedule(static, 1) if (parts > 1)
  for (int part = 0; part < parts; ++part) {
    const int begin = planes * part / parts, end = planes * (part + 1) / parts;
    const int own_begin = slabs * part / parts, own_end = slabs * (part + 1) / parts;
    CellLanes<Dim, T> cells(velocity_lattice), predicted(velocity_lattice);
    LaneVectors<T> gradients{};
    LaneMask wanted;
    for (int slab = 0; slab < slabs; ++slab) {
      const bool is_own = own_begin <= slab && slab < own_end;
      const SlabReach& of_slab = reach[static_cast<std::size_t>(slab)];
      if (!is_own && (of_slab.planes[0] >= end || of_slab.planes[1] < begin)) continue;
      all.visit_pieces(points, slab, cells.kLanes, [&](const Index<Dim>& index, std::size_t site, int count) {
        LaneVectors<T> given = vectors_of<Dim, T>(dual + Dim * site, count);
        const LaneVectors<T> dual_here = given;
        mark_nonzero<Dim, T>(given, wanted);
        if (std::none_of(wanted.begin(), wanted.begin() + count, [](int one) { return one != 0; })) {
          if (d_dual && is_own) std::fill_n(d_dual + Dim * site, Dim * count, T(0));
          return;
        }
        LanePoints<Dim, T> at = d ? lanes_of<Dim, T>(d + Dim * site, count) : LanePoints<Dim, T>{};
        if (!on_samples) cells.find(placed<Dim, T>(place, index, at));
        // Of another thread's slab the pieces that come here, which are few.
        if (!is_own && !on_samples && !cells.reach(count, begin - of_slab.way, end + of_slab.way)) return;
        predict_piece<Dim, T>(on_samples ? nullptr : &cells, first, site, count, step, at);
        predicted.find(placed<Dim, T>(place, index, at));

        for (auto& one : given) one *= step / 2;
        mark_nonzero<Dim, T>(given, wanted);
        if (predicted.reach(count, begin, end)) predicted.spread(given, count, wanted, begin, end, second_dual);
        const bool comes_first = !on_samples && cells.reach(count, begin, end);
        if (!is_own && !comes_first) return;
        gradient_piece<Dim, T>(predicted, second, given, per_mm, count, gradients);
        for (int lane = 0; lane < count; ++lane) given[lane] += step * gradients[lane];
        if (on_samples) {
          T* to = first_dual + Dim * site;
          const LaneVectors<T> before = vectors_of<Dim, T>(to, count);
          for (int lane = 0; lane < count; ++lane) put<Dim>(before[lane] + given[lane], to + Dim * lane);
        } else if (comes_first) {
          mark_nonzero<Dim, T>(given, wanted);
          cells.spread(given, count, wanted, begin, end, first_dual);
        }
        if (!d_dual || !is_own) return;
        LaneVectors<T> at_start{};
        if (!on_samples) gradient_piece<Dim, T>(cells, first, given, per_mm, count, at_start);
        T* to = d_dual + Dim * site;
        for (int lane = 0; lane < count; ++lane)
          put<Dim>(dual_here[lane] + gradients[lane] + at_start[lane], to + Dim * lane);
      });
    }
  }
}

}  // namespace saltus
