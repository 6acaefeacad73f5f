#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// How much of what a velocity changes from place to place is simple shear, as a slip is: sum |D v|^4 / sum |(D v)^2|^2
/// over all sites, in Frobenius norms. Of a jump t across a plane with normal n, D v is t n^T, whose square
/// (t . n) t n^T is 0 where t lies in the plane, whichever way that does: without bound, but no more than 1e6 is told.
/// A compression along an axis has 1, a rotation and a stretch that keeps volumes 2, independent entries 2 in 2-D and 3
/// in 3-D. Fourth powers let the strongest changes count, which is where something slides that order 0 has drawn out;
/// so it is the same however much of the image moves smoothly besides. 0 where v is the same everywhere.
///
/// `velocity` is interleaved, on `lattice`; differences are central, one-sided at the border.
template <int Dim, class T>
double simple_shear(const Lattice<Dim>& lattice, const Field<T>& velocity);

}  // namespace saltus
