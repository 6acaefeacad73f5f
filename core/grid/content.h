#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Samples [begin, end) along each axis.
template <int Dim>
struct IndexBox {
  Index<Dim> begin{}, end{};
  bool operator==(const IndexBox&) const = default;
};

/// Where an image shows something: the box beyond which each plane across an axis is background, that is, of its
/// samples no more than one in 1000 differs from it by more than `tolerance`. The background is the median of the
/// samples on the lattice's border. Samples of weight 0 are not there (null weights: 1 everywhere); where all of the
/// border is not, there is no background. All of the image where nothing is shown.
template <int Dim>
IndexBox<Dim> content_box(const Lattice<Dim>& lattice, const float* samples, const float* weights, double tolerance);

/// The part of a lattice that holds the points of [low, high] (frame, mm) and `margin` samples more on every side.
template <int Dim>
Lattice<Dim> part_around(const Lattice<Dim>& lattice, const Vector<Dim>& low, const Vector<Dim>& high, double margin);

/// The samples of `whole` that lie on `part`, one of its parts.
template <int Dim>
std::vector<float> samples_of_part(const Lattice<Dim>& whole, const std::vector<float>& samples,
                                   const Lattice<Dim>& part);

}  // namespace saltus
