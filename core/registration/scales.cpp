#include "core/registration/scales.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
Lattice<Dim> level_lattice(const Lattice<Dim>& image, int level) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  return level == 0 ? image : coarsened(image, std::ldexp(reference, level));
}

template <int Dim>
RegistrationOptions resolved(const RegistrationOptions& options, const Lattice<Dim>& image) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  double largest = 0;
  for (int axis = 0; axis < Dim; ++axis)
    largest = std::max(largest, image.size[axis] * image.spacing[axis] / reference);
  return resolved(options, Dim, largest);
}

template <int Dim, class T>
std::vector<PlacedScale<Dim, T>> make_scales(const Lattice<Dim>& image, const RegistrationOptions& options) {
  const RegistrationOptions::Momenta& momenta = options.momenta;
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  const bool gaussian = options.model == Model::Gaussian || options.model == Model::Sliding;
  const auto is_at = [](int q, int finest, int count) { return q >= finest && q < finest + count; };
  // Order 1 goes no coarser than order 0: what is smooth is order 0's part.
  const int coarsest = momenta.finest_scale + momenta.scales - 1;
  std::vector<PlacedScale<Dim, T>> scales;
  for (int q = std::max(coarsest, momenta.first_order_finest_scale); q >= 0; --q) {
    const bool zeroth = is_at(q, momenta.finest_scale, momenta.scales);
    const bool first = is_at(q, momenta.first_order_finest_scale, momenta.first_order_scales) &&
                       q <= std::max(coarsest, momenta.first_order_finest_scale);
    const double width = std::ldexp(momenta.width_voxels * reference, q);
    const auto place = [&](Orders orders, std::unique_ptr<KernelProfile> kernel) {
      MomentumScaleOptions<Dim> made;
      made.kernel = std::move(kernel);
      made.lattice = level_lattice(image, q);
      made.orders = orders;
      made.zeroth_weight = 1 / (momenta.regularisation);
      made.first_weight = 1 / momenta.first_order_regularisation;
      scales.push_back({q, std::make_unique<MomentumScale<Dim, T>>(made)});
    };
    // Both orders share a lattice sweep when they share the kernel.
    if (zeroth && first && !gaussian) {
      place(Orders::ZerothAndFirst, make_wendland_profile(width));
      continue;
    }
    if (zeroth) place(Orders::Zeroth, gaussian ? make_gaussian_profile(width) : make_wendland_profile(width));
    if (first) place(Orders::First, make_wendland_profile(width));
  }
  return scales;
}

template RegistrationOptions resolved(const RegistrationOptions&, const Lattice<2>&);
template RegistrationOptions resolved(const RegistrationOptions&, const Lattice<3>&);
template Lattice<2> level_lattice(const Lattice<2>&, int);
template Lattice<3> level_lattice(const Lattice<3>&, int);
template std::vector<PlacedScale<2, float>> make_scales(const Lattice<2>&, const RegistrationOptions&);
template std::vector<PlacedScale<3, float>> make_scales(const Lattice<3>&, const RegistrationOptions&);
template std::vector<PlacedScale<2, double>> make_scales(const Lattice<2>&, const RegistrationOptions&);
template std::vector<PlacedScale<3, double>> make_scales(const Lattice<3>&, const RegistrationOptions&);

}  // namespace saltus
