#pragma once

#include <string>

#include "core/grid/image_grid.h"

namespace saltus {

/// Whether two grids have the same size and every voxel at the same place, to a hundredth of the smallest spacing:
/// formats that keep their header in single precision still agree.
template <int Dim>
bool do_grids_agree(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b);

/// Throws InvalidInput naming both and the way out, unless the grids agree.
template <int Dim>
void require_same_grid(const std::string& name, const ImageGrid<Dim>& grid, const std::string& other_name,
                       const ImageGrid<Dim>& other);

}  // namespace saltus
