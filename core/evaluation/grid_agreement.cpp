#include "core/evaluation/grid_agreement.h"

#include "core/support/errors.h"

namespace saltus {
namespace {

template <int Dim>
std::string size_text(const ImageGrid<Dim>& grid) {
  std::string text;
  for (int axis = 0; axis < Dim; ++axis) text += (axis ? "x" : "") + std::to_string(grid.size[axis]);
  return text;
}

}  // namespace

template <int Dim>
bool do_grids_agree(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b) {
  if (a.size != b.size) return false;
  const double tolerance = 0.01 * std::min(a.spacing.minCoeff(), b.spacing.minCoeff());
  // The maps are affine, so voxels agree when the corners do.
  for (int corner = 0; corner < (1 << Dim); ++corner) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = (corner >> axis) & 1 ? a.size[axis] - 1 : 0;
    if (!((a.to_world(index) - b.to_world(index)).norm() <= tolerance)) return false;
  }
  return true;
}

template <int Dim>
void require_same_grid(const std::string& name, const ImageGrid<Dim>& grid, const std::string& other_name,
                       const ImageGrid<Dim>& other) {
  if (do_grids_agree(grid, other)) return;
  const std::string how = grid.size == other.size ? "at another place in the world (spacing, origin or direction)"
                                                  : "of size " + size_text(other);
  throw InvalidInput(name + " has the grid " + size_text(grid) + ", but " + other_name + " is " + how +
                     "; both must be on the same grid.");
}

#define SALTUS_INSTANTIATE(Dim)                                               \
  template bool do_grids_agree(const ImageGrid<Dim>&, const ImageGrid<Dim>&); \
  template void require_same_grid(const std::string&, const ImageGrid<Dim>&, const std::string&, const ImageGrid<Dim>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
