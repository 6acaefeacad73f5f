#include "core/registration/pyramid_run.h"
#include "core/registration/simple_shear.h"

#include <algorithm>

namespace saltus {

/// After order 0 has come to its end alone: whether its velocity shows something that slides, and first orders want to
/// be there. Those that do not wait begin where the level began.
template <int Dim>
bool PyramidRun<Dim>::first_orders_are_worth_it() {
  std::vector<Scalar>& momenta = reached_.minimiser.x;
  level_.simple_shear = simple_shear(objective_->flow_lattice(), objective_->starting_velocity(momenta));
  const bool is_worth_it = level_.simple_shear >= options_.momenta.first_order_shear &&
                           (!options_.momenta.first_order_waits || would_join());
  if (is_worth_it && !reached_.level_start.empty()) momenta = std::move(reached_.level_start);
  reached_.level_start.clear();
  level_.decision = is_worth_it ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut;
  if (!is_worth_it) return false;
  begin_beside_first_orders();
  for (std::size_t step = step_; step < levels_.size(); ++step) meter_.expect(step, planned_work(levels_[step], true));
  return true;
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
  if (!is_wanted) make_objective(rounds_[0]);
  return is_wanted;
}

/// From here on order 0 has the weight that it has beside first orders, and momenta that make the same velocity. Where
/// narrow widths counted less they are whole again, and what is smooth stays: kernels have unit mass.
template <int Dim>
void PyramidRun<Dim>::begin_beside_first_orders() {
  const double alone = options_.momenta.regularisation;
  const double asked = options_.momenta.regularisation_beside_first, beside = asked == 0 ? alone : asked;
  if (is_beside_first_ || (beside == alone && narrow_share() == 1)) return;
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
