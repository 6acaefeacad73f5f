#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// What is said of an image counts the samples whose weight is above 0 (null weights: all), whatever the others hold.

struct IntensityRange {
  double low = 0, high = 0;
  double width() const { return high - low; }
};

/// The 1st to the 99th percentile; smallest to largest where those coincide. Of width 0 for a constant image, and
/// [0, 0] when nothing is seen.
template <class T>
IntensityRange intensity_range(std::size_t sites, const T* image, const T* weights);

/// Standard deviation of white noise, by the median of |second differences along every axis of three samples or more,
/// one after the other| (all samples of the stencil seen): structure that is smooth along any axis leaves no trace.
/// 0 for an image without noise or without a stencil. For normal noise, after Immerkaer (1996) with the median of
/// Donoho (1995).
template <int Dim, class T>
double noise_deviation(const Lattice<Dim>& lattice, const T* image, const T* weights);

}  // namespace saltus
