#include "core/image_io/read_image.h"

#include <algorithm>
#include <limits>
#include <string>

#include "core/image_io/image_file.h"
#include "core/image_io/nearest_rotation.h"
#include "core/image_io/refuse_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

template <int Dim>
ImageGrid<Dim> grid_of(const ImageFileHeader& header, const std::filesystem::path& path) {
  if (header.dimension != Dim)
    refuse(path, "it is a " + std::to_string(header.dimension) + "-D image where a " + std::to_string(Dim) +
                     "-D image is needed");
  ImageGrid<Dim> grid;
  for (int axis = 0; axis < Dim; ++axis) {
    grid.size[axis] = static_cast<int>(std::min<std::size_t>(header.size[axis], std::numeric_limits<int>::max()));
    grid.spacing[axis] = header.spacing[axis];
    grid.origin[axis] = header.origin[axis];
    for (int row = 0; row < Dim; ++row) grid.direction(row, axis) = header.direction[axis][row];
  }
  if (const auto found = problems(grid, kRoundedDirection); !found.empty()) refuse(path, found.front());
  grid.direction = nearest_rotation<Dim>(grid.direction);
  return grid;
}

}  // namespace

int image_dimension(const std::filesystem::path& path) { return read_image_header(path).dimension; }

template <int Dim>
ImageGrid<Dim> read_grid(const std::filesystem::path& path) {
  return grid_of<Dim>(read_image_header(path), path);
}

template <int Dim>
Volume<Dim> read_volume(const std::filesystem::path& path) {
  const ImageFileHeader header = read_image_header(path);
  Volume<Dim> volume;
  volume.grid = grid_of<Dim>(header, path);
  if (header.components != 1)
    refuse(path, "it has " + std::to_string(header.components) +
                     " components a voxel where a scalar image is needed; give one component");
  volume.samples = read_image_file(path).samples;
  return volume;
}

template <int Dim>
VectorVolume<Dim> read_vector_volume(const std::filesystem::path& path) {
  const ImageFileHeader header = read_image_header(path);
  const ImageGrid<Dim> grid = grid_of<Dim>(header, path);
  if (header.components != Dim)
    refuse(path, "it has " + std::to_string(header.components) +
                     " component(s) a voxel where a displacement field with " + std::to_string(Dim) + " is needed");
  VectorVolume<Dim> vectors(grid);
  const std::vector<float> samples = read_image_file(path).samples;
  const std::size_t voxels = grid.voxels();
  for (int c = 0; c < Dim; ++c) {
    float* plane = vectors.component(c);
    for (std::size_t i = 0; i < voxels; ++i) plane[i] = samples[i * Dim + c];
  }
  return vectors;
}

template ImageGrid<2> read_grid<2>(const std::filesystem::path&);
template ImageGrid<3> read_grid<3>(const std::filesystem::path&);
template Volume<2> read_volume<2>(const std::filesystem::path&);
template Volume<3> read_volume<3>(const std::filesystem::path&);
template VectorVolume<2> read_vector_volume<2>(const std::filesystem::path&);
template VectorVolume<3> read_vector_volume<3>(const std::filesystem::path&);

}  // namespace saltus
