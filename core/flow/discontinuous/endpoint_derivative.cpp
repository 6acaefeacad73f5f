#include "core/flow/discontinuous/endpoint_derivative.h"

#include "core/support/errors.h"

#include <Eigen/LU>

namespace saltus {
namespace {

constexpr std::array<double, 4> kNode = {0.06943184420297371, 0.33000947820757187, 0.66999052179242813,
                                         0.93056815579702629};
constexpr std::array<double, 4> kWeight = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307,
                                           0.17392742256872693};

template <int Dim>
Matrix<Dim> local_fundamental(const TrajectoryStep<Dim>& step, double share) {
  const auto state = step.state.at(share);
  Matrix<Dim> local;
  for (int c = 0; c < Dim; ++c) local.col(c) = state.template segment<Dim>(Dim + Dim * c);
  return local;
}

/// What a node of a sliding piece makes of w+, w- and G.
template <int Dim>
struct SlidingNode {
  Sides minus, plus;
  double share_plus;
  Matrix<Dim> onto_surface;  ///< I - J g^T / g.J
  Vector<Dim> along_jump;    ///< J / g.J
  Vector<Dim> velocity;

  SlidingNode(const PiecewiseVelocity<Dim>& flow, const TrajectoryStep<Dim>& step, double t, const Vector<Dim>& x)
      : minus(step.sides), plus(step.sides) {
    minus[step.sliding] = -1;
    plus[step.sliding] = 1;
    const SurfaceJet<Dim> jet = flow.surface(step.sliding, t, x);
    const VelocityJet<Dim> from = flow.velocity(t, x, minus), to = flow.velocity(t, x, plus);
    const SlidingMotion<Dim> motion = sliding_motion(jet, from, to);
    const Vector<Dim> jump = to.value - from.value;
    share_plus = motion.share_plus;
    velocity = motion.velocity.value;
    along_jump = jump / jet.gradient.dot(jump);
    onto_surface = Matrix<Dim>::Identity() - along_jump * jet.gradient.transpose();
  }
};

template <int Dim>
void check(const Trajectory<Dim>& trajectory) {
  if (trajectory.ending != TrajectoryEnd::Complete)
    throw InvalidInput("the trajectory ended as \"" + to_string(trajectory.ending) +
                       "\"; only a complete one has a derivative");
  if (trajectory.steps.empty()) throw InvalidInput("the trajectory has no steps; follow it with keep_steps = true");
  for (const auto& event : trajectory.events)
    if (event.kind == EventKind::Grazing)
      throw InvalidInput("the trajectory grazes surface " + std::to_string(event.surface) +
                         "; its end point has no derivative there");
}

/// Weight of G in the jump of the perturbation at an event. Where a motion leaves a surface nothing jumps.
template <int Dim>
Vector<Dim> surface_jump(const TrajectoryEvent<Dim>& event) {
  if (event.kind == EventKind::Leaving || event.after == event.before || event.saltation.isIdentity(0))
    return Vector<Dim>::Zero();
  return (event.after - event.before) / event.jet.along(event.before);
}

}  // namespace

template <int Dim>
Vector<Dim> endpoint_derivative(const PiecewiseVelocity<Dim>& flow, const Trajectory<Dim>& trajectory,
                                const FlowPerturbation<Dim>& perturbation) {
  check(trajectory);
  Vector<Dim> change = Vector<Dim>::Zero();
  auto event = trajectory.events.begin();
  const auto pass_events = [&](std::size_t steps) {
    for (; event != trajectory.events.end() && event->steps_before <= steps; ++event) {
      const double moved = perturbation.surface(event->surface, event->time, event->position).value;
      change = event->saltation * change + surface_jump(*event) * moved;
    }
  };
  for (std::size_t i = 0; i < trajectory.steps.size(); ++i) {
    pass_events(i);
    const TrajectoryStep<Dim>& step = trajectory.steps[i];
    const Matrix<Dim> whole = local_fundamental(step, 1.0);
    Vector<Dim> sum = Vector<Dim>::Zero();
    for (int node = 0; node < 4; ++node) {
      const double t = step.time + kNode[node] * step.length;
      const Vector<Dim> x = step.state.at(kNode[node]).template head<Dim>();
      Vector<Dim> w;
      if (step.sliding < 0) {
        w = perturbation.velocity(t, x, step.sides);
      } else {
        const SlidingNode<Dim> at(flow, step, t, x);
        const auto surface = perturbation.surface(step.sliding, t, x);
        w = at.onto_surface * (at.share_plus * perturbation.velocity(t, x, at.plus) +
                               (1 - at.share_plus) * perturbation.velocity(t, x, at.minus)) -
            at.along_jump * (at.velocity.dot(surface.gradient) + surface.rate);
      }
      sum += kWeight[node] * step.length * local_fundamental(step, kNode[node]).inverse() * w;
    }
    change = whole * (change + sum);
  }
  pass_events(trajectory.steps.size());
  return change;
}

template <int Dim>
EndpointDual<Dim> pull_back(const PiecewiseVelocity<Dim>& flow, const Trajectory<Dim>& trajectory,
                            const Vector<Dim>& dual) {
  check(trajectory);
  EndpointDual<Dim> found;
  Vector<Dim> p = dual;
  auto event = trajectory.events.rbegin();
  const auto pass_events = [&](std::size_t steps) {
    for (; event != trajectory.events.rend() && event->steps_before >= steps; ++event) {
      const Vector<Dim> jump = surface_jump(*event);
      if (!jump.isZero(0))
        found.surface.push_back({event->surface, event->time, event->position, jump.dot(p), Vector<Dim>::Zero(), 0.0});
      p = event->saltation.transpose() * p;
    }
  };
  for (std::size_t i = trajectory.steps.size(); i-- > 0;) {
    pass_events(i + 1);
    const TrajectoryStep<Dim>& step = trajectory.steps[i];
    p = local_fundamental(step, 1.0).transpose() * p;
    for (int node = 0; node < 4; ++node) {
      const double t = step.time + kNode[node] * step.length;
      const Vector<Dim> x = step.state.at(kNode[node]).template head<Dim>();
      const Vector<Dim> here =
          kWeight[node] * step.length * local_fundamental(step, kNode[node]).inverse().transpose() * p;
      if (step.sliding < 0) {
        found.velocity.push_back({t, x, step.sides, here});
        continue;
      }
      const SlidingNode<Dim> at(flow, step, t, x);
      const Vector<Dim> tangential = at.onto_surface.transpose() * here;
      found.velocity.push_back({t, x, at.plus, at.share_plus * tangential});
      found.velocity.push_back({t, x, at.minus, (1 - at.share_plus) * tangential});
      const double normal = -at.along_jump.dot(here);
      found.surface.push_back({step.sliding, t, x, 0.0, normal * at.velocity, normal});
    }
  }
  pass_events(0);
  found.at_start = p;
  return found;
}

template <int Dim>
double EndpointDual<Dim>::pairing(const FlowPerturbation<Dim>& perturbation) const {
  double sum = 0;
  for (const OnVelocity& on : velocity) sum += on.vector.dot(perturbation.velocity(on.time, on.position, on.sides));
  for (const OnSurface& on : surface) {
    const auto change = perturbation.surface(on.surface, on.time, on.position);
    sum += on.on_value * change.value + on.on_gradient.dot(change.gradient) + on.on_rate * change.rate;
  }
  return sum;
}

#define SALTUS_ENDPOINT(DIM)                                                                      \
  template Vector<DIM> endpoint_derivative(const PiecewiseVelocity<DIM>&, const Trajectory<DIM>&, \
                                           const FlowPerturbation<DIM>&);                         \
  template struct EndpointDual<DIM>;                                                              \
  template EndpointDual<DIM> pull_back(const PiecewiseVelocity<DIM>&, const Trajectory<DIM>&, const Vector<DIM>&);
SALTUS_ENDPOINT(2)
SALTUS_ENDPOINT(3)
#undef SALTUS_ENDPOINT

}  // namespace saltus
