#include "core/phantom/make_phantom.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/phantom/planar_scene.h"
#include "core/phantom/scene.h"
#include "core/phantom/smooth_scene.h"
#include "core/phantom/thorax_scene.h"
#include "core/support/errors.h"
#include "core/support/random.h"

namespace saltus {
namespace {

template <int Dim>
Vector<Dim> voxel_centre(const ImageGrid<Dim>& grid, std::ptrdiff_t voxel) {
  Vector<Dim> index;
  for (int axis = 0; axis < Dim; ++axis) {
    index[axis] = static_cast<double>(voxel % grid.size[axis]);
    voxel /= grid.size[axis];
  }
  return grid.to_world(index);
}

template <int Dim>
void add_noise(Volume<Dim>& image, double sd, std::uint64_t seed, std::int64_t stream) {
  if (sd == 0) return;
  const auto count = static_cast<std::ptrdiff_t>(image.samples.size());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t voxel = 0; voxel < count; ++voxel)
    image.samples[voxel] += static_cast<float>(sd * normal_random(seed, {stream, voxel}));
}

template <int Dim>
void sample_scene(const Scene<Dim>& scene, Phantom<Dim>& phantom) {
  const ImageGrid<Dim>& grid = phantom.fixed.grid;
  const auto count = static_cast<std::ptrdiff_t>(grid.voxels());
  const double near_mm = 3 * grid.spacing.minCoeff();
#pragma omp parallel for schedule(dynamic, 4096)
  for (std::ptrdiff_t voxel = 0; voxel < count; ++voxel) {
    const Vector<Dim> x = voxel_centre(grid, voxel);
    phantom.fixed.samples[voxel] = static_cast<float>(scene.fixed(x));
    phantom.moving.samples[voxel] = static_cast<float>(scene.moving(x));
    phantom.fixed_labels.samples[voxel] = static_cast<float>(scene.fixed_label(x));
    phantom.moving_labels.samples[voxel] = static_cast<float>(scene.moving_label(x));
    const Vector<Dim> forward = scene.to_moving(x) - x;
    const Vector<Dim> backward = scene.to_fixed(x) - x;
    for (int axis = 0; axis < Dim; ++axis) {
      phantom.displacement.component(axis)[voxel] = static_cast<float>(forward[axis]);
      phantom.inverse_displacement.component(axis)[voxel] = static_cast<float>(backward[axis]);
    }
    const double distance = scene.interface_distance(x);
    phantom.masks.inside.samples[voxel] = distance < 0;
    phantom.masks.outside.samples[voxel] = !(distance < 0);
    phantom.masks.near.samples[voxel] = std::abs(distance) <= near_mm;
    phantom.masks.valid.samples[voxel] = scene.is_valid(x);
  }
}

template <int Dim>
double largest_displacement(const Phantom<Dim>& phantom) {
  double largest = 0;
  for (std::size_t voxel = 0; voxel < phantom.fixed.samples.size(); ++voxel) {
    if (phantom.masks.valid.samples[voxel] == 0) continue;
    double squared = 0;
    for (int axis = 0; axis < Dim; ++axis) {
      const double u = phantom.displacement.component(axis)[voxel];
      squared += u * u;
    }
    largest = std::max(largest, squared);
  }
  return std::sqrt(largest);
}

}  // namespace

template <int Dim>
ImageGrid<Dim> phantom_grid(const PhantomOptions& options) {
  ImageGrid<Dim> grid;
  for (int axis = 0; axis < Dim; ++axis) {
    grid.size[axis] = options.size[axis];
    grid.spacing[axis] = options.spacing[axis];
    if (options.kind == PhantomKind::Thorax) grid.origin[axis] = -0.5 * (grid.size[axis] - 1) * grid.spacing[axis];
  }
  return grid;
}

template <int Dim>
std::unique_ptr<Scene<Dim>> make_scene(const PhantomOptions& options) {
  if (const auto found = problems(options); !found.empty()) throw InvalidInput(found.front());
  if (options.dimension != Dim)
    throw InvalidInput("dimension is " + std::to_string(options.dimension) + "; a " + std::to_string(Dim) +
                       "-D phantom was asked for.");
  const ImageGrid<Dim> grid = phantom_grid<Dim>(options);
  switch (options.kind) {
    case PhantomKind::Rectangle:
    case PhantomKind::Wheel:
    case PhantomKind::Slip:
      return std::make_unique<PlanarScene<Dim>>(options, grid);
    case PhantomKind::Smooth:
      return std::make_unique<SmoothScene<Dim>>(options, grid);
    case PhantomKind::Thorax:
      if constexpr (Dim == 3) return std::make_unique<ThoraxScene>(options, grid);
  }
  throw InvalidInput("kind is not a phantom; choose rectangle, wheel, slip, thorax or smooth.");
}

template <int Dim>
Phantom<Dim> make_phantom(const PhantomOptions& options) {
  const auto scene = make_scene<Dim>(options);
  return sample_phantom(*scene, phantom_grid<Dim>(options), options.noise, options.seed);
}

template <int Dim>
Phantom<Dim> sample_phantom(const Scene<Dim>& scene, const ImageGrid<Dim>& grid, double noise, std::uint64_t seed) {
  const Volume<Dim> blank(grid);
  Phantom<Dim> phantom{.fixed = blank,
                       .moving = blank,
                       .displacement = VectorVolume<Dim>(grid),
                       .inverse_displacement = VectorVolume<Dim>(grid),
                       .masks = {blank, blank, blank, blank},
                       .fixed_labels = blank,
                       .moving_labels = blank,
                       .fixed_points = {},
                       .moving_points = {}};
  sample_scene(scene, phantom);
  phantom.largest_displacement_mm = largest_displacement(phantom);

  const auto [low, high] = std::minmax_element(phantom.moving.samples.begin(), phantom.moving.samples.end());
  phantom.noise_sd = noise * (*high - *low);
  add_noise(phantom.fixed, phantom.noise_sd, seed, 101);
  add_noise(phantom.moving, phantom.noise_sd, seed, 102);

  phantom.moving_points = scene.moving_landmarks();
  for (const Vector<Dim>& point : phantom.moving_points) phantom.fixed_points.push_back(scene.to_fixed(point));
  return phantom;
}

#define SALTUS_INSTANTIATE(Dim)                                           \
  template ImageGrid<Dim> phantom_grid(const PhantomOptions&);            \
  template std::unique_ptr<Scene<Dim>> make_scene(const PhantomOptions&); \
  template Phantom<Dim> make_phantom(const PhantomOptions&);              \
  template Phantom<Dim> sample_phantom(const Scene<Dim>&, const ImageGrid<Dim>&, double, std::uint64_t);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
