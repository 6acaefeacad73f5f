#pragma once

#include "core/phantom/blob_texture.h"
#include "core/phantom/scene.h"

namespace saltus {

/// Whether `world` lies inside the box of voxel centres, at least `inset` voxels from its faces.
template <int Dim>
bool is_inside(const ImageGrid<Dim>& grid, const Vector<Dim>& world, double inset);

/// Points spread over the moving image and, as far as 20000 draws find them, 40 within 3 mm of the interface:
/// all of them valid in the fixed image.
template <int Dim>
std::vector<Vector<Dim>> scattered_landmarks(const Scene<Dim>& scene, const ImageGrid<Dim>& grid, std::uint64_t seed);

/// The grey-level texture of the 2-D scenes, blobs of three scales about 128.
template <int Dim>
std::vector<typename BlobTexture<Dim>::Scale> grey_texture_scales();

}  // namespace saltus
