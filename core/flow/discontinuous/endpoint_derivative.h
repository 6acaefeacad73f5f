#pragma once

#include "core/flow/discontinuous/trajectory.h"

namespace saltus {

/// A change of a piecewise smooth velocity: v + eps w, H_k + eps G_k.
template <int Dim>
class FlowPerturbation {
 public:
  struct SurfaceChange {
    double value = 0;  ///< G
    Vector<Dim> gradient = Vector<Dim>::Zero();
    double rate = 0;  ///< G_t
  };
  virtual ~FlowPerturbation() = default;
  virtual Vector<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const = 0;
  virtual SurfaceChange surface(int, double, const Vector<Dim>&) const { return {}; }
};

/// d/deps of the end point of a trajectory (Bao et al., section 4.3),
///
///     integral of Phi(t1, s) w_s(s, x(s)) ds  +  sum over events of Phi(t1, t_e) (after - before) G / (g.before + H_t)
///
/// Phi holds the saltations. The sum is missing in the paper: it is 0 only when the surfaces stay where they are. On a
/// free piece w_s = w. On a sliding piece, with J = v+ - v- and g = grad H,
///
///     w_s = (I - J g^T / g.J) (a w+ + (1-a) w-)  -  J (v_s . grad G + G_t) / g.J
///
/// Integrals by Gauss' rule with 4 nodes a step. Throws InvalidInput unless the trajectory is complete, has its steps
/// and was made by SaltationRule::Filippov.
template <int Dim>
Vector<Dim> endpoint_derivative(const PiecewiseVelocity<Dim>& velocity, const Trajectory<Dim>& trajectory,
                                const FlowPerturbation<Dim>& perturbation);

/// The same read backwards: the functional (w, G) -> dual . endpoint_derivative as sums over places.
template <int Dim>
struct EndpointDual {
  /// vector . w(time, position, sides)
  struct OnVelocity {
    double time;
    Vector<Dim> position;
    Sides sides;
    Vector<Dim> vector;
  };
  /// on_value G + on_gradient . grad G + on_rate G_t
  struct OnSurface {
    int surface;
    double time;
    Vector<Dim> position;
    double on_value;
    Vector<Dim> on_gradient;
    double on_rate;
  };
  std::vector<OnVelocity> velocity;
  std::vector<OnSurface> surface;
  Vector<Dim> at_start;  ///< Phi^T dual: the derivative with respect to the start

  double pairing(const FlowPerturbation<Dim>& perturbation) const;
};

/// `dual` is pulled back along the trajectory: p' = -(D v)^T p, and S^T at each event. Throws as endpoint_derivative.
template <int Dim>
EndpointDual<Dim> pull_back(const PiecewiseVelocity<Dim>& velocity, const Trajectory<Dim>& trajectory,
                            const Vector<Dim>& dual);

}  // namespace saltus
