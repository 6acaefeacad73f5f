#include "core/registration/pyramid_run.h"

#include "core/flow/backward_map.h"
#include "core/registration/expected_iterations.h"
#include "core/registration/narrower_scale.h"
#include "core/support/errors.h"
#include "core/support/free_memory.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cmath>
#include <istream>
#include <utility>

namespace saltus {
namespace {

Termination termination_of(MinimiseTermination termination) {
  switch (termination) {
    case MinimiseTermination::Converged:
      return Termination::Converged;
    case MinimiseTermination::Settled:
      return Termination::Settled;
    case MinimiseTermination::NoiseFloor:
      return Termination::NoiseFloor;
    case MinimiseTermination::IterationLimit:
      return Termination::IterationLimit;
    case MinimiseTermination::LineSearchFailed:
      return Termination::LineSearchFailed;
    case MinimiseTermination::Stopped:
      return Termination::Stopped;
  }
  return Termination::Stopped;
}

/// What the rounds before have brought counts so much for a round with other weights, where it is to be said that a
/// round brings little: with 0 sliding takes 2.5 times as long on the brains, and beside slips the error is 3 % less.
constexpr double kShareOfRoundsBefore = 0.4;

constexpr SparsityRound kOrderZeroAlone{SparsityRound::Weights::Even, 1, false};

/// Thrown by the evaluation hook when the caller wants the run to end, caught where the rounds are run.
struct StopRequested {};

}  // namespace

template <int Dim>
PyramidRun<Dim>::PyramidRun(const RegistrationInput<Dim>& input, const RegistrationOptions& asked,
                            const Field<double>& directions, bool is_blank, const ProgressCallback& progress,
                            const Checkpointing& checkpointing)
    : options_(resolved(asked, lattice_of(input.fixed.grid))),
      directions_(directions),
      is_blank_(is_blank),
      progress_(progress),
      checkpointing_(checkpointing),
      pyramid_(input, options_) {
  // Noise and contrast are known now that there is a pyramid; what follows them is not used before the first level.
  options_ = resolved(asked, pyramid_.fixed_lattice(), {pyramid_.noise(), pyramid_.contrast()});
  scales_ = make_scales<Dim, Scalar>(pyramid_.fixed_lattice(), options_, directions);
  summary_.noise = pyramid_.noise();
  if (const std::optional<IndexBox<Dim>> region = pyramid_.region())
    for (int axis = 0; axis < Dim; ++axis) summary_.region.push_back({region->begin[axis], region->end[axis]});
  // Levels on which no scale takes part yet would have nothing to optimise.
  const int finest = options_.pyramid.finest_level;
  for (int level = options_.pyramid.levels - 1; level >= finest; --level)
    if (level == finest || std::any_of(scales_.begin(), scales_.end(), [&](const auto& s) { return s.level >= level; }))
      levels_.push_back(level);
  if (is_blank_) levels_ = {finest};
  map_steps_ = options_.flow.map_steps;  // of the first level, before which nothing is known of the motion

  // Where first orders have to be worth it, most levels end after the round without them.
  for (int level : levels_) meter_.plan_step(planned_work(level, options_.momenta.first_order_shear == 0));

  if (checkpointing.offer || checkpointing.resume) job_ = job_fingerprint(input, asked);
  if (!checkpointing.resume) return;
  reached_ = decode(*checkpointing.resume(), job_);
  if (reached_.step < 0 || reached_.step >= static_cast<int>(levels_.size()) || !reached_.minimiser.has_begun() ||
      reached_.history.empty() || reached_.level.rounds < 1)
    throw InvalidInput("the checkpoint is damaged, it is of no step of this registration; start again without it");
  is_resumed_ = true;
  summary_.levels = reached_.levels;
  summary_.history = reached_.history;
  for (std::size_t step = 0; step < static_cast<std::size_t>(reached_.step); ++step) meter_.end(step, true);
  seconds_before_ = reached_.seconds;
  cpu_seconds_before_ = reached_.cpu_seconds;
}

template <int Dim>
bool PyramidRun<Dim>::has_first_at(int level) const {
  return std::any_of(scales_.begin(), scales_.end(),
                     [&](const auto& placed) { return placed.level >= level && placed.scale->can_slide(); });
}

/// Whether first-order momenta are left of the levels before.
template <int Dim>
bool PyramidRun<Dim>::has_found() const {
  return !summary_.levels.empty() &&
         (summary_.levels.back().active_block_share > 0 || summary_.levels.back().oriented_elements > 0);
}

/// Whether the level, which has not begun, is to begin with order 0 alone and then asks for first orders.
template <int Dim>
bool PyramidRun<Dim>::decides_at(int level) const {
  return has_first_at(level) && options_.momenta.first_order_shear > 0 &&
         std::none_of(summary_.levels.begin(), summary_.levels.end(),
                      [](const LevelSummary& before) { return before.decision == FirstOrderDecision::LetIn; });
}

/// Of a level that has not begun, in sites evaluated.
template <int Dim>
double PyramidRun<Dim>::planned_work(int level, bool lets_in) const {
  const std::size_t rounds = lets_in ? sparsity_rounds(options_.momenta, has_first_at(level), has_found()).size() : 1;
  return static_cast<double>(pyramid_.lattice(level).sites()) * static_cast<double>(rounds) *
         (std::min(usual_iterations, options_.optimisation.max_iterations) + 1);
}

template <int Dim>
void PyramidRun<Dim>::run() {
  bool is_stopped = false;
  for (std::size_t step = static_cast<std::size_t>(reached_.step); step < levels_.size() && !is_stopped; ++step) {
    const ThreadCount threads(threads_of_level(level_lattice(pyramid_.fixed_lattice(), levels_[step]).sites()));
    begin_level(step);
    run_rounds();
    end_level();
    is_stopped = summary_.termination == Termination::Stopped;
  }
}

template <int Dim>
void PyramidRun<Dim>::count_time() {
  summary_.seconds = seconds_before_ + whole_.seconds();
  summary_.cpu_seconds = cpu_seconds_before_ + whole_.cpu_seconds();
}

template <int Dim>
void PyramidRun<Dim>::release() {
  objective_.reset();
  for (std::vector<Scalar>* samples :
       {&images_.fixed, &images_.fixed_weights, &images_.moving.samples, &images_.moving_weights.samples})
    free_vector(*samples);
}

template <int Dim>
void PyramidRun<Dim>::begin_level(std::size_t step) {
  step_ = step;
  watch_ = std::make_unique<Stopwatch>();
  const int level = levels_[step];
  objective_.reset();
  images_ = pyramid_.level(level);
  const double voxel = *std::min_element(images_.lattice.spacing.begin(), images_.lattice.spacing.end());

  level_ = {};
  level_.level = static_cast<int>(step) + 1;
  level_.grid = size_text<Dim>(images_.lattice.size);
  level_.spacing_mm = voxel;
  level_.smoothing_voxels = pyramid_.smoothing_voxels(level);
  level_.similarity_weight = pyramid_.similarity_weight(level);
  level_.map_steps = map_steps_;
  level_.shear_before = shear_before_;
  if (shear_before_ >= 0 && shear_before_ < options_.momenta.narrow_width_shear)
    level_.narrow_share = kNarrowShareOfSmooth;
  shear_before_ = -1;
  gives_up_sharp_ = showed_slip_ = false;
  if (is_resumed_) level_ = reached_.level;
  if (level_.narrow_share < 1 || (is_resumed_ && (narrow_share() < 1 || has_narrower())))
    make_scales_anew(options_, narrow_share());
  images_.map_steps = level_.map_steps;
  level_seconds_before_ = level_.seconds;
  level_cpu_seconds_before_ = level_.cpu_seconds;

  has_first_ = has_first_at(level);
  decides_ = decides_at(level);
  rounds_ = sparsity_rounds(options_.momenta, has_first_, has_found());
  if (decides_ && !options_.momenta.first_order_waits) rounds_.insert(rounds_.begin(), kOrderZeroAlone);
  if (level_.has_finer) rounds_.insert(rounds_.begin(), kOrderZeroAlone);
  if (level_.has_narrower) rounds_.insert(rounds_.begin(), kOrderZeroAlone);

  if (is_resumed_ && static_cast<std::size_t>(level_.rounds) > rounds_.size())
    throw InvalidInput("the checkpoint is damaged, it is of round " + std::to_string(level_.rounds) +
                       " where there are " + std::to_string(rounds_.size()) + "; start again without it");

  now_ = {};
  now_.level = level_.level;
  now_.levels = static_cast<int>(levels_.size());
  now_.max_iterations = options_.optimisation.max_iterations * static_cast<int>(rounds_.size());
  how_ = {};
  how_.max_iterations = is_blank_ ? 0 : options_.optimisation.max_iterations;
  how_.tolerance = options_.optimisation.tolerance;
  how_.history = options_.optimisation.history;
  how_.optimality_tolerance = options_.optimisation.optimality_tolerance;

  if (has_first_ && (!decides_ || level_.decision == FirstOrderDecision::LetIn)) begin_beside_first_orders();
  if (level_.has_finer && level_.decision != FirstOrderDecision::LetIn) begin_finer_scales();

  std::vector<Scalar>& momenta = reached_.minimiser.x;
  make_objective(rounds_[is_resumed_ ? level_.rounds - 1 : 0]);
  if (is_resumed_) {
    if (momenta.size() != objective_->size())
      throw InvalidInput("the checkpoint is damaged, it holds " + std::to_string(momenta.size()) + " momenta where " +
                         std::to_string(objective_->size()) + " are needed; start again without it");
    how_.optimality_reference = reached_.optimality_reference;
    now_.iteration = level_.iterations + reached_.minimiser.iterations();
    now_.energy = reached_.minimiser.energies.back();
    now_.similarity = summary_.history.back().similarity;
    return;
  }
  momenta.resize(objective_->size(), Scalar(0));  // finer scales come last and start at 0
  reached_.level_start.clear();
  if (decides_ && !options_.momenta.first_order_waits) reached_.level_start = momenta;
}

/// Whether there is no first-order momentum and none may appear.
template <int Dim>
bool PyramidRun<Dim>::is_smooth(const SparsityRound& round) const {
  const auto is_empty = [](const auto& list) { return list.empty(); };
  return !has_first_ || (!round.lets_blocks_join &&
                         std::all_of(reached_.active_blocks.begin(), reached_.active_blocks.end(), is_empty) &&
                         std::all_of(reached_.active_elements.begin(), reached_.active_elements.end(), is_empty));
}

/// Of the level, for a round that is_smooth, or not.
template <int Dim>
Lattice<Dim> PyramidRun<Dim>::flow_lattice(bool smooth) const {
  const int level = levels_[step_];
  if (!smooth) return flow_lattice_beside_first(pyramid_.fixed_lattice(), options_, level);
  if (has_narrower()) return narrow_flow_lattice(pyramid_.fixed_lattice(), options_, level, finest_zeroth().level);
  return level_lattice(pyramid_.fixed_lattice(), level + options_.flow.coarsening);
}

/// The objective of a round, made anew (true) only where the flow has to move to another lattice. What is in x stays
/// where it is: scales that are all order 1 have no momenta while they are left out.
template <int Dim>
bool PyramidRun<Dim>::make_objective(const SparsityRound& round) {
  const int level = levels_[step_];
  const bool smooth = is_smooth(round);
  const Lattice<Dim> flow = flow_lattice(smooth);
  std::vector<MomentumScale<Dim, Scalar>*> scales;
  for (const auto& placed : scales_)
    if (placed.level >= level && !(smooth && !has_zeroth(placed.scale->options().orders)))
      scales.push_back(placed.scale.get());
  if (objective_ && objective_->flow_lattice() == flow && scales == active_) return false;
  objective_.reset();
  active_ = scales;
  objective_ = std::make_unique<MatchingObjective<Dim, Scalar>>(
      active_, images_,
      make_similarity<Dim, Scalar>(options_.similarity, images_.lattice, options_.similarity_parameters,
                                   level_.spacing_mm),
      options_.momenta.sparsity, flow, options_.momenta.oriented_sparsity);
  if (options_.momenta.shear_only) objective_->working_set().keep_shear_only();
  objective_->working_set().want_oblique(options_.momenta.oblique_share);
  if (options_.momenta.oriented_alone > 0) objective_->working_set().let_elements_stand_alone();
  objective_->working_set().bound_active(
      most_active_blocks(pyramid_.fixed_lattice(), options_.momenta.most_active_share));
  // Finer scales begin with none, and where order 0 is alone nothing has any.
  objective_->working_set().set_active_blocks(smooth ? std::vector<std::vector<std::uint32_t>>{}
                                                     : reached_.active_blocks);
  objective_->working_set().set_active_elements(reached_.active_elements);
  objective_->on_work([this](double share) { count_work(share); });
  return true;
}

template <int Dim>
void PyramidRun<Dim>::run_rounds() {
  try {
    for (std::size_t round = is_resumed_ ? level_.rounds - 1 : 0;; ++round) {
      if (is_resumed_) {
        objective_->working_set().restore_weights(rounds_[round], reached_.sparsity_factors);
        objective_->working_set().restore_turned(reached_.turned_normals, reached_.turned_elements);
        is_resumed_ = false;
      } else {
        if (!goes_on(round)) break;
        begin_round(round);
      }
      minimise_round(round);
      if (level_.termination == Termination::Stopped) break;
    }
  } catch (const StopRequested&) {
    level_.termination = Termination::Stopped;
    if (!before_round_.empty()) {  // what was given up was not found again
      reached_.minimiser.x = std::move(before_round_);
      level_.gave_up_sharp = false;
    }
    if (!is_counted_) count_round();
  }
}

/// Before a round: whether it comes to that. With order 0 alone on its finest scales, and with a narrower one, there is
/// one more.
template <int Dim>
bool PyramidRun<Dim>::goes_on(std::size_t round) {
  if (round == 0) return true;
  const bool has_more = round < rounds_.size();
  if (has_first_ && !decides_) return has_more && (round > 1 || would_join());
  if (level_.has_narrower) return false;
  if (decides_ && (level_.decision == FirstOrderDecision::LetIn || first_orders_are_worth_it())) return has_more;
  if (decides_ && may_be_finer()) {
    level_.has_finer = true;
    level_.decision = FirstOrderDecision::None;  // that is yet to come
    begin_finer_scales();
  } else if (may_be_narrower() && finds_narrow_pull()) {
    const Lattice<Dim> before = flow_lattice(true);
    level_.has_narrower = true;
    // What is narrow is steep; less so between sites of a finer lattice.
    const int more =
        flow_lattice(true) == before ? 2 * level_.map_steps : level_.map_steps + (level_.map_steps + 1) / 2;
    if (options_.flow.map_tolerance > 0)
      level_.map_steps = images_.map_steps = std::max(level_.map_steps, std::min(more, kMostMapSteps));
    begin_narrower();
  } else {
    return false;
  }
  rounds_.insert(rounds_.begin(), kOrderZeroAlone);
  now_.max_iterations += options_.optimisation.max_iterations;
  make_objective(kOrderZeroAlone);
  reached_.minimiser.x.resize(objective_->size(), Scalar(0));
  return true;
}

template <int Dim>
void PyramidRun<Dim>::begin_round(std::size_t round) {
  std::vector<Scalar>& momenta = reached_.minimiser.x;
  level_.rounds = static_cast<int>(round) + 1;
  reached_.active_blocks = objective_->working_set().active_blocks();
  reached_.active_elements = objective_->working_set().active_elements();
  const bool is_new = make_objective(rounds_[round]);
  objective_->weigh(rounds_[round], momenta);
  level_.oblique_share = objective_->working_set().oblique_share();
  // After it was seen from these where something slides.
  if (std::exchange(gives_up_sharp_, false)) {
    before_round_ = momenta;
    objective_->smooth_zeroth(momenta);
  }
  // Other weights change the sparsity term alone, and elements turn by 36 degrees at most: what is known of the
  // smooth part's curvature remains a good model. Not one that has just found no way down.
  const bool is_known = !is_new && round > 0 && rounds_[round - 1].lets_blocks_join &&
                        options_.optimisation.keep_pairs && level_.termination != Termination::LineSearchFailed;
  std::deque<CurvaturePair<Scalar>> pairs = std::move(reached_.minimiser.pairs);
  reached_.minimiser = MinimiserState<Scalar>(std::move(momenta));
  if (is_known) reached_.minimiser.pairs = std::move(pairs);
}

template <int Dim>
void PyramidRun<Dim>::minimise_round(std::size_t round) {
  round_watch_ = Stopwatch();
  round_work_ = 0;
  is_counted_ = false;
  const RegistrationOptions::Optimisation& optimisation = options_.optimisation;
  how_.tolerance = optimisation.tolerance;
  const bool has_own = round == 0 && has_found() && optimisation.first_round_tolerance >= 0;
  if (round + 1 < rounds_.size() && rounds_[round].lets_blocks_join)
    how_.tolerance =
        std::max(how_.tolerance, has_own ? optimisation.first_round_tolerance : optimisation.round_tolerance);
  // Order 0 that is about to be asked whether something slides, or that is all that the level has.
  else if ((round == 0 || level_.has_finer || level_.has_narrower) && is_smooth(rounds_[round]) &&
           (decides_ || !has_first_) && optimisation.look_tolerance > 0)
    how_.tolerance = std::min(how_.tolerance, optimisation.look_tolerance);
  how_.noise_tolerance = is_smooth(rounds_[round]) ? optimisation.noise_tolerance : 0;
  how_.decrease_before = 0;
  if (round > 0 && options_.momenta.first_order_waits) {
    // A round in which first orders waited minimised the same energy, or with a narrower scale to come one whose
    // decrease counts like it, unless order 0 got another weight after it; others one with other weights.
    const bool is_same =
        !rounds_[round - 1].lets_blocks_join && !(is_beside_first_ && level_.decision == FirstOrderDecision::LetIn);
    const double share = is_same ? 1 : kShareOfRoundsBefore;
    how_.decrease_before = std::max(0.0, share * (level_.energy_before - level_.energy_after));
  }
  const MinimiseSummary found = round == 0 && decides_ ? minimise_until_slip_shows() : minimise_as(how_);
  if (level_.rounds == 1) how_.optimality_reference = found.first_optimality;
  count_round();
  level_.optimality = found.optimality;
  level_.termination = is_blank_ ? Termination::NothingToRegister : termination_of(found.termination);
}

/// Goes on from where the round has come to.
template <int Dim>
MinimiseSummary PyramidRun<Dim>::minimise_as(const MinimiseOptions& how) {
  return minimise<Scalar>(*objective_, how, reached_.minimiser,
                          [this](const MinimiseStep& taken) { return accept(taken); });
}

template <int Dim>
void PyramidRun<Dim>::end_level() {
  reached_.minimiser = MinimiserState<Scalar>(std::move(reached_.minimiser.x));  // the curvature's memory goes
  reached_.active_blocks = objective_->working_set().active_blocks();
  reached_.active_elements = objective_->working_set().active_elements();
  level_.active_block_share = objective_->working_set().active_block_share();
  for (const auto& elements : reached_.active_elements) level_.oriented_elements += static_cast<int>(elements.size());
  objective_->on_work({});  // who wanted to stop is not asked again
  if (options_.flow.map_tolerance > 0 && level_.termination != Termination::Stopped) choose_map_steps();
  meter_.end(step_);
  count_level_time(level_);
  summary_.termination = level_.termination;
  summary_.levels.push_back(level_);
  for (std::size_t step = step_ + 1; step < levels_.size() && has_found(); ++step)
    meter_.expect(step, planned_work(levels_[step], true));
  if (level_.termination != Termination::Stopped) ask_for_narrow_widths();
}

/// Of the next level, from what this one has found.
template <int Dim>
void PyramidRun<Dim>::choose_map_steps() {
  level_.map_error_mm =
      map_error<Dim, Scalar>(objective_->flow_lattice(), objective_->velocities(reached_.minimiser.x));
  if (step_ + 1 == levels_.size()) return;
  const Lattice<Dim> next = level_lattice(pyramid_.fixed_lattice(), levels_[step_ + 1]);
  const double voxel = *std::min_element(next.spacing.begin(), next.spacing.end());
  // Of second order, as if all steps were the map's.
  const double needed = level_.map_steps * std::sqrt(level_.map_error_mm / (options_.flow.map_tolerance * voxel));
  // What the finest level adds to the motion is narrow.
  const int least = step_ + 2 == levels_.size() ? options_.flow.map_steps : 1;
  map_steps_ = std::max(least, needed <= kMostMapSteps ? static_cast<int>(std::ceil(needed)) : kMostMapSteps);
}

template <int Dim>
void PyramidRun<Dim>::count_round() {
  const MinimiserState<Scalar>& state = reached_.minimiser;
  is_counted_ = true;
  level_.iterations += state.iterations();
  level_.evaluations += state.evaluations;
  level_.kept_out_share = std::max(level_.kept_out_share, objective_->working_set().kept_out_share());
  if (!state.has_begun()) return;
  if (level_.rounds == 1) level_.energy_before = state.energies.front();
  level_.energy_after = state.energies.back();
}

template <int Dim>
bool PyramidRun<Dim>::report() {
  now_.fraction = std::min(0.99, meter_.fraction());  // the whole is done when the last level has ended
  // By the speed of this round as soon as it has one: a site costs more where first orders take part.
  if (round_work_ >= 2.0 * static_cast<double>(images_.lattice.sites()))
    seconds_per_work_ = round_watch_.seconds() / round_work_;
  now_.seconds_left = seconds_per_work_ > 0 ? seconds_per_work_ * meter_.left() : -1;
  return !progress_ || progress_(now_) == ProgressAnswer::Continue;
}

template <int Dim>
bool PyramidRun<Dim>::accept(const MinimiseStep& taken) {
  free_vector(before_round_);
  const EnergyParts& parts = objective_->parts();
  summary_.history.push_back({now_.level, level_.rounds, level_.iterations + taken.iteration, taken.energy,
                              parts.similarity, parts.regularisation, taken.sparsity, taken.step, taken.optimality});
  now_.iteration = level_.iterations + taken.iteration;
  now_.energy = taken.energy;
  expect_of_level();
  now_.similarity = parts.similarity;
  if (checkpointing_.offer) {
    now_.fraction = std::min(0.99, meter_.fraction());
    checkpointing_.offer(now_, [this](std::ostream& out) { make_checkpoint(out); });
  }
  return report();
}

/// Where first orders are to be asked for, most levels leave them out: of their rounds a quarter of one is expected
/// until it is known.
template <int Dim>
void PyramidRun<Dim>::expect_of_level() {
  const bool is_alone = decides_ && level_.decision != FirstOrderDecision::LetIn;
  const double left_alone = level_.has_narrower ? 0 : may_be_finer() ? 1 : 0.25;
  const auto rounds_left = is_alone ? left_alone : static_cast<double>(rounds_.size()) - level_.rounds;
  // Blocks that join may keep an energy going that had settled.
  const bool may_join = rounds_[static_cast<std::size_t>(level_.rounds) - 1].lets_blocks_join && objective_->has_more();
  const double least = may_join ? std::min(5, how_.max_iterations - reached_.minimiser.iterations()) : 0;
  const double evaluations = std::max(least, expected_iterations_left(reached_.minimiser.energies, how_)) +
                             rounds_left * std::min(usual_iterations, how_.max_iterations);
  meter_.expect(step_, evaluations * static_cast<double>(images_.lattice.sites()));
}

template <int Dim>
void PyramidRun<Dim>::count_work(double share) {
  if (share < counted_) counted_ = 0;
  const double work = (share - counted_) * static_cast<double>(images_.lattice.sites());
  meter_.add(step_, work);
  round_work_ += work;
  counted_ = share;
  if (!report()) throw StopRequested{};
}

template <int Dim>
void PyramidRun<Dim>::make_checkpoint(std::ostream& out) {
  reached_.step = static_cast<int>(step_);
  reached_.level = level_;
  count_level_time(reached_.level);
  reached_.level.kept_out_share = std::max(level_.kept_out_share, objective_->working_set().kept_out_share());
  reached_.optimality_reference = how_.optimality_reference;
  reached_.sparsity_factors = objective_->working_set().weights();
  reached_.active_blocks = objective_->working_set().active_blocks();
  reached_.active_elements = objective_->working_set().active_elements();
  reached_.turned_normals = objective_->working_set().turned_normals();
  reached_.turned_elements = objective_->working_set().turned_elements();
  reached_.levels = summary_.levels;
  reached_.history = summary_.history;
  reached_.seconds = seconds_before_ + whole_.seconds();
  reached_.cpu_seconds = cpu_seconds_before_ + whole_.cpu_seconds();
  encode(reached_, job_, out);
  // Copies of what the objective has; the next one takes them anew.
  reached_.sparsity_factors.clear();
  reached_.turned_normals.clear();
  reached_.turned_elements.clear();
}

template <int Dim>
void PyramidRun<Dim>::count_level_time(LevelSummary& at) const {
  at.seconds = level_seconds_before_ + watch_->seconds();
  at.cpu_seconds = level_cpu_seconds_before_ + watch_->cpu_seconds();
}

template class PyramidRun<2>;
template class PyramidRun<3>;

}  // namespace saltus
