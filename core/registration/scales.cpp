#include "core/registration/scales.h"

#include "core/momenta/directional_momentum.h"
#include "core/momenta/spread_normals.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
Lattice<Dim> level_lattice(const Lattice<Dim>& image, int level) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  return level == 0 ? image : coarsened(image, std::ldexp(reference, level));
}

template <int Dim>
RegistrationOptions resolved(const RegistrationOptions& options, const Lattice<Dim>& image, double noise) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  double largest = 0;
  for (int axis = 0; axis < Dim; ++axis)
    largest = std::max(largest, image.size[axis] * image.spacing[axis] / reference);
  return resolved(options, Dim, reference, largest, noise);
}

namespace {

/// The kernel of a scale whose voxel is `voxel_mm`.
KernelSum kernel_of(const RegistrationOptions::Momenta& momenta, Orders orders, double voxel_mm,
                    std::unique_ptr<KernelProfile> (*make)(double)) {
  const auto& widths = orders == Orders::First ? momenta.first_order_kernel_widths : momenta.kernel_widths;
  if (widths.empty()) return make(momenta.width_voxels * voxel_mm);
  std::vector<KernelComponent> components;
  for (const KernelWidth& width : widths) components.push_back({width.weight, make(width.voxels * voxel_mm)});
  return KernelSum(std::move(components));
}

}  // namespace

template <int Dim, class T>
std::vector<PlacedScale<Dim, T>> make_scales(const Lattice<Dim>& image, const RegistrationOptions& options,
                                             const Field<double>& directions) {
  const RegistrationOptions::Momenta& momenta = options.momenta;
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  const bool gaussian =
      options.model != Model::Wendland && options.model != Model::Wendland1 && options.model != Model::Directional;
  const auto is_at = [](int q, int finest, int count) { return q >= finest && q < finest + count; };
  // Order 1 goes no coarser than order 0: what is smooth is order 0's part.
  const int coarsest = momenta.finest_scale + momenta.scales - 1;
  std::vector<PlacedScale<Dim, T>> scales;
  for (int q = std::max(coarsest, momenta.first_order_finest_scale); q >= 0; --q) {
    const bool zeroth = is_at(q, momenta.finest_scale, momenta.scales);
    const bool first = is_at(q, momenta.first_order_finest_scale, momenta.first_order_scales) &&
                       q <= std::max(coarsest, momenta.first_order_finest_scale);
    const auto place = [&](Orders orders, std::unique_ptr<KernelProfile> (*make)(double)) {
      MomentumScaleOptions<Dim> made;
      made.kernel = kernel_of(momenta, orders, std::ldexp(reference, q), make);
      made.lattice = level_lattice(image, orders == Orders::Zeroth ? q + options.flow.coarsening : q);
      made.orders = orders;
      if (has_first(orders) && options.model == Model::Directional)
        made.direction = nearest_directions<Dim>(image, directions, made.lattice);
      if (has_first(orders)) made.normals = spread_normals<Dim>(momenta.orientations);
      made.zeroth_weight = 1 / momenta.regularisation;
      made.first_weight = 1 / momenta.first_order_regularisation;
      scales.push_back({q, std::make_unique<MomentumScale<Dim, T>>(made)});
    };
    // Both orders share a lattice sweep when they share the kernel.
    if (zeroth && first && !gaussian) {
      place(Orders::ZerothAndFirst, make_wendland_profile);
      continue;
    }
    if (zeroth) place(Orders::Zeroth, gaussian ? make_gaussian_profile : make_wendland_profile);
    if (first) place(Orders::First, make_wendland_profile);
  }
  return scales;
}

template RegistrationOptions resolved(const RegistrationOptions&, const Lattice<2>&, double);
template RegistrationOptions resolved(const RegistrationOptions&, const Lattice<3>&, double);
template Lattice<2> level_lattice(const Lattice<2>&, int);
template Lattice<3> level_lattice(const Lattice<3>&, int);
template std::vector<PlacedScale<2, float>> make_scales(const Lattice<2>&, const RegistrationOptions&,
                                                        const Field<double>&);
template std::vector<PlacedScale<3, float>> make_scales(const Lattice<3>&, const RegistrationOptions&,
                                                        const Field<double>&);
template std::vector<PlacedScale<2, double>> make_scales(const Lattice<2>&, const RegistrationOptions&,
                                                         const Field<double>&);
template std::vector<PlacedScale<3, double>> make_scales(const Lattice<3>&, const RegistrationOptions&,
                                                         const Field<double>&);

}  // namespace saltus
