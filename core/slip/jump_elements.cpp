#include "core/slip/jump_elements.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// sigma / mass 2 k0'(0+), with the sigma of the sum; 0 for kernels that are smooth there.
double jump_of_unit(const KernelProfile& k0, double sigma) {
  constexpr double near = 1e-4;
  const double fall = 1 - k0.value(near * k0.width());  // quadratic in `near` where k0 is smooth
  return fall > 0.1 * near ? -sigma / k0.mass() * 2 * fall / (near * k0.width()) : 0;
}

constexpr double kLeastShare = 1e-3;  // of the largest momentum of a field

template <int Dim, class T>
void add_faces(const MomentumScale<Dim, T>& scale, const T* field, int axis, double unit,
               std::vector<JumpElement<Dim>>& elements) {
  const Lattice<Dim>& lattice = scale.lattice();
  const auto strength_at = [&](std::size_t site) {
    Vector<Dim> strength;
    for (int a = 0; a < Dim; ++a) strength[a] = unit * static_cast<double>(field[Dim * site + a]);
    return strength;
  };
  double largest = 0;
  for (std::size_t site = 0; site < lattice.sites(); ++site) largest = std::max(largest, strength_at(site).norm());
  const auto visit_elements = [&](const auto& visit) {
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        const Vector<Dim> strength = strength_at(site);
        // Beyond the last sample there is no face, whatever stands there.
        if (index[axis] + 1 < lattice.size[axis] && strength.norm() > kLeastShare * largest) visit(index, strength);
      });
  };
  // Where all momenta take part they are most of what is held at the end: no larger than they have to be.
  std::size_t count = 0;
  visit_elements([&](const Index<Dim>&, const Vector<Dim>&) { ++count; });
  elements.reserve(count);
  const Vector<Dim> normal = Vector<Dim>::Unit(axis);
  Vector<Dim> first, step;  // of the faces
  for (int a = 0; a < Dim; ++a) {
    step[a] = lattice.spacing[a];
    first[a] = lattice.offset[a] + 0.5 * normal[a] * step[a];
  }
  visit_elements([&](const Index<Dim>& index, const Vector<Dim>& strength) {
    Vector<Dim> at = first;
    for (int a = 0; a < Dim; ++a) at[a] += index[a] * step[a];
    elements.push_back({at, normal, strength});
  });
}

template <int Dim, class T>
void add_oriented(const OrientedMomenta<Dim, T>& oriented, const MomentumPointers<T>& momenta,
                  std::vector<JumpElement<Dim>>& elements) {
  using Oriented = OrientedMomenta<Dim, T>;
  const OrientedOptions<Dim>& options = oriented.options();
  const double unit = -6 / options.normal_width_mm() * options.weight * options.lattice.cell_volume();
  std::vector<T> corners;
  oriented.place(*momenta.elements, corners);
  for (std::size_t e = 0; e < momenta.elements->size(); ++e) {
    const auto place = Oriented::placement(corners.data() + Oriented::kCornerValues * e);
    const Matrix<Dim> axes = place.axes.template cast<double>();
    Vector<Dim> strength = Vector<Dim>::Zero();
    for (int j = 1; j < Dim; ++j)
      strength +=
          unit * static_cast<double>(momenta.oriented[Oriented::kComponents * e + j - 1]) * axes.row(j).transpose();
    if (strength.squaredNorm() > 0)
      elements.push_back({place.at.template cast<double>(), axes.row(0).transpose(), strength});
  }
}

}  // namespace

template <int Dim, class T>
std::vector<JumpElements<Dim>> jump_elements(const MomentumScale<Dim, T>& scale, const MomentumPointers<T>& momenta) {
  std::vector<JumpElements<Dim>> found;
  const KernelSum& kernel = scale.options().kernel;
  const double factor = scale.options().first_weight * scale.lattice().cell_volume();
  double unit = 0;
  std::vector<JumpSpread> spreads;
  for (const KernelComponent& component : kernel.components()) {
    const double part = factor * component.weight * jump_of_unit(*component.profile, kernel.width());
    if (part != 0) spreads.push_back({component.profile->width(), part});
    unit += part;
  }
  for (JumpSpread& spread : spreads) spread.share /= unit;  // all of one sign
  if (unit != 0 && momenta.first)
    for (int axis = 0; axis < Dim; ++axis) {
      found.push_back({scale.lattice(), spreads, {}, axis});
      add_faces(scale, momenta.first + static_cast<std::size_t>(axis) * scale.field_size(), axis, unit,
                found.back().list);
    }
  if (scale.oriented() && momenta.elements && !momenta.elements->empty()) {
    found.push_back({scale.lattice(), {{scale.oriented()->options().width_mm, 1}}, {}});
    add_oriented(*scale.oriented(), momenta, found.back().list);
  }
  std::erase_if(found, [](const JumpElements<Dim>& elements) { return elements.list.empty(); });
  return found;
}

template <int Dim>
double JumpElements<Dim>::widest_mm() const {
  double widest = 0;
  for (const JumpSpread& spread : spreads) widest = std::max(widest, spread.width_mm);
  return widest;
}

template struct JumpElements<2>;
template struct JumpElements<3>;

#define SALTUS_JUMP_ELEMENTS(DIM, T) \
  template std::vector<JumpElements<DIM>> jump_elements(const MomentumScale<DIM, T>&, const MomentumPointers<T>&);
SALTUS_JUMP_ELEMENTS(2, float)
SALTUS_JUMP_ELEMENTS(3, float)
SALTUS_JUMP_ELEMENTS(2, double)
SALTUS_JUMP_ELEMENTS(3, double)
#undef SALTUS_JUMP_ELEMENTS

}  // namespace saltus
