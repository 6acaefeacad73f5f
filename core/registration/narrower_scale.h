#pragma once

#include "core/registration/scales.h"

namespace saltus {

/// What momenta.narrower_pull stands for where it is -1; 0: never. Half way, as a ratio, between scenes that gain by a
/// narrower scale and others. With mind, whose descriptors are shares of what varies nearby, narrower_pull_share tells
/// them apart. In 2-D it was not measured. core/measurements.md, "Widths".
double least_narrow_pull(int dimension, SimilarityType similarity);

/// What pulls at a narrower scale of order 0 has at least so many times what pulls at the one beside it, each over
/// noise; measured, core/measurements.md, "Widths".
double narrower_pull_share(SimilarityType similarity);

/// The scale of order 0 alone that momenta.narrower_pull may add beside the finest one that has order 0, on the lattice
/// of that, by resolved options.
template <int Dim, class T>
PlacedScale<Dim, T> make_narrow_scale(const Lattice<Dim>& image, const RegistrationOptions& options,
                                      const PlacedScale<Dim, T>& finest);

/// Where the flow is on a level that has such a scale, beside scale `finest`: as flow.coarsening says, but with voxels
/// of about five eighths (lncc two thirds) of its width at most. A map between sites that are further from each other
/// loses some of what is so narrow, and folds. Measured, core/measurements.md, "Widths".
template <int Dim>
Lattice<Dim> narrow_flow_lattice(const Lattice<Dim>& image, const RegistrationOptions& options, int level, int finest);

}  // namespace saltus
