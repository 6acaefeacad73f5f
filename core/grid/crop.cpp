#include "core/grid/crop.h"

#include <algorithm>
#include <sstream>

#include "core/support/errors.h"

namespace saltus {

template <int Dim>
Volume<Dim> crop(const Volume<Dim>& image, const std::type_identity_t<Index<Dim>>& begin,
                 const std::type_identity_t<Index<Dim>>& end) {
  ImageGrid<Dim> grid = image.grid;
  Vector<Dim> corner;
  for (int axis = 0; axis < Dim; ++axis) {
    if (begin[axis] < 0 || begin[axis] >= end[axis] || end[axis] > image.grid.size[axis]) {
      std::ostringstream text;
      text << "crop takes voxels " << begin[axis] << " to " << end[axis] << " (exclusive) of axis " << axis
           << "; choose 0 <= begin < end <= " << image.grid.size[axis];
      throw InvalidInput(text.str());
    }
    grid.size[axis] = end[axis] - begin[axis];
    corner[axis] = begin[axis];
  }
  grid.origin = image.grid.to_world(corner);

  Volume<Dim> box(grid);
  const int rows_per_slice = grid.size[1];
  const int slices = Dim == 3 ? grid.size[Dim - 1] : 1;
  auto target = box.samples.begin();
  for (int z = 0; z < slices; ++z) {
    for (int y = 0; y < rows_per_slice; ++y) {
      const std::size_t slice = Dim == 3 ? z + begin[Dim - 1] : 0;
      const std::size_t row = slice * image.grid.size[1] + y + begin[1];
      const auto source = image.samples.begin() + row * image.grid.size[0] + begin[0];
      target = std::copy(source, source + grid.size[0], target);
    }
  }
  return box;
}

template Volume<2> crop(const Volume<2>&, const Index<2>&, const Index<2>&);
template Volume<3> crop(const Volume<3>&, const Index<3>&, const Index<3>&);

}  // namespace saltus
