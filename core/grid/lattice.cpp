#include "core/grid/lattice.h"

#include <cmath>

namespace saltus {

template <int Dim>
Lattice<Dim> lattice_of(const ImageGrid<Dim>& grid) {
  Lattice<Dim> lattice;
  for (int axis = 0; axis < Dim; ++axis) {
    lattice.size[axis] = grid.size[axis];
    lattice.spacing[axis] = grid.spacing[axis];
    lattice.offset[axis] = 0;
  }
  return lattice;
}

template <int Dim>
Lattice<Dim> coarsened(const Lattice<Dim>& image, double target_mm) {
  Lattice<Dim> coarse = image;
  for (int axis = 0; axis < Dim; ++axis) {
    const int samples = image.size[axis];
    if (samples < 4 || target_mm < 1.5 * image.spacing[axis]) continue;
    const double extent = samples * image.spacing[axis];
    coarse.size[axis] = std::max(2, static_cast<int>(std::ceil(extent / target_mm - 1e-9)));
    coarse.spacing[axis] = target_mm;
    const double span = (coarse.size[axis] - 1) * target_mm;
    coarse.offset[axis] = image.offset[axis] + 0.5 * ((samples - 1) * image.spacing[axis] - span);
  }
  return coarse;
}

template <int Dim>
double cell_along(const Lattice<Dim>& lattice, const Vector<Dim>& direction) {
  double square = 0;
  for (int a = 0; a < Dim; ++a) square += std::pow(direction[a] * lattice.spacing[a], 2);
  return std::sqrt(square);
}

template Lattice<2> lattice_of(const ImageGrid<2>&);
template Lattice<3> lattice_of(const ImageGrid<3>&);
template Lattice<2> coarsened(const Lattice<2>&, double);
template Lattice<3> coarsened(const Lattice<3>&, double);
template double cell_along(const Lattice<2>&, const Vector<2>&);
template double cell_along(const Lattice<3>&, const Vector<3>&);

}  // namespace saltus
