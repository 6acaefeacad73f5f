#pragma once

#include <filesystem>

#include "core/slip/slip_surface.h"

namespace saltus {

/// Writes a slip surface as text, one line a point: position and normal (x, y, z; 2-D: x, y), area_mm2 (2-D:
/// length_mm), jump (vector) and jump_mm (its length), gap_mm (negative: overlap), velocity_jump_mm, part. What they
/// are is in core/slip/slip_surface.h; positions are world mm (LPS) of the fixed image. An empty surface is the header
/// alone. Replaces `path` at once. Throws FileError when writing fails.
template <int Dim>
void write_slip_csv(const std::filesystem::path& path, const SlipSurface<Dim>& surface);

/// The same as VTK XML PolyData (.vtp, ASCII), for ParaView, 3D Slicer and vtkXMLPolyDataReader: the points, one vertex
/// each, and their figures as point data with the names of the columns, normals as "Normals". z is 0 in 2-D.
template <int Dim>
void write_slip_vtp(const std::filesystem::path& path, const SlipSurface<Dim>& surface);

}  // namespace saltus
