#pragma once

#include "core/grid/volume.h"
#include "server/worker/report/slice_plane.h"

#include <string>

namespace saltus::report {

/// The lines of a regular grid of the plane, carried along by x -> x + u(x), as the `d` of an SVG path in picture
/// pixels. Of a 3-D displacement the part within the plane is shown.
template <int Dim>
std::string deformed_grid_path(const VectorVolume<Dim>& displacement, const SlicePlane<Dim>& plane);

}  // namespace saltus::report
