#include "core/registration/narrower_scale.h"
#include "core/registration/pyramid_run.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// Of the intensity range: where images have less noise, interpolation alone leaves as much as this would.
constexpr double kLeastNoise = 0.01;

}  // namespace

/// Where order 0 begins its finest scale on the next level, and alone: how sharp what this one has found is.
template <int Dim>
void PyramidRun<Dim>::ask_for_narrow_widths() {
  const RegistrationOptions::Momenta& momenta = options_.momenta;
  if (momenta.narrow_width_shear == 0 || momenta.kernel_widths.size() < 2 || step_ + 1 == levels_.size()) return;
  const int next = levels_[step_ + 1];
  if (levels_[step_] <= momenta.finest_scale || next > momenta.finest_scale) return;
  if (has_first_at(next) && !decides_at(next)) return;
  shear_before_ = shear_reached();
}

/// What narrow widths count in the finest scale of order 0 as long as there are no first orders beside it.
template <int Dim>
double PyramidRun<Dim>::narrow_share() const {
  double share = level_.narrow_share;
  for (const LevelSummary& before : summary_.levels) share = std::min(share, before.narrow_share);
  return share;
}

/// Whether order 0, which stays alone, has left finer scales to first orders, and has to do without them for good: on
/// the finest level.
template <int Dim>
bool PyramidRun<Dim>::may_be_finer() const {
  return options_.momenta.finer_shear > 0 && !options_.momenta.first_order_waits && !level_.has_finer && !is_blank_ &&
         narrow_share() == 1 && step_ + 1 == levels_.size() && options_.momenta.finest_scale > levels_[step_];
}

/// Scales of which those of order 0 end where the level does. The finer ones come last in x.
template <int Dim>
void PyramidRun<Dim>::begin_finer_scales() {
  RegistrationOptions finer = options_;
  const int added = options_.momenta.finest_scale - levels_[step_];
  finer.momenta.finest_scale -= added;
  finer.momenta.scales += added;
  // Scales that there are keep their weights, and momenta their velocity.
  finer.momenta.regularisation *= std::pow(options_.momenta.coarser_regularisation, -added);
  make_scales_anew(finer, narrow_share());
}

/// First orders take their place. They begin where the level did, when there were none.
template <int Dim>
void PyramidRun<Dim>::end_finer_scales() {
  make_scales_anew(options_, narrow_share());
  make_objective(rounds_[0]);
}

/// Whether order 0 has settled. What its round asks for before it ends by itself may be more than that: at its limit
/// `tolerance` will do.
template <int Dim>
bool PyramidRun<Dim>::is_at_rest() const {
  switch (level_.termination) {
    case Termination::Converged:
    case Termination::Settled:
    case Termination::NoiseFloor:
      return true;
    case Termination::IterationLimit:
      return has_settled(reached_.minimiser.energies, 0, options_.optimisation.tolerance);
    case Termination::LineSearchFailed:
    case Termination::NothingToRegister:
    case Termination::Stopped:
      return false;
  }
  return false;
}

/// Whether order 0, alone and at rest with all of its scales, on the level that is as fine as these (the finest one or
/// the one before), may get one more. Where first orders are for finer levels alone its displacement must not show
/// what they are for.
template <int Dim>
bool PyramidRun<Dim>::may_be_narrower() {
  const RegistrationOptions::Momenta& asked = options_.momenta;
  const bool ends_here = levels_[step_] == asked.finest_scale && asked.finest_scale <= std::max(levels_.back(), 1);
  const bool has_more_to_come = asked.finer_shear > 0 && asked.finest_scale > levels_.back();
  const bool has_all = level_.has_finer || (ends_here && !has_more_to_come);
  if (asked.narrower_pull == 0 || !has_all || !is_at_rest()) return false;
  if (has_first_) return true;
  level_.simple_shear = shear_reached();
  return level_.simple_shear < asked.first_order_shear;
}

/// The finest scale that has order 0, which may get a narrower one beside it.
template <int Dim>
const PlacedScale<Dim, float>& PyramidRun<Dim>::finest_zeroth() const {
  return *std::find_if(scales_.rbegin(), scales_.rend(),
                       [](const auto& placed) { return has_zeroth(placed.scale->options().orders); });
}

/// Whether what would pull at a narrower scale where order 0 has settled stands out from noise.
template <int Dim>
bool PyramidRun<Dim>::finds_narrow_pull() {
  reached_.minimiser = MinimiserState<Scalar>(std::move(reached_.minimiser.x));  // the curvature's memory goes
  const auto narrow = make_narrow_scale<Dim, Scalar>(pyramid_.fixed_lattice(), options_, finest_zeroth());
  const auto beside = std::find(active_.begin(), active_.end(), finest_zeroth().scale.get()) - active_.begin();
  const double noise = pyramid_.matching_noise(std::max(pyramid_.noise(), kLeastNoise), levels_[step_]);
  const PullOverNoise pull = objective_->pull_over_noise(reached_.minimiser.x, beside, *narrow.scale, noise);
  level_.evaluations += 2;
  level_.own_pull = pull.own;
  level_.narrow_pull = pull.other;
  return pull.other >= options_.momenta.narrower_pull &&
         pull.other >= narrower_pull_share(options_.similarity) * pull.own;
}

/// On this level or one before.
template <int Dim>
bool PyramidRun<Dim>::has_narrower() const {
  const auto has = [](const LevelSummary& level) { return level.has_narrower; };
  return has(level_) || std::any_of(summary_.levels.begin(), summary_.levels.end(), has);
}

/// Those that there are from the beginning, and the one that came later.
template <int Dim>
void PyramidRun<Dim>::make_scales_anew(const RegistrationOptions& options, double narrow_share) {
  objective_.reset();
  active_.clear();
  scales_ = make_scales<Dim, Scalar>(pyramid_.fixed_lattice(), options, directions_, narrow_share);
  if (has_narrower()) begin_narrower();
}

/// One more scale of order 0. It comes last in x.
template <int Dim>
void PyramidRun<Dim>::begin_narrower() {
  objective_.reset();
  active_.clear();
  scales_.push_back(make_narrow_scale<Dim, Scalar>(pyramid_.fixed_lattice(), options_, finest_zeroth()));
}

#define SALTUS_SCALES(DIM)                                                             \
  template void PyramidRun<DIM>::ask_for_narrow_widths();                              \
  template double PyramidRun<DIM>::narrow_share() const;                               \
  template bool PyramidRun<DIM>::may_be_finer() const;                                 \
  template void PyramidRun<DIM>::begin_finer_scales();                                 \
  template void PyramidRun<DIM>::end_finer_scales();                                   \
  template bool PyramidRun<DIM>::is_at_rest() const;                                   \
  template bool PyramidRun<DIM>::may_be_narrower();                                    \
  template bool PyramidRun<DIM>::finds_narrow_pull();                                  \
  template bool PyramidRun<DIM>::has_narrower() const;                                 \
  template void PyramidRun<DIM>::make_scales_anew(const RegistrationOptions&, double); \
  template void PyramidRun<DIM>::begin_narrower();
SALTUS_SCALES(2)
SALTUS_SCALES(3)
#undef SALTUS_SCALES

}  // namespace saltus
