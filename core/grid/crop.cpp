#include "core/grid/crop.h"

#include <algorithm>
#include <sstream>

#include "core/support/errors.h"

namespace saltus {

template <int Dim>
std::vector<float> samples_in_box(const Index<Dim>& size, const std::vector<float>& samples,
                                  const std::type_identity_t<Index<Dim>>& begin,
                                  const std::type_identity_t<Index<Dim>>& end) {
  Index<Dim> extent;
  std::size_t count = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    extent[axis] = end[axis] - begin[axis];
    count *= static_cast<std::size_t>(extent[axis]);
  }
  std::vector<float> box(count);
  const int slices = Dim == 3 ? extent[Dim - 1] : 1;
  auto target = box.begin();
  for (int z = 0; z < slices; ++z) {
    for (int y = 0; y < extent[1]; ++y) {
      const std::size_t slice = Dim == 3 ? z + begin[Dim - 1] : 0;
      const std::size_t row = slice * size[1] + y + begin[1];
      const auto source = samples.begin() + static_cast<std::ptrdiff_t>(row * size[0] + begin[0]);
      target = std::copy(source, source + extent[0], target);
    }
  }
  return box;
}

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

  Volume<Dim> box;
  box.grid = grid;
  box.samples = samples_in_box<Dim>(image.grid.size, image.samples, begin, end);
  return box;
}

template std::vector<float> samples_in_box<2>(const Index<2>&, const std::vector<float>&, const Index<2>&,
                                              const Index<2>&);
template std::vector<float> samples_in_box<3>(const Index<3>&, const std::vector<float>&, const Index<3>&,
                                              const Index<3>&);
template Volume<2> crop(const Volume<2>&, const Index<2>&, const Index<2>&);
template Volume<3> crop(const Volume<3>&, const Index<3>&, const Index<3>&);

}  // namespace saltus
