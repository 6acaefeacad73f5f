#include "core/flow/element_transport.h"
#include "core/momenta/oriented_momenta.h"
#include "core/registration/finish.h"
#include "core/registration/narrower_scale.h"
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

constexpr double kScalar = sizeof(float);
template <int Dim>
constexpr double kVector = Dim * sizeof(float);

/// Velocities and positions of the map that there are at most.
double most_nodes(const RegistrationOptions& options) {
  const int map_steps = std::max(options.flow.map_steps, options.flow.map_tolerance > 0 ? kMostMapSteps : 1);
  return static_cast<double>(options.flow.time_steps) * map_steps + 1;
}

/// What one round of the finest level holds, in bytes: the members of MatchingObjective and of what it owns, and the
/// optimiser's. `smooth`: order 0 is alone.
template <int Dim>
class RoundMemory {
 public:
  RoundMemory(const Lattice<Dim>& image, const Lattice<Dim>& moving, const RegistrationOptions& options, bool smooth)
      : image_(image),
        options_(options),
        momenta_(options.momenta),
        smooth_(smooth),
        is_carried_(options.flow.evolution == Evolution::Carried),
        finest_zeroth_(finest_zeroth(options, smooth)),
        level_(level_lattice(image, options.pyramid.finest_level)),
        flow_(flow_lattice(image, options, smooth)) {
    count_images(static_cast<double>(moving_level_lattice(image, moving, options.pyramid.finest_level).sites()));
    count_flow();
    const int finest = finest_zeroth_;
    for (int q = finest; q < momenta_.finest_scale + momenta_.scales; ++q) count_zeroth(q);
    // On a level before the finest one it comes before first orders, which leave it.
    if (momenta_.narrower_pull > 0 && (smooth || finest > options.pyramid.finest_level)) count_narrower(finest);
    for (int q = momenta_.first_order_finest_scale; is_first_at(q); ++q) {
      if (momenta_.orientations > 0) count_oriented(q);
      if (!(momenta_.orientations > 0 && is_zeroth_gaussian(options.model) && has_oriented_alone(momenta_)))
        count_first(q);
    }
    count_threads();
  }

  /// While it runs.
  double most() const { return bytes_ + optimiser(); }
  /// Of which this is there until what jumps is listed, when it was the last.
  double left() const { return bytes_ + momenta() + sites_of(flow_) * most_nodes(options_) * kVector<Dim>; }
  /// Momenta of the result, and the list of what jumps.
  double kept() const { return kept_; }
  /// Where the flow is.
  double flow_sites() const { return sites_of(flow_); }
  /// All that is optimised.
  double momenta() const { return unknowns_ * kScalar; }

 private:
  /// The finest scale of order 0 that there may be.
  static int finest_zeroth(const RegistrationOptions& options, bool smooth) {
    const bool may_be_finer = smooth && options.momenta.finer_shear > 0;
    return may_be_finer ? std::min(options.momenta.finest_scale, options.pyramid.finest_level)
                        : options.momenta.finest_scale;
  }
  static Lattice<Dim> flow_lattice(const Lattice<Dim>& image, const RegistrationOptions& options, bool smooth) {
    const int level = options.pyramid.finest_level;
    if (smooth && options.momenta.narrower_pull > 0)
      return narrow_flow_lattice(image, options, level, std::max(level, finest_zeroth(options, smooth)));
    return smooth ? level_lattice(image, level + options.flow.coarsening)
                  : flow_lattice_beside_first(image, options, level);
  }
  static double sites_of(const Lattice<Dim>& lattice) { return static_cast<double>(lattice.sites()); }
  double sites_of(int q) const { return sites_of(level_lattice(image_, q)); }
  bool is_first_at(int q) const {
    return !smooth_ && q >= momenta_.first_order_finest_scale &&
           q < momenta_.first_order_finest_scale + momenta_.first_order_scales &&
           q <= std::max(momenta_.finest_scale + momenta_.scales - 1, momenta_.first_order_finest_scale);
  }
  /// Planes on the way from a coarser lattice, see LatticeInterpolation.
  static double planes_between(const Lattice<Dim>& coarse, const Lattice<Dim>& fine) {
    if (coarse == fine) return 0;
    return sites_of(coarse) / coarse.size[Dim - 1] * fine.size[Dim - 1] * kVector<Dim>;
  }

  /// The fixed image, the warped one and its dual; weights of the fixed one and of both; the moving image; either its
  /// weights and a dual, or the warped image's slopes, which elsewhere have the room of another field.
  void count_images(double moving) {
    const double level = sites_of(level_);
    const int slopes = flow_ == level_ ? 0 : Dim;
    bytes_ += level * (5 + similarity_scratch(options_.similarity, Dim)) * kScalar + moving * kScalar +
              std::max(level + moving, level * slopes) * kScalar;
  }

  /// Velocities and their duals; the map and its dual.
  void count_flow() {
    bytes_ += planes_between(flow_, level_) + sites_of(flow_) * 3 * most_nodes(options_) * kVector<Dim>;
  }

  /// Once for each lattice: where its sites are, with their duals, and the velocity of its scales on the way to and
  /// from another lattice.
  void count_lattice(int q) {
    const Lattice<Dim> lattice = level_lattice(image_, q);
    const double sites = sites_of(lattice), steps = options_.flow.time_steps;
    bytes_ += sites * (2 * steps + (steps > 1 ? 1 : 0) + (lattice == flow_ ? 0 : 2)) * kVector<Dim> +
              planes_between(lattice, flow_);
    if (!is_carried_) bytes_ += sites * 2 * Dim * kVector<Dim>;  // Jacobians
  }

  /// Of a scale of order 0 its momentum; one for the passes of a sum of widths; the velocity where another scale's is
  /// on the lattice before.
  void count_zeroth(int q) {
    const bool shares = options_.model == Model::Wendland1 || options_.model == Model::Directional;
    const int placed = shares && is_first_at(q) ? q : q + options_.flow.coarsening;
    const double sites = sites_of(placed);
    unknowns_ += Dim * sites;
    zeroth_ += Dim * sites;
    kept_ += sites * kVector<Dim>;
    count_lattice(placed);
    const bool adds_velocity = placed > q && is_first_at(placed);
    bytes_ += sites * (1 + (momenta_.kernel_widths.size() > 1 ? 1 : 0) + (adds_velocity ? 1 : 0)) * kVector<Dim>;
  }

  /// Of the scale that is narrower than scale q, on its lattice: its momentum, and its velocity.
  void count_narrower(int q) {
    const double sites = sites_of(q + options_.flow.coarsening);
    unknowns_ += Dim * sites;
    zeroth_ += Dim * sites;
    kept_ += sites * kVector<Dim>;
    bytes_ += sites * 2 * kVector<Dim>;
  }

  /// Oriented momenta: normals, and a field in padded rows, at all sites, weights (and those before them) for all
  /// elements. One element may join at a site that has room for one.
  void count_oriented(int q) {
    const Lattice<Dim> lattice = level_lattice(image_, q);
    const double sites = sites_of(lattice), steps = options_.flow.time_steps;
    // PaddedField has half a register more in a row, and an even number of rows in a plane.
    const double padded = (1 + 0.5 * static_cast<double>(kRegisterLanes<float>) / lattice.size[0]) *
                          (lattice.size[1] + lattice.size[1] % 2) / lattice.size[1];
    const auto elements =
        static_cast<double>(sites_with_room(lattice, first_order_width(image_, options_, q), kElementSpacing<Dim>));
    bytes_ += sites * ((2 + padded) * kVector<Dim> + 2 * momenta_.orientations * kScalar);
    unknowns_ += (Dim - 1) * elements;
    // Their points, see OrientedFlow: position and prediction in each step, and three duals. At a look all that may
    // join take part, with values and gradients of their own. What is transported has axes and duals beside.
    const int points =
        is_carried_ ? OrientedMomenta<Dim, float>::kCornerValues : ElementTransport<Dim, float>::kPointValues;
    bytes_ += elements * ((2 * steps + 3) * points + 3 * (Dim - 1) + Dim) * kScalar;
    if (!is_carried_) bytes_ += elements * (2 * sizeof(TransportedElement<Dim, float>) + (Dim + 1) * kVector<Dim>);
    kept_ += sites * kVector<Dim> + static_cast<double>(sizeof(JumpElement<Dim>)) * elements;
    // Without fields beside them, their velocity on the way to the flow's lattice.
    if (is_zeroth_gaussian(options_.model) && has_oriented_alone(momenta_) && lattice != flow_)
      bytes_ += sites * kVector<Dim> + planes_between(lattice, flow_);
  }

  /// First orders along the axes, or a direction.
  void count_first(int q) {
    const bool is_directional = options_.model == Model::Directional;
    const bool is_exact = options_.flow.evolution == Evolution::Exact;
    const double sites = sites_of(q);
    const int fields = is_directional ? 1 : Dim;
    const double active = most_active_sites(sites, fields);
    unknowns_ += Dim * active;
    kept_ += Dim * sites * kVector<Dim> +
             static_cast<double>(sizeof(JumpElement<Dim>)) * (is_directional ? Dim * active : active);
    const bool is_alone =
        options_.flow.coarsening > 0 || q < momenta_.finest_scale || q >= momenta_.finest_scale + momenta_.scales;
    if (is_alone) count_lattice(q);
    // Momenta on their way, what is listed of one field of them, and passes; alone also their velocity, or momenta of
    // order 0 that they turn into.
    bytes_ +=
        sites * (Dim + (is_exact ? 4 : 2) + 3 + (momenta_.first_order_kernel_widths.size() > 1 ? 1 : 0)) * kVector<Dim>;
    if (is_alone) bytes_ += sites * (is_exact ? 2 : 1) * kVector<Dim>;
    // With sparsity only active blocks are unknowns, beside momenta and gradients at all sites; and there are their
    // weights, once more in a checkpoint.
    if (momenta_.sparsity > 0) {
      bytes_ += sites * 2 * fields * kVector<Dim>;
      if (momenta_.reweighted_rounds > 0 || momenta_.debias) bytes_ += kScalar * (2 * fields * sites + active);
    }
    // Momenta along all axes and their gradients; the directions, twice in double precision and once more in single.
    if (is_directional) bytes_ += sites * (2 * Dim + 5) * kVector<Dim>;
  }

  /// In the active blocks of a scale's order-1 fields. How many will be is not known: all that may be, at worst.
  double most_active_sites(double sites, int fields) const {
    const double all = fields * sites;
    if (!(momenta_.sparsity > 0)) return all;
    return std::min(
        all, static_cast<double>(most_active_blocks(image_, momenta_.most_active_share)) * std::pow(kBlockEdge, Dim));
  }

  /// Of each thread: planes between two passes of order 0, one or a few small ones, see convolve_planes; and what the
  /// similarity sweeps with.
  void count_threads() {
    const int threads = options_.threads > 0 ? options_.threads : threads_of_loop(level_.sites());
    if (Dim == 3) {
      const Lattice<Dim> largest = level_lattice(image_, finest_zeroth_ + (smooth_ ? options_.flow.coarsening : 0));
      const double plane = sites_of(largest) / largest.size[Dim - 1] * kVector<Dim>;
      bytes_ += threads * std::max(plane, 512.0 * 1024);
    }
    // A plane of momenta for their penalty, whose rows end with a row of taps.
    if (!smooth_ && momenta_.orientations > 0) {
      const Lattice<Dim> elements = level_lattice(image_, momenta_.first_order_finest_scale);
      bytes_ += threads * (Dim - 1) * (elements.size[0] + 64.0) * elements.size[1] * kScalar;
    }
    bytes_ += similarity_tables(options_.similarity, options_.similarity_parameters, threads);
  }

  /// L-BFGS, see MinimiserState: one of its vectors makes room for one on its way while momenta join, and a checkpoint
  /// goes straight to a file. Before it has pairs it may look at the noise: with the next gradient, and with three
  /// images. What order 0 began with may be kept.
  double optimiser() const {
    const double history = options_.optimisation.history, pair_value = sizeof(Stored<float>);
    const double run =
        unknowns_ * (4 * kScalar + 2 * history * pair_value) + zeroth_ * (2 * kScalar + history * pair_value);
    const double noise_look = kScalar * (unknowns_ * 3 + zeroth_ * 2 + sites_of(level_) * 3);
    const bool looks = smooth_ && (options_.optimisation.noise_tolerance > 0 || momenta_.narrower_pull > 0);
    const bool keeps_beginning =
        momenta_.first_order_scales > 0 && momenta_.first_order_shear > 0 && !momenta_.first_order_waits;
    return (keeps_beginning ? zeroth_ * kScalar : 0) + (looks ? std::max(run, noise_look) : run);
  }

  const Lattice<Dim>& image_;
  const RegistrationOptions& options_;
  const RegistrationOptions::Momenta& momenta_;
  const bool smooth_, is_carried_;
  const int finest_zeroth_;
  const Lattice<Dim> level_, flow_;
  double bytes_ = 0, kept_ = 0;
  double unknowns_ = 0, zeroth_ = 0;  ///< momenta, and those of order 0
};

}  // namespace

template <int Dim>
std::size_t memory_estimate(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving,
                            const RegistrationOptions& asked) {
  const Lattice<Dim> image = lattice_of(fixed), moving_image = lattice_of(moving);
  const RegistrationOptions options = resolved(asked, image);
  const bool has_first = options.momenta.first_order_scales > 0;
  double most = 0, left = 0, kept = 0, momenta = 0, flow = 0;
  for (bool smooth : {true, false}) {
    if (!smooth && !has_first) break;
    const RoundMemory<Dim> round(image, moving_image, options, smooth);
    most = std::max(most, round.most());
    left = std::max(left, round.left());
    kept = std::max(kept, round.kept());
    momenta = std::max(momenta, round.momenta());
    flow = std::max(flow, round.flow_sites());
  }

  const auto sites_of = [&](int q) { return static_cast<double>(level_lattice(image, q).sites()); };
  const int finest = options.pyramid.finest_level;
  const auto full = static_cast<double>(fixed.voxels()), full_moving = static_cast<double>(moving.voxels());
  // While a level's images are made: what masks show, the scaled image, what it is reduced to on its way and what
  // divides that, of one image at a time, see ImagePyramid; the momenta wait.
  const double level_moving = static_cast<double>(moving_level_lattice(image, moving_image, finest).sites());
  const double making = (5 * std::max(full, full_moving) + 2 * (sites_of(finest) + level_moving)) * kScalar + momenta;
  // At the end, beside velocities and map: both images at full resolution with what they are made of, what warps them
  // and the similarity; then the fields, of the inverse some slabs on their way and how far it is off; then what a slip
  // surface is looked for in, see JumpDensity.
  const int threads = options.threads > 0 ? options.threads : threads_of_loop(fixed.voxels());
  const double similarity = full * (6 + similarity_scratch(options.similarity, Dim)) * kScalar +
                            full_moving * 3 * kScalar +
                            similarity_tables(options.similarity, options.similarity_parameters, threads);
  const double fields = full * (kVector<Dim> + 2 * kScalar) + full_moving * kVector<Dim>;
  const double under_way =
      full_moving * (kVector<Dim> * std::min(1.0, 1.0 * kSlabsAtOnce<Dim> / moving.size[Dim - 1]) + kScalar);
  const double slip = has_first ? sites_of(options.momenta.first_order_finest_scale) * 2 * Dim * kVector<Dim> : 0;
  const double end = full * kVector<Dim> + std::max(similarity, fields + std::max(under_way, slip)) +
                     flow * most_nodes(options) * kVector<Dim> + kept;
  // Both images with masks, a field of directions as given and as it is used, and what is too small to be counted one
  // by one.
  const double directions = options.model == Model::Directional ? 3 * kVector<Dim> * full : 0;
  const double input = 2 * kScalar * (full + full_moving) + directions + 2 * full;
  return static_cast<std::size_t>(input + std::max({most, left + kept, making, end})) + (64u << 20);
}

template std::size_t memory_estimate(const ImageGrid<2>&, const ImageGrid<2>&, const RegistrationOptions&);
template std::size_t memory_estimate(const ImageGrid<3>&, const ImageGrid<3>&, const RegistrationOptions&);

}  // namespace saltus
