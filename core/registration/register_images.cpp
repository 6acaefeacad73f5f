#include "core/registration/register_images.h"

#include "core/optimisation/lbfgs.h"
#include "core/registration/blank_images.h"
#include "core/registration/direction.h"
#include "core/registration/finish.h"
#include "core/registration/image_pyramid.h"
#include "core/registration/input_checks.h"
#include "core/registration/matching_objective.h"
#include "core/registration/move_points.h"
#include "core/registration/scales.h"
#include "core/registration/sparsity_rounds.h"
#include "core/support/errors.h"
#include "core/support/stopwatch.h"

#include <algorithm>
#include <cmath>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {
namespace {

using Scalar = float;

#ifdef _OPENMP
/// Runs with `threads` threads (0: as many as it finds) and leaves the caller's number as it was.
class ThreadCount {
 public:
  explicit ThreadCount(int threads) : before_(omp_get_max_threads()) {
    if (threads > 0) omp_set_num_threads(threads);
  }
  ~ThreadCount() { omp_set_num_threads(before_); }
  ThreadCount(const ThreadCount&) = delete;
  ThreadCount& operator=(const ThreadCount&) = delete;

 private:
  int before_;
};
#endif

Termination termination_of(MinimiseTermination termination) {
  switch (termination) {
    case MinimiseTermination::Converged:
      return Termination::Converged;
    case MinimiseTermination::Settled:
      return Termination::Settled;
    case MinimiseTermination::IterationLimit:
      return Termination::IterationLimit;
    case MinimiseTermination::LineSearchFailed:
      return Termination::LineSearchFailed;
    case MinimiseTermination::Stopped:
      return Termination::Stopped;
  }
  return Termination::Stopped;
}

/// Thrown by the evaluation hook when the caller wants the run to end, caught where the levels are run.
struct StopRequested {};

/// Work done and to come, in units of voxel evaluations.
class WorkMeter {
 public:
  void plan(double work) { planned_ += work; }
  /// Line searches can take more than was planned: within a level the count stops at the level's end.
  void done(double work, double planned_until_level_ends) { done_ = std::min(done_ + work, planned_until_level_ends); }
  /// A level has ended: what it did not use will not come.
  void settle(double planned_until_here) { done_ = planned_until_here; }
  double fraction() const { return planned_ > 0 ? std::min(1.0, done_ / planned_) : 0; }

 private:
  double planned_ = 0, done_ = 0;
};

}  // namespace

template <int Dim>
RegistrationResult<Dim> register_images(const RegistrationInput<Dim>& input, const RegistrationOptions& asked,
                                        const ProgressCallback& progress, const Checkpointing& checkpointing) {
  check_input(input);
  const std::vector<std::string> wrong = problems(asked);
  if (!wrong.empty()) throw InvalidInput(wrong.front());
  const RegistrationOptions options = resolved(asked, lattice_of(input.fixed.grid));
  const Field<double> directions = frame_directions(input, options);
  check_points(input.fixed_points);
#ifdef _OPENMP
  const ThreadCount threads(options.threads);
#endif

  const Stopwatch whole;
  RegistrationResult<Dim> result;
  result.options = options;
  RegistrationSummary& summary = result.summary;
  const ImagePyramid<Dim> pyramid(input, options);
  summary.noise = pyramid.noise();
  std::vector<PlacedScale<Dim, Scalar>> scales = make_scales<Dim, Scalar>(pyramid.fixed_lattice(), options, directions);

  summary.notices = blank_images(input);
  const bool is_blank = !summary.notices.empty();

  // Levels on which no scale takes part yet would have nothing to optimise.
  std::vector<int> levels;
  for (int level = options.pyramid.levels - 1; level >= options.pyramid.finest_level; --level)
    if (std::any_of(scales.begin(), scales.end(), [&](const auto& s) { return s.level >= level; }) ||
        level == options.pyramid.finest_level)
      levels.push_back(level);
  if (is_blank) levels = {options.pyramid.finest_level};

  WorkMeter meter;
  std::vector<double> planned_until;
  double planned = 0;
  for (int level : levels) {
    const bool has_first = std::any_of(scales.begin(), scales.end(), [&](const auto& placed) {
      return placed.level >= level && placed.scale->has_first_order();
    });
    planned += static_cast<double>(level_lattice(pyramid.fixed_lattice(), level).sites()) *
               static_cast<double>(sparsity_rounds(options.momenta, has_first).size()) *
               (options.optimisation.max_iterations + 2);
    planned_until.push_back(planned);
  }
  meter.plan(planned);

  const std::uint64_t job = checkpointing.offer || !checkpointing.resume.empty() ? job_fingerprint(input, options) : 0;
  Checkpoint reached;  // where the run stands; all but the minimiser and the round's weights is filled in for a blob
  if (!checkpointing.resume.empty()) {
    reached = decode(checkpointing.resume, job);
    if (reached.step < 0 || reached.step >= static_cast<int>(levels.size()) || !reached.minimiser.has_begun() ||
        reached.history.empty() || reached.level.rounds < 1)
      throw InvalidInput("the checkpoint is damaged, it is of no step of this registration; start again without it");
    summary.levels = reached.levels;
    summary.history = reached.history;
    if (reached.step > 0) meter.settle(planned_until[reached.step - 1]);
  }
  const double seconds_before = reached.seconds, cpu_seconds_before = reached.cpu_seconds;
  bool is_resumed = reached.minimiser.has_begun();
  std::vector<Scalar>& momenta = reached.minimiser.x;
  std::unique_ptr<MatchingObjective<Dim, Scalar>> objective;
  MatchingLevel<Dim, Scalar> level_images;
  std::vector<MomentumScale<Dim, Scalar>*> active;
  bool is_stopped = false;
  for (std::size_t step = static_cast<std::size_t>(reached.step); step < levels.size() && !is_stopped; ++step) {
    const Stopwatch watch;
    const int level = levels[step];
    objective.reset();
    level_images = pyramid.level(level);
    active.clear();
    for (const auto& placed : scales)
      if (placed.level >= level) active.push_back(placed.scale.get());
    const bool has_first =
        std::any_of(active.begin(), active.end(), [](const auto* scale) { return scale->has_first_order(); });
    const std::vector<SparsityRound> rounds = sparsity_rounds(options.momenta, has_first);
    Progress now;
    now.level = static_cast<int>(step) + 1;
    now.levels = static_cast<int>(levels.size());
    now.max_iterations = options.optimisation.max_iterations * static_cast<int>(rounds.size());
    const double work = static_cast<double>(level_images.lattice.sites());
    const auto report = [&] {
      now.fraction = meter.fraction();
      now.seconds_left =
          now.fraction > 0.01 ? (seconds_before + whole.seconds()) * (1 - now.fraction) / now.fraction : -1;
      return !progress || progress(now) == ProgressAnswer::Continue;
    };
    double counted = 0;  // share of this evaluation that the meter has
    const auto count_work = [&](double share) {
      if (share < counted) counted = 0;
      meter.done((share - counted) * work, planned_until[step]);
      counted = share;
      if (!report()) throw StopRequested{};
    };

    // While there is no order 1 all velocities are smooth, and so is the map.
    const auto flow_lattice = [&](const SparsityRound& round) {
      const bool is_smooth = !has_first || (!round.lets_blocks_join &&
                                            std::all_of(reached.active_blocks.begin(), reached.active_blocks.end(),
                                                        [](const auto& blocks) { return blocks.empty(); }));
      return level_lattice(pyramid.fixed_lattice(), is_smooth ? level + options.flow.coarsening : level);
    };
    const auto make_objective = [&](const SparsityRound& round) {
      const Lattice<Dim> flow = flow_lattice(round);
      if (objective && objective->flow_lattice() == flow) return;
      objective.reset();
      objective = std::make_unique<MatchingObjective<Dim, Scalar>>(
          active, level_images,
          make_similarity<Dim, Scalar>(
              options.similarity, level_images.lattice, options.similarity_parameters,
              *std::min_element(level_images.lattice.spacing.begin(), level_images.lattice.spacing.end())),
          options.momenta.sparsity, flow);
      if (options.momenta.shear_only) objective->keep_shear_only();
      objective->set_active_blocks(reached.active_blocks);  // finer scales begin with none
      objective->on_work(count_work);
    };
    make_objective(rounds[is_resumed ? reached.level.rounds - 1 : 0]);
    if (is_resumed && momenta.size() != objective->size())
      throw InvalidInput("the checkpoint is damaged, it holds " + std::to_string(momenta.size()) + " momenta where " +
                         std::to_string(objective->size()) + " are needed; start again without it");
    momenta.resize(objective->size(), Scalar(0));  // finer scales come last and start at 0

    MinimiseOptions how;
    how.max_iterations = is_blank ? 0 : options.optimisation.max_iterations;
    how.tolerance = options.optimisation.tolerance;
    how.history = options.optimisation.history;
    how.optimality_tolerance = options.optimisation.optimality_tolerance;
    LevelSummary level_summary;
    level_summary.level = now.level;
    level_summary.grid = size_text<Dim>(level_images.lattice.size);
    level_summary.spacing_mm =
        *std::min_element(level_images.lattice.spacing.begin(), level_images.lattice.spacing.end());
    level_summary.smoothing_voxels = pyramid.smoothing_voxels(level);
    level_summary.similarity_weight = pyramid.similarity_weight(level);
    if (is_resumed) {
      level_summary = reached.level;
      how.optimality_reference = reached.optimality_reference;
      now.iteration = level_summary.iterations + reached.minimiser.iterations();
      now.energy = reached.minimiser.energies.back();
      now.similarity = summary.history.back().similarity;
    }
    const double level_seconds_before = level_summary.seconds, level_cpu_seconds_before = level_summary.cpu_seconds;
    const auto count_time = [&](LevelSummary& at) {
      at.seconds = level_seconds_before + watch.seconds();
      at.cpu_seconds = level_cpu_seconds_before + watch.cpu_seconds();
    };
    const MakeCheckpoint make_checkpoint = [&] {
      reached.step = static_cast<int>(step);
      reached.level = level_summary;
      count_time(reached.level);
      reached.optimality_reference = how.optimality_reference;
      reached.sparsity_factors = objective->weights();
      reached.active_blocks = objective->active_blocks();
      reached.levels = summary.levels;
      reached.history = summary.history;
      reached.seconds = seconds_before + whole.seconds();
      reached.cpu_seconds = cpu_seconds_before + whole.cpu_seconds();
      return encode(reached, job);
    };
    const auto accepted = [&](const MinimiseStep& taken) {
      const EnergyParts& parts = objective->parts();
      summary.history.push_back({now.level, level_summary.rounds, level_summary.iterations + taken.iteration,
                                 taken.energy, parts.similarity, parts.regularisation, taken.sparsity, taken.step,
                                 taken.optimality});
      now.iteration = level_summary.iterations + taken.iteration;
      now.energy = taken.energy;
      now.similarity = parts.similarity;
      if (checkpointing.offer) {
        now.fraction = meter.fraction();
        checkpointing.offer(now, make_checkpoint);
      }
      return report();
    };
    const auto count_round = [&] {
      const MinimiserState<Scalar>& state = reached.minimiser;
      level_summary.iterations += state.iterations();
      level_summary.evaluations += state.evaluations;
      if (!state.has_begun()) return;
      if (level_summary.rounds == 1) level_summary.energy_before = state.energies.front();
      level_summary.energy_after = state.energies.back();
    };
    try {
      for (std::size_t round = is_resumed ? level_summary.rounds - 1 : 0; round < rounds.size(); ++round) {
        if (is_resumed) {
          objective->restore_weights(rounds[round], reached.sparsity_factors);
          is_resumed = false;
        } else {
          level_summary.rounds = static_cast<int>(round) + 1;
          reached.active_blocks = objective->active_blocks();
          make_objective(rounds[round]);
          objective->weigh(rounds[round], momenta);
          reached.minimiser = MinimiserState<Scalar>(std::move(momenta));
        }
        // A round in which first orders waited minimised the same energy.
        how.decrease_before = round > 0 && !rounds[round - 1].lets_blocks_join
                                  ? level_summary.energy_before - level_summary.energy_after
                                  : 0;
        const MinimiseSummary found = minimise<Scalar>(*objective, how, reached.minimiser, accepted);
        if (level_summary.rounds == 1) how.optimality_reference = found.first_optimality;
        count_round();
        level_summary.optimality = found.optimality;
        level_summary.termination = is_blank ? Termination::NothingToRegister : termination_of(found.termination);
        if (level_summary.termination == Termination::Stopped) break;
      }
    } catch (const StopRequested&) {
      level_summary.termination = Termination::Stopped;
      count_round();
    }
    reached.minimiser = MinimiserState<Scalar>(std::move(momenta));  // the momenta stay, the curvature's memory goes
    reached.active_blocks = objective->active_blocks();
    level_summary.active_block_share = objective->active_block_share();
    objective->on_work({});
    meter.settle(planned_until[step]);
    count_time(level_summary);
    summary.termination = level_summary.termination;
    is_stopped = level_summary.termination == Termination::Stopped;
    summary.levels.push_back(level_summary);
  }

  const std::vector<Field<Scalar>>& velocities = objective->velocities(momenta);
  const Field<Scalar> backward = write_fields(input, objective->flow_lattice(), velocities, result);
  collect_momenta(active, objective->pointers(momenta), input.fixed.grid, result);
  summarise_similarity(pyramid.full_resolution(), options, backward, result);
  if (active.size() == 1) {
    const std::vector<double> energies = objective->hamiltonians(momenta);
    for (double energy : energies)
      if (energies[0] > 0)
        summary.hamiltonian_drift = std::max(summary.hamiltonian_drift, std::abs(energy - energies[0]) / energies[0]);
  } else {
    summary.hamiltonian_drift = -1;
  }
  result.moved_points = move_points(input, objective->flow_lattice(), velocities, active, objective->pointers(momenta));
  summary.seconds = seconds_before + whole.seconds();
  summary.cpu_seconds = cpu_seconds_before + whole.cpu_seconds();
  return result;
}

template RegistrationResult<2> register_images(const RegistrationInput<2>&, const RegistrationOptions&,
                                               const ProgressCallback&, const Checkpointing&);
template RegistrationResult<3> register_images(const RegistrationInput<3>&, const RegistrationOptions&,
                                               const ProgressCallback&, const Checkpointing&);

}  // namespace saltus
