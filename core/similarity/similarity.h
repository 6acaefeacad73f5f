#pragma once

#include "core/grid/lattice.h"
#include "core/similarity/similarity_options.h"

#include <memory>

namespace saltus {

/// How unlike two images on one lattice are: an integral over the lattice (mm^Dim), lower is more similar.
/// Weights (masks) are in [0,1]; where the weight is 0 an image contributes nothing, whatever its value.
template <int Dim, class T>
class Similarity {
 public:
  virtual ~Similarity() = default;

  /// `fixed` and `weights` as at construction of the level; `warped` varies. Null weights mean 1 everywhere.
  /// Writes dE/d warped to `gradient` and, when `weight_gradient` is not null, dE/d weights to it.
  virtual double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) = 0;
};

/// Integral of (fixed - warped)^2. In [0, inf).
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_sum_of_squares(const Lattice<Dim>& lattice);

/// Integral of 1 - c with the un-squared local correlation c = cov / sqrt((var_f + floor^2) (var_w + floor^2)) over box
/// windows of half width `radius_mm` (at least one sample on each axis that has more than one). In [0, 2] per mm^Dim.
/// The floor, in intensity units, keeps flat windows at c = 0 with a finite gradient. Cost does not depend on the
/// radius.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_local_correlation(const Lattice<Dim>& lattice, double radius_mm, double floor);

/// What the options ask for at a level whose voxels are `level_spacing_mm` wide. Images must be scaled to unit range.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_similarity(SimilarityType type, const Lattice<Dim>& lattice,
                                                    const SimilarityOptions& parameters, double level_spacing_mm);

}  // namespace saltus
