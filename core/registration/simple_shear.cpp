#include "core/registration/simple_shear.h"

#include "core/registration/field_derivative.h"
#include "core/support/ranking.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace saltus {

template <int Dim, class T>
Matrix<Dim> usual_derivative(const Lattice<Dim>& lattice, const Field<T>& field) {
  const FieldDerivative<Dim, T> derivative(lattice, field);
  Field<T> entries(lattice.sites());
  Matrix<Dim> usual;
  for (int axis = 0; axis < Dim; ++axis)
    for (int c = 0; c < Dim; ++c) {
#pragma omp parallel for schedule(static)
      for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
        visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
          entries[site] = derivative.entry(index, site, c, axis);
        });
      usual(c, axis) = static_cast<double>(ranking_of(entries.size(), entries.data()).at(entries.size() / 2));
    }
  return usual;
}

template <int Dim, class T>
double simple_shear(const Lattice<Dim>& lattice, const Field<T>& field, const Matrix<Dim>& usual) {
  constexpr double most = 1e6;
  struct Sums {
    double fourth = 0, square = 0;
  };
  std::vector<Sums> slabs(static_cast<std::size_t>(lattice.size[Dim - 1]));  // added in one order for all threads
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab) {
    Sums sums;
    visit_derivatives<Dim>(lattice, field, slab, [&](std::size_t, const Eigen::Matrix<T, Dim, Dim>& derivative) {
      const Matrix<Dim> d = derivative.template cast<double>() - usual;
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

template <int Dim, class T>
double shear_of_slip(const Lattice<Dim>& lattice, const Field<T>& field) {
  return std::max(simple_shear(lattice, field), simple_shear(lattice, field, usual_derivative(lattice, field)));
}

#define SALTUS_SIMPLE_SHEAR(DIM, T)                                                       \
  template Matrix<DIM> usual_derivative(const Lattice<DIM>&, const Field<T>&);            \
  template double simple_shear(const Lattice<DIM>&, const Field<T>&, const Matrix<DIM>&); \
  template double shear_of_slip(const Lattice<DIM>&, const Field<T>&);
SALTUS_SIMPLE_SHEAR(2, float)
SALTUS_SIMPLE_SHEAR(3, float)
SALTUS_SIMPLE_SHEAR(2, double)
SALTUS_SIMPLE_SHEAR(3, double)
#undef SALTUS_SIMPLE_SHEAR

}  // namespace saltus
