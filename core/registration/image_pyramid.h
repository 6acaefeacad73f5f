#pragma once

#include "core/grid/content.h"
#include "core/grid/intensity_range.h"
#include "core/registration/matching_objective.h"
#include "core/registration/register_images.h"

#include <limits>
#include <optional>
#include <vector>

namespace saltus {

/// The images of a registration with their masks, and the levels of the pyramid made from them. Intensities are scaled
/// so that the fixed image's 1st to 99th percentile (of what its mask shows) is [0,1], both images alike: weights then
/// mean the same for every scanner. Nothing is clipped. Levels are made from the input each time; no copy of the images
/// is kept.
template <int Dim>
class ImagePyramid {
 public:
  /// `input` and `options` (resolved) must outlive this.
  ImagePyramid(const RegistrationInput<Dim>& input, const RegistrationOptions& options);

  const Lattice<Dim>& fixed_lattice() const { return fixed_lattice_; }
  /// Standard deviation of the noise, the root mean square of both images': with ssd in units of the scaled
  /// intensities, else each in units of its own range.
  double noise() const { return noise_; }
  /// What so much noise is at a level, as MatchingLevel::noise.
  double matching_noise(double noise, int level) const;
  /// rms_gradient of what the fixed image shows beside background, in units of the scaled intensities; infinite with
  /// other similarities than ssd, which make intensities alike by themselves.
  double contrast() const { return contrast_; }
  /// Where the images of a level are compared: with region_margin, around what either of them (the moving one after the
  /// affine start) shows beside background within its noise, or where a mask lets it be seen; else the whole fixed
  /// image. Momenta and flow do not end there.
  Lattice<Dim> lattice(int level) const;
  /// That, without the margin, in voxels of the fixed image; empty where it is the whole image.
  std::optional<IndexBox<Dim>> region() const;
  /// Gaussian that the images of a level are smoothed with, sd in voxels of the level (at least half a voxel along axes
  /// that the level coarsens).
  double smoothing_voxels(int level) const;
  /// What the similarity of a level is multiplied with. ssd counts the less the more noise a level has; coarse levels
  /// have little, and large motion is found there.
  double similarity_weight(int level) const;
  /// What the divergence penalty of a level is multiplied with.
  double divergence_weight(int level) const;

  /// Images of one level, smoothed.
  MatchingLevel<Dim, float> level(int level) const;
  /// Images at full resolution, not smoothed.
  MatchingLevel<Dim, float> full_resolution() const;

 private:
  void measure_noise(const std::vector<float>& fixed_weights, const std::vector<float>& moving_weights);
  /// Of each image's range: what differs from background by less is background. None where noise hides which that is.
  std::optional<double> background_tolerance() const;
  void measure_contrast(const std::vector<float>& fixed_weights);
  void find_region(const std::vector<float>& fixed_weights, const std::vector<float>& moving_weights);
  double level_noise(int level) const;
  double share_beside_noise(int level) const;
  MatchingLevel<Dim, float> make_level(int level, const Lattice<Dim>& part, double smoothing) const;
  double scaled(double intensity) const;
  std::vector<float> scaled(const Volume<Dim>& image, const std::vector<float>& weights) const;
  FramedImage<Dim, float> framed(std::vector<float> samples, const std::vector<float>& weights, double smoothing,
                                 const Lattice<Dim>& lattice) const;

  const RegistrationInput<Dim>& input_;
  const RegistrationOptions& options_;
  Lattice<Dim> fixed_lattice_, moving_lattice_;
  AffineMap<Dim> to_moving_;
  IntensityRange range_, moving_intensities_;  ///< of both images as they are
  double moving_range_ = 1;  ///< in units of the scaled intensities, where the moving image's range counts by itself
  double noise_ = 0, contrast_ = std::numeric_limits<double>::infinity();
  Vector<Dim> region_low_, region_high_;  ///< frame, mm
  bool has_region_ = false;
};

}  // namespace saltus
