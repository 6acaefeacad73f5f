#include "core/evaluation/warp_image.h"

#include <algorithm>
#include <cmath>

#include "core/evaluation/cubic_spline.h"
#include "core/grid/interpolation.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

/// Linear interpolation at a continuous index within the image.
template <int Dim>
double linear_at(const Volume<Dim>& image, const Vector<Dim>& index) {
  std::array<double, Dim> at;
  for (int axis = 0; axis < Dim; ++axis) at[axis] = index[axis];
  const LinearCell<Dim, double> cell(Lattice<Dim>{.size = image.grid.size}, at);
  double sum = 0;
  for (int bits = 0; bits < cell.corners; ++bits)
    if (const double weight = cell.weight(bits); weight != 0) sum += weight * image.samples[cell.corner(bits)];
  return sum;
}

template <int Dim>
double nearest_at(const Volume<Dim>& image, const Vector<Dim>& index) {
  std::size_t voxel = 0, stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    voxel += stride * static_cast<std::size_t>(std::lround(index[axis]));
    stride *= static_cast<std::size_t>(image.grid.size[axis]);
  }
  return image.samples[voxel];
}

template <int Dim, typename At>
Volume<Dim> warp_with(const Volume<Dim>& image, const VectorVolume<Dim>& displacement, std::optional<float> outside,
                      const At& at) {
  const ImageGrid<Dim>& grid = displacement.grid;
  Volume<Dim> warped(grid);
  const auto count = static_cast<std::ptrdiff_t>(grid.voxels());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t voxel = 0; voxel < count; ++voxel) {
    Vector<Dim> site;
    std::ptrdiff_t rest = voxel;
    for (int axis = 0; axis < Dim; ++axis) {
      site[axis] = static_cast<double>(rest % grid.size[axis]);
      rest /= grid.size[axis];
    }
    Vector<Dim> world = grid.to_world(site);
    for (int c = 0; c < Dim; ++c) world[c] += displacement.component(c)[voxel];
    Vector<Dim> index = image.grid.to_index(world);
    bool is_outside = false;
    for (int axis = 0; axis < Dim; ++axis) {
      const double last = image.grid.size[axis] - 1;
      // Half a voxel around the outermost centres still belongs to the image.
      is_outside = is_outside || !(index[axis] >= -0.5 && index[axis] <= last + 0.5);
      // Written so that a coordinate that is not a number becomes 0.
      index[axis] = index[axis] > 0 ? std::min(index[axis], last) : 0;
    }
    warped.samples[voxel] = is_outside && outside ? *outside : static_cast<float>(at(index));
  }
  return warped;
}

}  // namespace

std::string to_string(Interpolation interpolation) {
  switch (interpolation) {
    case Interpolation::Linear:
      return "linear";
    case Interpolation::Nearest:
      return "nearest";
    case Interpolation::BSpline:
      return "bspline";
  }
  return "unknown";
}

Interpolation parse_interpolation(std::string_view text) {
  for (Interpolation candidate : {Interpolation::Linear, Interpolation::Nearest, Interpolation::BSpline})
    if (to_string(candidate) == text) return candidate;
  throw InvalidInput("interpolation '" + std::string(text) + "' is not known; choose one of linear, nearest, bspline.");
}

template <int Dim>
Volume<Dim> warp_image(const Volume<Dim>& image, const VectorVolume<Dim>& displacement, const WarpOptions& options) {
  switch (options.interpolation) {
    case Interpolation::Linear:
      return warp_with(image, displacement, options.outside,
                       [&image](const Vector<Dim>& index) { return linear_at(image, index); });
    case Interpolation::Nearest:
      return warp_with(image, displacement, options.outside,
                       [&image](const Vector<Dim>& index) { return nearest_at(image, index); });
    case Interpolation::BSpline:
      break;
  }
  return warp_with(image, displacement, options.outside, CubicSpline<Dim>(image));
}

template Volume<2> warp_image(const Volume<2>&, const VectorVolume<2>&, const WarpOptions&);
template Volume<3> warp_image(const Volume<3>&, const VectorVolume<3>&, const WarpOptions&);

}  // namespace saltus
