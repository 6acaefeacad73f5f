#pragma once

#include "core/flow/discontinuous/endpoint_derivative.h"

#include <functional>

namespace saltus::testing {

/// A piecewise smooth velocity put together from functions; everything can depend on a parameter, so that differences
/// in it can be taken.
template <int Dim>
class AnalyticVelocity : public PiecewiseVelocity<Dim> {
 public:
  using Surface = std::function<SurfaceJet<Dim>(double, const Vector<Dim>&)>;
  using Velocity = std::function<VelocityJet<Dim>(double, const Vector<Dim>&, const Sides&)>;
  AnalyticVelocity(std::vector<Surface> surfaces, Velocity velocity)
      : surfaces_(std::move(surfaces)), velocity_(std::move(velocity)) {}
  int surfaces() const override { return static_cast<int>(surfaces_.size()); }
  SurfaceJet<Dim> surface(int which, double t, const Vector<Dim>& x) const override { return surfaces_[which](t, x); }
  VelocityJet<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const override {
    return velocity_(t, x, sides);
  }

 private:
  std::vector<Surface> surfaces_;
  Velocity velocity_;
};

/// H = scale (n.x - position - speed t) with |n| = 1.
template <int Dim>
auto moving_plane(Vector<Dim> n, double position, double speed, double scale = 1) {
  return [=](double t, const Vector<Dim>& x) {
    SurfaceJet<Dim> jet;
    jet.value = scale * (n.dot(x) - position - speed * t);
    jet.gradient = scale * n;
    jet.rate = -scale * speed;
    return jet;
  };
}

/// H = |x|^2 - (radius + speed t)^2: no distance.
template <int Dim>
auto growing_ball(double radius, double speed) {
  return [=](double t, const Vector<Dim>& x) {
    SurfaceJet<Dim> jet;
    const double r = radius + speed * t;
    jet.value = x.squaredNorm() - r * r;
    jet.gradient = 2 * x;
    jet.rate = -2 * r * speed;
    jet.hessian = 2 * Matrix<Dim>::Identity();
    return jet;
  };
}

template <int Dim>
VelocityJet<Dim> affine(const Vector<Dim>& offset, const Matrix<Dim>& linear, const Vector<Dim>& x) {
  return {offset + linear * x, linear};
}

/// Waves of size 1 / scale, smooth in space and time.
template <int Dim>
VelocityJet<Dim> wave(int seed, double t, const Vector<Dim>& x, double scale = 1) {
  VelocityJet<Dim> jet;
  for (int c = 0; c < Dim; ++c) {
    Vector<Dim> k;
    for (int a = 0; a < Dim; ++a) k[a] = scale * (0.7 + 0.4 * std::sin(1.7 * seed + 2.3 * c + 3.1 * a));
    const double phase = k.dot(x) + 0.9 * t + seed + c;
    jet.value[c] = 0.3 * std::sin(phase);
    jet.jacobian.row(c) = 0.3 * std::cos(phase) * k.transpose();
  }
  return jet;
}

template <int Dim>
VelocityJet<Dim> operator+(VelocityJet<Dim> a, const VelocityJet<Dim>& b) {
  a.value += b.value;
  a.jacobian += b.jacobian;
  return a;
}

/// D of the end point with respect to the start by central differences.
template <int Dim>
Matrix<Dim> differenced_fundamental(const PiecewiseVelocity<Dim>& velocity, const Vector<Dim>& start, double time,
                                    double until, double step, const TrajectoryOptions& options = {}) {
  Matrix<Dim> found;
  for (int c = 0; c < Dim; ++c)
    found.col(c) = (follow<Dim>(velocity, start + step * Vector<Dim>::Unit(c), time, until, options).position -
                    follow<Dim>(velocity, start - step * Vector<Dim>::Unit(c), time, until, options).position) /
                   (2 * step);
  return found;
}

}  // namespace saltus::testing
