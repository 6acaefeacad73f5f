#include "core/grid/warp.h"

#include "core/grid/block_mask.h"
#include "core/grid/cell_lanes.h"

#include <algorithm>

namespace saltus {
namespace {

template <int Dim, class T>
constexpr int kLanes = CellLanes<Dim, T>::kLanes;
template <int Dim, class T>
using Lanes = typename CellLanes<Dim, T>::Lanes;

/// Index coordinates as base + index-wise steps + linear * displacement, so that the large part stays in double.
template <int Dim, class T>
struct PointMap {
  double base[Dim], step[Dim][Dim];
  T turn[Dim][Dim];

  PointMap(const FramedImage<Dim, T>& image, const Lattice<Dim>& points) {
    for (int row = 0; row < Dim; ++row) {
      base[row] = image.offset[row];
      for (int col = 0; col < Dim; ++col) {
        base[row] += image.linear(row, col) * points.offset[col];
        step[row][col] = image.linear(row, col) * points.spacing[col];
        turn[row][col] = static_cast<T>(image.linear(row, col));
      }
    }
  }

  /// Of the sites from `index` on along x, with displacements `mm` (by axis).
  [[gnu::always_inline]] LanePoints<Dim, T> operator()(const Index<Dim>& index, const LanePoints<Dim, T>& mm) const {
    LanePoints<Dim, T> at;
    for (int row = 0; row < Dim; ++row) {
      double rest = base[row];
      for (int col = 1; col < Dim; ++col) rest += step[row][col] * index[col];
#pragma omp simd
      for (int lane = 0; lane < kLanes<Dim, T>; ++lane) {
        T moved = 0;
        for (int col = 0; col < Dim; ++col) moved += turn[row][col] * mm[col][lane];
        at[row][lane] = static_cast<T>(rest + step[row][0] * (index[0] + lane) + static_cast<double>(moved));
      }
    }
    return at;
  }
};

/// A thread's planes of a displacement, one after the other.
template <int Dim, class T>
class PlaneAtHand {
 public:
  PlaneAtHand(const Displacement<Dim, T>& displacement, std::size_t scalars)
      : displacement_(displacement),
        scalars_(scalars),
        own_(displacement.to_sites || !displacement.field ? scalars : 0) {}

  /// Stands until the next one is taken.
  const T* take(int plane) {
    if (!displacement_.field) return own_.data();
    if (!displacement_.to_sites) return displacement_.field + static_cast<std::size_t>(plane) * scalars_;
    displacement_.to_sites->take_plane(displacement_.field, plane, scratch_, own_.data());
    return own_.data();
  }
  /// Where interpolated planes lie.
  T* own() { return own_.data(); }
  typename LatticeInterpolation<Dim, T>::Scratch& scratch() { return scratch_; }

 private:
  const Displacement<Dim, T>& displacement_;
  const std::size_t scalars_;
  std::vector<T> own_;
  typename LatticeInterpolation<Dim, T>::Scratch scratch_;
};

/// visit(plane, its first site, the thread's planes), planes in parallel.
template <int Dim, class T, class Visit>
void for_planes(const Lattice<Dim>& points, const Displacement<Dim, T>& displacement, Visit&& visit) {
  const std::size_t sites = points.sites() / static_cast<std::size_t>(points.size[Dim - 1]);
#pragma omp parallel
  {
    PlaneAtHand<Dim, T> at_hand(displacement, Dim * sites);
#pragma omp for schedule(static)
    for (int plane = 0; plane < points.size[Dim - 1]; ++plane)
      visit(plane, static_cast<std::size_t>(plane) * sites, at_hand);
  }
}

}  // namespace

template <int Dim, class T>
void warp(const FramedImage<Dim, T>& image, const Lattice<Dim>& points, const Displacement<Dim, T>& displacement,
          T* out) {
  const PointMap<Dim, T> map(image, points);
  const auto all = BlockMask<Dim>::all(points);
  for_planes(points, displacement, [&](int plane, std::size_t first, PlaneAtHand<Dim, T>& at_hand) {
    const T* mm_of_plane = at_hand.take(plane);
    CellLanes<Dim, T> cells(image.lattice);
    all.visit_pieces(points, plane, kLanes<Dim, T>, [&](const Index<Dim>& index, std::size_t site, int count) {
      const LanePoints<Dim, T> mm = lanes_of<Dim, T>(mm_of_plane + Dim * (site - first), count);
      cells.find(map(index, mm));
      const Lanes<Dim, T> values = cells.value(image.samples.data());
      std::copy_n(values.begin(), count, out + site);
    });
  });
}

template <int Dim, class T>
void warp_adjoint(const std::vector<WarpedDual<Dim, T>>& warped, const Lattice<Dim>& points,
                  const Displacement<Dim, T>& displacement, T* displacement_dual) {
  std::vector<PointMap<Dim, T>> maps;
  for (const WarpedDual<Dim, T>& one : warped) maps.emplace_back(*one.image, points);
  const auto all = BlockMask<Dim>::all(points);
  LatticeInterpolation<Dim, T>* to_sites = displacement.to_sites;
  if (to_sites) to_sites->begin_transpose();
  for_planes(points, displacement, [&](int plane, std::size_t first, PlaneAtHand<Dim, T>& at_hand) {
    const T* mm_of_plane = at_hand.take(plane);
    T* plane_dual = to_sites ? at_hand.own() : displacement_dual + Dim * first;
    all.visit_pieces(points, plane, kLanes<Dim, T>, [&](const Index<Dim>& index, std::size_t site, int count) {
      const LanePoints<Dim, T> mm = lanes_of<Dim, T>(mm_of_plane + Dim * (site - first), count);
      LanePoints<Dim, T> sum{}, gradient;
      for (std::size_t i = 0; i < maps.size(); ++i) {
        Lanes<Dim, T> dual{};
        std::copy_n(warped[i].dual + site, count, dual.begin());
        if (std::all_of(dual.begin(), dual.end(), [](T value) { return value == T(0); })) continue;
        CellLanes<Dim, T> cells(warped[i].image->lattice);
        cells.find(maps[i](index, mm));
        cells.value(warped[i].image->samples.data(), &gradient);
#pragma omp simd
        for (int lane = 0; lane < kLanes<Dim, T>; ++lane)
          for (int col = 0; col < Dim; ++col) {
            T along = 0;
            for (int row = 0; row < Dim; ++row) along += maps[i].turn[row][col] * gradient[row][lane];
            // Not a product with 0: what counts for nothing need not be a number.
            sum[col][lane] += dual[lane] == T(0) ? T(0) : dual[lane] * along;
          }
      }
      T* out = plane_dual + Dim * (site - first);
      for (int lane = 0; lane < count; ++lane)
        for (int col = 0; col < Dim; ++col) out[Dim * lane + col] = sum[col][lane];
    });
    if (to_sites) to_sites->transpose_plane(plane_dual, plane, at_hand.scratch());
  });
  if (to_sites) to_sites->finish_transpose(displacement_dual);
}

#define SALTUS_WARP(DIM, TYPE)                                                                                      \
  template void warp<DIM, TYPE>(const FramedImage<DIM, TYPE>&, const Lattice<DIM>&, const Displacement<DIM, TYPE>&, \
                                TYPE*);                                                                             \
  template void warp_adjoint<DIM, TYPE>(const std::vector<WarpedDual<DIM, TYPE>>&, const Lattice<DIM>&,             \
                                        const Displacement<DIM, TYPE>&, TYPE*);
SALTUS_WARP(2, float)
SALTUS_WARP(3, float)
SALTUS_WARP(2, double)
SALTUS_WARP(3, double)
#undef SALTUS_WARP

}  // namespace saltus
