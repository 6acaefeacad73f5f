#include "core/grid/warp.h"

#include "core/grid/block_mask.h"
#include "core/grid/field_lanes.h"

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

  /// Gradients by index coordinates as those by mm of the displacement.
  [[gnu::always_inline]] LanePoints<Dim, T> turned_back(const LanePoints<Dim, T>& gradient) const {
    LanePoints<Dim, T> turned;
    for (int col = 0; col < Dim; ++col)
#pragma omp simd
      for (int lane = 0; lane < kLanes<Dim, T>; ++lane) {
        T along = 0;
        for (int row = 0; row < Dim; ++row) along += turn[row][col] * gradient[row][lane];
        turned[col][lane] = along;
      }
    return turned;
  }
};

/// Of sites side by side, each by its own factor. Not a product with 0: what counts for nothing need not be a number.
template <int Dim, class T>
[[gnu::always_inline]] inline void scale_by(const Lanes<Dim, T>& factor, LanePoints<Dim, T>& values) {
  for (int col = 0; col < Dim; ++col)
#pragma omp simd
    for (int lane = 0; lane < kLanes<Dim, T>; ++lane)
      values[col][lane] = factor[lane] == T(0) ? T(0) : factor[lane] * values[col][lane];
}

/// A thread's planes of a displacement, one after the other.
template <int Dim, class T>
class PlaneAtHand {
 public:
  PlaneAtHand(const Displacement<Dim, T>& displacement, std::size_t scalars)
      : displacement_(displacement), scalars_(scalars) {}

  /// Stands until the next one is taken.
  const T* take(int plane) {
    if (displacement_.field && !displacement_.to_sites)
      return displacement_.field + static_cast<std::size_t>(plane) * scalars_;
    own_.resize(scalars_);  // 0 at first, and where there is no displacement
    if (!displacement_.field) return own_.data();
    displacement_.to_sites->take_plane(displacement_.field, plane, scratch_, own_.data());
    return own_.data();
  }
  /// Room for another one.
  T* other() {
    other_.resize(scalars_);
    return other_.data();
  }
  typename LatticeInterpolation<Dim, T>::Scratch& scratch() { return scratch_; }

 private:
  const Displacement<Dim, T>& displacement_;
  const std::size_t scalars_;
  std::vector<T> own_, other_;
  typename LatticeInterpolation<Dim, T>::Scratch scratch_;
};

template <int Dim>
std::size_t plane_sites(const Lattice<Dim>& points) {
  return points.sites() / static_cast<std::size_t>(points.size[Dim - 1]);
}

/// visit(plane, its first site, the thread's planes), planes in parallel.
template <int Dim, class T, class Visit>
void for_planes(const Lattice<Dim>& points, const Displacement<Dim, T>& displacement, Visit&& visit) {
  const std::size_t sites = plane_sites(points);
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
          T* out, T* slopes, OnSample sides) {
  const PointMap<Dim, T> map(image, points);
  const auto all = BlockMask<Dim>::all(points);
  for_planes(points, displacement, [&](int plane, std::size_t first, PlaneAtHand<Dim, T>& at_hand) {
    const T* mm_of_plane = at_hand.take(plane);
    CellLanes<Dim, T> cells(image.lattice);
    all.visit_pieces(points, plane, kLanes<Dim, T>, [&](const Index<Dim>& index, std::size_t site, int count) {
      const LanePoints<Dim, T> mm = lanes_of<Dim, T>(mm_of_plane + Dim * (site - first), count);
      cells.find(map(index, mm));
      Lanes<Dim, T> values;
      if (slopes) {
        LanePoints<Dim, T> gradient;
        values = cells.value(image.samples.data(), &gradient);
        if (sides == OnSample::Mean) cells.centre_gradient(image.samples.data(), values, gradient);
        put_lanes<Dim, T>(map.turned_back(gradient), count, slopes + Dim * site);
      } else {
        values = cells.value(image.samples.data());
      }
      put_scalars(values, count, out + site);
    });
  });
}

template <int Dim, class T>
void warp_adjoint(const T* dual, const T* slopes, const Lattice<Dim>& points, LatticeInterpolation<Dim, T>* to_sites,
                  T* displacement_dual) {
  const Displacement<Dim, T> interpolated{nullptr, to_sites};
  const std::size_t sites = plane_sites(points);
  if (to_sites) to_sites->begin_transpose();
  for_planes(points, interpolated, [&](int plane, std::size_t first, PlaneAtHand<Dim, T>& at_hand) {
    T* plane_dual = to_sites ? at_hand.other() : displacement_dual + Dim * first;
    for (std::size_t site = 0; site < sites; site += kLanes<Dim, T>) {
      const int count = static_cast<int>(std::min<std::size_t>(kLanes<Dim, T>, sites - site));
      LanePoints<Dim, T> values = lanes_of<Dim, T>(slopes + Dim * (first + site), count);
      scale_by<Dim, T>(scalars_of<Lanes<Dim, T>>(dual + first + site, count), values);
      put_lanes<Dim, T>(values, count, plane_dual + Dim * site);
    }
    if (to_sites) to_sites->transpose_plane(plane_dual, plane, at_hand.scratch());
  });
  if (to_sites) to_sites->finish_transpose(displacement_dual);
}

template <int Dim, class T>
void warp_adjoint(const std::vector<WarpedDual<Dim, T>>& warped, const Lattice<Dim>& points,
                  const Displacement<Dim, T>& displacement, T* displacement_dual, OnSample sides) {
  const auto all = BlockMask<Dim>::all(points);
  const std::size_t scalars = Dim * plane_sites(points);
  LatticeInterpolation<Dim, T>* to_sites = displacement.to_sites;
  if (to_sites) to_sites->begin_transpose();
  for_planes(points, displacement, [&](int plane, std::size_t first, PlaneAtHand<Dim, T>& at_hand) {
    const T* mm_of_plane = at_hand.take(plane);
    T* plane_dual = at_hand.other();
    std::fill_n(plane_dual, scalars, T(0));
    for (const WarpedDual<Dim, T>& one : warped) {
      const PointMap<Dim, T> map(*one.image, points);
      const T *dual = one.dual, *samples = one.image->samples.data();
      CellLanes<Dim, T> cells(one.image->lattice);
      all.visit_pieces(points, plane, kLanes<Dim, T>, [&](const Index<Dim>& index, std::size_t site, int count) {
        const Lanes<Dim, T> given = scalars_of<Lanes<Dim, T>>(dual + site, count);
        if (std::all_of(given.begin(), given.end(), [](T value) { return value == T(0); })) return;
        const LanePoints<Dim, T> mm = lanes_of<Dim, T>(mm_of_plane + Dim * (site - first), count);
        cells.find(map(index, mm));
        LanePoints<Dim, T> gradient;
        const Lanes<Dim, T> found = cells.value(samples, &gradient);
        if (sides == OnSample::Mean) cells.centre_gradient(samples, found, gradient);
        LanePoints<Dim, T> values = map.turned_back(gradient);
        scale_by<Dim, T>(given, values);
        T* to = plane_dual + Dim * (site - first);
        LanePoints<Dim, T> sum = lanes_of<Dim, T>(to, count);
        for (int col = 0; col < Dim; ++col)
#pragma omp simd
          for (int lane = 0; lane < kLanes<Dim, T>; ++lane) sum[col][lane] += values[col][lane];
        put_lanes<Dim, T>(sum, count, to);
      });
    }
    if (to_sites)
      to_sites->transpose_plane(plane_dual, plane, at_hand.scratch());
    else
      std::copy_n(plane_dual, scalars, displacement_dual + Dim * first);
  });
  if (to_sites) to_sites->finish_transpose(displacement_dual);
}

#define SALTUS_WARP(DIM, TYPE)                                                                                      \
  template void warp<DIM, TYPE>(const FramedImage<DIM, TYPE>&, const Lattice<DIM>&, const Displacement<DIM, TYPE>&, \
                                TYPE*, TYPE*, OnSample);                                                            \
  template void warp_adjoint<DIM, TYPE>(const TYPE*, const TYPE*, const Lattice<DIM>&,                              \
                                        LatticeInterpolation<DIM, TYPE>*, TYPE*);                                   \
  template void warp_adjoint<DIM, TYPE>(const std::vector<WarpedDual<DIM, TYPE>>&, const Lattice<DIM>&,             \
                                        const Displacement<DIM, TYPE>&, TYPE*, OnSample);
SALTUS_WARP(2, float)
SALTUS_WARP(3, float)
SALTUS_WARP(2, double)
SALTUS_WARP(3, double)
#undef SALTUS_WARP

}  // namespace saltus
