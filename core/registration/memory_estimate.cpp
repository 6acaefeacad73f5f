#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/similarity/similarity.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim>
std::size_t memory_estimate(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving,
                            const RegistrationOptions& asked) {
  const Lattice<Dim> image = lattice_of(fixed);
  const RegistrationOptions options = resolved(asked, image);
  const double full = static_cast<double>(fixed.voxels()), full_moving = static_cast<double>(moving.voxels());
  const double nodes = options.flow.time_steps * options.flow.map_steps + 1;
  constexpr double vector = Dim * sizeof(float), scalar = sizeof(float);
  const double similarity = scalar * similarity_scratch(options.similarity, Dim);

  // What register_images holds on its finest level: see the members of MatchingObjective and of what it owns.
  const double level = static_cast<double>(level_lattice(image, options.pyramid.finest_level).sites());
  const double scatter = Dim * scalar + 3 * scalar;               // a ScatterPlan: point, plane and order of each site
  double level_bytes = level * (2 * nodes * vector                // velocities and their duals
                                + (nodes + 5) * vector + scatter  // backward map and its adjoint's work
                                + 6 * scalar + similarity);       // images, weights, duals
  const RegistrationOptions::Momenta& m = options.momenta;
  double unknowns = 0;
  // Once for each lattice: where its sites are, with their duals, Jacobians and plan. Then for each scale its momenta.
  const auto add_lattice = [&](double sites) {
    level_bytes += sites * ((2 * nodes + 5) * vector + scatter + 2 * Dim * vector);
  };
  for (int q = m.finest_scale; q < m.finest_scale + m.scales; ++q) {
    const double sites = static_cast<double>(level_lattice(image, q).sites());
    unknowns += Dim * sites;
    add_lattice(sites);
    level_bytes += sites * 6 * vector;
  }
  for (int q = m.first_order_finest_scale; q < m.first_order_finest_scale + m.first_order_scales; ++q) {
    if (q > std::max(m.finest_scale + m.scales - 1, m.first_order_finest_scale)) break;
    const double sites = static_cast<double>(level_lattice(image, q).sites());
    unknowns += Dim * Dim * sites;
    if (q < m.finest_scale || q >= m.finest_scale + m.scales) add_lattice(sites);
    level_bytes += sites * (6 * vector + 5 * Dim * vector + (2 + Dim) * (1 + Dim) * vector);
    // With sparsity only active blocks are unknowns, beside momenta and gradients at all sites. How many there will be
    // is not known: nearly all, at worst.
    if (m.sparsity > 0) level_bytes += sites * 2 * Dim * vector;
  }
  // L-BFGS: three vectors a pair, ten of its own. A checkpoint, where one is asked for, holds most of that once more.
  level_bytes += unknowns * scalar * (3 * options.optimisation.history + 11);
  level_bytes += unknowns * scalar * (3 * options.optimisation.history + 3);

  // At the end: fields, warped image, Jacobian, the following of both maps, and the similarity at full resolution.
  const double end_bytes = full * ((nodes + 4) * vector + 10 * scalar + similarity) + full_moving * (vector + 8);
  const double input_bytes = 3 * scalar * (full + full_moving);
  return static_cast<std::size_t>(input_bytes + std::max(level_bytes, end_bytes + level * 2 * nodes * vector)) +
         (64u << 20);
}

template std::size_t memory_estimate(const ImageGrid<2>&, const ImageGrid<2>&, const RegistrationOptions&);
template std::size_t memory_estimate(const ImageGrid<3>&, const ImageGrid<3>&, const RegistrationOptions&);

}  // namespace saltus
