#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Root mean square length of an image's gradient, in intensities over the lattice's finest spacing. White noise does
/// not count: along each axis it is the mean product of two central differences one sample apart, which share no
/// sample. Axes of fewer than four samples tell nothing; nor do samples with a weight of 0 (null: all count). 0 where
/// nothing is left, or less than chance.
template <int Dim, class T>
double rms_gradient(const Lattice<Dim>& lattice, const T* samples, const T* weights);

}  // namespace saltus
