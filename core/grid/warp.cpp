#include "core/grid/warp.h"

#include "core/grid/interpolation.h"

namespace saltus {
namespace {

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

  std::array<T, Dim> operator()(const Index<Dim>& index, const T* mm) const {
    std::array<T, Dim> at;
    for (int row = 0; row < Dim; ++row) {
      double rest = base[row];
      T moved = 0;
      for (int col = 0; col < Dim; ++col) {
        rest += step[row][col] * index[col];
        moved += turn[row][col] * mm[col];
      }
      at[row] = static_cast<T>(rest + static_cast<double>(moved));
    }
    return at;
  }
};

}  // namespace

template <int Dim, class T>
void warp(const FramedImage<Dim, T>& image, const Lattice<Dim>& points, const T* displacement, T* out) {
  const PointMap<Dim, T> map(image, points);
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab)
    visit_slab<Dim>(points, slab, [&](const Index<Dim>& index, std::size_t site) {
      out[site] = LinearCell<Dim, T>(image.lattice, map(index, displacement + Dim * site))
                      .template value<1>(image.samples.data())[0];
    });
}

template <int Dim, class T>
void warp_adjoint(const std::vector<WarpedDual<Dim, T>>& warped, const Lattice<Dim>& points, const T* displacement,
                  T* displacement_dual) {
  std::vector<PointMap<Dim, T>> maps;
  for (const WarpedDual<Dim, T>& one : warped) maps.emplace_back(*one.image, points);
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < points.size[Dim - 1]; ++slab)
    visit_slab<Dim>(points, slab, [&](const Index<Dim>& index, std::size_t site) {
      std::array<T, Dim> sum{};
      for (std::size_t i = 0; i < maps.size(); ++i) {
        const T dual = warped[i].dual[site];
        if (dual == T(0)) continue;
        const FramedImage<Dim, T>& image = *warped[i].image;
        const std::array<T, Dim> gradient = LinearCell<Dim, T>(image.lattice, maps[i](index, displacement + Dim * site))
                                                .template pulled_back_gradient<1>(image.samples.data(), {dual});
        for (int col = 0; col < Dim; ++col)
          for (int row = 0; row < Dim; ++row) sum[col] += maps[i].turn[row][col] * gradient[row];
      }
      for (int col = 0; col < Dim; ++col) displacement_dual[Dim * site + col] = sum[col];
    });
}

#define SALTUS_WARP(DIM, TYPE)                                                                                       \
  template void warp<DIM, TYPE>(const FramedImage<DIM, TYPE>&, const Lattice<DIM>&, const TYPE*, TYPE*);             \
  template void warp_adjoint<DIM, TYPE>(const std::vector<WarpedDual<DIM, TYPE>>&, const Lattice<DIM>&, const TYPE*, \
                                        TYPE*);
SALTUS_WARP(2, float)
SALTUS_WARP(3, float)
SALTUS_WARP(2, double)
SALTUS_WARP(3, double)
#undef SALTUS_WARP

}  // namespace saltus
