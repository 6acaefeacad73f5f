#pragma once

#include "core/flow/discontinuous/transported_point.h"
#include "core/grid/volume.h"
#include "core/registration/options.h"
#include "core/slip/slip_surface.h"

#include <array>
#include <string>
#include <vector>

namespace saltus {

/// One accepted iteration, also of those that were given back (LevelSummary::termination NoiseFloor). Energies are
/// integrals over the fixed image (mm^Dim times the density's unit).
struct IterationRecord {
  int level = 0;  ///< 1 is the coarsest
  int round = 1;  ///< of the level, see sparsity_rounds.h
  int iteration = 0;
  double energy = 0;
  double similarity = 0;
  double regularisation = 0;
  double sparsity = 0;
  double step = 0;
  double optimality = 0;  ///< optimality residual: size of the (pseudo-)gradient relative to the level's first
};

enum class Termination {
  Converged,   ///< the optimality residual fell to its tolerance
  Settled,     ///< the energy fell no more by a share that counts
  NoiseFloor,  ///< what pulled was mostly noise of the images
  IterationLimit,
  LineSearchFailed,  ///< no step along the last direction lowers the energy
  Stopped,           ///< the caller wanted it to end
  NothingToRegister  ///< an image has no contrast; a notice says which, and nothing was moved
};
std::string to_string(Termination termination);

/// Whether first orders are worth it (momenta.first_order_shear), asked on a level when order 0 had settled alone, or
/// before that where a slip was plain (momenta.plain_shear) or order 0 quick (momenta.quick_tolerance).
enum class FirstOrderDecision {
  None,  ///< not asked: there are none, they always take part, or they were let in on a coarser level
  LeftOut,
  LetIn  ///< here and on all finer levels
};

struct LevelSummary {
  int level = 0;
  std::string grid;       ///< "166x195x25"
  double spacing_mm = 0;  ///< smallest
  int iterations = 0;
  int evaluations = 0;
  int rounds = 0;                ///< minimisations with different sparsity weights, each from where the last ended
  double optimality = 0;         ///< optimality residual at the end, relative to the level's first
  double smoothing_voxels = 0;   ///< sd of the Gaussian that both images were smoothed with
  double similarity_weight = 1;  ///< what the similarity was multiplied with
  double energy_before = 0;
  double energy_after = 0;
  Termination termination = Termination::Converged;
  double active_block_share = 0;  ///< at the end: blocks of first-order momenta that were stored, of all there are
  double kept_out_share = 0;      ///< most of all blocks that momenta.most_active_share had no room for at a time
  FirstOrderDecision decision = FirstOrderDecision::None;
  double simple_shear = 0;  ///< of the displacement that it rests on, see simple_shear.h; where there is no decision,
                            ///< that whether a narrower scale is asked for rests on, 0: it was not looked at
  bool has_finer = false;  ///< that order 0 had the scales by then that it leaves to first orders (momenta.finer_shear)
  bool was_plain = false;  ///< that it was asked early, and the slip so plain that order 0 need not settle
  double quick_share = -1;  ///< of what brought order 0, alone, to `tolerance`, what its first ten iterations had (all:
                            ///< 1); -1: not looked at, as where it had not settled, or was quick before
  int quick_after = -1;     ///< iterations after which first orders were let in since it was quick, see
                            ///< momenta.quick_tolerance; -1: they were not, or not since it was
  bool gave_up_sharp = false;  ///< that order 0 then began smooth beside first orders
  double shear_before = -1;    ///< simple shear that the level before ended with; -1: narrow_width_shear did not ask
  double narrow_share = 1;     ///< what narrow widths count in the order-0 scale that begins here while it is alone
  double narrow_pull = -1;     ///< what pulled at a narrower scale of order 0, see momenta.narrower_pull; -1: not asked
  double own_pull = 0;         ///< and at the finest of those that there were
  bool has_narrower = false;   ///< that it therefore went on with one
  int oriented_elements = 0;   ///< at the end: active oriented momenta
  int map_steps = 1;           ///< in each time step
  double map_error_mm = 0;     ///< at the end, of 99.9 % of the sites, see map_error; 0: nothing moved, or not asked
  double oblique_share = 0;    ///< of what may slide, see InterfaceNormals; 0 where there are no oriented momenta
  double seconds = 0;
  double cpu_seconds = 0;
};

/// Whether what was seen on this level is a plain slip: early (momenta.plain_shear), or by the time that first
/// orders were let in (momenta.settled_plain_shear).
bool is_plain(const RegistrationOptions::Momenta& momenta, const LevelSummary& level);
/// What order 0 weighs, per mm^2, beside first orders that were let in on this level.
double regularisation_beside(const RegistrationOptions::Momenta& momenta, const LevelSummary& level);

struct RegistrationSummary {
  std::vector<LevelSummary> levels;                  ///< coarsest first
  std::vector<IterationRecord> history;              ///< all levels in order
  Termination termination = Termination::Converged;  ///< Stopped when the progress callback asked for it
  std::vector<std::string> notices;                  ///< sentences that a user should read before the result
  std::vector<std::array<int, 2>> region;  ///< [begin, end) along each axis of the fixed image, in voxels, of what was
                                           ///< compared (and a margin around it); empty: all
  double noise = 0;                        ///< sd of the images' noise as used, in units of the fixed image's range
  double similarity_before = 0;            ///< similarity at full resolution, after the affine start only
  double similarity_after = 0;
  double seconds = 0;
  double cpu_seconds = 0;
  /// max |H(t) - H(0)| / H(0) along the geodesic; -1 where H is no invariant: with several kernels, oriented momenta or
  /// another evolution than `exact`.
  double hamiltonian_drift = 0;
  double active_first_order_share = 0;  ///< of first-order sites, with a non-zero momentum along an axis
  double inverse_consistency_mm = 0;    ///< median |psi(phi(y)) - y|
  double min_jacobian = 0;
  double share_jacobian_not_positive = 0;
};

/// Initial momentum of one scale and order, enough to inspect it.
template <int Dim>
struct MomentumField {
  static constexpr int kZeroth = -1;
  static constexpr int kOriented = -2;  ///< oriented first-order momenta, at each site the sum of those that lie on it
  std::string kernel;                   ///< "gaussian" or "wendland"
  double width_mm = 0;
  double normal_width_mm = 0;  ///< of oriented momenta, along their normal
  int axis = -1;               ///< kZeroth; i: the first-order momentum m_i along grid axis i; kOriented
  VectorVolume<Dim> vectors;   ///< components along the grid's axes
};

/// Everything register_images found. Displacements are world millimetres (LPS).
template <int Dim>
struct RegistrationResult {
  VectorVolume<Dim> displacement;  ///< on the fixed grid: fixed(x) ~ moving(x + u(x)); contains the affine start
  VectorVolume<Dim> inverse_displacement;  ///< on the moving grid: moving(y) ~ fixed(y + w(y))
  Volume<Dim> warped;                      ///< moving image on the fixed grid
  Volume<Dim> jacobian;                    ///< det D(x + u(x)) on the fixed grid
  std::vector<MomentumField<Dim>> momenta;
  std::vector<TransportedPoint<Dim>> moved_points;  ///< the input's fixed_points in the moving image, by particles
  SlipSurface<Dim> slip;                            ///< where first-order momenta make the motion slide, fixed image
  RegistrationOptions options;                      ///< as used: everything automatic filled in
  RegistrationSummary summary;
};

}  // namespace saltus
