#include "core/momenta/oriented_momenta.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/similarity/similarity.h"
#include "core/support/registers.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
std::size_t memory_estimate(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving,
                            const RegistrationOptions& asked) {
  const Lattice<Dim> image = lattice_of(fixed);
  const RegistrationOptions options = resolved(asked, image);
  const RegistrationOptions::Momenta& m = options.momenta;
  const double full = static_cast<double>(fixed.voxels()), full_moving = static_cast<double>(moving.voxels());
  const double steps = options.flow.time_steps;
  const double nodes = steps * std::max(options.flow.map_steps, options.flow.map_tolerance > 0 ? kMostMapSteps : 1) + 1;
  constexpr double vector = Dim * sizeof(float), scalar = sizeof(float);
  const double similarity = scalar * similarity_scratch(options.similarity, Dim);
  const auto sites_of = [&](int level) { return static_cast<double>(level_lattice(image, level).sites()); };

  // What one round holds: see the members of MatchingObjective and of what it owns. `smooth`: order 0 is alone.
  const int finest = options.pyramid.finest_level, coarsening = options.flow.coarsening;
  const double level = sites_of(finest);
  const auto round_bytes = [&](bool smooth) {
    double bytes = level * (8 * scalar + similarity);  // images, weights, duals
    const Lattice<Dim> flow_lattice = level_lattice(image, smooth ? finest + coarsening : finest);
    const double flow = static_cast<double>(flow_lattice.sites());
    // Planes on the way from a coarser lattice, see LatticeInterpolation.
    const auto planes_between = [&](const Lattice<Dim>& coarse, const Lattice<Dim>& fine) {
      return coarse == fine ? 0.0
                            : static_cast<double>(coarse.sites()) / coarse.size[Dim - 1] * fine.size[Dim - 1] * vector;
    };
    bytes += planes_between(flow_lattice, level_lattice(image, finest));
    bytes += flow * (2 * nodes * vector        // velocities and their duals
                     + (nodes + 2) * vector);  // map and its adjoint's work
    double unknowns = 0, dense = 0;            // momenta, and those of order 0
    // Once for each lattice: where its sites are, with their duals. Then for each scale its momenta.
    const auto add_lattice = [&](int q) {
      const Lattice<Dim> lattice = level_lattice(image, q);
      const double sites = static_cast<double>(lattice.sites());
      bytes += sites * (2 * steps + 5) * vector + planes_between(lattice, flow_lattice);
      if (options.flow.evolution != Evolution::Carried) bytes += sites * 2 * Dim * vector;  // Jacobians
    };
    const auto is_first_at = [&](int q) {
      return !smooth && q >= m.first_order_finest_scale && q < m.first_order_finest_scale + m.first_order_scales &&
             q <= std::max(m.finest_scale + m.scales - 1, m.first_order_finest_scale);
    };
    const bool shares = options.model == Model::Wendland1 || options.model == Model::Directional;
    for (int q = m.finest_scale; q < m.finest_scale + m.scales; ++q) {
      const int placed = shares && is_first_at(q) ? q : q + coarsening;
      const double sites = sites_of(placed);
      unknowns += Dim * sites;
      dense += Dim * sites;
      add_lattice(placed);
      // Its momentum; one for the passes of a sum of widths; the velocity where another scale's is on the lattice
      // before.
      const bool adds_velocity = placed > q && is_first_at(placed);
      bytes += sites * (1 + (m.kernel_widths.size() > 1 ? 1 : 0) + (adds_velocity ? 1 : 0)) * vector;
    }
    for (int q = m.first_order_finest_scale; is_first_at(q); ++q) {
      const double sites = sites_of(q);
      unknowns += Dim * Dim * sites;
      if (coarsening > 0 || q < m.finest_scale || q >= m.finest_scale + m.scales) add_lattice(q);
      bytes += sites * ((m.first_order_kernel_widths.size() > 1 ? 6 : 5) * vector + Dim * vector);
      // With sparsity only active blocks are unknowns, beside momenta and gradients at all sites. How many there will
      // be is not known: nearly all, at worst.
      if (m.sparsity > 0) bytes += sites * 2 * Dim * vector;
      if (options.model == Model::Directional) bytes += sites * 2 * Dim * vector;
      // Oriented momenta: normals, and a field in padded rows, at all sites, weights (and those before them) for all
      // elements. One element may join at a site that has room for one.
      if (m.orientations > 0) {
        const Lattice<Dim> lattice = level_lattice(image, q);
        const double row = lattice.size[0], padded = (row + static_cast<double>(kRegisterLanes<float>)) / row;
        bytes += sites * ((2 + padded) * vector + 2 * m.orientations * scalar);
        unknowns += (Dim - 1) * static_cast<double>(sites_with_room(lattice, first_order_width(image, options, q),
                                                                    kElementSpacing<Dim>));
      }
    }
    // L-BFGS, see MinimiserState, and one vector on its way while momenta join; a checkpoint goes straight to a file.
    bytes += scalar * (unknowns * (2 * options.optimisation.history + 7) + dense * (options.optimisation.history + 2));
    return bytes;
  };
  const bool has_first = m.first_order_scales > 0;
  const double level_bytes = std::max(round_bytes(true), has_first ? round_bytes(false) : 0.0);

  // At the end: map, displacement and the frame at rest, Jacobian and warped image, both images again with what warps
  // them, and the similarity at full resolution; the inverse; velocities.
  const double flow = sites_of(has_first ? finest : finest + coarsening);
  const double end_bytes =
      full * (3 * vector + 8 * scalar + similarity) + full_moving * (vector + 8 + 2 * scalar) + flow * nodes * vector;
  const double input_bytes = scalar * (full + full_moving);
  return static_cast<std::size_t>(input_bytes + std::max(level_bytes, end_bytes)) + (64u << 20);
}

template std::size_t memory_estimate(const ImageGrid<2>&, const ImageGrid<2>&, const RegistrationOptions&);
template std::size_t memory_estimate(const ImageGrid<3>&, const ImageGrid<3>&, const RegistrationOptions&);

}  // namespace saltus
