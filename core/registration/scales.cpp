#include "core/registration/scales.h"

#include "core/grid/noise.h"
#include "core/momenta/directional_momentum.h"
#include "core/momenta/spread_normals.h"
#include "core/registration/narrower_scale.h"
#include "core/registration/slip_criteria.h"
#include "core/similarity/similarity.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace saltus {
namespace {

/// How much the narrower width of order 0 counts beside the wider one without noise, and the noise at which it counts
/// half of that; measured, core/measurements.md, "Widths".
struct FineWidth {
  double weight, half_at;
};
template <int Dim>
constexpr FineWidth kFineWidth = Dim == 3 ? FineWidth{2, 0.008} : FineWidth{0.7, 0.015};

/// Of full_contrast: an image may be all but blank, and something has to hold momenta back.
constexpr double kLeastCounted = 0.25;
/// What tolerances count at least, and those of rounds that others follow: core/measurements.md, "Sparsity".
constexpr double kLeastTolerance = 0.56, kLeastRoundTolerance = 0.875;

/// As a report may show it.
double in_few_digits(double value) {
  if (!(value > 0)) return value;
  const double unit = std::pow(10.0, std::floor(std::log10(value)) - 3);
  return std::round(value / unit) * unit;
}

/// Voxels that 3-D images are taken at every second of.
bool is_fine(double reference_mm) { return 2 * reference_mm <= 3; }

/// What a displacement has at least where order 0 needs narrow widths, see simple_shear; measured,
/// core/measurements.md, "Widths". In 3-D 4.5 is that of chance which keeps volumes, and what breathes smoothly has up
/// to 4.7.
double sharp_shear(int dimension, SimilarityType similarity) {
  return dimension == 3 && similarity == SimilarityType::Lncc ? 4.8 : 0;
}

/// How many times the lambda of sliding auto has, whose momenta of oblique interfaces are oriented;
/// core/measurements.md, "Sparsity". A window of lncc holds fewer samples in 2-D, and more noise. With mi, ngf and mind
/// more elements than an interface has sites would take part ("mi, ngf and mind").
double sparsity_share(int dimension, SimilarityType similarity, Preset preset) {
  if (preset == Preset::Fast) return 1;
  const bool is_flat = dimension == 2, is_balanced = preset == Preset::Balanced;
  switch (similarity) {
    case SimilarityType::Ssd:
      return 1;
    case SimilarityType::Ncc:
      return 2;
    case SimilarityType::Lncc:
      return is_flat ? 2 : 0.5;
    case SimilarityType::Mi:
      return is_flat ? (is_balanced ? 2 : 1) : 5;
    case SimilarityType::Ngf:
      return is_flat && !is_balanced ? 1 : 2;
    case SimilarityType::Mind:
      return is_flat ? (is_balanced ? 3 : 1) : 1.5;
  }
  return 1;
}

/// With auto and all but ssd: what the next round makes its weights from is seen after a few iterations in 3-D, but
/// with ncc; core/measurements.md, "Sparsity". In 2-D accurate, with mi, loses by it ("Finer images").
double usual_round_tolerance(int dimension, SimilarityType similarity, Preset preset) {
  if (dimension == 2 && preset == Preset::Accurate) return 0;
  return dimension == 3 && similarity != SimilarityType::Ncc ? 0.5 : 0.1;
}

/// Pairs that L-BFGS keeps; measured, core/measurements.md, "Pairs of L-BFGS".
int usual_history(int dimension, Model model, SimilarityType similarity) {
  // Where every site has first orders a pair takes more than a third of what images and map do; two are as good.
  if (dimension == 3) return model == Model::Wendland1 ? 2 : 4;
  if (similarity != SimilarityType::Ssd) return 6;
  return model == Model::Auto ? 32 : model == Model::Sliding ? 20 : 6;  // of auto, which keeps them from round to round
}

/// Elements of a kernel that is narrow along the normal leave nothing beside an interface that order 0 would have to
/// take back, and cost less, and such elements do along the axes as well. Measured with `balanced` where 3-D images end
/// at half of their resolution, core/measurements.md, "Slip at any orientation".
bool are_elements_narrow(int dimension, SimilarityType similarity) {
  return dimension == 3 && similarity != SimilarityType::Ssd;
}
constexpr double kNarrowElement = 0.5;  // of the first orders' width
constexpr double kLeastElement = 0.35;

/// Whether elements do all that first orders do, along the axes as well; core/measurements.md, "Alone", and in 2-D
/// "`mi`, `ngf` and `mind`".
bool are_elements_alone(int dimension, SimilarityType similarity) {
  if (dimension == 3) return similarity != SimilarityType::Ssd;
  return similarity == SimilarityType::Mi || similarity == SimilarityType::Ngf || similarity == SimilarityType::Mind;
}

/// Whether first orders, and the flow, stay as coarse as balanced has them where accurate sees finer images. With ssd
/// they take the place of order 0 on the finest scale; core/measurements.md, "Finer images".
bool keeps_first_orders_coarse(const RegistrationOptions& options) {
  return options.model == Model::Auto && options.similarity != SimilarityType::Ssd;
}

/// Both orders at all sites of an image of full resolution take 800 bytes a voxel. At every second one they take a
/// third to a half of that and of the time; errors are less but beside large jumps (core/measurements.md, "Memory").
bool are_momenta_coarse(int dimension, Model model) { return dimension == 3 && model == Model::Wendland1; }

}  // namespace

template <int Dim>
Lattice<Dim> level_lattice(const Lattice<Dim>& image, int level) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  return level == 0 ? image : coarsened(image, std::ldexp(reference, level));
}

template <int Dim>
Lattice<Dim> moving_level_lattice(const Lattice<Dim>& fixed, const Lattice<Dim>& moving, int level) {
  const double reference = *std::min_element(fixed.spacing.begin(), fixed.spacing.end());
  return level == 0 ? moving : coarsened(moving, std::ldexp(reference, level));
}

namespace {

/// The finest level of a preset; voxels of 3 to 4 mm still show vessels and the surfaces of organs, wider ones do not.
int finest_level(int dimension, Preset preset, double reference_mm) {
  if (dimension == 2) return 0;
  switch (preset) {
    case Preset::Fast:
      return 4 * reference_mm <= 4 ? 2 : 2 * reference_mm <= 4 ? 1 : 0;
    case Preset::Balanced:
      return is_fine(reference_mm) ? 1 : 0;
    case Preset::Accurate:
      return 0;
  }
  return 0;
}

/// Halvings until the longest axis has fewer than 32 samples, one level at least.
template <int Dim>
int usual_levels(const Lattice<Dim>& image, double reference_mm) {
  double largest_axis = 0;  // in reference voxels
  for (int axis = 0; axis < Dim; ++axis)
    largest_axis = std::max(largest_axis, image.size[axis] * image.spacing[axis] / reference_mm);
  int levels = 1;
  while (levels < 8 && largest_axis / (1 << (levels - 1)) >= 32) ++levels;
  return levels;
}

/// `asked`: before anything was resolved.
void resolve_scales(int dimension, double reference_mm, const RegistrationOptions& asked, RegistrationOptions& o) {
  const int finest = o.pyramid.finest_level;
  const bool is_coarse = are_momenta_coarse(dimension, o.model);
  // Images that accurate takes finer than balanced are for seeing more, not for narrower kernels.
  const bool sees_finer =
      dimension == 3 && o.preset == Preset::Accurate && asked.pyramid.finest_level < 0 && is_fine(reference_mm);
  const bool is_given = asked.momenta.finest_scale >= 0;
  if (o.momenta.finer_shear < 0 && (sees_finer || is_given)) o.momenta.finer_shear = 0;
  if (o.momenta.finest_scale < 0) {
    int scale = finest - 1 - o.momenta.finest_scale;
    // A Gaussian of so many pixels holds far fewer samples than one of as many voxels, and follows their noise.
    if ((dimension == 2 || sees_finer) && is_zeroth_gaussian(o.model) && o.similarity != SimilarityType::Ssd)
      scale = std::max(scale, 1);
    if (is_coarse) scale = std::max(scale, 1);
    o.momenta.finest_scale = std::min(scale, o.pyramid.levels - 1);
  }
  if (o.momenta.first_order_finest_scale < 0) {
    const bool stays_coarse = is_coarse || (sees_finer && keeps_first_orders_coarse(o));
    o.momenta.first_order_finest_scale =
        stays_coarse ? std::clamp(1, finest, std::max(finest, o.pyramid.levels - 1)) : finest;
  }
  if (o.similarity_parameters.lost_noise == 0)
    // On all levels, as it was measured with lncc and ngf; core/measurements.md, "Finer images".
    o.similarity_parameters.lost_noise = sees_finer && o.model == Model::Auto ? 0.003 : 0.0075;
  if (o.momenta.scales == 0) o.momenta.scales = std::max(1, o.pyramid.levels - o.momenta.finest_scale);
}

/// What was measured for each similarity and dimension.
void resolve_measured(int dimension, RegistrationOptions& o) {
  const RegistrationOptions usual = default_options(o.model, o.similarity, o.preset);
  const bool is_ssd = o.similarity == SimilarityType::Ssd, is_lncc = o.similarity == SimilarityType::Lncc;
  o.similarity_parameters.lncc_radius_voxels = lncc_radius_voxels(o.similarity_parameters, dimension);
  o.similarity_parameters.lncc_cell = lncc_cell(o.similarity_parameters, dimension);
  if (o.momenta.regularisation == 0)
    o.momenta.regularisation = is_ssd ? (dimension == 2 ? 3e-6 : 1e-6) : usual.momenta.regularisation;
  if (o.momenta.sparsity < 0)
    o.momenta.sparsity = o.model == Model::Auto
                             ? sparsity_share(dimension, o.similarity, o.preset) *
                                   default_options(Model::Sliding, o.similarity, o.preset).momenta.sparsity
                             : usual.momenta.sparsity;
  if (o.momenta.narrow_width_shear < 0) {
    const bool is_measured = o.momenta.kernel_widths.empty() && o.momenta.width_voxels == 0;
    o.momenta.narrow_width_shear = is_measured ? sharp_shear(dimension, o.similarity) : 0;
  }
  if (o.momenta.narrower_pull < 0) {
    const bool is_measured = o.momenta.kernel_widths.empty() && o.momenta.width_voxels == 0 && o.flow.coarsening == 1;
    o.momenta.narrower_pull = is_measured ? least_narrow_pull(dimension, o.similarity) : 0;
  }
  // No more was wanted at full resolution in the 3-D images that this was measured on (core/measurements.md, "Memory").
  if (o.momenta.most_active_share == 0)
    o.momenta.most_active_share = o.model == Model::Auto && dimension == 3 ? 0.75 : 1;
  if (o.optimisation.round_tolerance < 0)
    o.optimisation.round_tolerance = usual.optimisation.round_tolerance >= 0
                                         ? usual.optimisation.round_tolerance
                                         : usual_round_tolerance(dimension, o.similarity, o.preset);
  if (o.optimisation.history == 0) o.optimisation.history = usual_history(dimension, o.model, o.similarity);
  if (o.flow.divergence_weight < 0)
    o.flow.divergence_weight = is_lncc ? (dimension == 2 ? 1 : 0.6) : usual.flow.divergence_weight;
}

/// Of elements that are alone; core/measurements.md, "First weights from the velocity". In 2-D slips lose. A path that
/// is given is gone along.
int usual_shear_weights(int dimension, const RegistrationOptions& o) {
  const RegistrationOptions::Momenta &momenta = o.momenta,
                                     usual = default_options(o.model, o.similarity, o.preset).momenta;
  const bool is_measured = are_elements_narrow(dimension, o.similarity) && is_zeroth_gaussian(o.model) &&
                           has_oriented_alone(momenta) && momenta.first_order_waits && momenta.reweighted_rounds > 0;
  const bool is_given = momenta.sparsity_path != usual.sparsity_path || momenta.even_sparsity != usual.even_sparsity;
  if (!is_measured || is_given) return 0;
  return 2;
}

/// As far as these do not go with the contrast, see follow_contrast.
void resolve_elements(int dimension, RegistrationOptions& o) {
  if (o.momenta.orientations < 0) {
    // With the other evolutions they are worth little (core/measurements.md, "Slip at any orientation").
    const bool can = o.momenta.first_order_scales > 0 && o.model != Model::Directional && o.momenta.sparsity > 0 &&
                     o.flow.evolution == Evolution::Carried;
    o.momenta.orientations = can ? (dimension == 2 ? 8 : 9) : 0;
  }
  const bool is_narrow = are_elements_narrow(dimension, o.similarity);
  const bool is_alone = are_elements_alone(dimension, o.similarity);
  if (o.momenta.oblique_share < 0) o.momenta.oblique_share = is_alone ? 0 : 0.7;
  // Elements are where order 0 shows an interface before.
  if (o.momenta.oriented_alone < 0 && is_alone) o.momenta.oriented_alone = o.momenta.first_order_waits ? 2 : 1;
  if (o.momenta.oriented_sparsity == 0) o.momenta.oriented_sparsity = is_narrow ? 0.5 : 0.4;
  if (o.momenta.oriented_width == 0 && is_narrow) o.momenta.oriented_width = kNarrowElement;
  if (o.momenta.shear_weights < 0) o.momenta.shear_weights = usual_shear_weights(dimension, o);
}

/// `noise`: on the finest level.
template <int Dim>
void follow_noise(double noise, RegistrationOptions& o) {
  if (o.momenta.width_voxels == 0) {
    o.momenta.width_voxels = 6;
    if (is_zeroth_gaussian(o.model) && o.similarity != SimilarityType::Ssd && o.momenta.kernel_widths.empty()) {
      const FineWidth narrow = kFineWidth<Dim>;
      const double fine = narrow.weight / (1 + std::pow(noise / narrow.half_at, 2));
      o.momenta.kernel_widths = {{9, 1}};
      if (fine >= 0.01) o.momenta.kernel_widths.push_back({4, std::round(1000 * fine) / 1000});
    }
  }
  if (o.momenta.sparsity_noise > 0) {
    o.momenta.sparsity *= 1 + noise / o.momenta.sparsity_noise;
    o.momenta.sparsity_noise = 0;  // it has been followed
  }
}

/// With ssd, whose weights were measured on images of full contrast.
void follow_contrast(double contrast, double noise, RegistrationOptions& o) {
  if (!(o.momenta.full_contrast > 0) || o.similarity != SimilarityType::Ssd) return;
  // What noise hides in, ssd leaves over anyhow: the part of its weights that is due to noise stays.
  const double beside_noise = std::pow(noise / o.similarity_parameters.ssd_residual, 2);
  const auto share = [&](double without_noise) { return (without_noise + beside_noise) / (1 + beside_noise); };
  const double there_is = std::ldexp(contrast, o.pyramid.finest_level) / o.momenta.full_contrast;
  o.momenta.full_contrast = 0;  // it has been followed
  if (there_is >= 1) return;
  // What turns shows little of its interface then, and order 0, which has no fine scale, none of the rest.
  if (o.momenta.oriented_alone < 0) o.momenta.oriented_alone = 0;
  const double counted = std::max(there_is, kLeastCounted);
  o.momenta.sparsity = in_few_digits(o.momenta.sparsity * share(counted * counted));
  // So much less of the energy is the motion's: a round has to go on for longer before its momenta are worth weights.
  // Where rounds go on from the pairs of the one before, that is so for the first one of a level alone, which has none.
  RegistrationOptions::Optimisation& how = o.optimisation;
  const double of_motion = in_few_digits(how.round_tolerance * share(counted * counted));
  if (!how.keep_pairs) {
    how.round_tolerance = of_motion;
  } else {
    const double enough = in_few_digits(how.tolerance / std::sqrt(share(counted)));
    // All end a little later, and the last ones later still.
    how.tolerance = in_few_digits(how.tolerance * std::max(kLeastTolerance, share(counted)));
    how.round_tolerance = in_few_digits(how.round_tolerance * std::max(kLeastRoundTolerance, share(counted)));
    if (how.first_round_tolerance < 0)
      how.first_round_tolerance = std::min(how.round_tolerance, std::max(of_motion, enough));
  }
  if (o.momenta.regularisation_beside_first == 0)
    o.momenta.regularisation_beside_first = in_few_digits(o.momenta.regularisation * share(counted));
  // Order 0 that is held so little fills what is beside an interface by itself.
  if (o.momenta.oriented_width == 0) o.momenta.oriented_width = std::max(kLeastElement, in_few_digits(share(counted)));
}

}  // namespace

template <int Dim>
RegistrationOptions resolved(const RegistrationOptions& options, const Lattice<Dim>& image, const ImageTraits& traits) {
  const double reference_mm = *std::min_element(image.spacing.begin(), image.spacing.end());
  RegistrationOptions o = options;
  if (o.pyramid.finest_level < 0) {
    o.pyramid.finest_level = finest_level(Dim, o.preset, reference_mm);
    if (o.pyramid.levels > 0) o.pyramid.finest_level = std::min(o.pyramid.finest_level, o.pyramid.levels - 1);
  }
  if (o.pyramid.levels == 0) o.pyramid.levels = std::max(usual_levels(image, reference_mm), o.pyramid.finest_level + 1);
  resolve_scales(Dim, reference_mm, options, o);
  resolve_measured(Dim, o);
  resolve_elements(Dim, o);
  const double noise = noise_of_level(traits.noise, image, level_lattice(image, o.pyramid.finest_level));
  follow_noise<Dim>(noise, o);
  follow_contrast(traits.contrast, noise, o);
  if (o.momenta.oriented_width == 0) o.momenta.oriented_width = 1;
  if (o.momenta.oriented_alone < 0) o.momenta.oriented_alone = 1;
  resolve_slip_criteria(Dim, o);
  return o;
}

namespace {

/// With all widths of order 0 but the widest counting `share` of what they do.
RegistrationOptions::Momenta with_narrow_share(RegistrationOptions::Momenta momenta, double share) {
  const auto is_narrower = [](const KernelWidth& a, const KernelWidth& b) { return a.voxels < b.voxels; };
  const auto widest = std::max_element(momenta.kernel_widths.begin(), momenta.kernel_widths.end(), is_narrower);
  for (auto width = momenta.kernel_widths.begin(); width != momenta.kernel_widths.end(); ++width)
    if (width != widest) width->weight *= share;
  return momenta;
}

/// The kernel of a scale whose voxel is `voxel_mm`.
KernelSum kernel_of(const RegistrationOptions::Momenta& momenta, Orders orders, double voxel_mm,
                    std::unique_ptr<KernelProfile> (*make)(double)) {
  const auto& widths = orders == Orders::First ? momenta.first_order_kernel_widths : momenta.kernel_widths;
  if (widths.empty()) return make(momenta.width_voxels * voxel_mm);
  std::vector<KernelComponent> components;
  for (const KernelWidth& width : widths) components.push_back({width.weight, make(width.voxels * voxel_mm)});
  return KernelSum(std::move(components));
}

/// Both orders of a scale share a lattice sweep when they share the kernel.
bool shares_kernel(const RegistrationOptions& options, int q) {
  const RegistrationOptions::Momenta& m = options.momenta;
  return !is_zeroth_gaussian(options.model) && q >= m.finest_scale && q < m.finest_scale + m.scales;
}

}  // namespace

bool has_oriented_alone(const RegistrationOptions::Momenta& momenta) {
  return momenta.orientations > 0 && momenta.oriented_alone == 2;
}

template <int Dim>
double first_order_width(const Lattice<Dim>& image, const RegistrationOptions& options, int q) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  return kernel_of(options.momenta, shares_kernel(options, q) ? Orders::ZerothAndFirst : Orders::First,
                   std::ldexp(reference, q), make_wendland_profile)
      .width();
}

template <int Dim>
Lattice<Dim> flow_lattice_beside_first(const Lattice<Dim>& image, const RegistrationOptions& options, int level) {
  const int coarsest = level + options.flow.coarsening;
  return level_lattice(image, std::clamp(options.momenta.first_order_finest_scale, level, coarsest));
}

template <int Dim, class T>
std::vector<PlacedScale<Dim, T>> make_scales(const Lattice<Dim>& image, const RegistrationOptions& options,
                                             const Field<double>& directions, double narrow_share) {
  const RegistrationOptions::Momenta& momenta = options.momenta;
  if (!(momenta.regularisation > 0))
    throw InvalidInput(
        "regularisation is 0, which is to be chosen for an image; take the options that are resolved for it");
  if (momenta.orientations > 0 && !(momenta.oriented_width > 0 && momenta.oriented_sparsity > 0))
    throw InvalidInput(
        "oriented_width or oriented_sparsity is 0, which is to be chosen for an image; take the options that are "
        "resolved for it");
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  const bool gaussian = is_zeroth_gaussian(options.model);
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
      const bool is_finest_zeroth = has_zeroth(orders) && q == momenta.finest_scale;
      made.kernel = kernel_of(is_finest_zeroth ? with_narrow_share(momenta, narrow_share) : momenta, orders,
                              std::ldexp(reference, q), make);
      made.lattice = level_lattice(image, orders == Orders::Zeroth ? q + options.flow.coarsening : q);
      made.orders = orders;
      if (has_first(orders) && options.model == Model::Directional)
        made.direction = nearest_directions<Dim>(image, directions, made.lattice);
      if (has_first(orders)) made.normals = spread_normals<Dim>(momenta.orientations);
      if (gaussian && orders == Orders::First && has_oriented_alone(momenta)) made.orders = Orders::Oriented;
      made.oriented_spacing = kElementSpacing<Dim>;
      made.oriented_normal_share = momenta.oriented_width;
      made.zeroth_weight =
          1 / (momenta.regularisation * std::pow(momenta.coarser_regularisation, q - momenta.finest_scale));
      made.first_weight = 1 / momenta.first_order_regularisation;
      scales.push_back({q, std::make_unique<MomentumScale<Dim, T>>(made)});
    };
    if (zeroth && first && shares_kernel(options, q)) {
      place(Orders::ZerothAndFirst, make_wendland_profile);
      continue;
    }
    if (zeroth) place(Orders::Zeroth, gaussian ? make_gaussian_profile : make_wendland_profile);
    if (first) place(Orders::First, make_wendland_profile);
  }
  return scales;
}

template RegistrationOptions resolved(const RegistrationOptions&, const Lattice<2>&, const ImageTraits&);
template RegistrationOptions resolved(const RegistrationOptions&, const Lattice<3>&, const ImageTraits&);
template Lattice<2> level_lattice(const Lattice<2>&, int);
template Lattice<3> level_lattice(const Lattice<3>&, int);
template Lattice<2> moving_level_lattice(const Lattice<2>&, const Lattice<2>&, int);
template Lattice<3> moving_level_lattice(const Lattice<3>&, const Lattice<3>&, int);
template Lattice<2> flow_lattice_beside_first(const Lattice<2>&, const RegistrationOptions&, int);
template Lattice<3> flow_lattice_beside_first(const Lattice<3>&, const RegistrationOptions&, int);
template double first_order_width(const Lattice<2>&, const RegistrationOptions&, int);
template double first_order_width(const Lattice<3>&, const RegistrationOptions&, int);
template std::vector<PlacedScale<2, float>> make_scales(const Lattice<2>&, const RegistrationOptions&,
                                                        const Field<double>&, double);
template std::vector<PlacedScale<3, float>> make_scales(const Lattice<3>&, const RegistrationOptions&,
                                                        const Field<double>&, double);
template std::vector<PlacedScale<2, double>> make_scales(const Lattice<2>&, const RegistrationOptions&,
                                                         const Field<double>&, double);
template std::vector<PlacedScale<3, double>> make_scales(const Lattice<3>&, const RegistrationOptions&,
                                                         const Field<double>&, double);

}  // namespace saltus
