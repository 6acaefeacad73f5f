#include "core/flow/element_transport.h"
#include "core/momenta/oriented_momenta.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/registration/working_set.h"
#include "core/similarity/similarity.h"
#include "core/slip/jump_elements.h"
#include "core/support/registers.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// How many sites the active blocks of a scale's order-1 fields have at most.
template <int Dim>
double most_active_sites(const Lattice<Dim>& image, const Lattice<Dim>& lattice, int fields, double share) {
  return std::min(static_cast<double>(fields) * static_cast<double>(lattice.sites()),
                  static_cast<double>(most_active_blocks(image, share)) * std::pow(kBlockEdge, Dim));
}

}  // namespace

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
  const Lattice<Dim> image_of_moving = lattice_of(moving);
  const auto sites_of = [&](int level) { return static_cast<double>(level_lattice(image, level).sites()); };

  const bool has_first = m.first_order_scales > 0;
  // What one round holds: see the members of MatchingObjective and of what it owns. `smooth`: order 0 is alone.
  const int finest = options.pyramid.finest_level, coarsening = options.flow.coarsening;
  const double level = sites_of(finest);
  const auto level_moving = static_cast<double>(moving_level_lattice(image, image_of_moving, finest).sites());
  struct Round {
    double most;  ///< while it runs
    double left;  ///< of which this is there until what jumps is listed, when it was the last
    double kept;  ///< momenta of the result, and that list
    double momenta;
  };
  const auto round_of = [&](bool smooth) {
    const Lattice<Dim> flow_lattice = level_lattice(image, smooth ? finest + coarsening : finest);
    // The fixed image, the warped one and its dual; weights of the fixed one and of both; the moving image; either its
    // weights and a dual, or the warped image's slopes, which elsewhere have the room of another field.
    const int slopes = flow_lattice == level_lattice(image, finest) ? 0 : Dim;
    double bytes = level * (5 * scalar + similarity) + level_moving * scalar +
                   scalar * std::max(level + level_moving, level * slopes);
    const double flow = static_cast<double>(flow_lattice.sites());
    // Planes on the way from a coarser lattice, see LatticeInterpolation.
    const auto planes_between = [&](const Lattice<Dim>& coarse, const Lattice<Dim>& fine) {
      return coarse == fine ? 0.0
                            : static_cast<double>(coarse.sites()) / coarse.size[Dim - 1] * fine.size[Dim - 1] * vector;
    };
    bytes += planes_between(flow_lattice, level_lattice(image, finest));
    bytes += flow * (2 * nodes * vector        // velocities and their duals
                     + nodes * vector);        // map and its dual
    double unknowns = 0, dense = 0, kept = 0;  // momenta, and those of order 0
    // Once for each lattice: where its sites are, with their duals, and the velocity of its scales on the way to and
    // from another lattice. Then for each scale its momenta.
    const auto add_lattice = [&](int q) {
      const Lattice<Dim> lattice = level_lattice(image, q);
      const double sites = static_cast<double>(lattice.sites());
      bytes += sites * (2 * steps + (steps > 1 ? 1 : 0) + (lattice == flow_lattice ? 0 : 2)) * vector +
               planes_between(lattice, flow_lattice);
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
      kept += sites * vector;
      add_lattice(placed);
      // Its momentum; one for the passes of a sum of widths; the velocity where another scale's is on the lattice
      // before.
      const bool adds_velocity = placed > q && is_first_at(placed);
      bytes += sites * (1 + (m.kernel_widths.size() > 1 ? 1 : 0) + (adds_velocity ? 1 : 0)) * vector;
    }
    for (int q = m.first_order_finest_scale; is_first_at(q); ++q) {
      const Lattice<Dim> lattice = level_lattice(image, q);
      const double sites = static_cast<double>(lattice.sites());
      const bool is_directional = options.model == Model::Directional;
      // Oriented momenta: normals, and a field in padded rows, at all sites, weights (and those before them) for all
      // elements. One element may join at a site that has room for one.
      if (m.orientations > 0) {
        // PaddedField has half a register more in a row, and an even number of rows in a plane.
        const double padded = (1 + 0.5 * static_cast<double>(kRegisterLanes<float>) / lattice.size[0]) *
                              (lattice.size[1] + lattice.size[1] % 2) / lattice.size[1];
        const auto elements =
            static_cast<double>(sites_with_room(lattice, first_order_width(image, options, q), kElementSpacing<Dim>));
        bytes += sites * ((2 + padded) * vector + 2 * m.orientations * scalar);
        unknowns += (Dim - 1) * elements;
        // Their points, see OrientedFlow: position and prediction in each step, and three duals. At a look all that may
        // join take part, with values and gradients of their own. What is transported has axes and duals beside.
        using Transport = ElementTransport<Dim, float>;
        const bool is_carried = options.flow.evolution == Evolution::Carried;
        const int points = is_carried ? OrientedMomenta<Dim, float>::kCornerValues : Transport::kPointValues;
        bytes += elements * ((2 * steps + 3) * points + 2 * (Dim - 1) + 2) * scalar;
        if (!is_carried) bytes += elements * (2 * sizeof(TransportedElement<Dim, float>) + (Dim + 1) * vector);
        kept += sites * vector + static_cast<double>(sizeof(JumpElement<Dim>)) * elements;
        if (is_zeroth_gaussian(options.model) && has_oriented_alone(m)) {  // of which there are no fields
          if (lattice != flow_lattice) bytes += sites * vector + planes_between(lattice, flow_lattice);
          continue;
        }
      }
      const int fields = is_directional ? 1 : Dim;
      const double active =
          m.sparsity > 0 ? most_active_sites(image, lattice, fields, m.most_active_share) : fields * sites;
      unknowns += Dim * active;
      kept += Dim * sites * vector +
              static_cast<double>(sizeof(JumpElement<Dim>)) * (is_directional ? Dim * active : active);
      const bool is_alone = coarsening > 0 || q < m.finest_scale || q >= m.finest_scale + m.scales;
      if (is_alone) add_lattice(q);
      // Momenta on their way, what is listed of one field of them, and passes; alone also their velocity, or momenta of
      // order 0 that they turn into.
      const bool is_exact = options.flow.evolution == Evolution::Exact;
      bytes += sites * (Dim + (is_exact ? 4 : 2) + 3 + (m.first_order_kernel_widths.size() > 1 ? 1 : 0)) * vector;
      if (is_alone) bytes += sites * (is_exact ? 2 : 1) * vector;
      // With sparsity only active blocks are unknowns, beside momenta and gradients at all sites; and there are their
      // weights, once more in a checkpoint. How many will be active is not known: all that may be, at worst.
      if (m.sparsity > 0) {
        bytes += sites * 2 * fields * vector;
        if (m.reweighted_rounds > 0 || m.debias) bytes += scalar * (2 * fields * sites + active);
      }
      // Momenta along all axes and their gradients; the directions, twice in double precision and once more in single.
      if (is_directional) bytes += sites * (2 * Dim + 5) * vector;
    }
    // Of each thread: planes between two passes of order 0, one or a few small ones, see convolve_planes; and what the
    // similarity sweeps with.
    const int threads = options.threads > 0 ? options.threads : threads_of_loop(static_cast<std::size_t>(level));
    if (Dim == 3) {
      const Lattice<Dim> largest = level_lattice(image, m.finest_scale + (smooth ? coarsening : 0));
      const double plane = static_cast<double>(largest.sites()) / largest.size[Dim - 1] * vector;
      bytes += threads * std::max(plane, 512.0 * 1024);
    }
    bytes += similarity_tables(options.similarity, options.similarity_parameters, threads);
    // L-BFGS, see MinimiserState: one of its vectors makes room for one on its way while momenta join, and a checkpoint
    // goes straight to a file. Before it has pairs it may look at the noise: with the next gradient, and with three
    // images. What order 0 began with may be kept.
    const double history = options.optimisation.history, pair_value = sizeof(Stored<float>);
    const double run = unknowns * (4 * scalar + 2 * history * pair_value) + dense * (2 * scalar + history * pair_value);
    const double noise_look = scalar * (unknowns * 3 + dense * 2 + level * 3);
    const bool looks = smooth && options.optimisation.noise_tolerance > 0;
    const double beginning = has_first && m.first_order_shear > 0 && !m.first_order_waits ? dense * scalar : 0;
    return Round{bytes + beginning + (looks ? std::max(run, noise_look) : run),
                 bytes + unknowns * scalar + flow * nodes * vector, kept, unknowns * scalar};
  };
  Round round = round_of(true);
  if (has_first) {
    const Round other = round_of(false);
    round = {std::max(round.most, other.most), std::max(round.left, other.left), std::max(round.kept, other.kept),
             std::max(round.momenta, other.momenta)};
  }

  // While a level's images are made: what masks show, the scaled image, what it is reduced to on its way and what
  // divides that, of one image at a time, see ImagePyramid; the momenta wait.
  const double making = 5 * scalar * std::max(full, full_moving) + 2 * scalar * (level + level_moving);
  // At the end: map, displacement and the frame at rest, Jacobian and warped image, both images again with what warps
  // them, and the similarity at full resolution; the inverse; velocities.
  const double flow = sites_of(has_first ? finest : finest + coarsening);
  const double end_bytes = full * (3 * vector + 8 * scalar + similarity) + full_moving * (vector + 8 + 2 * scalar) +
                           flow * nodes * vector + round.kept;
  // Both images with masks, a field of directions as given and as it is used, and what is too small to be counted one
  // by one.
  const double input_bytes =
      2 * scalar * (full + full_moving) + (options.model == Model::Directional ? 3 * vector * full : 0) + 2 * full;
  return static_cast<std::size_t>(input_bytes +
                                  std::max({round.most, round.left + round.kept, making + round.momenta, end_bytes})) +
         (64u << 20);
}

template std::size_t memory_estimate(const ImageGrid<2>&, const ImageGrid<2>&, const RegistrationOptions&);
template std::size_t memory_estimate(const ImageGrid<3>&, const ImageGrid<3>&, const RegistrationOptions&);

}  // namespace saltus
