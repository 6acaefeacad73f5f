#pragma once

#include "core/drawing/slice_plane.h"
#include "core/slip/slip_surface.h"

#include <optional>
#include <string>

namespace saltus::report {

/// SVG paths in picture pixels of the pieces of a slip surface within half a slice of the plane, coloured by their
/// tangential jump up to `most_mm` (as `interface_colour`): each a line as long as the piece, where it cuts the plane;
/// a piece that lies in the plane is a square. In 2-D all of them.
template <int Dim>
std::string slip_marks(const SlipSurface<Dim>& surface, const ImageGrid<Dim>& grid,
                       const drawing::SlicePlane<Dim>& plane, double most_mm);

/// Continuous index of the piece around which (three voxels) jump times area, summed, is largest. Empty for an empty
/// surface.
template <int Dim>
std::optional<Vector<Dim>> strongest_slip(const SlipSurface<Dim>& surface, const ImageGrid<Dim>& grid);

}  // namespace saltus::report
