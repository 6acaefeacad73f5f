#include "core/momenta/directional_momentum.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim, class T>
void DirectionalMomentum<Dim, T>::expand(const T* along, T* first) const {
  const std::size_t count = w_.size();
  for (int axis = 0; axis < Dim; ++axis) {
    T* out = first + static_cast<std::size_t>(axis) * count;
#pragma omp parallel for schedule(static)
    for (std::size_t at = 0; at < count; at += Dim)
      for (int c = 0; c < Dim; ++c) out[at + c] = w_[at + axis] * along[at + c];
  }
}

template <int Dim, class T>
void DirectionalMomentum<Dim, T>::contract(const T* first, T* along) const {
  const std::size_t count = w_.size();
#pragma omp parallel for schedule(static)
  for (std::size_t at = 0; at < count; at += Dim)
    for (int c = 0; c < Dim; ++c) {
      T sum = 0;
      for (int axis = 0; axis < Dim; ++axis)
        sum += w_[at + axis] * first[static_cast<std::size_t>(axis) * count + at + c];
      along[at + c] = sum;
    }
}

template <int Dim, class T>
void DirectionalMomentum<Dim, T>::drop_normal(T* along) const {
  const std::size_t count = w_.size();
#pragma omp parallel for schedule(static)
  for (std::size_t at = 0; at < count; at += Dim) {
    T normal = 0;
    for (int c = 0; c < Dim; ++c) normal += w_[at + c] * along[at + c];
    for (int c = 0; c < Dim; ++c) along[at + c] -= normal * w_[at + c];
  }
}

template <int Dim>
Field<double> nearest_directions(const Lattice<Dim>& image, const Field<double>& w, const Lattice<Dim>& lattice) {
  Field<double> nearest(Dim * lattice.sites());
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      std::size_t from = 0, stride = 1;
      for (int axis = 0; axis < Dim; ++axis) {
        const double at =
            (lattice.offset[axis] + index[axis] * lattice.spacing[axis] - image.offset[axis]) / image.spacing[axis];
        const int sample = std::clamp(static_cast<int>(std::lround(at)), 0, image.size[axis] - 1);
        from += stride * static_cast<std::size_t>(sample);
        stride *= static_cast<std::size_t>(image.size[axis]);
      }
      std::copy_n(w.begin() + static_cast<std::ptrdiff_t>(Dim * from), Dim,
                  nearest.begin() + static_cast<std::ptrdiff_t>(Dim * site));
    });
  return nearest;
}

template class DirectionalMomentum<2, float>;
template class DirectionalMomentum<3, float>;
template class DirectionalMomentum<2, double>;
template class DirectionalMomentum<3, double>;
template Field<double> nearest_directions(const Lattice<2>&, const Field<double>&, const Lattice<2>&);
template Field<double> nearest_directions(const Lattice<3>&, const Field<double>&, const Lattice<3>&);

}  // namespace saltus
