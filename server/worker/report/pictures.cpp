#include "server/worker/report/pictures.h"

#include "core/drawing/colour_map.h"
#include "core/drawing/field_sampling.h"
#include "core/drawing/painting.h"
#include "core/evaluation/statistics.h"

#include <algorithm>
#include <cmath>

namespace saltus::report {

using namespace drawing;

namespace {

template <int Dim>
double largest(const VectorVolume<Dim>& field) {
  const std::size_t sites = field.grid.voxels();
  double most = 0;
  for (std::size_t site = 0; site < sites; ++site) {
    double squares = 0;
    for (std::size_t c = 0; c < Dim; ++c) squares += std::pow(static_cast<double>(field.samples[c * sites + site]), 2);
    most = std::max(most, squares);
  }
  return std::sqrt(most);
}

}  // namespace

template <int Dim>
Pictures<Dim>::Pictures(const ReportInput<Dim>& input, const DisplacementMeasures& motion) : input_(input) {
  const RegistrationInput<Dim>& images = *input.input;
  const RegistrationResult<Dim>& result = *input.result;
  fixed_window_ = window_of(images.fixed);
  // Sums of squares compare intensities themselves, so the pictures must not scale them apart.
  moving_window_ = input.options->similarity == SimilarityType::Ssd ? fixed_window_ : window_of(images.moving);

  const ImageGrid<Dim>& grid = images.fixed.grid;
  const auto index_of = [&grid](std::size_t voxel) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) {
      index[axis] = static_cast<double>(voxel % static_cast<std::size_t>(grid.size[axis]));
      voxel /= static_cast<std::size_t>(grid.size[axis]);
    }
    return index;
  };
  auto differences = thinned(grid.voxels(), [&](std::size_t voxel) {
    const Vector<Dim> index = index_of(voxel);
    return std::abs(moving_at(index) - fixed_at(index));
  });
  difference_range_ = std::max(0.02, quantile_of(differences, 0.99));
  displacement_range_ = motion.max_mm;
  if (!(displacement_range_ > 0)) displacement_range_ = 1;
  auto logarithms = thinned(grid.voxels(), [&](std::size_t voxel) {
    const double j = result.jacobian.samples[voxel];
    return j > 0 ? std::abs(std::log2(j)) : 0.0;
  });
  const double logarithm = quantile_of(logarithms, 0.999);
  jacobian_range_ = std::exp2(std::clamp(logarithm, std::log2(1.1), 2.0));
  // The first-order fields of one kernel share a scale: which axis carries the jump is what one wants to see.
  for (const MomentumField<Dim>& field : result.momenta) {
    double most = 0;
    for (const MomentumField<Dim>& other : result.momenta)
      if (other.kernel == field.kernel && other.width_mm == field.width_mm &&
          (other.axis == MomentumField<Dim>::kZeroth) == (field.axis == MomentumField<Dim>::kZeroth))
        most = std::max(most, largest(other.vectors));
    momentum_ranges_.push_back(most);
  }
}

template <int Dim>
double Pictures<Dim>::fixed_at(const Vector<Dim>& index) const {
  const Volume<Dim>& image = input_.input->fixed;
  return fixed_window_(sample(image.grid, image.samples.data(), index));
}

template <int Dim>
double Pictures<Dim>::moving_at(const Vector<Dim>& index) const {
  const Volume<Dim>& image = input_.input->moving;
  const Vector<Dim> world = input_.input->start(input_.input->fixed.grid.to_world(index));
  return moving_window_(sample(image.grid, image.samples.data(), image.grid.to_index(world)));
}

template <int Dim>
double Pictures<Dim>::warped_at(const Vector<Dim>& index) const {
  const Volume<Dim>& image = input_.result->warped;
  return moving_window_(sample(image.grid, image.samples.data(), index));
}

template <int Dim>
double Pictures<Dim>::displacement_at(const Vector<Dim>& index) const {
  return sample(input_.result->displacement, index).norm();
}

template <int Dim>
double Pictures<Dim>::jacobian_at(const Vector<Dim>& index) const {
  // The nearest voxel: interpolation would hide a fold between good neighbours.
  const Volume<Dim>& image = input_.result->jacobian;
  const Vector<Dim> nearest = index.array().round().matrix();
  return sample(image.grid, image.samples.data(), nearest);
}

template <int Dim>
Raster Pictures<Dim>::fixed(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) { return grey(fixed_at(index)); });
}

template <int Dim>
Raster Pictures<Dim>::moving(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) { return grey(moving_at(index)); });
}

template <int Dim>
Raster Pictures<Dim>::warped(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) { return grey(warped_at(index)); });
}

template <int Dim>
Raster Pictures<Dim>::difference_before(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) {
    return diverging((moving_at(index) - fixed_at(index)) / difference_range_);
  });
}

template <int Dim>
Raster Pictures<Dim>::difference_after(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) {
    return diverging((warped_at(index) - fixed_at(index)) / difference_range_);
  });
}

template <int Dim>
Raster Pictures<Dim>::checkerboard(const SlicePlane<Dim>& plane) const {
  const int field = std::max(2, (std::max(plane.width, plane.height) + 7) / 8);
  return paint(plane, grid(), [&](const Vector<Dim>& index, int column, int row) {
    const bool is_fixed = (column / field + row / field) % 2 == 0;
    return grey(is_fixed ? fixed_at(index) : warped_at(index));
  });
}

template <int Dim>
Raster Pictures<Dim>::displacement(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) {
    return sequential(displacement_at(index) / displacement_range_);
  });
}

template <int Dim>
Raster Pictures<Dim>::jacobian(const SlicePlane<Dim>& plane) const {
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) {
    const double j = jacobian_at(index);
    return j > 0 ? diverging(std::log2(j) / std::log2(jacobian_range_)) : folded;
  });
}

template <int Dim>
Raster Pictures<Dim>::momentum(const SlicePlane<Dim>& plane, std::size_t field) const {
  const VectorVolume<Dim>& vectors = input_.result->momenta[field].vectors;
  const double range = momentum_ranges_[field] > 0 ? momentum_ranges_[field] : 1;
  return paint(plane, grid(), [&](const Vector<Dim>& index, int, int) {
    const Vector<Dim> nearest = vectors.grid.to_index(grid().to_world(index)).array().round().matrix();
    const double share = sample(vectors, nearest).norm() / range;
    // The image stays visible, dimmed, where the momentum is small.
    return blend(grey(0.1 + 0.45 * std::clamp(fixed_at(index), 0.0, 1.0)), heat(0.35 + 0.65 * share),
                 std::min(1.0, 2.5 * share));
  });
}

template class Pictures<2>;
template class Pictures<3>;

}  // namespace saltus::report
