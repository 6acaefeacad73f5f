#pragma once

#include "core/grid/block_mask.h"
#include "core/grid/field_lanes.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

namespace saltus {

/// The sites of a lattice that are in `where`, with a displacement each (mm, interleaved; null for none), seen from
/// another lattice. Numbered as sites; a chunk is a slab of the last axis.
template <int Dim, class T>
class MovedPoints {
 public:
  MovedPoints(const Lattice<Dim>& lattice, const BlockMask<Dim>& where, const T* displacement,
              const Lattice<Dim>& target)
      : lattice_(lattice), where_(where), displacement_(displacement), place_(lattice, target) {}

  int chunks() const { return lattice_.size[Dim - 1]; }
  std::size_t most() const { return lattice_.sites(); }  ///< points at most
  /// visit(first point, how many, their index coordinates) for pieces that follow each other.
  template <class Visit>
  void visit(int chunk, Visit&& visit) const {
    where_.visit_pieces(
        lattice_, chunk, CellLanes<Dim, T>::kLanes, [&](const Index<Dim>& index, std::size_t site, int count) {
          visit(site, count,
                placed<Dim, T>(
                    place_, index,
                    displacement_ ? lanes_of<Dim, T>(displacement_ + Dim * site, count) : LanePoints<Dim, T>{}));
        });
  }
  /// First and last plane of the target (last axis) that the cells of a chunk reach; all where a displacement is not a
  /// number, none (last before first) where there is no point. From the displacements along that axis alone.
  std::array<int, 2> reach(int chunk, const Lattice<Dim>& target) const {
    constexpr T none = std::numeric_limits<T>::infinity();
    T least = none, most = -none;
    int odd = 0;
    where_.visit_pieces(lattice_, chunk, lattice_.size[0], [&](const Index<Dim>&, std::size_t site, int count) {
      if (!displacement_) least = std::min(least, T(0)), most = std::max(most, T(0));
      const T* along = displacement_ ? displacement_ + Dim * site + Dim - 1 : nullptr;
#pragma omp simd reduction(min : least) reduction(max : most) reduction(+ : odd)
      for (int i = 0; i < (along ? count : 0); ++i) {
        const T mm = along[Dim * i];
        least = mm < least ? mm : least;
        most = mm > most ? mm : most;
        odd += mm != mm;
      }
    });
    const int last = target.size[Dim - 1] - 1;
    if (odd > 0) return {0, last + 1};
    if (least > most) return {last + 1, -1};
    const auto plane = [&](T mm) {
      const T at = static_cast<T>(chunk * place_.scale[Dim - 1] + place_.shift[Dim - 1] +
                                  static_cast<double>(mm) * place_.per_mm[Dim - 1]);
      return std::min(static_cast<int>(std::clamp(at, T(0), static_cast<T>(last))), std::max(0, last - 1));
    };
    return {plane(least), plane(most) + 1};
  }

 private:
  const Lattice<Dim>& lattice_;
  const BlockMask<Dim>& where_;
  const T* displacement_;
  SitePlacement<Dim, T> place_;
};

/// Points at(i), index coordinates, of a list. A chunk is as many as are worth a look whom they concern.
template <int Dim, class T, class At>
class ListedPoints {
 public:
  ListedPoints(std::size_t count, At at) : count_(count), at_(std::move(at)) {}

  int chunks() const { return static_cast<int>((count_ + kChunk - 1) / kChunk); }
  std::size_t most() const { return count_; }
  template <class Visit>
  void visit(int chunk, Visit&& visit) const {
    const std::size_t begin = static_cast<std::size_t>(chunk) * kChunk, end = std::min(count_, begin + kChunk);
    constexpr int lanes = CellLanes<Dim, T>::kLanes;
    for (std::size_t first = begin; first < end; first += lanes) {
      const int count = static_cast<int>(std::min<std::size_t>(lanes, end - first));
      LanePoints<Dim, T> at{};
      for (int lane = 0; lane < count; ++lane) {
        const std::array<T, Dim> point = at_(first + static_cast<std::size_t>(lane));
        for (int axis = 0; axis < Dim; ++axis) at[axis][lane] = point[axis];
      }
      visit(first, count, at);
    }
  }
  std::array<int, 2> reach(int chunk, const Lattice<Dim>& target) const {
    std::array<int, 2> planes{target.size[Dim - 1], -1};
    CellLanes<Dim, T> cells(target);
    visit(chunk, [&](std::size_t, int count, const LanePoints<Dim, T>& at) {
      cells.find(at);
      for (int lane = 0; lane < count; ++lane) {
        planes[0] = std::min(planes[0], cells.plane(lane));
        planes[1] = std::max(planes[1], cells.plane(lane) + 1);
      }
    });
    return planes;
  }

 private:
  static constexpr std::size_t kChunk = 512;
  std::size_t count_;
  At at_;
};

/// Which vectors are not 0.
template <int Dim, class T>
[[gnu::always_inline]] inline void mark_nonzero(const LaneVectors<T>& values, LaneMask& marks) {
  const LanePoints<Dim, T> by = by_component<Dim, T>(values);
#pragma omp simd
  for (int lane = 0; lane < CellLanes<Dim, T>::kLanes; ++lane) {
    int any = 0;
    for (int c = 0; c < Dim; ++c) any |= by[c][lane] != T(0);
    marks[lane] = any;
  }
}

/// For `scatter`: factor times an interleaved field's values at the points, nothing where they are 0.
template <int Dim, class T>
auto scaled_values(const T* field, T factor) {
  return [field, factor](std::size_t first, int count, LaneVectors<T>& out, LaneMask& wanted) {
    out = vectors_of<Dim, T>(field + Dim * first, count);
    for (auto& one : out) one *= factor;
    mark_nonzero<Dim, T>(out, wanted);
  };
}

template <int Dim, class T, class At>
ListedPoints<Dim, T, At> listed_points(std::size_t count, At at) {
  return {count, std::move(at)};
}

/// visit(first point, how many, their cells) for all points, chunks in parallel.
template <int Dim, class T, class Points, class Visit>
void for_cells(const Points& points, const Lattice<Dim>& target, Visit&& visit) {
  const int chunks = points.chunks();
#pragma omp parallel for schedule(static) if (is_worth_threads(points.most()))
  for (int chunk = 0; chunk < chunks; ++chunk) {
    CellLanes<Dim, T> cells(target);
    points.visit(chunk, [&](std::size_t first, int count, const LanePoints<Dim, T>& at) {
      cells.find(at);
      visit(first, count, cells);
    });
  }
}

/// Adds vectors at points anywhere to a lattice, the transpose of linear interpolation: to[Dim * corner + c] += weight
/// * value[c]. `value(first point, how many, out, wanted)` fills `out` and says who has anything to add; it is called
/// more than once for a few points, from several threads.
///
/// A thread owns a range of planes (last axis) and passes over the chunks that reach none of them and, of those that
/// do, over the pieces that reach none. So each target value receives its terms in the same order always: the result
/// does not depend on the number of threads.
///
/// visit(first point, how many, their cells, their values, which are the thread's own) for pieces of which some points
/// are; each point is one thread's own. A value of who has nothing to add is as `value` left it.
template <int Dim, class T, class Points, class Value, class Visit>
void scatter(const Points& points, const Lattice<Dim>& target, Value&& value, T* to, Visit&& visit) {
  const int planes = target.size[Dim - 1], chunks = points.chunks();
  const int parts = std::max(1, std::min(planes, threads_of_loop(points.most())));
  // The planes that a chunk reaches, first and last.
  std::vector<std::array<int, 2>> reach(static_cast<std::size_t>(chunks), {0, planes});
  if (parts > 1) {
#pragma omp parallel for schedule(static)
    for (int chunk = 0; chunk < chunks; ++chunk) reach[static_cast<std::size_t>(chunk)] = points.reach(chunk, target);
  }
#pragma omp parallel for schedule(static, 1) if (parts > 1)
  for (int part = 0; part < parts; ++part) {
    const int begin = planes * part / parts, end = planes * (part + 1) / parts;
    CellLanes<Dim, T> cells(target);
    LaneVectors<T> values{};
    LaneMask wanted{}, own{};
    for (int chunk = 0; chunk < chunks; ++chunk) {
      const std::array<int, 2>& planes_of = reach[static_cast<std::size_t>(chunk)];
      if (planes_of[0] >= end || planes_of[1] < begin) continue;
      points.visit(chunk, [&](std::size_t first, int count, const LanePoints<Dim, T>& at) {
        cells.find(at);
        if (!cells.reach(count, begin, end)) return;
        value(first, count, values, wanted);
        cells.spread(values, count, wanted, begin, end, to);
#pragma omp simd
        for (int lane = 0; lane < cells.kLanes; ++lane)
          own[lane] = (cells.plane(lane) >= begin) & (cells.plane(lane) < end);
        if (std::any_of(own.begin(), own.begin() + count, [](int one) { return one != 0; }))
          visit(first, count, cells, values, own);
      });
    }
  }
}

template <int Dim, class T, class Points, class Value>
void scatter(const Points& points, const Lattice<Dim>& target, Value&& value, T* to) {
  scatter<Dim, T>(points, target, value, to,
                  [](std::size_t, int, const CellLanes<Dim, T>&, const LaneVectors<T>&, const LaneMask&) {});
}

}  // namespace saltus
