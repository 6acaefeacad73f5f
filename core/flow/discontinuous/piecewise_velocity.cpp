#include "core/flow/discontinuous/piecewise_velocity.h"

#include <numeric>

namespace saltus {

template <int Dim>
void PiecewiseVelocity<Dim>::surfaces_near(double, const Vector<Dim>&, double, std::vector<int>& found) const {
  found.resize(static_cast<std::size_t>(surfaces()));
  std::iota(found.begin(), found.end(), 0);
}

template <int Dim>
SurfaceJet<Dim> ReversedVelocity<Dim>::surface(int which, double t, const Vector<Dim>& x) const {
  SurfaceJet<Dim> jet = forward_.surface(which, -t, x);
  jet.rate = -jet.rate;
  jet.rate_gradient = -jet.rate_gradient;
  return jet;
}

template <int Dim>
VelocityJet<Dim> ReversedVelocity<Dim>::velocity(double t, const Vector<Dim>& x, const Sides& sides) const {
  VelocityJet<Dim> jet = forward_.velocity(-t, x, sides);
  jet.value = -jet.value;
  jet.jacobian = -jet.jacobian;
  return jet;
}

template <int Dim>
void ReversedVelocity<Dim>::surfaces_near(double t, const Vector<Dim>& x, double reach, std::vector<int>& found) const {
  forward_.surfaces_near(-t, x, reach, found);
}

template <int Dim>
std::vector<double> ReversedVelocity<Dim>::time_breaks() const {
  const std::vector<double> forward = forward_.time_breaks();
  std::vector<double> breaks;
  for (auto t = forward.rbegin(); t != forward.rend(); ++t) breaks.push_back(-*t);
  return breaks;
}

template class PiecewiseVelocity<2>;
template class PiecewiseVelocity<3>;
template class ReversedVelocity<2>;
template class ReversedVelocity<3>;

}  // namespace saltus
