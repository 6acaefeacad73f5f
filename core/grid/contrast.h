#pragma once

#include "core/grid/content.h"
#include "core/grid/lattice.h"

namespace saltus {

/// Root mean square length of an image's gradient within a box, in intensities over the lattice's finest spacing. White
/// noise does not count: along each axis it is the mean product of two central differences one sample apart, which
/// share no sample. Nor does structure as thin as a sample, and a step between two samples counts half. Axes of fewer
/// than four samples tell nothing; nor do samples with a weight of 0 (null: all count). 0 where there is less than
/// chance, infinite where nothing is left.
template <int Dim, class T>
double rms_gradient(const Lattice<Dim>& lattice, const T* samples, const T* weights, const IndexBox<Dim>& box);

}  // namespace saltus
