#include "core/flow/discontinuous/transport_points.h"

#include "core/support/errors.h"

#include <algorithm>

namespace saltus {

template <int Dim>
TrajectoryOptions gridded_trajectory_options(const Lattice<Dim>& lattice) {
  const double spacing = *std::min_element(lattice.spacing.begin(), lattice.spacing.end());
  TrajectoryOptions options;
  options.position_tolerance = 1e-4 * spacing;
  options.fundamental_tolerance = 1e-2;
  options.event_tolerance = 1e-6 * spacing;
  options.max_step = 1;
  options.when_grazing = GrazingRule::KeepSide;
  return options;
}

template <int Dim, class T>
std::vector<TransportedPoint<Dim>> transport_points(const GriddedVelocity<Dim, T>& velocity,
                                                    const std::vector<Vector<Dim>>& points,
                                                    TransportDirection direction, const TrajectoryOptions& options) {
  check(options);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!points[i].allFinite())
      throw InvalidInput("point " + std::to_string(i) + " is not finite; leave it out or give its coordinates");
  const ReversedVelocity<Dim> reversed(velocity);
  std::vector<TransportedPoint<Dim>> found(points.size());
#pragma omp parallel for schedule(dynamic, 8)
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Trajectory<Dim> path = direction == TransportDirection::MovingToFixed
                                     ? follow<Dim>(velocity, points[i], 0.0, 1.0, options)
                                     : follow<Dim>(reversed, points[i], -1.0, 0.0, options);
    found[i] = {path.position,
                path.fundamental,
                path.ending,
                path.count(EventKind::Crossing),
                path.count(EventKind::Sliding),
                path.count(EventKind::Grazing)};
  }
  return found;
}

#define SALTUS_TRANSPORT(DIM, T)                                \
  template std::vector<TransportedPoint<DIM>> transport_points( \
      const GriddedVelocity<DIM, T>&, const std::vector<Vector<DIM>>&, TransportDirection, const TrajectoryOptions&);
template TrajectoryOptions gridded_trajectory_options(const Lattice<2>&);
template TrajectoryOptions gridded_trajectory_options(const Lattice<3>&);
SALTUS_TRANSPORT(2, float)
SALTUS_TRANSPORT(3, float)
SALTUS_TRANSPORT(2, double)
SALTUS_TRANSPORT(3, double)
#undef SALTUS_TRANSPORT

}  // namespace saltus
