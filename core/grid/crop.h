#pragma once

#include <type_traits>
#include <vector>

#include "core/grid/volume.h"

namespace saltus {

/// Of samples on a grid of `size`, x fastest, those of the box [begin, end), which lies in it.
template <int Dim>
std::vector<float> samples_in_box(const Index<Dim>& size, const std::vector<float>& samples,
                                  const std::type_identity_t<Index<Dim>>& begin,
                                  const std::type_identity_t<Index<Dim>>& end);

/// The box of voxels [begin, end) of `image`, each voxel where it was in the world.
/// Throws InvalidInput when the box is empty or leaves the image.
template <int Dim>
Volume<Dim> crop(const Volume<Dim>& image, const std::type_identity_t<Index<Dim>>& begin,
                 const std::type_identity_t<Index<Dim>>& end);

}  // namespace saltus
