#include "core/image_io/affine_start.h"

#include <itkAffineTransform.h>
#include <itkEuler2DTransform.h>
#include <itkEuler3DTransform.h>
#include <itkImageMaskSpatialObject.h>
#include <itkImageRegistrationMethodv4.h>
#include <itkMattesMutualInformationImageToImageMetricv4.h>
#include <itkRegistrationParameterScalesFromPhysicalShift.h>
#include <itkRegularStepGradientDescentOptimizerv4.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/image_io/itk_geometry.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

constexpr int levels = 3;
constexpr double most_samples = 50000;

/// Sets ITK's global thread count and kind of threads for one call, and puts them back.
class ThreadLimit {
 public:
  explicit ThreadLimit(int threads)
      : lock_(mutex()),
        count_(itk::MultiThreaderBase::GetGlobalDefaultNumberOfThreads()),
        kind_(itk::MultiThreaderBase::GetGlobalDefaultThreader()) {
    if (threads == 0) return;
    // ITK's pool keeps the threads it was made with; the platform kind starts as many as are asked for.
    itk::MultiThreaderBase::SetGlobalDefaultThreader(itk::MultiThreaderBase::ThreaderEnum::Platform);
    itk::MultiThreaderBase::SetGlobalDefaultNumberOfThreads(threads);
  }
  ~ThreadLimit() {
    itk::MultiThreaderBase::SetGlobalDefaultThreader(kind_);
    itk::MultiThreaderBase::SetGlobalDefaultNumberOfThreads(count_);
  }
  ThreadLimit(const ThreadLimit&) = delete;
  ThreadLimit& operator=(const ThreadLimit&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex one;
    return one;
  }
  std::lock_guard<std::mutex> lock_;
  itk::ThreadIdType count_;
  itk::MultiThreaderBase::ThreaderEnum kind_;
};

template <int Dim>
using ItkImage = itk::Image<float, Dim>;
template <int Dim>
using ItkTransform = itk::MatrixOffsetTransformBase<double, Dim, Dim>;
template <int Dim>
using Metric = itk::MattesMutualInformationImageToImageMetricv4<ItkImage<Dim>, ItkImage<Dim>>;

template <int Dim>
typename ItkImage<Dim>::Pointer to_itk(const Volume<Dim>& volume) {
  const auto image = ItkImage<Dim>::New();
  set_geometry(*image, volume.grid);
  image->Allocate();
  std::copy(volume.samples.begin(), volume.samples.end(), image->GetBufferPointer());
  return image;
}

template <int Dim>
typename itk::ImageMaskSpatialObject<Dim>::Pointer to_itk_mask(const Volume<Dim>& mask) {
  const auto image = itk::Image<unsigned char, Dim>::New();
  set_geometry(*image, mask.grid);
  image->Allocate();
  std::transform(mask.samples.begin(), mask.samples.end(), image->GetBufferPointer(),
                 [](float sample) { return sample != 0 ? 1 : 0; });
  const auto object = itk::ImageMaskSpatialObject<Dim>::New();
  object->SetImage(image);
  object->Update();
  return object;
}

template <int Dim>
void check_image(const std::string& name, const Volume<Dim>& image, const Volume<Dim>* mask) {
  for (int axis = 0; axis < Dim; ++axis) {
    if (image.grid.size[axis] < 4)
      throw InvalidInput(name + " image has " + std::to_string(image.grid.size[axis]) + " voxels along axis " +
                         std::to_string(axis) + "; an affine start needs 4, so choose none");
  }
  const auto [low, high] = std::minmax_element(image.samples.begin(), image.samples.end());
  if (!std::isfinite(*low) || !std::isfinite(*high) || !(*low < *high))
    throw InvalidInput(name + " image has values from " + std::to_string(*low) + " to " + std::to_string(*high) +
                       "; an affine start needs finite ones that differ");
  if (mask && std::all_of(mask->samples.begin(), mask->samples.end(), [](float sample) { return sample == 0; }))
    throw InvalidInput(name + " mask is 0 everywhere; mark what counts, or leave the mask out");
}

template <int Dim>
Vector<Dim> grid_centre(const ImageGrid<Dim>& grid) {
  Vector<Dim> middle;
  for (int axis = 0; axis < Dim; ++axis) middle[axis] = 0.5 * (grid.size[axis] - 1);
  return grid.to_world(middle);
}

/// Centre of mass of the image above its minimum.
template <int Dim>
Vector<Dim> mass_centre(const Volume<Dim>& image) {
  const double low = *std::min_element(image.samples.begin(), image.samples.end());
  Vector<Dim> moment = Vector<Dim>::Zero();
  double mass = 0;
  Index<Dim> index{};
  for (const float sample : image.samples) {
    for (int axis = 0; axis < Dim; ++axis) moment[axis] += (sample - low) * index[axis];
    mass += sample - low;
    for (int axis = 0; axis < Dim && ++index[axis] == image.grid.size[axis]; ++axis) index[axis] = 0;
  }
  return image.grid.to_world(moment / mass);
}

/// The spacing of the finest level: that of the fixed image, or so coarse that it has 64^Dim voxels.
template <int Dim>
double finest_spacing(const ImageGrid<Dim>& grid) {
  const double extent = std::pow(grid.voxel_volume() * static_cast<double>(grid.voxels()), 1.0 / Dim);
  return std::max(grid.spacing.minCoeff(), extent / 64);
}

template <int Dim>
Index<Dim> shrink_factors(const ImageGrid<Dim>& grid, double spacing) {
  Index<Dim> factors;
  for (int axis = 0; axis < Dim; ++axis)
    factors[axis] = std::clamp(static_cast<int>(std::lround(spacing / grid.spacing[axis])), 1, grid.size[axis] / 4);
  return factors;
}

template <int Dim>
class AffineSearch {
 public:
  AffineSearch(const Volume<Dim>& fixed, const Volume<Dim>& moving, const AffineMasks<Dim>& masks)
      : fixed_grid_(fixed.grid), fixed_(to_itk(fixed)), moving_(to_itk(moving)) {
    if (masks.fixed) fixed_mask_ = to_itk_mask(*masks.fixed);
    if (masks.moving) moving_mask_ = to_itk_mask(*masks.moving);
  }

  typename Metric<Dim>::Pointer make_metric() const {
    // Threads would add to the histogram in the order in which they come. The metric keeps the thread count that it
    // finds when it is made; its own setter has no effect on that.
    const itk::ThreadIdType threads = itk::MultiThreaderBase::GetGlobalDefaultNumberOfThreads();
    itk::MultiThreaderBase::SetGlobalDefaultNumberOfThreads(1);
    const auto metric = Metric<Dim>::New();
    itk::MultiThreaderBase::SetGlobalDefaultNumberOfThreads(threads);
    metric->SetNumberOfHistogramBins(32);
    metric->SetUseMovingImageGradientFilter(false);
    metric->SetUseFixedImageGradientFilter(false);
    if (fixed_mask_) metric->SetFixedImageMask(fixed_mask_);
    if (moving_mask_) metric->SetMovingImageMask(moving_mask_);
    return metric;
  }

  /// Negative mutual information on the grid of the second level; infinite when the images do not meet.
  double mismatch(ItkTransform<Dim>& transform) const {
    const Index<Dim> factors = shrink_factors(fixed_grid_, 2 * finest_spacing(fixed_grid_));
    ImageGrid<Dim> coarse = fixed_grid_;
    Vector<Dim> first;
    for (int axis = 0; axis < Dim; ++axis) {
      coarse.size[axis] = fixed_grid_.size[axis] / factors[axis];
      coarse.spacing[axis] *= factors[axis];
      first[axis] = 0.5 * (factors[axis] - 1);
    }
    coarse.origin = fixed_grid_.to_world(first);
    const auto domain = ItkImage<Dim>::New();
    set_geometry(*domain, coarse);
    const auto metric = make_metric();
    metric->SetFixedImage(fixed_);
    metric->SetMovingImage(moving_);
    metric->SetVirtualDomainFromImage(domain);
    metric->SetMovingTransform(&transform);
    try {
      metric->Initialize();
      const double value = metric->GetValue();
      return metric->GetNumberOfValidPoints() * 10 >= coarse.voxels() || fixed_mask_ || moving_mask_
                 ? value
                 : std::numeric_limits<double>::infinity();
    } catch (const itk::ExceptionObject&) {
      return std::numeric_limits<double>::infinity();
    }
  }

  void improve(ItkTransform<Dim>& transform) const {
    using Method = itk::ImageRegistrationMethodv4<ItkImage<Dim>, ItkImage<Dim>>;
    const auto metric = make_metric();
    const auto scales = itk::RegistrationParameterScalesFromPhysicalShift<Metric<Dim>>::New();
    scales->SetMetric(metric);
    const auto optimiser = itk::RegularStepGradientDescentOptimizerv4<double>::New();
    optimiser->SetScalesEstimator(scales);
    optimiser->SetDoEstimateLearningRateOnce(true);
    optimiser->SetNumberOfIterations(200);
    optimiser->SetRelaxationFactor(0.8);
    optimiser->SetMinimumStepLength(1e-3);
    optimiser->SetGradientMagnitudeTolerance(1e-8);

    const auto method = Method::New();
    method->SetFixedImage(fixed_);
    method->SetMovingImage(moving_);
    method->SetMetric(metric);
    method->SetOptimizer(optimiser);
    method->SetInitialTransform(&transform);
    method->InPlaceOn();
    method->SetNumberOfLevels(levels);
    method->SetSmoothingSigmasAreSpecifiedInPhysicalUnits(true);
    typename Method::SmoothingSigmasArrayType sigmas(levels);
    typename Method::MetricSamplingPercentageArrayType shares(levels);
    for (int level = 0; level < levels; ++level) {
      const double spacing = std::ldexp(finest_spacing(fixed_grid_), levels - 1 - level);
      sigmas[level] = 0.35 * spacing;
      typename Method::ShrinkFactorsPerDimensionContainerType factors;
      double samples = 1;
      const Index<Dim> wanted = shrink_factors(fixed_grid_, spacing);
      for (int axis = 0; axis < Dim; ++axis) {
        factors[axis] = wanted[axis];
        samples *= fixed_grid_.size[axis] / wanted[axis];
      }
      method->SetShrinkFactorsPerDimension(level, factors);
      shares[level] = std::min(1.0, most_samples / samples);
    }
    method->SetSmoothingSigmasPerLevel(sigmas);
    method->SetMetricSamplingStrategy(Method::MetricSamplingStrategyEnum::REGULAR);
    method->SetMetricSamplingPercentagePerLevel(shares);
    method->MetricSamplingReinitializeSeed(20);
    method->Update();
  }

 private:
  ImageGrid<Dim> fixed_grid_;
  typename ItkImage<Dim>::Pointer fixed_;
  typename ItkImage<Dim>::Pointer moving_;
  typename itk::ImageMaskSpatialObject<Dim>::Pointer fixed_mask_;
  typename itk::ImageMaskSpatialObject<Dim>::Pointer moving_mask_;
};

template <int Dim>
typename ItkTransform<Dim>::Pointer make_transform(AffineKind kind) {
  if (kind == AffineKind::Affine) return itk::AffineTransform<double, Dim>::New().GetPointer();
  if constexpr (Dim == 2) {
    return itk::Euler2DTransform<double>::New().GetPointer();
  } else {
    return itk::Euler3DTransform<double>::New().GetPointer();
  }
}

template <int Dim>
AffineMap<Dim> to_map(const ItkTransform<Dim>& transform) {
  AffineMap<Dim> map;
  for (int row = 0; row < Dim; ++row) {
    map.offset[row] = transform.GetOffset()[row];
    for (int column = 0; column < Dim; ++column) map.linear(row, column) = transform.GetMatrix()(row, column);
  }
  return map;
}

}  // namespace

template <int Dim>
AffineMap<Dim> find_affine_start(const Volume<Dim>& fixed, const Volume<Dim>& moving, AffineKind kind, int threads,
                                 const AffineMasks<Dim>& masks) {
  if (kind == AffineKind::None) return {};
  if (threads < 0) throw InvalidInput("threads is " + std::to_string(threads) + "; it must be 0 (all) or more");
  check_image("fixed", fixed, masks.fixed);
  check_image("moving", moving, masks.moving);

  const ThreadLimit limit(threads);
  try {
    const AffineSearch<Dim> search(fixed, moving, masks);
    const auto transform = make_transform<Dim>(kind);
    const Vector<Dim> centre = grid_centre(fixed.grid);
    typename ItkTransform<Dim>::InputPointType itk_centre;
    for (int axis = 0; axis < Dim; ++axis) itk_centre[axis] = centre[axis];
    transform->SetCenter(itk_centre);

    const std::vector<Vector<Dim>> shifts{Vector<Dim>::Zero(), grid_centre(moving.grid) - centre,
                                          mass_centre(moving) - mass_centre(fixed)};
    double best = std::numeric_limits<double>::infinity();
    std::optional<typename ItkTransform<Dim>::OutputVectorType> start;
    for (const Vector<Dim>& shift : shifts) {
      typename ItkTransform<Dim>::OutputVectorType translation;
      for (int axis = 0; axis < Dim; ++axis) translation[axis] = shift[axis];
      transform->SetTranslation(translation);
      const double mismatch = search.mismatch(*transform);
      if (mismatch < best) {
        best = mismatch;
        start = translation;
      }
    }
    if (!start) throw NumericalFailure("no affine start was found, the images do not overlap; choose none");
    transform->SetTranslation(*start);
    const AffineMap<Dim> before = to_map<Dim>(*transform);
    search.improve(*transform);
    return search.mismatch(*transform) <= best ? to_map<Dim>(*transform) : before;
  } catch (const itk::ExceptionObject& error) {
    throw NumericalFailure(std::string("no affine start was found (") + error.GetDescription() +
                           "); choose none, or masks");
  }
}

template AffineMap<2> find_affine_start(const Volume<2>&, const Volume<2>&, AffineKind, int, const AffineMasks<2>&);
template AffineMap<3> find_affine_start(const Volume<3>&, const Volume<3>&, AffineKind, int, const AffineMasks<3>&);

}  // namespace saltus
