#pragma once

#include <vector>

#include "core/evaluation/transition_width.h"
#include "core/phantom/scene.h"

namespace saltus {

/// Places of a scene's sliding interface in the fixed image: for each voxel whose centre is at most half a voxel away
/// (measured along the normal), the nearest point of the interface, with the direction in which the true motion jumps
/// there as the tangent. Only where errors count on both sides (Scene::is_valid) and the motion does jump. In voxel
/// order.
template <int Dim>
std::vector<InterfacePoint<Dim>> interface_points(const Scene<Dim>& scene, const ImageGrid<Dim>& grid);

}  // namespace saltus
