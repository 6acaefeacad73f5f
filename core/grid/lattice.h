#pragma once

#include "core/grid/image_grid.h"
#include "core/support/line_vector.h"

#include <array>
#include <cstddef>
#include <vector>

namespace saltus {

/// Axis-aligned samples in the *frame* of the registration: millimetres along the fixed image's grid axes, measured
/// from its voxel 0. All of the flow lives in this frame; directions and origins appear only when images come in and
/// fields go out. x runs fastest.
template <int Dim>
struct Lattice {
  Index<Dim> size{};
  std::array<double, Dim> spacing{};  ///< mm
  std::array<double, Dim> offset{};   ///< frame position of sample 0, mm

  std::size_t sites() const {
    std::size_t count = 1;
    for (int extent : size) count *= static_cast<std::size_t>(extent);
    return count;
  }
  double cell_volume() const {
    double volume = 1;
    for (double h : spacing) volume *= h;
    return volume;
  }
  bool operator==(const Lattice&) const = default;
};

/// The lattice of the fixed image itself.
template <int Dim>
Lattice<Dim> lattice_of(const ImageGrid<Dim>& grid);

/// Lattice over the same extent whose axes have the spacing `target_mm` wherever the image is at least 1.5 times finer,
/// and the image's own spacing elsewhere; centred. Axes of fewer than four samples are never coarsened.
template <int Dim>
Lattice<Dim> coarsened(const Lattice<Dim>& image, double target_mm);

/// Width of a site's cell along a direction, mm: that of a cube is the same for all.
template <int Dim>
double cell_along(const Lattice<Dim>& lattice, const Vector<Dim>& direction);

/// A vector per site, components together: values[Dim * site + component]. It begins with a cache line, so that a
/// register that is loaded from it lies in one.
template <class T>
using Field = LineVector<T>;

/// Calls visit(index, site) for all sites of one slab of the last axis.
template <int Dim, class Visit>
inline void visit_slab(const Lattice<Dim>& lattice, int slab, Visit&& visit) {
  const int nx = lattice.size[0];
  if constexpr (Dim == 2) {
    std::size_t site = static_cast<std::size_t>(slab) * nx;
    for (int x = 0; x < nx; ++x, ++site) visit(Index<2>{x, slab}, site);
  } else {
    const int ny = lattice.size[1];
    std::size_t site = static_cast<std::size_t>(slab) * ny * nx;
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x, ++site) visit(Index<3>{x, y, slab}, site);
  }
}

}  // namespace saltus
