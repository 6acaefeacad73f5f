#include "core/evaluation/field_sampling.h"

#include "core/grid/interpolation.h"

namespace saltus {

template <int Dim>
Vector<Dim> displacement_at(const VectorVolume<Dim>& field, const Vector<Dim>& world) {
  const Vector<Dim> index = field.grid.to_index(world);
  std::array<double, Dim> at;
  for (int axis = 0; axis < Dim; ++axis) at[axis] = index[axis];
  const LinearCell<Dim, double> cell(Lattice<Dim>{.size = field.grid.size}, at);
  Vector<Dim> sum = Vector<Dim>::Zero();
  for (int bits = 0; bits < cell.corners; ++bits) {
    // A corner without weight may hold anything, even a value that is not finite.
    const double weight = cell.weight(bits);
    if (weight == 0) continue;
    for (int c = 0; c < Dim; ++c) sum[c] += weight * field.component(c)[cell.corner(bits)];
  }
  return sum;
}

template <int Dim>
std::vector<Vector<Dim>> transform_points(const VectorVolume<Dim>& field, const std::vector<Vector<Dim>>& points) {
  std::vector<Vector<Dim>> moved;
  moved.reserve(points.size());
  for (const Vector<Dim>& point : points) moved.push_back(point + displacement_at(field, point));
  return moved;
}

#define SALTUS_INSTANTIATE(Dim)                                                       \
  template Vector<Dim> displacement_at(const VectorVolume<Dim>&, const Vector<Dim>&); \
  template std::vector<Vector<Dim>> transform_points(const VectorVolume<Dim>&, const std::vector<Vector<Dim>>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
