#include "core/flow/divergence_penalty.h"

#include "core/support/planes.h"

#include <vector>

namespace saltus {

template <int Dim, class T>
double add_divergence_penalty(const Lattice<Dim>& lattice, const T* velocity, double factor, T* dual) {
  constexpr int corners = 1 << Dim;
  std::array<std::size_t, corners> step{};  // from the lowest corner of a cell, in sites
  std::array<std::array<T, Dim>, corners> slope;
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    for (int bits = 0; bits < corners; ++bits) {
      const bool upper = bits >> axis & 1;
      if (upper && lattice.size[axis] > 1) step[bits] += stride;
      // Mean over the cell's edges along this axis; 0 on an axis of one sample.
      const double difference = lattice.size[axis] > 1 ? 2.0 / (corners * lattice.spacing[axis]) : 0.0;
      slope[bits][axis] = static_cast<T>(upper ? difference : -difference);
    }
    stride *= static_cast<std::size_t>(lattice.size[axis]);
  }
  Lattice<Dim> cells = lattice;
  for (int& extent : cells.size) extent = extent > 1 ? extent - 1 : 1;
  const T weight = static_cast<T>(factor * lattice.cell_volume());
  std::vector<double> energy(static_cast<std::size_t>(cells.size[Dim - 1]), 0.0);
  for_planes_apart<2>(cells.size[Dim - 1], [&](int slab) {
    double sum = 0;
    visit_slab<Dim>(cells, slab, [&](const Index<Dim>& index, std::size_t) {
      std::size_t site = 0, along = 1;
      for (int axis = 0; axis < Dim; ++axis) {
        site += along * static_cast<std::size_t>(index[axis]);
        along *= static_cast<std::size_t>(lattice.size[axis]);
      }
      T divergence = 0;
      for (int bits = 0; bits < corners; ++bits)
        for (int axis = 0; axis < Dim; ++axis)
          divergence += slope[bits][axis] * velocity[Dim * (site + step[bits]) + axis];
      sum += static_cast<double>(divergence) * divergence;
      const T pull = weight * divergence;
      for (int bits = 0; bits < corners; ++bits)
        for (int axis = 0; axis < Dim; ++axis) dual[Dim * (site + step[bits]) + axis] += slope[bits][axis] * pull;
    });
    energy[static_cast<std::size_t>(slab)] = sum;
  });
  double total = 0;
  for (double sum : energy) total += sum;
  return 0.5 * factor * lattice.cell_volume() * total;
}

template double add_divergence_penalty<2, float>(const Lattice<2>&, const float*, double, float*);
template double add_divergence_penalty<3, float>(const Lattice<3>&, const float*, double, float*);
template double add_divergence_penalty<2, double>(const Lattice<2>&, const double*, double, double*);
template double add_divergence_penalty<3, double>(const Lattice<3>&, const double*, double, double*);

}  // namespace saltus
