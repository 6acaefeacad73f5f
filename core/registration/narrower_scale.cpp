#include "core/registration/narrower_scale.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// Of the scale that momenta.narrower_pull adds, and of the flow beside it, voxels of the scale next to it;
/// core/measurements.md, "Widths".
struct NarrowScale {
  double width, flow_voxel;
};
NarrowScale narrow_scale(SimilarityType similarity) {
  return similarity == SimilarityType::Lncc ? NarrowScale{3, 2} : NarrowScale{2, 1.25};
}

}  // namespace

double least_narrow_pull(int dimension, SimilarityType similarity) {
  if (dimension == 2) return 0;
  switch (similarity) {
    case SimilarityType::Ssd:
      return 140;
    case SimilarityType::Ncc:
      return 40;
    case SimilarityType::Lncc:
      return 5;
    case SimilarityType::Mi:
      return 11;
    case SimilarityType::Ngf:
      return 3.4;
    case SimilarityType::Mind:
      return 0.3;
  }
  return 0;
}

double narrower_pull_share(SimilarityType similarity) {
  switch (similarity) {
    case SimilarityType::Ssd:  // what differs in intensity pulls at all widths
      return 0;
    case SimilarityType::Mind:
      return 1.5;
    case SimilarityType::Ncc:
    case SimilarityType::Lncc:
    case SimilarityType::Mi:
    case SimilarityType::Ngf:
      return 1.1;
  }
  return 1.1;
}

template <int Dim, class T>
PlacedScale<Dim, T> make_narrow_scale(const Lattice<Dim>& image, const RegistrationOptions& options,
                                      const PlacedScale<Dim, T>& finest) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  MomentumScaleOptions<Dim> made;
  made.kernel = make_gaussian_profile(narrow_scale(options.similarity).width * std::ldexp(reference, finest.level));
  made.lattice = finest.scale->lattice();
  made.zeroth_weight = finest.scale->options().zeroth_weight;
  return {finest.level, std::make_unique<MomentumScale<Dim, T>>(made)};
}

template <int Dim>
Lattice<Dim> narrow_flow_lattice(const Lattice<Dim>& image, const RegistrationOptions& options, int level, int finest) {
  const double reference = *std::min_element(image.spacing.begin(), image.spacing.end());
  const int usual = level + options.flow.coarsening;
  const double voxel = narrow_scale(options.similarity).flow_voxel * std::ldexp(reference, finest);
  return voxel < std::ldexp(reference, usual) ? coarsened(image, voxel) : level_lattice(image, usual);
}

template PlacedScale<2, float> make_narrow_scale(const Lattice<2>&, const RegistrationOptions&,
                                                 const PlacedScale<2, float>&);
template PlacedScale<2, double> make_narrow_scale(const Lattice<2>&, const RegistrationOptions&,
                                                  const PlacedScale<2, double>&);
template PlacedScale<3, float> make_narrow_scale(const Lattice<3>&, const RegistrationOptions&,
                                                 const PlacedScale<3, float>&);
template PlacedScale<3, double> make_narrow_scale(const Lattice<3>&, const RegistrationOptions&,
                                                  const PlacedScale<3, double>&);
template Lattice<2> narrow_flow_lattice(const Lattice<2>&, const RegistrationOptions&, int, int);
template Lattice<3> narrow_flow_lattice(const Lattice<3>&, const RegistrationOptions&, int, int);

}  // namespace saltus
