#include "core/registration/pyramid_run.h"

namespace saltus {

/// Whether first orders promise there what is asked of them.
template <int Dim>
bool PyramidRun<Dim>::is_enough(const FirstOrderPromise& promise, int level) const {
  const RegistrationOptions::Momenta& asked = options_.momenta;
  return level == options_.pyramid.finest_level
             ? promise.gain >= asked.first_order_finest_gain && promise.shear >= asked.first_order_finest_shear
             : promise.gain >= asked.first_order_gain && promise.shear >= asked.first_order_shear;
}

/// One look at what first orders would gain, where order 0 is alone. Oriented momenta are not asked.
template <int Dim>
FirstOrderPromise PyramidRun<Dim>::ask_first_orders() {
  make_objective(rounds_[1]);
  objective_->working_set().weigh(rounds_[1], reached_.minimiser.x);  // what is not asked need not be turned yet
  ++level_.evaluations;
  return objective_->first_order_promise(reached_.minimiser.x);
}

/// Goes on with the first round, which ended where mostly noise pulled, until order 0 has settled.
template <int Dim>
void PyramidRun<Dim>::settle_beyond_noise() {
  reached_.is_beyond_noise = true;
  reached_.noise_floor = reached_.minimiser.x;
  reached_.noise_floor_energy = level_.energy_after;
  reached_.noise_floor_optimality = level_.optimality;
  make_objective(rounds_[0]);
  objective_->weigh(rounds_[0], reached_.minimiser.x);
  level_.iterations -= reached_.minimiser.iterations();  // counted again with all of the round
  level_.evaluations -= reached_.minimiser.evaluations;
  minimise_round(0);
}

/// Back from where order 0 has settled to where mostly noise began to pull: what it did since was for a look alone.
template <int Dim>
void PyramidRun<Dim>::return_to_noise_floor() {
  reached_.minimiser.x = std::move(reached_.noise_floor);
  reached_.noise_floor.clear();
  level_.energy_after = reached_.noise_floor_energy;
  level_.optimality = reached_.noise_floor_optimality;
  level_.termination = Termination::NoiseFloor;
}

/// After order 0 has come to its end alone: whether first orders would gain enough. If they seem to where order 0 was
/// left to noise, it has to settle before that is believed: what it has not pulls at them as well. Whatever is found,
/// the run goes on as it would have without that look: from where order 0 was left to noise or, with first orders that
/// do not wait, from where the level began.
template <int Dim>
bool PyramidRun<Dim>::first_orders_are_worth_it() {
  std::vector<Scalar>& momenta = reached_.minimiser.x;
  FirstOrderPromise promise = ask_first_orders();
  if (is_enough(promise, levels_[step_]) && level_.termination == Termination::NoiseFloor) {
    settle_beyond_noise();
    if (level_.termination == Termination::Stopped) return false;
    promise = ask_first_orders();
  }
  const bool is_worth_it = is_enough(promise, levels_[step_]);
  if (!is_worth_it) make_objective(rounds_[0]);
  if (reached_.is_beyond_noise) return_to_noise_floor();
  if (is_worth_it && !reached_.level_start.empty()) momenta = std::move(reached_.level_start);
  reached_.level_start.clear();
  if (is_worth_it) begin_beside_first_orders();
  level_.decision = is_worth_it ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut;
  level_.first_order_gain = promise.gain;
  level_.first_order_shear = promise.shear;
  if (is_worth_it)
    for (std::size_t step = step_; step < levels_.size(); ++step)
      meter_.expect(step, planned_work(levels_[step], true));
  return is_worth_it;
}

/// Where first orders waited and there are none yet: whether any wants to be there, with the least weight that is to
/// come. If not, the next rounds would go on with what has settled. Directions and oriented momenta cannot be asked.
template <int Dim>
bool PyramidRun<Dim>::would_join() {
  if (rounds_[0].lets_blocks_join || has_found() || options_.model == Model::Directional) return true;
  std::vector<Scalar>& momenta = reached_.minimiser.x;
  make_objective(rounds_[1]);
  if (objective_->working_set().has_oriented()) return true;
  objective_->working_set().weigh({}, momenta);
  const bool is_wanted = objective_->first_order_promise(momenta).gain > 0;
  ++level_.evaluations;
  if (!is_wanted) make_objective(rounds_[0]);
  return is_wanted;
}

/// From here on order 0 has the weight that it has beside first orders, and momenta that make the same velocity.
template <int Dim>
void PyramidRun<Dim>::begin_beside_first_orders() {
  const double alone = options_.momenta.regularisation, beside = options_.momenta.regularisation_beside_first;
  if (is_beside_first_ || beside == 0 || beside == alone) return;
  is_beside_first_ = true;
  const bool has_objective = objective_ != nullptr;
  objective_.reset();
  active_.clear();
  RegistrationOptions options = options_;
  options.momenta.regularisation = beside;
  scales_ = make_scales<Dim, Scalar>(pyramid_.fixed_lattice(), options, directions_);
  // No first-order momentum is other than 0 yet. Those of a checkpoint have been changed.
  if (!is_resumed_)
    for (Scalar& value : reached_.minimiser.x) value *= static_cast<Scalar>(beside / alone);
  if (has_objective) make_objective(rounds_[1]);
}

#define SALTUS_FIRST_ORDERS(DIM)                              \
  template bool PyramidRun<DIM>::first_orders_are_worth_it(); \
  template bool PyramidRun<DIM>::would_join();                \
  template void PyramidRun<DIM>::begin_beside_first_orders();
SALTUS_FIRST_ORDERS(2)
SALTUS_FIRST_ORDERS(3)
#undef SALTUS_FIRST_ORDERS

}  // namespace saltus
