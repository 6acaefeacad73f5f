#pragma once

#include "core/grid/lattice.h"

#include <Eigen/Core>

#include <array>

namespace saltus {

/// Differences of an interleaved field on a lattice, a velocity or a displacement: central, one-sided at the border, 0
/// along an axis of one sample.
template <int Dim, class T>
class FieldDerivative {
 public:
  /// `field` must outlive this.
  FieldDerivative(const Lattice<Dim>& lattice, const Field<T>& field) : lattice_(lattice), field_(field.data()) {
    std::size_t stride = Dim;
    for (int a = 0; a < Dim; ++a) {
      strides_[a] = stride;
      stride *= static_cast<std::size_t>(lattice.size[a]);
    }
  }

  /// Of component c along axis a at a site.
  T entry(const Index<Dim>& index, std::size_t site, int c, int a) const {
    const bool has_above = index[a] + 1 < lattice_.size[a], has_below = index[a] > 0;
    const T span = static_cast<T>((has_above + has_below) * lattice_.spacing[a]);
    if (span == T(0)) return T(0);
    const T* at = field_ + Dim * site + c;
    return (at[has_above ? strides_[a] : 0] - *(at - (has_below ? strides_[a] : 0))) / span;
  }

  /// D u, with component c along axis a in row c, column a.
  Eigen::Matrix<T, Dim, Dim> at(const Index<Dim>& index, std::size_t site) const {
    Eigen::Matrix<T, Dim, Dim> derivative;
    for (int a = 0; a < Dim; ++a)
      for (int c = 0; c < Dim; ++c) derivative(c, a) = entry(index, site, c, a);
    return derivative;
  }

 private:
  Lattice<Dim> lattice_;
  const T* field_;
  std::array<std::size_t, Dim> strides_;
};

/// Calls visit(site, D u) for each site of a slab (the last axis' index), see FieldDerivative.
template <int Dim, class T, class Visit>
void visit_derivatives(const Lattice<Dim>& lattice, const Field<T>& field, int slab, Visit&& visit) {
  const FieldDerivative<Dim, T> derivative(lattice, field);
  visit_slab<Dim>(lattice, slab,
                  [&](const Index<Dim>& index, std::size_t site) { visit(site, derivative.at(index, site)); });
}

}  // namespace saltus
