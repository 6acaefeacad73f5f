#include "core/registration/move_points.h"

#include "core/flow/discontinuous/transport_points.h"
#include "core/slip/slip_sheets.h"
#include "core/support/errors.h"

#include <algorithm>

namespace saltus {

template <int Dim>
void check_points(const std::vector<Vector<Dim>>& points) {
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!points[i].allFinite())
      throw InvalidInput("fixed_points: point " + std::to_string(i + 1) +
                         " is not finite; leave it out or give its coordinates");
}

template <int Dim>
std::vector<TransportedPoint<Dim>> move_points(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                                               const std::vector<Field<float>>& velocities,
                                               const std::vector<MomentumScale<Dim, float>*>& scales,
                                               const std::vector<MomentumPointers<float>>& momenta) {
  if (input.fixed_points.empty()) return {};
  std::vector<SwitchingSheet<Dim>> sheets;
  // Oriented momenta lie on the sites around their surface and not between them, where faces do: then all that jumps is
  // taken together.
  const bool is_oblique = std::any_of(momenta.begin(), momenta.end(), [](const MomentumPointers<float>& scale) {
    return scale.elements && !scale.elements->empty();
  });
  if (is_oblique) {
    std::vector<JumpElements<Dim>> jumps;
    for (std::size_t s = 0; s < scales.size(); ++s)
      for (auto& of_kernel : jump_elements<Dim, float>(*scales[s], momenta[s])) jumps.push_back(std::move(of_kernel));
    sheets = slip_sheets<Dim>(jumps, lattice, velocities);
  }
  for (std::size_t s = 0; s < scales.size() && !is_oblique; ++s)
    if (scales[s]->has_first_order())
      for (auto& sheet : find_switching_sheets<Dim, float>(*scales[s], momenta[s].first, lattice, velocities))
        sheets.push_back(std::move(sheet));
  const ImageGrid<Dim>& fixed = input.fixed.grid;
  std::vector<Vector<Dim>> frame;
  for (const Vector<Dim>& world : input.fixed_points)
    frame.push_back(fixed.direction.transpose() * (world - fixed.origin));
  const GriddedVelocity<Dim, float> velocity(lattice, velocities, std::move(sheets));
  std::vector<TransportedPoint<Dim>> moved = transport_points<Dim, float>(
      velocity, frame, TransportDirection::FixedToMoving, gridded_trajectory_options(lattice));
  for (TransportedPoint<Dim>& point : moved) {
    point.position = input.start(fixed.origin + fixed.direction * point.position);
    point.fundamental = input.start.linear * fixed.direction * point.fundamental * fixed.direction.transpose();
  }
  return moved;
}

#define SALTUS_MOVE_POINTS(DIM)                                                             \
  template void check_points(const std::vector<Vector<DIM>>&);                              \
  template std::vector<TransportedPoint<DIM>> move_points(                                  \
      const RegistrationInput<DIM>&, const Lattice<DIM>&, const std::vector<Field<float>>&, \
      const std::vector<MomentumScale<DIM, float>*>&, const std::vector<MomentumPointers<float>>&);
SALTUS_MOVE_POINTS(2)
SALTUS_MOVE_POINTS(3)
#undef SALTUS_MOVE_POINTS

}  // namespace saltus
