#pragma once

#include "core/flow/discontinuous/dormand_prince.h"
#include "core/flow/discontinuous/saltation.h"
#include "core/flow/discontinuous/transported_point.h"

#include <vector>

namespace saltus {

/// Grazing: stop there (the derivative of the flow does not exist), or keep to the own side with S = I, which is right
/// for a surface that moves with both sides and that a point touches by rounding only.
enum class GrazingRule { Stop, KeepSide };

struct TrajectoryOptions {
  double position_tolerance = 1e-9;     ///< local error of a step, mm
  double fundamental_tolerance = 1e-8;  ///< the same of the fundamental matrix, relative to 1 + its largest entry
  double event_tolerance =
      1e-11;              ///< |H|/|grad H| at an event, mm; events closer in time than this (times speed) are one
  double grazing = 1e-3;  ///< an approach |n.v - c| of at most this times max(|v-|, |v+|, |c|) is grazing
  double max_step = 0.1;  ///< unit: time
  int max_events = 1000;
  SaltationRule rule = SaltationRule::Filippov;
  GrazingRule when_grazing = GrazingRule::Stop;
  bool keep_steps = false;  ///< needed by endpoint_derivative.h
};

/// Throws InvalidInput when a tolerance, max_step or max_events is not positive.
void check(const TrajectoryOptions& options);

enum class EventKind { Crossing, Sliding, Leaving, Grazing };

/// What happened at a surface. `before` and `after` are velocities, `saltation` is the jump of the fundamental matrix.
template <int Dim>
struct TrajectoryEvent {
  EventKind kind;
  int surface;
  double time;
  Vector<Dim> position;
  Vector<Dim> before, after;
  SurfaceJet<Dim> jet;
  Matrix<Dim> saltation;
  std::size_t steps_before;  ///< steps that lie before it
};

/// A smooth piece: position (first Dim values) and fundamental matrix from the step's start (column by column).
template <int Dim>
struct TrajectoryStep {
  double time, length;
  Sides sides;
  int sliding;  ///< the surface along which it slides, or -1
  DormandPrinceStep<Dim + Dim * Dim> state;
};

template <int Dim>
struct Trajectory {
  TrajectoryEnd ending = TrajectoryEnd::Complete;
  double time;  ///< where it ended
  Vector<Dim> position;
  Matrix<Dim> fundamental;  ///< D of the end with respect to the start: smooth pieces times saltations
  std::vector<TrajectoryEvent<Dim>> events;
  std::vector<TrajectoryStep<Dim>> steps;  ///< empty unless keep_steps

  int count(EventKind kind) const;
};

/// Follows a point from `time` to `until` > time through a piecewise smooth velocity in the sense of Filippov: smooth
/// pieces by Dormand-Prince steps of adaptive length, every crossing located to event_tolerance, in time order. For
/// motion backwards use ReversedVelocity. A point that starts on a surface goes where the flow takes it.
/// Throws InvalidInput when until <= time or as check(options).
template <int Dim>
Trajectory<Dim> follow(const PiecewiseVelocity<Dim>& velocity, const Vector<Dim>& start, double time, double until,
                       const TrajectoryOptions& options = {});

/// Velocity in a smooth piece: of the sides, or Filippov's along `sliding`.
template <int Dim>
VelocityJet<Dim> velocity_of_piece(const PiecewiseVelocity<Dim>& velocity, double t, const Vector<Dim>& x, Sides& sides,
                                   int sliding);

}  // namespace saltus
