#include "core/registration/image_pyramid.h"

#include "core/grid/contrast.h"
#include "core/grid/noise.h"
#include "core/grid/pyramid.h"
#include "core/registration/finish.h"
#include "core/registration/scales.h"
#include "core/support/free_memory.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace saltus {
namespace {

/// Standard deviations of the noise within which background stays, all but one sample in thousands.
constexpr double kNoise = 5;
/// Of the range: where so much is noise, what an image shows cannot be told from background.
constexpr double kMostNoise = 0.25;
/// Of the range of intensities: what differs by less from the background is background, however little noise there is.
constexpr double kLeastContrast = 0.02;
/// A region that is more of the image than this is not worth it.
constexpr double kMostOfImage = 0.9;

/// 1 where the mask shows something; empty without a mask.
template <int Dim>
std::vector<float> binary(const std::optional<Volume<Dim>>& mask) {
  if (!mask) return {};
  std::vector<float> weights(mask->samples.size());
  std::transform(mask->samples.begin(), mask->samples.end(), weights.begin(),
                 [](float v) { return v > 0 ? float(1) : float(0); });
  return weights;
}

template <int Dim>
double noise_variance(const Lattice<Dim>& lattice, const std::vector<float>& samples,
                      const std::vector<float>& weights) {
  const double sd = noise_sd<Dim>(lattice, samples.data(), weights.empty() ? nullptr : weights.data());
  return sd * sd;
}

/// What a mask hides takes the mean of what it shows, so that no hidden value reaches an interpolation or a window.
void hide(const std::vector<float>& weights, std::vector<float>& samples) {
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    sum += double(weights[i]) * samples[i];
    count += weights[i];
  }
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (weights[i] == 0) samples[i] = static_cast<float>(sum / count);
}

/// Downsampled; smoothed; near a mask's border the mean of what it shows, not a mixture with what it hides.
template <int Dim>
std::vector<float> reduced(const Lattice<Dim>& from, std::vector<float> samples, const std::vector<float>& weights,
                           const Lattice<Dim>& to, double smoothing) {
  if (from == to && !(smoothing > 0)) return samples;
  std::vector<float> plain = downsampled(from, samples, to, smoothing);
  if (weights.empty()) return plain;
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] *= weights[i];
  const std::vector<float> sum = downsampled(from, samples, to, smoothing);
  free_vector(samples);  // memory_estimate counts what is held at the same time
  const std::vector<float> share = downsampled(from, weights, to, smoothing);
  for (std::size_t i = 0; i < plain.size(); ++i)
    if (share[i] > float(1e-3)) plain[i] = sum[i] / share[i];
  return plain;
}

}  // namespace

template <int Dim>
ImagePyramid<Dim>::ImagePyramid(const RegistrationInput<Dim>& input, const RegistrationOptions& options)
    : input_(input),
      options_(options),
      fixed_lattice_(lattice_of(input.fixed.grid)),
      moving_lattice_(lattice_of(input.moving.grid)),
      to_moving_(frame_to_index(input)) {
  const std::vector<float> fixed_weights = binary(input.fixed_mask);
  range_ = intensity_range(input.fixed.samples.size(), input.fixed.samples.data(),
                           fixed_weights.empty() ? nullptr : fixed_weights.data());
  const std::vector<float> moving_weights = binary(input.moving_mask);
  moving_intensities_ = intensity_range(input.moving.samples.size(), input.moving.samples.data(),
                                        moving_weights.empty() ? nullptr : moving_weights.data());
  // Only ssd compares intensities; for the others each image's noise is a share of its own range.
  const double width = scaled(moving_intensities_.high) - scaled(moving_intensities_.low);
  if (options.similarity != SimilarityType::Ssd && width > 0) moving_range_ = width;
  noise_ = options.similarity_parameters.noise;
  if (noise_ < 0) measure_noise(fixed_weights, moving_weights);
  if (options.similarity == SimilarityType::Ssd) measure_contrast(fixed_weights);
  if (options.pyramid.region_margin >= 0) find_region(fixed_weights, moving_weights);
}

template <int Dim>
void ImagePyramid<Dim>::measure_noise(const std::vector<float>& fixed_weights,
                                      const std::vector<float>& moving_weights) {
  const double fixed_variance = noise_variance(fixed_lattice_, scaled(input_.fixed, fixed_weights), fixed_weights);
  const double moving_variance =
      noise_variance(moving_lattice_, scaled(input_.moving, moving_weights), moving_weights) /
      (moving_range_ * moving_range_);
  noise_ = std::sqrt((fixed_variance + moving_variance) / 2);
}

template <int Dim>
std::optional<double> ImagePyramid<Dim>::background_tolerance() const {
  if (kNoise * noise_ > kMostNoise) return std::nullopt;
  return std::max(kNoise * noise_, kLeastContrast);
}

template <int Dim>
void ImagePyramid<Dim>::measure_contrast(const std::vector<float>& fixed_weights) {
  const float* const seen = fixed_weights.empty() ? nullptr : fixed_weights.data();
  const std::vector<float> samples = scaled(input_.fixed, fixed_weights);
  IndexBox<Dim> content{{}, fixed_lattice_.size};  // around it nothing pulls, however much of the image that is
  if (const auto tolerance = background_tolerance())
    content = content_box(fixed_lattice_, samples.data(), seen, *tolerance);
  contrast_ = rms_gradient<Dim>(fixed_lattice_, samples.data(), seen, content);
}

template <int Dim>
void ImagePyramid<Dim>::find_region(const std::vector<float>& fixed_weights, const std::vector<float>& moving_weights) {
  const auto tolerance = background_tolerance();
  if (!tolerance) return;
  const auto seen = [](const std::vector<float>& weights) { return weights.empty() ? nullptr : weights.data(); };
  const std::vector<float>&fixed_samples = input_.fixed.samples, &moving_samples = input_.moving.samples;
  const IndexBox<Dim> fixed = content_box(fixed_lattice_, fixed_samples.data(), seen(fixed_weights),
                                          *tolerance * range_.width()),
                      moving = content_box(moving_lattice_, moving_samples.data(), seen(moving_weights),
                                           *tolerance * moving_intensities_.width());
  for (int axis = 0; axis < Dim; ++axis) {
    region_low_[axis] = fixed.begin[axis] * fixed_lattice_.spacing[axis];
    region_high_[axis] = (fixed.end[axis] - 1) * fixed_lattice_.spacing[axis];
  }
  const Matrix<Dim> to_frame = to_moving_.linear.inverse();
  for (int corner = 0; corner < 1 << Dim; ++corner) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = corner >> axis & 1 ? moving.end[axis] - 1 : moving.begin[axis];
    const Vector<Dim> point = to_frame * (index - to_moving_.offset);
    region_low_ = region_low_.cwiseMin(point);
    region_high_ = region_high_.cwiseMax(point);
  }
  const double part = static_cast<double>(
      part_around<Dim>(fixed_lattice_, region_low_, region_high_, options_.pyramid.region_margin).sites());
  has_region_ = part < kMostOfImage * static_cast<double>(fixed_lattice_.sites());
}

template <int Dim>
Lattice<Dim> ImagePyramid<Dim>::lattice(int level) const {
  const Lattice<Dim> whole = level_lattice(fixed_lattice_, level);
  return has_region_ ? part_around<Dim>(whole, region_low_, region_high_, options_.pyramid.region_margin) : whole;
}

template <int Dim>
std::optional<IndexBox<Dim>> ImagePyramid<Dim>::region() const {
  if (!has_region_) return {};
  const Lattice<Dim> part = part_around<Dim>(fixed_lattice_, region_low_, region_high_, 0);
  IndexBox<Dim> box;
  for (int axis = 0; axis < Dim; ++axis) {
    box.begin[axis] = static_cast<int>(std::lround(part.offset[axis] / fixed_lattice_.spacing[axis]));
    box.end[axis] = box.begin[axis] + part.size[axis];
  }
  return box;
}

/// Maps the fixed image's range to [0,1], one of width 0 to its difference from the lower end.
template <int Dim>
double ImagePyramid<Dim>::scaled(double intensity) const {
  return (intensity - range_.low) * (range_.width() > 0 ? 1 / range_.width() : 1);
}

/// What a mask hides is hidden.
template <int Dim>
std::vector<float> ImagePyramid<Dim>::scaled(const Volume<Dim>& image, const std::vector<float>& weights) const {
  std::vector<float> result(image.samples.size());
  std::transform(image.samples.begin(), image.samples.end(), result.begin(),
                 [&](float v) { return static_cast<float>(scaled(v)); });
  if (!weights.empty()) hide(weights, result);
  return result;
}

template <int Dim>
double ImagePyramid<Dim>::matching_noise(double noise, int level) const {
  return std::sqrt(2.0) * noise_of_level(noise, fixed_lattice_, level_lattice(fixed_lattice_, level)) * moving_range_;
}

template <int Dim>
double ImagePyramid<Dim>::level_noise(int level) const {
  return noise_of_level(noise_, fixed_lattice_, level_lattice(fixed_lattice_, level));
}

template <int Dim>
double ImagePyramid<Dim>::share_beside_noise(int level) const {
  if (options_.similarity != SimilarityType::Ssd) return 1;
  return 1 / (1 + std::pow(level_noise(level) / options_.similarity_parameters.ssd_residual, 2));
}

template <int Dim>
double ImagePyramid<Dim>::similarity_weight(int level) const {
  return options_.similarity_parameters.weight * share_beside_noise(level);
}

template <int Dim>
double ImagePyramid<Dim>::divergence_weight(int level) const {
  // The divergence penalty gives way half as fast as the similarity does: measured, on scenes that slide and on one
  // that does not (core/measurements.md, "Noise").
  return options_.flow.divergence_weight * std::sqrt(share_beside_noise(level));
}

template <int Dim>
double ImagePyramid<Dim>::smoothing_voxels(int level) const {
  const double asked = options_.similarity_parameters.smoothing_voxels;
  return asked >= 0 ? asked
                    : smoothing_against_noise(level_noise(level), Dim, options_.similarity_parameters.lost_noise);
}

template <int Dim>
MatchingLevel<Dim, float> ImagePyramid<Dim>::level(int level) const {
  return make_level(level, lattice(level), smoothing_voxels(level));
}

template <int Dim>
MatchingLevel<Dim, float> ImagePyramid<Dim>::full_resolution() const {
  return make_level(0, fixed_lattice_, 0);
}

template <int Dim>
MatchingLevel<Dim, float> ImagePyramid<Dim>::make_level(int level, const Lattice<Dim>& part, double smoothing) const {
  MatchingLevel<Dim, float> made;
  const Lattice<Dim> whole = level_lattice(fixed_lattice_, level);
  made.lattice = part;
  std::vector<float> fixed_weights = binary(input_.fixed_mask);
  const auto on_part = [&](std::vector<float> samples) {
    return part == whole ? std::move(samples) : samples_of_part(whole, samples, part);
  };
  made.fixed = on_part(reduced(fixed_lattice_, scaled(input_.fixed, fixed_weights), fixed_weights, whole, smoothing));
  if (input_.fixed_mask) made.fixed_weights = on_part(downsampled(fixed_lattice_, fixed_weights, whole));
  free_vector(fixed_weights);
  const Lattice<Dim> moving = moving_level_lattice(fixed_lattice_, moving_lattice_, level);
  std::vector<float> moving_weights = binary(input_.moving_mask);
  made.moving = framed(scaled(input_.moving, moving_weights), moving_weights, smoothing, moving);
  if (input_.moving_mask) made.moving_weights = framed(std::move(moving_weights), {}, 0, moving);
  made.similarity_weight = similarity_weight(level);
  made.divergence_weight = divergence_weight(level);
  // Smoothing leaves what noise holds at the kernels' wavelengths as it is.
  made.noise = matching_noise(noise_, level);
  made.time_steps = options_.flow.time_steps;
  made.map_steps = options_.flow.map_steps;
  made.evolution = options_.flow.evolution;
  return made;
}

template <int Dim>
FramedImage<Dim, float> ImagePyramid<Dim>::framed(std::vector<float> samples, const std::vector<float>& weights,
                                                  double smoothing, const Lattice<Dim>& lattice) const {
  FramedImage<Dim, float> image;
  image.lattice = lattice;
  image.samples = reduced(moving_lattice_, std::move(samples), weights, lattice, smoothing);
  // Index of the full image -> index of the level's image.
  for (int axis = 0; axis < Dim; ++axis) {
    const double ratio = moving_lattice_.spacing[axis] / lattice.spacing[axis];
    image.linear.row(axis) = ratio * to_moving_.linear.row(axis);
    image.offset[axis] = ratio * to_moving_.offset[axis] - lattice.offset[axis] / lattice.spacing[axis];
  }
  return image;
}

template class ImagePyramid<2>;
template class ImagePyramid<3>;

}  // namespace saltus
