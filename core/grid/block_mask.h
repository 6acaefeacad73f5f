#pragma once

#include "core/grid/lattice.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <vector>

namespace saltus {

/// Blocks that lattices are cut into: this many sites along every axis, fewer at the upper border. Blocks are numbered
/// as sites are, x fastest.
constexpr int kBlockEdge = 4;

/// Where on a lattice a field is worth anything, by blocks. What a field holds outside is not defined, so that nobody
/// has to write it. A mask is small (a byte for each block) and quick to make; BlockSet is for what has to last.
template <int Dim>
class BlockMask {
 public:
  static BlockMask all(const Lattice<Dim>& lattice) { return BlockMask(lattice, true); }
  static BlockMask none(const Lattice<Dim>& lattice) { return BlockMask(lattice, false); }

  bool is_all() const { return all_; }
  bool is_empty() const { return !all_ && !any_; }
  bool operator[](std::size_t block) const { return all_ || marks_[block]; }
  const Index<Dim>& blocks() const { return blocks_; }  ///< along each axis

  void mark(std::size_t block) {
    marks_[block] = 1;
    any_ = true;
  }
  /// Marks the blocks of the corners of the cells (LinearCell) of the first `count` points: index coordinates, by axis.
  template <class T, std::size_t Lanes>
  void mark_cells(const Lattice<Dim>& lattice, const std::array<std::array<T, Lanes>, Dim>& points, int count) {
    std::array<int, Lanes> low{}, crosses{};  // block of the lowest corner; along which axes another begins
    int stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      const int last = lattice.size[axis] - 1, upper = std::max(0, last - 1);
      const T end = static_cast<T>(last);
#pragma omp simd
      for (std::size_t lane = 0; lane < Lanes; ++lane) {
        T at = points[axis][lane] > T(0) ? points[axis][lane] : T(0);
        at = at < end ? at : end;
        const int cell = std::min(static_cast<int>(at), upper);
        low[lane] += stride * (cell / kBlockEdge);
        crosses[lane] |= (cell % kBlockEdge == kBlockEdge - 1 && cell < last) << axis;
      }
      stride *= blocks_[axis];
    }
    for (std::size_t lane = 0; lane < static_cast<std::size_t>(count); ++lane) {
      if (lane > 0 && low[lane] == low[lane - 1] && crosses[lane] == crosses[lane - 1]) continue;
      for (int bits = 0; bits < 1 << Dim; ++bits) {
        if ((bits & crosses[lane]) != bits) continue;
        int block = low[lane], step = 1;
        for (int axis = 0; axis < Dim; ++axis) {
          if (bits >> axis & 1) block += step;
          step *= blocks_[axis];
        }
        mark(static_cast<std::size_t>(block));
      }
    }
  }

  BlockMask& operator|=(const BlockMask& other);
  BlockMask& operator&=(const BlockMask& other);
  /// With all blocks that are up to `sites` samples along `axis` away from one in here.
  BlockMask dilated(int axis, int sites) const;
  /// With all blocks that touch one in here, over edges and corners too.
  BlockMask with_neighbours() const;

  /// Takes in the rest where most blocks are in: work on the whole field is cheaper then than picking.
  void complete_if_dense();

  /// Calls visit(first site, number of sites) for runs of sites along x that together are all sites in here: rising
  /// within a slab of the last axis, slabs in parallel.
  template <class Visit>
  void for_runs(const Lattice<Dim>& lattice, Visit&& visit) const {
#pragma omp parallel for schedule(static) if (is_worth_threads(lattice.sites()))
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab) visit_slab_runs(lattice, slab, visit);
  }

  /// Sum of what term(first site, number of sites) gives for those runs, in an order that does not depend on the number
  /// of threads.
  template <class Term>
  double sum_runs(const Lattice<Dim>& lattice, Term&& term) const {
    std::vector<double> by_slab(static_cast<std::size_t>(lattice.size[Dim - 1]), 0.0);
#pragma omp parallel for schedule(static) if (is_worth_threads(lattice.sites()))
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab_runs(lattice, slab, [&](std::size_t begin, std::size_t count) {
        by_slab[static_cast<std::size_t>(slab)] += term(begin, count);
      });
    return std::accumulate(by_slab.begin(), by_slab.end(), 0.0);
  }

  /// visit(index, site) for the sites of one slab.
  template <class Visit>
  void visit_sites(const Lattice<Dim>& lattice, int slab, Visit&& visit) const {
    if (all_) return visit_slab<Dim>(lattice, slab, visit);
    visit_slab_runs(lattice, slab, [&](std::size_t begin, std::size_t count) {
      Index<Dim> index;
      std::size_t rest = begin;
      for (int axis = 0; axis < Dim; ++axis) {
        index[axis] = static_cast<int>(rest % static_cast<std::size_t>(lattice.size[axis]));
        rest /= static_cast<std::size_t>(lattice.size[axis]);
      }
      for (std::size_t site = begin; site < begin + count; ++site, ++index[0]) visit(index, site);
    });
  }

  /// visit(index, site, count) for pieces of rows, of at most `longest` sites from `index` on along x, that together
  /// are the sites of one slab.
  template <class Visit>
  void visit_pieces(const Lattice<Dim>& lattice, int slab, int longest, Visit&& visit) const {
    const auto width = static_cast<std::size_t>(lattice.size[0]);
    visit_slab_runs(lattice, slab, [&](std::size_t begin, std::size_t count) {
      for (std::size_t site = begin; site < begin + count;) {
        Index<Dim> index;
        index[0] = static_cast<int>(site % width);
        if constexpr (Dim == 3) index[1] = static_cast<int>(site / width % static_cast<std::size_t>(lattice.size[1]));
        index[Dim - 1] = slab;
        const std::size_t row_end = std::min(begin + count, site - site % width + width);
        while (site < row_end) {
          const int piece = static_cast<int>(std::min<std::size_t>(static_cast<std::size_t>(longest), row_end - site));
          visit(index, site, piece);
          site += static_cast<std::size_t>(piece);
          index[0] += piece;
        }
      }
    });
  }

  /// Writes 0 to all sites in here.
  template <class T>
  void clear(const Lattice<Dim>& lattice, std::size_t channels, T* field) const {
    for_runs(lattice, [&](std::size_t begin, std::size_t count) {
      std::fill_n(field + channels * begin, channels * count, T(0));
    });
  }

 private:
  BlockMask(const Lattice<Dim>& lattice, bool all);

  template <class Visit>
  void visit_slab_runs(const Lattice<Dim>& lattice, int slab, Visit&& visit) const {
    const std::size_t width = static_cast<std::size_t>(lattice.size[0]);
    const std::size_t rows = Dim == 3 ? static_cast<std::size_t>(lattice.size[1]) : 1;
    const std::size_t first_row = static_cast<std::size_t>(slab) * rows;
    if (all_) return visit(first_row * width, rows * width);
    const std::size_t across = static_cast<std::size_t>(blocks_[0]), down = Dim == 3 ? blocks_[1] : 1;
    for (std::size_t y = 0; y < rows; ++y) {
      const char* marks = marks_.data() + (slab / kBlockEdge * down + y / kBlockEdge) * across;
      for (std::size_t b = 0; b < across; ++b) {
        if (!marks[b]) continue;
        std::size_t end = b + 1;
        while (end < across && marks[end]) ++end;
        const std::size_t begin = b * kBlockEdge;
        visit((first_row + y) * width + begin, std::min(width, end * kBlockEdge) - begin);
        b = end;
      }
    }
  }

  Index<Dim> blocks_;
  bool all_, any_ = false;
  std::vector<char> marks_;  ///< by block; kept also where all_ is set
};

}  // namespace saltus
