#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// D u of most of an image: of each entry the median over all sites. That of a frame which turned or was stretched as a
/// whole, or otherwise next to nothing; what slides is not half of an image. `field` is interleaved, on `lattice`;
/// differences are central, one-sided at the border.
template <int Dim, class T>
Matrix<Dim> usual_derivative(const Lattice<Dim>& lattice, const Field<T>& field);

/// How much of what a field u changes from place to place is simple shear, as a slip is: sum |D|^4 / sum |D^2|^2 over
/// all sites, in Frobenius norms, of D = D u - `usual`. Of a jump t across a plane with normal n, D is t n^T, whose
/// square (t . n) t n^T is 0 where t lies in the plane, whichever way that does: without bound, but no more than 1e6 is
/// told. A compression along an axis has 1, a rotation and a stretch that keeps volumes 2; chance has 2 in 2-D and 3 in
/// 3-D where all entries are independent, and 14 / 3 and 4.5 where volumes are kept. Fourth powers let the strongest
/// changes count, which is where something slides that order 0 has drawn out, more than weaker ones all around; what
/// changes as strongly in much of the image, but not in most of it, hides it. 0 where D is 0 everywhere, or not finite.
///
/// `field` as above.
template <int Dim, class T>
double simple_shear(const Lattice<Dim>& lattice, const Field<T>& field, const Matrix<Dim>& usual = Matrix<Dim>::Zero());

/// That of the field as it is or beside its usual derivative, whichever is more: the former is hidden where the frame
/// turns as a whole, the latter where what slides is a large part of it.
template <int Dim, class T>
double shear_of_slip(const Lattice<Dim>& lattice, const Field<T>& field);

}  // namespace saltus
