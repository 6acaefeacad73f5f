#pragma once

#include "core/grid/volume.h"

namespace saltus {

/// det D(x + u(x)) at each voxel from central differences of u, one-sided at the border; an axis of one voxel counts
/// as constant. Across a sliding interface the differences bridge the jump: the value there says nothing about a fold.
template <int Dim>
Volume<Dim> jacobian_determinant(const VectorVolume<Dim>& displacement);

}  // namespace saltus
