#pragma once

#include "core/grid/block_mask.h"
#include "core/grid/interpolation.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {

/// Adds values at scattered points to a lattice: the transpose of linear interpolation, in parallel and with a result
/// that does not depend on the number of threads.
///
/// Points are sorted by the target plane (last axis) they fall into. A thread owns a range of planes and visits the
/// points that touch it in sorted order, so each target value receives its terms in the same order always.
template <int Dim, class T>
class ScatterPlan {
 public:
  using Point = std::array<T, Dim>;  ///< index coordinates on the target lattice

  /// Room for `count` points; fill points() and then sort.
  void resize(std::size_t count) { points_.resize(count); }
  std::vector<Point>& points() { return points_; }

  /// Points are the sites of `from` that lie in `where`, in their order, with a displacement (mm, interleaved; null for
  /// none).
  void place_sites(const Lattice<Dim>& from, const BlockMask<Dim>& where, const T* displacement,
                   const Lattice<Dim>& target) {
    const int slabs = from.size[Dim - 1];
    sites_.clear();
    if (where.is_all()) {
      resize(from.sites());
    } else {
      for (int slab = 0; slab < slabs; ++slab)
        where.visit_sites(from, slab, [&](const Index<Dim>&, std::size_t site) {
          sites_.push_back(static_cast<std::uint32_t>(site));
        });
      resize(sites_.size());
    }
    const std::size_t plane = from.sites() / static_cast<std::size_t>(slabs);
    const SitePlacement<Dim, T> place(from, target);
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < slabs; ++slab) {
      std::size_t point = static_cast<std::size_t>(slab) * plane;
      if (!where.is_all())
        point = static_cast<std::size_t>(std::lower_bound(sites_.begin(), sites_.end(), point) - sites_.begin());
      where.visit_sites(from, slab, [&](const Index<Dim>& index, std::size_t site) {
        static constexpr T none[Dim] = {};
        points_[point++] = place(index, displacement ? displacement + Dim * site : none);
      });
    }
    sort(target);
  }
  void place_sites(const Lattice<Dim>& from, const T* displacement, const Lattice<Dim>& target) {
    place_sites(from, BlockMask<Dim>::all(from), displacement, target);
  }
  /// Of which site a point is, after place_sites.
  std::size_t site(std::size_t point) const { return sites_.empty() ? point : sites_[point]; }
  std::size_t size() const { return points_.size(); }

  void sort(const Lattice<Dim>& target) {
    target_ = target;
    const int planes = target.size[Dim - 1];
    plane_of_.resize(points_.size());
    order_.resize(points_.size());
    start_.assign(static_cast<std::size_t>(planes) + 1, 0);
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < points_.size(); ++i) plane_of_[i] = cell(i).low[Dim - 1];
    for (int plane : plane_of_) ++start_[static_cast<std::size_t>(plane) + 1];
    for (int plane = 0; plane < planes; ++plane) start_[plane + 1] += start_[plane];
    next_.assign(start_.begin(), start_.end() - 1);
    for (std::size_t i = 0; i < points_.size(); ++i)
      order_[next_[static_cast<std::size_t>(plane_of_[i])]++] = static_cast<std::uint32_t>(i);
  }

  LinearCell<Dim, T> cell(std::size_t point) const { return LinearCell<Dim, T>(target_, points_[point]); }

  /// target[Channels * corner + c] += weight * value[c] for all points. `value(point, out)` fills out[Channels] and
  /// returns whether there is anything to add. Called more than once for a few points, from several threads.
  template <int Channels, class Value>
  void add(Value&& value, T* target) const {
    const int planes = target_.size[Dim - 1];
#ifdef _OPENMP
    const int parts = std::max(1, std::min(planes, omp_get_max_threads()));
#else
    const int parts = 1;
#endif
#pragma omp parallel for schedule(static, 1) num_threads(parts)
    for (int part = 0; part < parts; ++part) {
      const int begin = planes * part / parts, end = planes * (part + 1) / parts;
      for (int plane = std::max(0, begin - 1); plane < end; ++plane) {
        for (std::uint32_t k = start_[plane]; k < start_[plane + 1]; ++k) {
          std::array<T, Channels> out;
          if (!value(order_[k], out)) continue;
          cell(order_[k]).template spread<Channels>(out, begin, end, target);
        }
      }
    }
  }

 private:
  Lattice<Dim> target_;
  std::vector<Point> points_;
  std::vector<int> plane_of_;
  std::vector<std::uint32_t> order_, start_, next_, sites_;
};

}  // namespace saltus
