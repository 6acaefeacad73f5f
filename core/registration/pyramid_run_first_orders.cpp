#include "core/registration/pyramid_run.h"
#include "core/registration/simple_shear.h"

#include <algorithm>

namespace saltus {
namespace {

/// Iterations of a level after which a slip may be plain, see momenta.plain_shear.
constexpr int kEarlyLook = 3;
/// Iterations in which order 0 brings most of what it brings where it is quick, see momenta.quick_share and
/// momenta.quick_tolerance.
constexpr int kQuickIterations = 10;

/// Iterations after which a round has settled to `tolerance` for the first time; -1: it has not.
int settled_after(const std::vector<double>& energies, double tolerance) {
  std::vector<double> until;
  for (double energy : energies) {
    until.push_back(energy);
    if (has_settled(until, 0, tolerance)) return static_cast<int>(until.size()) - 1;
  }
  return -1;
}

}  // namespace

/// Simple shear of what the momenta reached make, see shear_of_slip.
template <int Dim>
double PyramidRun<Dim>::shear_reached() {
  return shear_of_slip(objective_->flow_lattice(), objective_->displacement(reached_.minimiser.x));
}

/// Whether the displacement of order 0, which is alone, shows at least so much simple shear, and first orders want to
/// be there.
template <int Dim>
bool PyramidRun<Dim>::shows_slip(double least_shear) {
  const double shear = shear_reached();
  const bool shows = shear >= least_shear && (!options_.momenta.first_order_waits || would_join());
  level_.simple_shear = shear;  // not of a look in which the run is stopped: nothing rests on that
  return shows;
}

/// The round of order 0 alone that first orders depend on. It is asked whenever the answer may be known: after a few
/// iterations, where a slip may be so plain that the rest would tell nothing new; as soon as it is known to be quick,
/// since it gives up then what is sharp; when it has settled as other rounds have to; and when it has gone on to
/// look_tolerance. Until a slip shows the round goes on as if it had not been asked; one that is taken up again asks no
/// more what it has asked before.
template <int Dim>
MinimiseSummary PyramidRun<Dim>::minimise_until_slip_shows() {
  const RegistrationOptions::Momenta& asked = options_.momenta;
  const MinimiserState<Scalar>& state = reached_.minimiser;
  asked_at_ = -1;
  MinimiseOptions few = how_;
  few.max_iterations = std::min(how_.max_iterations, kEarlyLook);
  if (asked.plain_shear > 0 && state.iterations() <= few.max_iterations) {
    const MinimiseSummary found = minimise_as(few);
    if (found.termination != MinimiseTermination::IterationLimit) return found;
    level_.was_plain = shows_slip(asked.plain_shear);
    if (level_.was_plain) return found;
    level_.simple_shear = 0;  // nothing rests on it
  }
  if (asked.quick_tolerance > 0 && asked.first_order_waits)
    if (const auto found = ask_when_settled(asked.quick_tolerance, kQuickIterations)) return *found;
  if (const auto found = ask_when_settled(options_.optimisation.tolerance, how_.max_iterations)) return *found;
  return minimise_as(how_);
}

/// Goes on until order 0 has settled to `tolerance`, for so many iterations of the round at most, and asks it then. How
/// the round ended, where it did; nothing where it goes on, as it does where all this is behind it.
template <int Dim>
std::optional<MinimiseSummary> PyramidRun<Dim>::ask_when_settled(double tolerance, int most_iterations) {
  const MinimiserState<Scalar>& state = reached_.minimiser;
  const int after = settled_after(state.energies, tolerance);
  const bool is_behind = state.iterations() > most_iterations ||
                         (after >= 0 && (after < state.iterations() || asked_at_ == state.iterations()));
  if (is_behind || tolerance <= how_.tolerance) return std::nullopt;
  MinimiseOptions until = how_;
  until.tolerance = tolerance;
  until.max_iterations = std::min(how_.max_iterations, most_iterations);
  const MinimiseSummary found = minimise_as(until);
  if (found.termination == MinimiseTermination::IterationLimit && until.max_iterations < how_.max_iterations)
    return std::nullopt;
  if (found.termination != MinimiseTermination::Settled) return found;
  asked_at_ = state.iterations();
  showed_slip_ = shows_slip(options_.momenta.first_order_shear);
  if (showed_slip_) return found;
  level_.simple_shear = 0;
  return std::nullopt;
}

/// After the round in which order 0 was alone: whether its displacement shows something that slides. First orders that
/// do not wait begin where the level began.
template <int Dim>
bool PyramidRun<Dim>::first_orders_are_worth_it() {
  const RegistrationOptions::Momenta& asked = options_.momenta;
  const bool is_worth_it =
      level_.was_plain || showed_slip_ || shows_slip(level_.has_finer ? asked.finer_shear : asked.first_order_shear);
  level_.decision = is_worth_it ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut;
  if (is_worth_it && level_.has_finer) end_finer_scales();
  if (is_worth_it && !reached_.level_start.empty()) reached_.minimiser.x = std::move(reached_.level_start);
  if (is_worth_it || !may_be_finer()) reached_.level_start.clear();
  if (!is_worth_it) return false;
  look_how_quick_it_was();
  begin_beside_first_orders();
  for (std::size_t step = step_; step < levels_.size(); ++step) meter_.expect(step, planned_work(levels_[step], true));
  return true;
}

/// Of order 0, which is alone and has settled, when first orders are let in. What it would find again in a few
/// iterations it gives up as far as it is sharp: to leave it to first orders little by little takes longer. Where so
/// few were all that it took, they say nothing, unless that is why the round ended.
template <int Dim>
void PyramidRun<Dim>::look_how_quick_it_was() {
  const RegistrationOptions::Momenta& asked = options_.momenta;
  if (level_.was_plain || !asked.first_order_waits || !is_at_rest()) return;
  const std::vector<double>& energies = reached_.minimiser.energies;
  const auto brought_until = [&](int iteration) {
    return energies.front() - energies[static_cast<std::size_t>(iteration)];
  };
  const int done = reached_.minimiser.iterations();
  if (asked.quick_tolerance > 0 && done <= kQuickIterations && settled_after(energies, asked.quick_tolerance) == done) {
    level_.quick_after = done;
  } else {
    const int after = settled_after(energies, options_.optimisation.tolerance);
    const int end = after < 0 ? done : after;
    if (end <= kQuickIterations || !(brought_until(end) > 0)) return;
    level_.quick_share = brought_until(kQuickIterations) / brought_until(end);
  }
  gives_up_sharp_ = level_.gave_up_sharp =
      level_.quick_after >= 0 || (asked.quick_share > 0 && level_.quick_share >= asked.quick_share);
}

/// Where first orders waited and there are none yet: whether any wants to be there, with the least weight that is to
/// come. If not, the next rounds would go on with what has settled. Directions and oriented momenta cannot be asked.
template <int Dim>
bool PyramidRun<Dim>::would_join() {
  if (rounds_[0].lets_blocks_join || has_found() || options_.model == Model::Directional) return true;
  const bool has_oriented = std::any_of(scales_.begin(), scales_.end(), [&](const auto& placed) {
    return placed.level >= levels_[step_] && placed.scale->oriented();
  });
  if (has_oriented) return true;
  const std::vector<Scalar>& momenta = reached_.minimiser.x;
  make_objective(rounds_[1]);
  objective_->working_set().weigh({}, momenta);
  const bool is_wanted = objective_->would_join(momenta);
  ++level_.evaluations;
  if (!is_wanted) {
    make_objective(rounds_[0]);
    objective_->weigh(rounds_[0], momenta);  // order 0 may go on alone
  }
  return is_wanted;
}

/// What order 0 weighs beside first orders that were let in on this level or a coarser one.
template <int Dim>
double PyramidRun<Dim>::regularisation_beside() const {
  for (const LevelSummary& before : summary_.levels)
    if (before.decision == FirstOrderDecision::LetIn) return saltus::regularisation_beside(options_.momenta, before);
  return saltus::regularisation_beside(options_.momenta, level_);
}

/// From here on order 0 has the weight that it has beside first orders, and momenta that make the same velocity. Where
/// narrow widths counted less they are whole again, and what is smooth stays: kernels have unit mass.
template <int Dim>
void PyramidRun<Dim>::begin_beside_first_orders() {
  const double alone = options_.momenta.regularisation, beside = regularisation_beside();
  if (is_beside_first_ || (beside == alone && narrow_share() == 1)) return;
  is_beside_first_ = true;
  const bool has_objective = objective_ != nullptr;
  RegistrationOptions options = options_;
  options.momenta.regularisation = beside;
  make_scales_anew(options, 1);
  // No first-order momentum is other than 0 yet. Those of a checkpoint have been changed.
  if (!is_resumed_)
    for (Scalar& value : reached_.minimiser.x) value *= static_cast<Scalar>(beside / alone);
  if (has_objective) make_objective(rounds_[level_.has_finer ? 2 : 1]);
}

#define SALTUS_FIRST_ORDERS(DIM)                                                          \
  template double PyramidRun<DIM>::shear_reached();                                       \
  template MinimiseSummary PyramidRun<DIM>::minimise_until_slip_shows();                  \
  template std::optional<MinimiseSummary> PyramidRun<DIM>::ask_when_settled(double, int); \
  template bool PyramidRun<DIM>::first_orders_are_worth_it();                             \
  template void PyramidRun<DIM>::look_how_quick_it_was();                                 \
  template bool PyramidRun<DIM>::would_join();                                            \
  template double PyramidRun<DIM>::regularisation_beside() const;                         \
  template void PyramidRun<DIM>::begin_beside_first_orders();
SALTUS_FIRST_ORDERS(2)
SALTUS_FIRST_ORDERS(3)
#undef SALTUS_FIRST_ORDERS

}  // namespace saltus
