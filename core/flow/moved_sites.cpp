#include "core/flow/moved_sites.h"

#include "core/flow/jump_aware_jacobian.h"
#include "core/support/planes.h"

#include <Eigen/LU>

#include <algorithm>

namespace saltus {

template <int Dim, class T>
MovedSites<Dim, T>::MovedSites(const Lattice<Dim>& lattice, Evolution evolution) : lattice_(lattice) {
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    stride_[axis] = stride;
    per_mm_[axis] = 1 / lattice.spacing[axis];
    stride *= static_cast<std::size_t>(lattice.size[axis]);
  }
  if (evolution == Evolution::Carried) return;
  jacobian_.resize(Dim * Dim * lattice.sites());
  jacobian_dual_.resize(jacobian_.size());
}

template <int Dim, class T>
void MovedSites<Dim, T>::move(const T* displacement, const BlockMask<Dim>& where) {
  displacement_ = displacement;
  if (!has_jacobians()) return;
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
    where.visit_sites(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
      T* F = jacobian_.data() + Dim * Dim * site;
      for (int axis = 0; axis < Dim; ++axis) {
        T column[Dim];
        SideDifferences<Dim, Dim, T>(lattice_, index, site, stride_[axis], axis, displacement,
                                     static_cast<T>(1 / lattice_.spacing[axis]))
            .combine(column);
        for (int row = 0; row < Dim; ++row) F[Dim * row + axis] = column[row] + (row == axis ? T(1) : T(0));
      }
    });
}

template <int Dim, class T>
auto MovedSites<Dim, T>::inverse_jacobian(std::size_t site) const -> Matrix {
  if (!has_jacobians()) return Matrix::Identity();
  return Eigen::Map<const Matrix, Eigen::Unaligned>(jacobian_.data() + Dim * Dim * site).inverse();
}

template <int Dim, class T>
void MovedSites<Dim, T>::begin_adjoint(const BlockMask<Dim>& where) {
  if (has_jacobians()) where.clear(lattice_, Dim * Dim, jacobian_dual_.data());
}

template <int Dim, class T>
void MovedSites<Dim, T>::end_adjoint(const BlockMask<Dim>& where, T* displacement_dual) {
  if (!has_jacobians()) return;
  for_planes_apart<3>(lattice_.size[Dim - 1], [&](int slab) {
    where.visit_sites(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
      const T* dual = jacobian_dual_.data() + Dim * Dim * site;
      if (std::all_of(dual, dual + Dim * Dim, [](T value) { return value == T(0); })) return;
      for (int axis = 0; axis < Dim; ++axis) {
        T column[Dim];
        for (int row = 0; row < Dim; ++row) column[row] = dual[Dim * row + axis];
        const T scale = static_cast<T>(1 / lattice_.spacing[axis]);
        SideDifferences<Dim, Dim, T>(lattice_, index, site, stride_[axis], axis, displacement_, scale)
            .adjoint(column, site, stride_[axis], scale, displacement_dual);
      }
    });
  });
}

template class MovedSites<2, float>;
template class MovedSites<3, float>;
template class MovedSites<2, double>;
template class MovedSites<3, double>;

}  // namespace saltus
