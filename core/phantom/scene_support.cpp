#include "core/phantom/scene_support.h"

#include <cmath>

#include "core/support/random.h"

namespace saltus {

template <int Dim>
bool is_inside(const ImageGrid<Dim>& grid, const Vector<Dim>& world, double inset) {
  const Vector<Dim> index = grid.to_index(world);
  for (int axis = 0; axis < Dim; ++axis)
    if (!(index[axis] >= inset && index[axis] <= grid.size[axis] - 1 - inset)) return false;
  return true;
}

template <int Dim>
std::vector<Vector<Dim>> scattered_landmarks(const Scene<Dim>& scene, const ImageGrid<Dim>& grid, std::uint64_t seed) {
  constexpr int kSpread = 160;
  constexpr int kNearInterface = 40;
  constexpr double kNearMm = 3;
  RandomSequence random(seed, 17);
  std::vector<Vector<Dim>> points;
  int near = 0;
  for (int draw = 0; draw < 20000 && (points.size() < kSpread || near < kNearInterface); ++draw) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = random.uniform(0, grid.size[axis] - 1);
    const Vector<Dim> moving = grid.to_world(index);
    const Vector<Dim> fixed = scene.to_fixed(moving);
    if (!scene.is_valid(fixed)) continue;
    const bool is_near = std::abs(scene.interface_distance(fixed)) <= kNearMm;
    if (is_near ? near >= kNearInterface : points.size() >= kSpread) continue;
    near += is_near;
    points.push_back(moving);
  }
  return points;
}

template <int Dim>
std::vector<typename BlobTexture<Dim>::Scale> grey_texture_scales() {
  return {{34, 70}, {14, 60}, {6, 50}};
}

#define SALTUS_INSTANTIATE(Dim)                                                                                   \
  template bool is_inside(const ImageGrid<Dim>&, const Vector<Dim>&, double);                                     \
  template std::vector<Vector<Dim>> scattered_landmarks(const Scene<Dim>&, const ImageGrid<Dim>&, std::uint64_t); \
  template std::vector<BlobTexture<Dim>::Scale> grey_texture_scales<Dim>();
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
