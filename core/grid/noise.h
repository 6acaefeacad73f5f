#pragma once

#include "core/grid/lattice.h"

#include <cmath>

namespace saltus {

/// Standard deviation of the white noise in an image, from the median size of the product of its second differences
/// along all axes of at least three samples (smooth structure cancels; edges are few). Samples whose neighbourhood is
/// constant, or holds a weight of 0, tell nothing and are left out; 0 when none is left. Null weights mean 1
/// everywhere. After Immerkaer (1996), with the median of Donoho (1995).
template <int Dim, class T>
double noise_sd(const Lattice<Dim>& lattice, const T* samples, const T* weights);

/// Noise of an image that is sampled again on the lattice `level` of its pyramid: a sample there averages about as many
/// of the image's as its cell is larger, and the noise falls with the root of that number. Axes that are not coarsened
/// add nothing to it.
template <int Dim>
double noise_of_level(double noise, const Lattice<Dim>& image, const Lattice<Dim>& level) {
  return noise * std::sqrt(image.cell_volume() / level.cell_volume());
}

/// Linear interpolation half way between samples averages noise away, so that a sum of squares prefers displacements
/// by half a sample. The standard deviation, in samples, of the least Gaussian that makes noise of standard deviation
/// `noise` so alike from sample to sample that at most a variance of tolerance^2 is lost; at most 2.
double smoothing_against_noise(double noise, int dimension, double tolerance);

}  // namespace saltus
