#pragma once

#include "core/drawing/slice_plane.h"
#include "server/worker/report/interface.h"

#include <string>

namespace saltus::report {

/// SVG paths in picture pixels of the faces of an interface that the plane cuts, coloured by their slip up to
/// `most_mm` (as `interface_colour`). A face that lies within the plane is a square on its voxel.
template <int Dim>
std::string interface_paths(const DetectedInterface<Dim>& found, const ImageGrid<Dim>& grid,
                            const drawing::SlicePlane<Dim>& plane, double most_mm);

}  // namespace saltus::report
