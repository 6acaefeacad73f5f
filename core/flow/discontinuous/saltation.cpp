#include "core/flow/discontinuous/saltation.h"

namespace saltus {

template <int Dim>
Matrix<Dim> saltation(const SurfaceJet<Dim>& surface, const Vector<Dim>& before, const Vector<Dim>& after) {
  return Matrix<Dim>::Identity() + (after - before) * surface.gradient.transpose() / surface.along(before);
}

template <int Dim>
Matrix<Dim> saltation(const SurfaceJet<Dim>& surface, const Vector<Dim>& before, const Vector<Dim>& after,
                      SaltationRule rule, bool is_sliding) {
  if (rule == SaltationRule::Filippov) return saltation(surface, before, after);
  const Vector<Dim> n = surface.gradient.normalized();
  if (is_sliding) return Matrix<Dim>::Identity() - n * n.transpose();
  return Matrix<Dim>::Identity() + (after - before) * n.transpose() / (n.dot(before) + surface.rate);
}

template <int Dim>
SlidingMotion<Dim> sliding_motion(const SurfaceJet<Dim>& surface, const VelocityJet<Dim>& minus,
                                  const VelocityJet<Dim>& plus) {
  const double from_minus = surface.along(minus.value), from_plus = surface.along(plus.value);
  const double a = from_minus / (from_minus - from_plus);
  const auto slope = [&](const VelocityJet<Dim>& v) -> Vector<Dim> {
    return surface.hessian * v.value + v.jacobian.transpose() * surface.gradient + surface.rate_gradient;
  };
  const Vector<Dim> slope_of_a = ((1 - a) * slope(minus) + a * slope(plus)) / (from_minus - from_plus);
  SlidingMotion<Dim> motion;
  motion.share_plus = a;
  motion.velocity.value = a * plus.value + (1 - a) * minus.value;
  motion.velocity.jacobian =
      a * plus.jacobian + (1 - a) * minus.jacobian + (plus.value - minus.value) * slope_of_a.transpose();
  return motion;
}

#define SALTUS_SALTATION(DIM)                                                                                          \
  template Matrix<DIM> saltation(const SurfaceJet<DIM>&, const Vector<DIM>&, const Vector<DIM>&);                      \
  template Matrix<DIM> saltation(const SurfaceJet<DIM>&, const Vector<DIM>&, const Vector<DIM>&, SaltationRule, bool); \
  template SlidingMotion<DIM> sliding_motion(const SurfaceJet<DIM>&, const VelocityJet<DIM>&, const VelocityJet<DIM>&);
SALTUS_SALTATION(2)
SALTUS_SALTATION(3)
#undef SALTUS_SALTATION

}  // namespace saltus
