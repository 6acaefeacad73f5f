#pragma once

#include "core/grid/lattice.h"

#include <vector>

namespace saltus {

/// psi = phi_1^-1 on the sites of a lattice: each site is followed back from t = 1 to 0 through the nodes' velocities
/// with Heun's rule (second order). No map is ever interpolated, so a jump stays as sharp as the velocity has it.
template <int Dim, class T>
class BackwardMap {
 public:
  BackwardMap(const Lattice<Dim>& points, const Lattice<Dim>& velocity_lattice, int time_steps);

  /// psi(x) - x, mm, interleaved. Valid until the next call.
  const Field<T>& follow(const std::vector<Field<T>>& velocities);

  /// Adjoint of the last follow: adds to velocity_duals what `dual` of psi(x) - x makes of the velocities; what
  /// is left in `dual` means nothing.
  void adjoint(const std::vector<Field<T>>& velocities, Field<T>& dual, std::vector<Field<T>>& velocity_duals);

 private:
  Lattice<Dim> points_, lattice_;
  int time_steps_;
  /// Displacement at node k; [time_steps] is empty, meaning 0, and [0], which nothing follows on, serves the adjoint.
  std::vector<Field<T>> position_;
};

/// What BackwardMap::follow gives, where no adjoint is wanted: one field and nothing else.
template <int Dim, class T>
Field<T> backward_map(const Lattice<Dim>& points, const Lattice<Dim>& velocity_lattice,
                      const std::vector<Field<T>>& velocities);

/// How far backward_map is from what it would be with ever more nodes, between which v is linear in time: at most so
/// far, mm, at 99.9 % of the sites of the velocities' own lattice. From the same map with twice as many steps, the
/// error being of second order.
template <int Dim, class T>
double map_error(const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities);

/// phi_1(y) of a point in the frame, mm: the inverse of what BackwardMap::follow does to it, not another approximation
/// of the flow. Each step of follow is undone by x <- x + (target - step(x)) from Heun's guess, which contracts by
/// about |D v| / time_steps (at once in a pure shear), until the target is met to a thousandth of the smallest spacing
/// or a step brings it no closer: across a jump, where psi is not onto, the nearest point found stands.
template <int Dim, class T>
Vector<Dim> forward_point(const Lattice<Dim>& velocity_lattice, const std::vector<Field<T>>& velocities,
                          const Vector<Dim>& start);

/// phi_1(y) by Heun's rule alone: within the error of the time steps of forward_point, at a quarter of its price or
/// less.
template <int Dim, class T>
Vector<Dim> forward_guess(const Lattice<Dim>& velocity_lattice, const std::vector<Field<T>>& velocities,
                          const Vector<Dim>& start);

/// The same for all sites x of a lattice from where `moved` (mm by site) has brought them: x + moved goes from y to
/// forward_guess(y).
template <int Dim, class T>
void move_forward(const Lattice<Dim>& points, const Lattice<Dim>& velocity_lattice,
                  const std::vector<Field<T>>& velocities, Field<T>& moved);

/// phi_1(y) - y on the sites of a lattice, mm.
template <int Dim, class T>
Field<T> forward_map(const Lattice<Dim>& points, const Lattice<Dim>& velocity_lattice,
                     const std::vector<Field<T>>& velocities);

}  // namespace saltus
