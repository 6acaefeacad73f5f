#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// How much of what a velocity changes from place to place is simple shear, as a slip is: sum |D v|^4 / sum |(D v)^2|^2
/// over all sites, in Frobenius norms. Of a jump t across a plane with normal n, D v is t n^T, whose square
/// (t . n) t n^T is 0 where t lies in the plane, whichever way that does: without bound, but no more than 1e6 is told.
/// A compression along an axis has 1, a rotation and a stretch that keeps volumes 2; chance has 2 in 2-D and 3 in 3-D
/// where all entries are independent, and 14 / 3 and 4.5 where the velocity keeps volumes. Fourth powers let the
/// strongest changes count, which is where something slides that order 0 has drawn out, more than weaker ones all
/// around; what changes as strongly in much of the image, as where that turns, hides it. 0 where v is the same
/// everywhere, or is not finite.
///
/// `velocity` is interleaved, on `lattice`; differences are central, one-sided at the border.
template <int Dim, class T>
double simple_shear(const Lattice<Dim>& lattice, const Field<T>& velocity);

}  // namespace saltus
