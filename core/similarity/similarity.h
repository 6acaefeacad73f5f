#pragma once

#include "core/grid/lattice.h"
#include "core/similarity/similarity_options.h"

#include <memory>

namespace saltus {

/// How unlike two images on one lattice are: an integral over the lattice (mm^Dim), lower is more similar.
/// Weights (masks) are in [0,1]; where the weight is 0 an image contributes nothing, whatever its value (NaN included).
/// When all weights are 0 the value and the gradient are 0: that nothing overlaps is for the caller to judge.
template <int Dim, class T>
class Similarity {
 public:
  virtual ~Similarity() = default;

  /// Learns once what does not change while `warped` does. To be called before the first evaluation and again when
  /// `fixed` changes. `resting` is the moving image on the lattice before any deformation, `weights` as in evaluate.
  /// Those that learn nothing need not be prepared; the others throw std::logic_error when they were not.
  virtual void prepare(const T* /*fixed*/, const T* /*resting*/, const T* /*weights*/) {}

  /// `fixed` as prepared; `warped` and `weights` vary. Null weights mean 1 everywhere.
  /// Writes dE/d warped to `gradient` and, when `weight_gradient` is not null, dE/d weights to it: where the weight is
  /// 0, the one-sided derivative (towards showing the sample, so that there its value matters).
  virtual double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) = 0;
};

/// Integral of (fixed - warped)^2. In [0, inf).
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_sum_of_squares(const Lattice<Dim>& lattice);

/// Volume of the lattice (sum of the weights) times 1 - c, with the un-squared correlation
/// c = cov / sqrt((var_f + floor^2) (var_w + floor^2)) of the whole images. In [0, 2] per mm^Dim, like lncc.
/// The floor, in intensity units, keeps flat images at c = 0 with a finite gradient.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_global_correlation(const Lattice<Dim>& lattice, double floor);

/// Integral of 1 - c with the un-squared local correlation c = cov / sqrt((var_f + floor^2) (var_w + floor^2)) over box
/// windows of half width about `radius_mm`. In [0, 2] per mm^Dim. The floor, in intensity units, keeps flat windows at
/// c = 0 with a finite gradient. A window whose weights sum to less than 1e-6 sees nothing: c = 0 there.
/// With r = radius / spacing, rounded and at least 1, windows have 2 r + 1 samples along an axis, one around each. Cost
/// grows with the radius. prepare finds about where the images' values are; without it each evaluation does.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_local_correlation(const Lattice<Dim>& lattice, double radius_mm, double floor);

/// The same for windows that are made of cells of two samples along axes where r is above 1, (r + 1) / 2 (whole) on
/// both sides of the middle one, of which the outermost count a quarter. They move by a cell and count for all samples
/// that are in its middle one, so that this takes a third of the time in 3-D, and hardly more where they are wide.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_cell_correlation(const Lattice<Dim>& lattice, double radius_mm, double floor);

/// Minus the volume of the lattice (sum of the weights) times the mutual information of the images, in nats, from a
/// joint Parzen histogram of `bins` x `bins` (at least 8): hat windows for the fixed image, cubic B-splines for the
/// warped one (Mattes et al. 2003). In [-log(bins), 0] per mm^Dim; 0 when one image says nothing of the other, and in
/// particular when the fixed image is constant.
/// Two thirds of the bins share the range of what is seen of an image by prepare (1st to 99th percentile) evenly. What
/// lies beyond, then or later, is drawn together into the bins at the ends: monotone, twice differentiable, with a
/// slope that falls with the cube of the distance, so that no value is lost. A thousandth of the weight is spread
/// evenly over all bins, which keeps derivatives finite where a bin is empty. Null information is therefore met up to
/// about 0.01.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_mutual_information(const Lattice<Dim>& lattice, int bins);

/// Normalised gradient fields (Haber and Modersitzki 2006): the integral of 1 - <n_f, n_w>^2 with
/// n = grad I / sqrt(|grad I|^2 + edge^2), which sees along which line the gradient lies but neither its sign nor its
/// length. In [0, 1] per mm^Dim, but for rounding (1e-7 in single precision); where either image is flat 1, with no
/// gradient. Central differences in mm; a neighbour
/// beyond the border or hidden by its weight counts as having the sample's own value.
/// `edge` > 0 (intensity per mm) holds for both images. 0: prepare finds one for each image, so that their scales do
/// not matter: twice the gradients of the noise (see noise_sd), and a tenth of the mean gradient, in squares.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_gradient_fields(const Lattice<Dim>& lattice, double edge);

/// Modality independent descriptors, self-similarity context (Heinrich et al. 2013): the integral of
/// mean_k (S_k(warped) - S_k(fixed))^2, where k runs over the pairs of a sample's neighbours `step_mm` away (at least
/// one sample) on different axes, four pairs for each two axes, S_k = exp(-D_k / (mean D + floor)), and D_k is the mean
/// squared difference of the box patches of half width `radius_mm` around both neighbours. In [0, 1] per mm^Dim. It
/// sees neither brightness, contrast nor its sign; where an image is flat all S_k are 1, which a structure there
/// differs from. What of a patch is hidden by its weight or beyond the border counts as no difference. prepare finds
/// the floor for each image: twice the variance of its noise (see noise_sd) and a thousandth of its mean D. The
/// descriptors are not shifted to a largest one of 1, which would make them kink. Patches of more than five samples
/// along an axis cost up to three times as much; the step does not matter. An axis with fewer samples than the step is
/// left out.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_self_similarity(const Lattice<Dim>& lattice, double radius_mm, double step_mm);

/// What the options ask for at a level whose voxels are `level_spacing_mm` wide. Images must be scaled to unit range.
template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_similarity(SimilarityType type, const Lattice<Dim>& lattice,
                                                    const SimilarityOptions& parameters, double level_spacing_mm);

/// Half width of the windows of lncc: as asked for, or what suits the dimension, since a window in the plane holds
/// fewer samples.
double lncc_radius_voxels(const SimilarityOptions& parameters, int dimension);
/// Samples of their cells, by the same.
int lncc_cell(const SimilarityOptions& parameters, int dimension);

/// Scalars a site that such a similarity keeps for its own work, at the most (with a mask that moves).
int similarity_scratch(SimilarityType type, int dimension);
/// Bytes that it keeps beside those, however many sites there are, with so many threads.
double similarity_tables(SimilarityType type, const SimilarityOptions& parameters, int threads);

}  // namespace saltus
