#include "core/registration/pyramid_run.h"
#include "core/registration/simple_shear.h"

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
  shear_before_ = simple_shear(objective_->flow_lattice(), objective_->starting_velocity(reached_.minimiser.x));
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
  objective_.reset();
  active_.clear();
  RegistrationOptions finer = options_;
  const int added = options_.momenta.finest_scale - levels_[step_];
  finer.momenta.finest_scale -= added;
  finer.momenta.scales += added;
  // Scales that there are keep their weights, and momenta their velocity.
  finer.momenta.regularisation *= std::pow(options_.momenta.coarser_regularisation, -added);
  scales_ = make_scales<Dim, Scalar>(pyramid_.fixed_lattice(), finer, directions_, narrow_share());
}

/// First orders take their place. They begin where the level did, when there were none.
template <int Dim>
void PyramidRun<Dim>::end_finer_scales() {
  objective_.reset();
  active_.clear();
  scales_ = make_scales<Dim, Scalar>(pyramid_.fixed_lattice(), options_, directions_, narrow_share());
  make_objective(rounds_[0]);
}

/// Whether order 0 has settled with all of its scales, on the finest level and alone for good, and may get one more.
template <int Dim>
bool PyramidRun<Dim>::may_be_narrower() const {
  const int level = levels_[step_], finest = options_.momenta.finest_scale;
  const bool has_settled = level_.termination == Termination::Converged || level_.termination == Termination::Settled ||
                           level_.termination == Termination::NoiseFloor;
  return options_.momenta.narrower_pull > 0 && has_settled && step_ + 1 == levels_.size() &&
         (level_.has_finer || (finest >= level && finest <= std::max(level, 1)));
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

/// One more scale of order 0. It comes last in x.
template <int Dim>
void PyramidRun<Dim>::begin_narrower() {
  objective_.reset();
  active_.clear();
  scales_.push_back(make_narrow_scale<Dim, Scalar>(pyramid_.fixed_lattice(), options_, finest_zeroth()));
}

#define SALTUS_SCALES(DIM)                                \
  template void PyramidRun<DIM>::ask_for_narrow_widths(); \
  template double PyramidRun<DIM>::narrow_share() const;  \
  template bool PyramidRun<DIM>::may_be_finer() const;    \
  template void PyramidRun<DIM>::begin_finer_scales();    \
  template void PyramidRun<DIM>::end_finer_scales();      \
  template bool PyramidRun<DIM>::may_be_narrower() const; \
  template bool PyramidRun<DIM>::finds_narrow_pull();     \
  template void PyramidRun<DIM>::begin_narrower();
SALTUS_SCALES(2)
SALTUS_SCALES(3)
#undef SALTUS_SCALES

}  // namespace saltus
