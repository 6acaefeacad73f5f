#include "core/phantom/smooth_scene.h"

#include <cmath>
#include <limits>

#include "core/phantom/scene_support.h"
#include "core/support/random.h"

namespace saltus {
namespace {

constexpr double kTwoPi = 2 * 3.14159265358979323846;
constexpr double kShear = 0.7;  ///< of the displacement
constexpr double kStretch = 0.35;

}  // namespace

template <int Dim>
SmoothScene<Dim>::SmoothScene(const PhantomOptions& options, const ImageGrid<Dim>& grid)
    : options_(options), grid_(grid), texture_(grey_texture_scales<Dim>(), options.seed) {
  RandomSequence random(options.seed, 23);
  for (int axis = 0; axis < Dim; ++axis) {
    frequency_[axis] = kTwoPi / (grid.size[axis] * grid.spacing[axis]);
    phase_[axis] = random.uniform(0, kTwoPi);
  }
}

template <int Dim>
double SmoothScene<Dim>::shear(const Vector<Dim>& p, int axis) const {
  double angle = phase_[axis];
  for (int other = 0; other < Dim; ++other)
    if (other != axis) angle += frequency_[other] * p[other];
  return kShear * options_.displacement_mm * std::sin(angle);
}

template <int Dim>
Vector<Dim> SmoothScene<Dim>::to_moving(const Vector<Dim>& x) const {
  Vector<Dim> p = x;
  for (int axis = 0; axis < Dim; ++axis)
    p[axis] += kStretch * options_.displacement_mm * std::sin(frequency_[axis] * (x[axis] - grid_.origin[axis]));
  for (int axis = 0; axis < Dim; ++axis) p[axis] += shear(p, axis);
  return p;
}

template <int Dim>
Vector<Dim> SmoothScene<Dim>::to_fixed(const Vector<Dim>& y) const {
  Vector<Dim> p = y;
  for (int axis = Dim - 1; axis >= 0; --axis) p[axis] -= shear(p, axis);
  Vector<Dim> x = p;
  const double amount = kStretch * options_.displacement_mm;
  for (int axis = 0; axis < Dim; ++axis) {
    // The slope stays within 1 -+ 0.33 (see problems), so Newton's steps contract from anywhere.
    for (int iteration = 0; iteration < 50; ++iteration) {
      const double angle = frequency_[axis] * (x[axis] - grid_.origin[axis]);
      const double step =
          (x[axis] + amount * std::sin(angle) - p[axis]) / (1 + amount * frequency_[axis] * std::cos(angle));
      x[axis] -= step;
      if (std::abs(step) < 1e-12) break;
    }
  }
  return x;
}

template <int Dim>
double SmoothScene<Dim>::jacobian(const Vector<Dim>& x) const {
  double determinant = 1;  // shears have determinant 1
  for (int axis = 0; axis < Dim; ++axis)
    determinant *= 1 + kStretch * options_.displacement_mm * frequency_[axis] *
                           std::cos(frequency_[axis] * (x[axis] - grid_.origin[axis]));
  return determinant;
}

template <int Dim>
double SmoothScene<Dim>::interface_distance(const Vector<Dim>&) const {
  return std::numeric_limits<double>::infinity();
}

template <int Dim>
bool SmoothScene<Dim>::is_valid(const Vector<Dim>& x) const {
  return is_inside<Dim>(grid_, x, 1) && is_inside<Dim>(grid_, to_moving(x), 1);
}

template <int Dim>
std::vector<Vector<Dim>> SmoothScene<Dim>::moving_landmarks() const {
  return scattered_landmarks<Dim>(*this, grid_, options_.seed);
}

template class SmoothScene<2>;
template class SmoothScene<3>;

}  // namespace saltus
