#include "core/phantom/lung_motion.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

double smooth_step(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return t * t * t * (10 + t * (6 * t - 15));
}

double smooth_step_slope(double t) {
  if (t <= 0 || t >= 1) return 0;
  return 30 * t * t * (1 - t) * (1 - t);
}

double raw_amount(double xi, double eta) {
  return 0.7 + 0.2 * eta - 0.12 * (xi * xi + eta * eta) + 0.1 * std::cos(2.3 * xi + 0.9 * eta);
}

}  // namespace

LungMotion::LungMotion(Side side, const Vector<2>& body_mm, double height_mm, double displacement_mm)
    : side_(side == Side::Right ? -1 : 1),
      displacement_(side == Side::Right ? displacement_mm : 0.85 * displacement_mm),
      height_(height_mm),
      centre_across_(0.5 * body_mm[0]),
      centre_y_(-0.03 * body_mm[1]),
      half_width_(0.33 * body_mm[0]),
      half_depth_(0.70 * body_mm[1]),
      bend_(0.12 * body_mm[0]),
      apex_(0.42 * height_mm),
      still_above_(0.32 * height_mm),
      full_below_(-0.22 * height_mm) {
  // The largest amount over the cross-section becomes 1.
  double largest = 0;
  for (double eta = -1; eta <= 1; eta += 0.01)
    for (double xi = -1; xi <= 1; xi += 0.01)
      if (xi * xi + eta * eta <= 1) largest = std::max(largest, raw_amount(xi, eta));
  amount_scale_ = 1 / largest;
}

double LungMotion::taper(double zeta) const {
  return 1 - 0.45 * smooth_step((zeta + 0.30 * height_) / (0.75 * height_));
}

double LungMotion::centre_x(double zeta) const {
  return centre_across_ * (1 - 0.16 * smooth_step((zeta + 0.30 * height_) / (0.75 * height_)));
}

double LungMotion::ramp(double zeta) const { return smooth_step((still_above_ - zeta) / (still_above_ - full_below_)); }

double LungMotion::ramp_slope(double zeta) const {
  const double length = still_above_ - full_below_;
  return -smooth_step_slope((still_above_ - zeta) / length) / length;
}

double LungMotion::amount(double xi, double eta) const { return amount_scale_ * displacement_ * raw_amount(xi, eta); }

double LungMotion::turn(double squared_radius, double zeta) const {
  const double rim = 1 - std::min(squared_radius, 1.0);
  return 0.006 * displacement_ * rim * rim * ramp(zeta);
}

Vector<3> LungMotion::to_organ(const Vector<3>& world) const {
  const double s = taper(world[2]);
  const double eta = (world[1] - centre_y_) / (s * half_depth_);
  const double xi = ((side_ * world[0] - centre_x(world[2])) / s + bend_ * eta * eta) / half_width_;
  return {xi, eta, world[2]};
}

Vector<3> LungMotion::to_world(const Vector<3>& organ) const {
  const double s = taper(organ[2]);
  const double x = centre_x(organ[2]) + s * (half_width_ * organ[0] - bend_ * organ[1] * organ[1]);
  return {side_ * x, centre_y_ + s * half_depth_ * organ[1], organ[2]};
}

Vector<3> LungMotion::to_moving(const Vector<3>& organ) const {
  const double zeta = organ[2] - amount(organ[0], organ[1]) * ramp(organ[2]);
  const double angle = turn(organ[0] * organ[0] + organ[1] * organ[1], zeta);
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * organ[0] - s * organ[1], s * organ[0] + c * organ[1], zeta};
}

Vector<3> LungMotion::to_fixed(const Vector<3>& organ) const {
  const double angle = turn(organ[0] * organ[0] + organ[1] * organ[1], organ[2]);
  const double c = std::cos(angle), s = std::sin(angle);
  const double xi = c * organ[0] + s * organ[1];
  const double eta = -s * organ[0] + c * organ[1];
  const double most = amount(xi, eta);
  // f(zeta) = zeta - most g(zeta) - zeta' has slope 1 at least and its root in [zeta', zeta' + most]:
  // Newton's method, with bisection where it would leave the bracket.
  double low = organ[2], high = organ[2] + most;
  double zeta = organ[2] + most * ramp(organ[2]);
  for (int iteration = 0; iteration < 100; ++iteration) {
    const double residual = zeta - most * ramp(zeta) - organ[2];
    if (std::abs(residual) < 1e-12 * height_) break;
    (residual > 0 ? high : low) = zeta;
    zeta -= residual / (1 - most * ramp_slope(zeta));
    if (!(zeta >= low && zeta <= high)) zeta = 0.5 * (low + high);
  }
  return {xi, eta, zeta};
}

double LungMotion::jacobian(const Vector<3>& organ) const {
  const double most = amount(organ[0], organ[1]);
  const double ratio = taper(organ[2] - most * ramp(organ[2])) / taper(organ[2]);
  return ratio * ratio * (1 - most * ramp_slope(organ[2]));
}

double LungMotion::wall_distance(const Vector<3>& world) const {
  auto radius = [this](const Vector<3>& p) { return std::hypot(to_organ(p)[0], to_organ(p)[1]); };
  constexpr double kStep = 1e-3;
  Vector<3> gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector<3> step = kStep * Vector<3>::Unit(axis);
    gradient[axis] = (radius(world + step) - radius(world - step)) / (2 * kStep);
  }
  return (radius(world) - 1) / std::max(gradient.norm(), 1e-9);
}

double LungMotion::cap(const Vector<3>& organ) const {
  const double squared = organ[0] * organ[0] + organ[1] * organ[1];
  return apex_ - 0.07 * height_ * (1 - std::sqrt(std::max(0.0, 1 - squared)));
}

double LungMotion::diaphragm(const Vector<3>& organ) const {
  const double squared = organ[0] * organ[0] + organ[1] * organ[1];
  return -0.31 * height_ + 0.15 * height_ * (1 - squared) - 0.06 * height_ * organ[1] +
         (side_ < 0 ? 0.015 * height_ : 0);
}

bool LungMotion::is_lung(const Vector<3>& organ) const {
  return organ[0] * organ[0] + organ[1] * organ[1] < 1 && organ[2] > diaphragm(organ) && organ[2] < cap(organ);
}

}  // namespace saltus
