#include "core/evaluation/grid_agreement.h"

#include "core/support/errors.h"

namespace saltus {

template <int Dim>
bool do_grids_agree(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b) {
  if (a.size != b.size) return false;
  const double tolerance = 0.01 * std::min(a.spacing.minCoeff(), b.spacing.minCoeff());
  return largest_distance(a, b) <= tolerance;
}

template <int Dim>
void require_same_grid(const std::string& name, const ImageGrid<Dim>& grid, const std::string& other_name,
                       const ImageGrid<Dim>& other) {
  if (do_grids_agree(grid, other)) return;
  const std::string how = grid.size == other.size ? "at another place in the world (spacing, origin or direction)"
                                                  : "of size " + size_text<Dim>(other.size);
  throw InvalidInput(name + " has the grid " + size_text<Dim>(grid.size) + ", but " + other_name + " is " + how +
                     "; both must be on the same grid.");
}

#define SALTUS_INSTANTIATE(Dim)                                               \
  template bool do_grids_agree(const ImageGrid<Dim>&, const ImageGrid<Dim>&); \
  template void require_same_grid(const std::string&, const ImageGrid<Dim>&, const std::string&, const ImageGrid<Dim>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
