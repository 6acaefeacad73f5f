#include "core/registration/register_images.h"

#include "core/optimisation/lbfgs.h"
#include "core/registration/blank_images.h"
#include "core/registration/finish.h"
#include "core/registration/image_pyramid.h"
#include "core/registration/input_checks.h"
#include "core/registration/matching_objective.h"
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

template <int Dim>
std::string describe(const Index<Dim>& size) {
  std::string text;
  for (int extent : size) text += (text.empty() ? "" : "x") + std::to_string(extent);
  return text;
}

}  // namespace

template <int Dim>
RegistrationResult<Dim> register_images(const RegistrationInput<Dim>& input, const RegistrationOptions& asked,
                                        const ProgressCallback& progress) {
  check_input(input);
  const std::vector<std::string> wrong = problems(asked);
  if (!wrong.empty()) throw InvalidInput(wrong.front());
  const RegistrationOptions options = resolved(asked, lattice_of(input.fixed.grid));
#ifdef _OPENMP
  const ThreadCount threads(options.threads);
#endif

  const Stopwatch whole;
  RegistrationResult<Dim> result;
  result.options = options;
  RegistrationSummary& summary = result.summary;
  const ImagePyramid<Dim> pyramid(input, options);
  summary.noise = pyramid.noise();
  summary.similarity_weight = pyramid.similarity_weight();
  std::vector<PlacedScale<Dim, Scalar>> scales = make_scales<Dim, Scalar>(pyramid.fixed_lattice(), options);

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

  std::vector<Scalar> momenta;
  std::unique_ptr<MatchingObjective<Dim, Scalar>> objective;
  MatchingLevel<Dim, Scalar> level_images;
  std::vector<MomentumScale<Dim, Scalar>*> active;
  bool is_stopped = false;
  for (std::size_t step = 0; step < levels.size() && !is_stopped; ++step) {
    const Stopwatch watch;
    const int level = levels[step];
    objective.reset();
    level_images = pyramid.level(level);
    active.clear();
    for (const auto& placed : scales)
      if (placed.level >= level) active.push_back(placed.scale.get());
    objective = std::make_unique<MatchingObjective<Dim, Scalar>>(
        active, level_images,
        make_similarity<Dim, Scalar>(
            options.similarity, level_images.lattice, options.similarity_parameters,
            *std::min_element(level_images.lattice.spacing.begin(), level_images.lattice.spacing.end())),
        options.momenta.sparsity);
    if (options.momenta.shear_only) objective->keep_shear_only();
    momenta.resize(objective->size(), Scalar(0));  // finer scales come last and start at 0

    Progress now;
    now.level = static_cast<int>(step) + 1;
    now.levels = static_cast<int>(levels.size());
    now.max_iterations = options.optimisation.max_iterations *
                         static_cast<int>(sparsity_rounds(options.momenta, !objective->sparsity().empty()).size());
    const double work = static_cast<double>(level_images.lattice.sites());
    const auto report = [&] {
      now.fraction = meter.fraction();
      now.seconds_left = now.fraction > 0.01 ? whole.seconds() * (1 - now.fraction) / now.fraction : -1;
      return !progress || progress(now) == ProgressAnswer::Continue;
    };
    double counted = 0;  // share of this evaluation that the meter has
    objective->on_work([&](double share) {
      if (share < counted) counted = 0;
      meter.done((share - counted) * work, planned_until[step]);
      counted = share;
      if (!report()) throw StopRequested{};
    });

    MinimiseOptions how;
    how.max_iterations = is_blank ? 0 : options.optimisation.max_iterations;
    how.tolerance = options.optimisation.tolerance;
    how.history = options.optimisation.history;
    how.optimality_tolerance = options.optimisation.optimality_tolerance;
    LevelSummary level_summary;
    level_summary.level = now.level;
    level_summary.grid = describe<Dim>(level_images.lattice.size);
    level_summary.spacing_mm =
        *std::min_element(level_images.lattice.spacing.begin(), level_images.lattice.spacing.end());
    level_summary.smoothing_voxels = pyramid.smoothing_voxels(level);
    const auto accepted = [&](const MinimiseStep& taken) {
      const EnergyParts& parts = objective->parts();
      summary.history.push_back({now.level, level_summary.rounds, level_summary.iterations + taken.iteration,
                                 taken.energy, parts.similarity, parts.regularisation, taken.sparsity, taken.step,
                                 taken.optimality});
      now.iteration = level_summary.iterations + taken.iteration;
      now.energy = taken.energy;
      now.similarity = parts.similarity;
      return report();
    };
    try {
      for (const SparsityRound& round : sparsity_rounds(options.momenta, !objective->sparsity().empty())) {
        ++level_summary.rounds;
        objective->weigh(round, momenta);
        const MinimiseSummary found = minimise<Scalar>(*objective, how, momenta, accepted);
        if (level_summary.rounds == 1) {
          how.optimality_reference = found.first_optimality;
          level_summary.energy_before = found.energy_before;
        }
        level_summary.iterations += found.iterations;
        level_summary.evaluations += found.evaluations;
        level_summary.energy_after = found.energy_after;
        level_summary.optimality = found.optimality;
        level_summary.termination = is_blank ? Termination::NothingToRegister : termination_of(found.termination);
        if (level_summary.termination == Termination::Stopped) break;
      }
    } catch (const StopRequested&) {
      level_summary.termination = Termination::Stopped;
    }
    objective->on_work({});
    meter.settle(planned_until[step]);
    level_summary.seconds = watch.seconds();
    level_summary.cpu_seconds = watch.cpu_seconds();
    summary.termination = level_summary.termination;
    is_stopped = level_summary.termination == Termination::Stopped;
    summary.levels.push_back(level_summary);
  }

  const std::vector<Field<Scalar>>& velocities = objective->velocities(momenta);
  const Field<Scalar> backward = write_fields(input, level_images.lattice, velocities, result);
  collect_momenta(active, momenta, input.fixed.grid, result);
  summarise_similarity(pyramid.full_resolution(), options, backward, result);
  if (active.size() == 1) {
    const std::vector<double> energies = objective->hamiltonians(momenta);
    for (double energy : energies)
      if (energies[0] > 0)
        summary.hamiltonian_drift = std::max(summary.hamiltonian_drift, std::abs(energy - energies[0]) / energies[0]);
  } else {
    summary.hamiltonian_drift = -1;
  }
  summary.seconds = whole.seconds();
  summary.cpu_seconds = whole.cpu_seconds();
  return result;
}

template RegistrationResult<2> register_images(const RegistrationInput<2>&, const RegistrationOptions&,
                                               const ProgressCallback&);
template RegistrationResult<3> register_images(const RegistrationInput<3>&, const RegistrationOptions&,
                                               const ProgressCallback&);

}  // namespace saltus
