#include "core/phantom/planar_scene.h"

#include <algorithm>
#include <cmath>

#include "core/phantom/scene_support.h"

namespace saltus {
namespace {

constexpr double kRadian = 3.14159265358979323846 / 180;

template <int Dim>
Vector<2> scene_centre(const PhantomOptions& options, const ImageGrid<Dim>& grid) {
  Vector<2> index((grid.size[0] - 1) / 2.0, (grid.size[1] - 1) / 2.0);
  // The paper's wheel turns about pixel (101, 100) of 202x202.
  if (options.kind == PhantomKind::Wheel) index = Vector<2>(grid.size[0] / 2, grid.size[1] / 2 - 1);
  return grid.origin.template head<2>() + index.cwiseProduct(grid.spacing.template head<2>());
}

Vector<2> rotated(const Vector<2>& p, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * p[0] - s * p[1], s * p[0] + c * p[1]};
}

/// The paper's rectangle: dark, a linear rise, a slower linear fall. `t` in mm from the centre, `length` of the image.
double tent(double t, double length) {
  const double pixels = 80 * t / length - 2.5;
  return std::max(17.0, pixels < 0 ? 253 + 5.6 * pixels : 253 - 4.4 * pixels);
}

}  // namespace

template <int Dim>
PlanarScene<Dim>::PlanarScene(const PhantomOptions& options, const ImageGrid<Dim>& grid)
    : options_(options),
      grid_(grid),
      centre_(scene_centre(options, grid)),
      tangent_(std::cos(options.angle_deg * kRadian), std::sin(options.angle_deg * kRadian)),
      texture_(grey_texture_scales<Dim>(), options.seed) {
  if (options.kind == PhantomKind::Wheel) options_.interface = InterfaceShape::Circle;
  if (options.kind == PhantomKind::Rectangle) options_.interface = InterfaceShape::Line;
  if (options.kind == PhantomKind::Slip) options_.texture = TextureKind::Blobs;
}

template <int Dim>
bool PlanarScene<Dim>::is_circle() const {
  return options_.interface == InterfaceShape::Circle;
}

template <int Dim>
double PlanarScene<Dim>::moving(const Vector<Dim>& y) const {
  if (options_.texture == TextureKind::Blobs) return 128 + texture_(y);
  const Vector<2> p = y.template head<2>() - centre_;
  if (is_circle()) return 220 - 192 * std::abs(std::atan2(p[1], p[0])) / (180 * kRadian);
  return tent(tangent_.dot(p), grid_.size[0] * grid_.spacing[0]);
}

template <int Dim>
Vector<Dim> PlanarScene<Dim>::moved(const Vector<Dim>& from, double sign) const {
  Vector<Dim> to = from;
  const bool inner = interface_distance(from) < 0;
  const Vector<2> p = from.template head<2>() - centre_;
  if (!is_circle()) {
    to.template head<2>() += sign * (inner ? -0.5 : 0.5) * options_.slip_mm * tangent_;
    return to;
  }
  double angle = (inner ? 1 : -1) * options_.rotation_deg * kRadian;
  if (options_.kind == PhantomKind::Slip)
    angle = inner ? options_.slip_mm / (2 * options_.radius_mm) : -options_.slip_mm / (2 * p.norm());
  to.template head<2>() = centre_ + rotated(p, sign * angle);
  return to;
}

template <int Dim>
Vector<Dim> PlanarScene<Dim>::to_moving(const Vector<Dim>& x) const {
  return moved(x, 1);
}

// The sides and the radius are the same in both images, so the opposite amount is the inverse.
template <int Dim>
Vector<Dim> PlanarScene<Dim>::to_fixed(const Vector<Dim>& y) const {
  return moved(y, -1);
}

template <int Dim>
double PlanarScene<Dim>::interface_distance(const Vector<Dim>& x) const {
  const Vector<2> p = x.template head<2>() - centre_;
  if (is_circle()) return p.norm() - options_.radius_mm;
  return tangent_[0] * p[1] - tangent_[1] * p[0];
}

template <int Dim>
bool PlanarScene<Dim>::is_valid(const Vector<Dim>& x) const {
  const double pixel = grid_.spacing[0];
  switch (options_.kind) {
    case PhantomKind::Wheel: {
      // The paper's annulus: the ramp has no scale at the centre, and the corners are seen once only.
      const double radius = (x.template head<2>() - centre_).norm();
      return radius >= 8 * pixel &&
             radius <= (std::min(grid_.size[0] * pixel, grid_.size[1] * grid_.spacing[1]) / 2 - 9 * pixel);
    }
    case PhantomKind::Rectangle: {
      // Columns 14 to 65 of the paper's scene: nine pixels more than the motion, along it, on both ends.
      Vector<Dim> reach = Vector<Dim>::Zero();
      reach.template head<2>() = (std::abs(options_.slip_mm) / 2 + 9 * pixel) * tangent_;
      return is_inside<Dim>(grid_, x + reach, 0) && is_inside<Dim>(grid_, x - reach, 0);
    }
    default:
      break;
  }
  return is_inside<Dim>(grid_, x, 1) && is_inside<Dim>(grid_, to_moving(x), 1);
}

template <int Dim>
int PlanarScene<Dim>::moving_label(const Vector<Dim>& y) const {
  return moving(y) > 128 ? 1 : 0;
}

template <int Dim>
std::vector<Vector<Dim>> PlanarScene<Dim>::moving_landmarks() const {
  return scattered_landmarks<Dim>(*this, grid_, options_.seed);
}

template class PlanarScene<2>;
template class PlanarScene<3>;

}  // namespace saltus
