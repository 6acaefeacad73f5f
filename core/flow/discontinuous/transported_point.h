#pragma once

#include "core/grid/image_grid.h"

#include <string>

namespace saltus {

/// How a trajectory ended. All but Complete leave it where it was.
enum class TrajectoryEnd {
  Complete,       ///< reached the end of time
  Escaping,       ///< on a surface that both sides leave (n.v- < c < n.v+): no unique continuation
  Grazing,        ///< met a surface too nearly along it, see TrajectoryOptions::grazing
  Corner,         ///< met several surfaces at once and their order matters
  TooManyEvents,  ///< crosses without end (chattering), see TrajectoryOptions::max_events
  StepTooSmall,   ///< the tolerances cannot be met: the velocity is not smooth where it should be
  NotFinite       ///< velocity or position is not a finite number
};
std::string to_string(TrajectoryEnd end);

/// Where a point went, and what it met. Position and matrix are those at its end also when that is not Complete.
template <int Dim>
struct TransportedPoint {
  Vector<Dim> position;
  Matrix<Dim> fundamental;  ///< D of the position with respect to the start; one-sided at an interface
  TrajectoryEnd ending = TrajectoryEnd::Complete;
  int crossed = 0, slid = 0, grazed = 0;  ///< numbers of events
};

}  // namespace saltus
