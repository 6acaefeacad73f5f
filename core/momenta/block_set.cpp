#include "core/momenta/block_set.h"

#include "core/support/errors.h"
#include "core/support/short_float.h"

#include <algorithm>
#include <cstring>
#include <numeric>

namespace saltus {

template <int Dim>
BlockSet<Dim> BlockSet<Dim>::all(const Lattice<Dim>& lattice) {
  std::vector<std::uint32_t> active(none(lattice).blocks());
  std::iota(active.begin(), active.end(), 0u);
  return BlockSet(lattice, std::move(active));
}

template <int Dim>
BlockSet<Dim>::BlockSet(const Lattice<Dim>& lattice, std::vector<std::uint32_t> active)
    : size_(lattice.size),
      all_sites_(lattice.sites()),
      active_(std::move(active)),
      mask_(BlockMask<Dim>::none(lattice)) {
  for (int axis = 0; axis < Dim; ++axis) blocks_ *= blocks_along(axis);
  for (std::size_t k = 0; k < active_.size(); ++k) {
    if (active_[k] >= blocks_)
      throw InvalidInput("the active blocks name block " + std::to_string(active_[k]) + " of a lattice that has " +
                         std::to_string(blocks_) + "; give numbers below that");
    if (k > 0 && active_[k] <= active_[k - 1])
      throw InvalidInput("the active blocks name block " + std::to_string(active_[k]) + " after block " +
                         std::to_string(active_[k - 1]) + "; give each block once, in rising order");
  }

  if (is_complete())
    mask_ = BlockMask<Dim>::all(lattice);
  else
    for (std::uint32_t block : active_) mask_.mark(block);

  // Blocks of one row of blocks follow each other in active_; each such group is cut by all rows of sites through it.
  const std::size_t across = blocks_along(0), width = static_cast<std::size_t>(size_[0]);
  const std::size_t layers = Dim == 3 ? static_cast<std::size_t>(size_[Dim - 1]) : 1;
  const std::size_t rows = static_cast<std::size_t>(size_[1]);
  for (std::size_t z = 0; z < layers; ++z)
    for (std::size_t y = 0; y < rows; ++y) {
      const std::size_t first = (z / kEdge * blocks_along(1) + y / kEdge) * across;
      auto block = std::lower_bound(active_.begin(), active_.end(), first);
      while (block != active_.end() && *block < first + across) {
        auto last = block;
        while (last + 1 != active_.end() && last[1] == *last + 1 && last[1] < first + across) ++last;
        const std::size_t begin = (*block - first) * kEdge, end = std::min(width, (*last - first + 1) * kEdge);
        runs_.push_back({(z * rows + y) * width + begin, sites_, end - begin, *block});
        sites_ += end - begin;
        block = last + 1;
      }
    }
  runs_.shrink_to_fit();
}

template <int Dim>
template <class T>
void BlockSet<Dim>::gather(int channels, const T* dense, T* compact) const {
#pragma omp parallel for schedule(static)
  for (const Run& run : runs_)
    std::copy_n(dense + channels * run.site, channels * run.count, compact + channels * run.at);
}

template <int Dim>
template <class T>
void BlockSet<Dim>::scatter(int channels, const T* compact, T* dense) const {
  if (!is_complete()) {
    const std::size_t count = channels * all_sites_;
#pragma omp parallel for simd schedule(static)
    for (std::size_t i = 0; i < count; ++i) dense[i] = T(0);
  }
  scatter_within(channels, compact, dense);
}

template <int Dim>
template <class T>
void BlockSet<Dim>::scatter_within(int channels, const T* compact, T* dense) const {
#pragma omp parallel for schedule(static)
  for (const Run& run : runs_)
    std::copy_n(compact + channels * run.at, channels * run.count, dense + channels * run.site);
}

template <int Dim>
template <class T>
void BlockSet<Dim>::gather_from(const BlockSet& from, int channels, const T* theirs, T* compact) const {
  if (active_ == from.active_) {
    std::copy_n(theirs, static_cast<std::size_t>(channels) * sites_, compact);
    return;
  }
#pragma omp parallel for schedule(static)
  for (const Run& run : runs_) {
    T* to = compact + channels * run.at;
    std::fill_n(to, channels * run.count, T(0));
    auto other = std::upper_bound(from.runs_.begin(), from.runs_.end(), run.site,
                                  [](std::size_t site, const Run& r) { return site < r.site + r.count; });
    for (; other != from.runs_.end() && other->site < run.site + run.count; ++other) {
      const std::size_t begin = std::max(run.site, other->site);
      const std::size_t end = std::min(run.site + run.count, other->site + other->count);
      std::copy_n(theirs + channels * (other->at + begin - other->site), channels * (end - begin),
                  to + channels * (begin - run.site));
    }
  }
}

template <int Dim>
template <class T>
void BlockSet<Dim>::mark_nonzero(const T* compact, std::vector<char>& found) const {
  // Of all values at once, which is quicker than to stop at one, the more so where their number is compiled in.
  const auto has_any = [](const T* values, std::size_t count) __attribute__((always_inline)) {
    char any = 0;
    for (std::size_t i = 0; i < count; ++i) any |= static_cast<char>(values[i] != 0);
    return any;
  };
  for (const Run& run : runs_) {
    if (!std::memchr(found.data() + run.block, 0, (run.count + kEdge - 1) / kEdge)) continue;
    for (std::size_t i = 0; i < run.count; i += kEdge) {
      char& mark = found[run.block + i / kEdge];
      if (mark) continue;
      const T* values = compact + Dim * (run.at + i);
      mark = i + kEdge <= run.count ? has_any(values, Dim * kEdge) : has_any(values, Dim * (run.count - i));
    }
  }
}

template class BlockSet<2>;
template class BlockSet<3>;

#define SALTUS_INSTANTIATE(DIM, T)                               \
  template void BlockSet<DIM>::gather(int, const T*, T*) const;  \
  template void BlockSet<DIM>::scatter(int, const T*, T*) const; \
  template void BlockSet<DIM>::scatter_within(int, const T*, T*) const
#define SALTUS_INSTANTIATE_COMPACT(DIM, T)                                            \
  template void BlockSet<DIM>::gather_from(const BlockSet&, int, const T*, T*) const; \
  template void BlockSet<DIM>::mark_nonzero(const T*, std::vector<char>&) const
SALTUS_INSTANTIATE(2, float);
SALTUS_INSTANTIATE(3, float);
SALTUS_INSTANTIATE(2, double);
SALTUS_INSTANTIATE(3, double);
SALTUS_INSTANTIATE_COMPACT(2, float);
SALTUS_INSTANTIATE_COMPACT(3, float);
SALTUS_INSTANTIATE_COMPACT(2, double);
SALTUS_INSTANTIATE_COMPACT(3, double);
SALTUS_INSTANTIATE_COMPACT(2, ShortFloat);
SALTUS_INSTANTIATE_COMPACT(3, ShortFloat);
#undef SALTUS_INSTANTIATE
#undef SALTUS_INSTANTIATE_COMPACT

}  // namespace saltus
