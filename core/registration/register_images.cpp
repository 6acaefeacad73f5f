#include "core/registration/register_images.h"

#include "core/registration/blank_images.h"
#include "core/registration/direction.h"
#include "core/registration/finish.h"
#include "core/registration/input_checks.h"
#include "core/registration/move_points.h"
#include "core/registration/pyramid_run.h"
#include "core/slip/measure_slip.h"
#include "core/support/errors.h"
#include "core/support/free_memory.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

void check_options(const RegistrationOptions& options) {
  const std::vector<std::string> wrong = problems(options);
  if (!wrong.empty()) throw InvalidInput(wrong.front());
}

/// Largest |H(t) - H(0)| / H(0).
double drift_of(const std::vector<double>& energies) {
  double drift = 0;
  for (double energy : energies)
    if (energies[0] > 0) drift = std::max(drift, std::abs(energy - energies[0]) / energies[0]);
  return drift;
}

}  // namespace

template <int Dim>
RegistrationResult<Dim> register_images(const RegistrationInput<Dim>& input, const RegistrationOptions& asked,
                                        const ProgressCallback& progress, const Checkpointing& checkpointing) {
  check_input(input);
  check_options(asked);
  check_options(resolved(asked, lattice_of(input.fixed.grid)));  // some of it can be said of an image only
  const Field<double> directions = frame_directions(input, asked);
  check_points(input.fixed_points);
  const ThreadCount threads(asked.threads);

  const std::vector<std::string> notices = blank_images(input);
  PyramidRun<Dim> run(input, asked, directions, !notices.empty(), progress, checkpointing);
  run.run();
  const RegistrationOptions& options = run.options();

  RegistrationResult<Dim> result;
  result.options = options;
  RegistrationSummary& summary = result.summary = run.summary();
  summary.notices = notices;
  MatchingObjective<Dim, float>& objective = run.objective();
  const std::vector<float>& momenta = run.momenta();
  const std::vector<Field<float>> velocities = objective.velocities(momenta);
  const Lattice<Dim> flow = objective.flow_lattice();
  collect_momenta(run.scales(), objective.working_set().pointers(momenta), input.fixed.grid, result);
  result.moved_points = move_points(input, flow, velocities, run.scales(), objective.working_set().pointers(momenta));
  const bool is_conserved =
      options.flow.evolution == Evolution::Exact && run.scales().size() == 1 && !run.scales()[0]->oriented();
  summary.hamiltonian_drift = is_conserved ? drift_of(objective.hamiltonians(momenta)) : -1;
  // The momenta go with the run; what jumps by them is a short list.
  std::vector<JumpElements<Dim>> jumps;
  for (std::size_t s = 0; s < run.scales().size(); ++s)
    for (auto& of_kernel : jump_elements<Dim, float>(*run.scales()[s], objective.working_set().pointers(momenta)[s]))
      jumps.push_back(std::move(of_kernel));
  run.release();
  give_back_free_memory();  // fields are larger than what has become free
  // The similarity first: what it needs for itself is gone before there are fields.
  const Field<float> backward = map_back(input, flow, velocities);
  summarise_similarity(run.pyramid().full_resolution(), options, backward, result);
  write_fields(input, flow, velocities, backward, result);
  result.slip =
      measure_slip<Dim>(jumps, {flow, velocities, input.fixed.grid, backward, input.start, input.moving.grid});
  run.count_time();
  summary.seconds = run.summary().seconds;
  summary.cpu_seconds = run.summary().cpu_seconds;
  return result;
}

template RegistrationResult<2> register_images(const RegistrationInput<2>&, const RegistrationOptions&,
                                               const ProgressCallback&, const Checkpointing&);
template RegistrationResult<3> register_images(const RegistrationInput<3>&, const RegistrationOptions&,
                                               const ProgressCallback&, const Checkpointing&);

}  // namespace saltus
