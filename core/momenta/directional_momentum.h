#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// One first-order momentum a site, with the derivative along a given unit vector w there in place of one along each
/// axis (numerics, model `directional`):
///
///     sum_i D^i K * m_i   with   m_i = w_i m_w ,      a jump across the surface that w is normal to, along m_w
///
/// Component i of site s goes to the face half a sample up axis i of s, one to one: means over the two faces beside a
/// site would draw a sheet of one sample out over two gaps, and would not see momenta that alternate. Where w is 0,
/// there is no first-order momentum.
template <int Dim, class T>
class DirectionalMomentum {
 public:
  /// w: Dim components a site, in the frame.
  explicit DirectionalMomentum(const Field<double>& w) : w_(w.begin(), w.end()) {}

  /// The Dim fields m_i, one after the other, of `along` (Dim values a site).
  void expand(const T* along, T* first) const;
  /// Exact transpose of expand: along = sum_i w_i first_i.
  void contract(const T* first, T* along) const;
  /// Takes w (w . value) off each value: what is left can only slide.
  void drop_normal(T* along) const;

 private:
  std::vector<T> w_;
};

/// w on a lattice from w on the image's own: that of the nearest sample, since w and -w mean the same and a mean of
/// both would be none.
template <int Dim>
Field<double> nearest_directions(const Lattice<Dim>& image, const Field<double>& w, const Lattice<Dim>& lattice);

}  // namespace saltus
