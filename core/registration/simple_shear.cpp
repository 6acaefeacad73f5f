#include "core/registration/simple_shear.h"

#include "core/registration/velocity_derivative.h"

#include <cmath>
#include <vector>

namespace saltus {

template <int Dim, class T>
double simple_shear(const Lattice<Dim>& lattice, const Field<T>& velocity) {
  constexpr double most = 1e6;
  struct Sums {
    double fourth = 0, square = 0;
  };
  std::vector<Sums> slabs(static_cast<std::size_t>(lattice.size[Dim - 1]));  // added in one order for all threads
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab) {
    Sums sums;
    visit_derivatives<Dim>(lattice, velocity, slab, [&](std::size_t, const Eigen::Matrix<T, Dim, Dim>& derivative) {
      const Eigen::Matrix<double, Dim, Dim> d = derivative.template cast<double>();
      const double squared_norm = d.squaredNorm();
      sums.fourth += squared_norm * squared_norm;
      sums.square += (d * d).squaredNorm();
    });
    slabs[static_cast<std::size_t>(slab)] = sums;
  }
  Sums all;
  for (const Sums& one : slabs) {
    all.fourth += one.fourth;
    all.square += one.square;
  }
  if (!(all.fourth > 0) || !std::isfinite(all.fourth)) return 0;
  return all.square * most > all.fourth ? all.fourth / all.square : most;
}

template double simple_shear(const Lattice<2>&, const Field<float>&);
template double simple_shear(const Lattice<3>&, const Field<float>&);
template double simple_shear(const Lattice<2>&, const Field<double>&);
template double simple_shear(const Lattice<3>&, const Field<double>&);

}  // namespace saltus
