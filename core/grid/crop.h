#pragma once

#include <type_traits>

#include "core/grid/volume.h"

namespace saltus {

/// The box of voxels [begin, end) of `image`, each voxel where it was in the world.
/// Throws InvalidInput when the box is empty or leaves the image.
template <int Dim>
Volume<Dim> crop(const Volume<Dim>& image, const std::type_identity_t<Index<Dim>>& begin,
                 const std::type_identity_t<Index<Dim>>& end);

}  // namespace saltus
