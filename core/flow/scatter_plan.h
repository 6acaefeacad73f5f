#pragma once

#include "core/grid/interpolation.h"

#include <cstdint>
#include <vector>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {

/// Adds values at displaced sites to a lattice: the transpose of linear interpolation, in parallel and with a result
/// that does not depend on the number of threads.
///
/// Sites are sorted by the target plane (last axis) they fall into. A thread owns a range of planes and visits the
/// sites that touch it in sorted order, so each target value receives its terms in the same order always.
template <int Dim, class T>
class ScatterPlan {
 public:
  /// `displacement` (mm, interleaved; null for none) is read again by add, so it must stay.
  void build(const Lattice<Dim>& from, const T* displacement, const Lattice<Dim>& target) {
    from_ = from;
    target_ = target;
    displacement_ = displacement;
    const std::size_t sites = from.sites();
    const int planes = target.size[Dim - 1];
    plane_of_.resize(sites);
    order_.resize(sites);
    start_.assign(static_cast<std::size_t>(planes) + 1, 0);
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < from.size[Dim - 1]; ++slab)
      visit_slab<Dim>(from, slab, [&](const Index<Dim>& index, std::size_t site) {
        plane_of_[site] = cell(index, site).low[Dim - 1];
      });
    for (std::size_t site = 0; site < sites; ++site) ++start_[static_cast<std::size_t>(plane_of_[site]) + 1];
    for (int plane = 0; plane < planes; ++plane) start_[plane + 1] += start_[plane];
    std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
    for (std::size_t site = 0; site < sites; ++site)
      order_[next[static_cast<std::size_t>(plane_of_[site])]++] = static_cast<std::uint32_t>(site);
  }

  LinearCell<Dim, T> cell(const Index<Dim>& index, std::size_t site) const {
    static constexpr T none[Dim] = {};
    return LinearCell<Dim, T>(target_, displaced<Dim, T>(from_, index, displacement_ ? displacement_ + Dim * site : none, target_));
  }

  /// target[Channels * corner + c] += weight * value[c] for all sites. `value(index, site, out)` fills out[Channels] and
  /// returns whether there is anything to add. Called more than once for a few sites, from several threads.
  template <int Channels, class Value>
  void add(Value&& value, T* target) const {
    const int planes = target_.size[Dim - 1];
#ifdef _OPENMP
    const int parts = std::max(1, std::min(planes, omp_get_max_threads()));
#else
    const int parts = 1;
#endif
    std::size_t plane_size = Channels;
    for (int axis = 0; axis + 1 < Dim; ++axis) plane_size *= static_cast<std::size_t>(target_.size[axis]);
#pragma omp parallel for schedule(static, 1) num_threads(parts)
    for (int part = 0; part < parts; ++part) {
      const int begin = planes * part / parts, end = planes * (part + 1) / parts;
      for (int plane = std::max(0, begin - 1); plane < end; ++plane) {
        const bool whole = plane >= begin && plane + 1 < end;
        for (std::uint32_t k = start_[plane]; k < start_[plane + 1]; ++k) {
          const std::size_t site = order_[k];
          std::array<T, Channels> out;
          const Index<Dim> index = index_of(site);
          if (!value(index, site, out)) continue;
          const LinearCell<Dim, T> at = cell(index, site);
          for (int bits = 0; bits < LinearCell<Dim, T>::corners; ++bits) {
            const std::size_t corner = at.corner(bits);
            if (!whole) {
              const int touched = at.low[Dim - 1] + ((bits >> (Dim - 1) & 1) && at.step[Dim - 1] ? 1 : 0);
              if (touched < begin || touched >= end) continue;
            }
            const T weight = at.weight(bits);
            T* to = target + Channels * corner;
            for (int c = 0; c < Channels; ++c) to[c] += weight * out[c];
          }
        }
      }
    }
  }

 private:
  Index<Dim> index_of(std::size_t site) const {
    Index<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) {
      index[axis] = static_cast<int>(site % static_cast<std::size_t>(from_.size[axis]));
      site /= static_cast<std::size_t>(from_.size[axis]);
    }
    return index;
  }

  Lattice<Dim> from_, target_;
  const T* displacement_ = nullptr;
  std::vector<int> plane_of_;
  std::vector<std::uint32_t> order_, start_;
};

}  // namespace saltus
