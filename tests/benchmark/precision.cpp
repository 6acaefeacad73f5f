#include "tests/benchmark/precision.h"

#include <algorithm>
#include <cmath>

#include "core/optimisation/lbfgs.h"
#include "core/registration/finish.h"
#include "core/registration/matching_objective.h"
#include "core/registration/scales.h"
#include "core/support/random.h"
#include "core/support/stopwatch.h"

namespace saltus::benchmark {
namespace {

/// What one type of number gave.
struct Outcome {
  double value = 0, end_value = 0;
  std::vector<double> gradient, displacement;
};

template <int Dim, class T>
Outcome run(const Pair<Dim>& pair, const RegistrationOptions& options) {
  MatchingLevel<Dim, T> level;
  level.lattice = lattice_of(pair.input.fixed.grid);
  const auto scaled = [](const std::vector<float>& samples) {
    std::vector<T> values(samples.size());
    std::transform(samples.begin(), samples.end(), values.begin(), [](float v) { return static_cast<T>(v) / 255; });
    return values;
  };
  level.fixed = scaled(pair.input.fixed.samples);
  const AffineMap<Dim> to_moving = frame_to_index(pair.input);
  level.moving.lattice = lattice_of(pair.input.moving.grid);
  level.moving.samples = scaled(pair.input.moving.samples);
  level.moving.linear = to_moving.linear;
  level.moving.offset = to_moving.offset;
  level.similarity_weight = options.similarity_parameters.weight;
  level.divergence_weight = options.flow.divergence_weight;
  level.time_steps = options.flow.time_steps;
  level.evolution = options.flow.evolution;

  auto scales = make_scales<Dim, T>(level.lattice, options);
  std::vector<MomentumScale<Dim, T>*> active;
  for (const auto& placed : scales) active.push_back(placed.scale.get());
  MatchingObjective<Dim, T> objective(
      active, level,
      make_similarity<Dim, T>(options.similarity, level.lattice, options.similarity_parameters,
                              *std::min_element(level.lattice.spacing.begin(), level.lattice.spacing.end())),
      options.momenta.sparsity);

  Outcome outcome;
  std::vector<T> x(objective.size()), gradient(objective.size()), preconditioned(objective.size());
  // Displacements of tenths of a voxel: linear interpolation has a kink at every sample, and nearer than single
  // precision resolves to one, float and double would take different sides of it.
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] = static_cast<T>(0.1 * options.momenta.regularisation * normal_random(7, {static_cast<std::int64_t>(i)}));
  outcome.value = objective.evaluate(x, gradient, preconditioned).value;
  outcome.gradient.assign(gradient.begin(), gradient.end());

  std::fill(x.begin(), x.end(), T(0));
  MinimiseOptions how;
  how.max_iterations = options.optimisation.max_iterations;
  how.history = resolved(options, level.lattice).optimisation.history;
  how.tolerance = 0;
  outcome.end_value = minimise<T>(objective, how, x, [](const MinimiseStep&) { return true; }).energy_after;
  BackwardMap<Dim, T> map(level.lattice, level.lattice, options.flow.time_steps);
  const Field<T>& displacement = map.follow(objective.velocities(x));
  outcome.displacement.assign(displacement.begin(), displacement.end());
  return outcome;
}

}  // namespace

template <int Dim>
Row compare_precision(const std::string& name, const Pair<Dim>& pair, const RegistrationOptions& options) {
  Row row;
  row.name = name;
  const Stopwatch watch;
  const Outcome single = run<Dim, float>(pair, options), twice = run<Dim, double>(pair, options);
  row.add("cpu_seconds", watch.cpu_seconds());
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < twice.gradient.size(); ++i) {
    difference += std::pow(single.gradient[i] - twice.gradient[i], 2);
    size += std::pow(twice.gradient[i], 2);
  }
  row.add("float_energy_relative", std::abs(single.value - twice.value) / twice.value);
  row.add("float_gradient_relative", std::sqrt(difference / size));
  row.add("float_end_energy_relative", std::abs(single.end_value - twice.end_value) / twice.end_value);
  const double voxel = pair.input.fixed.grid.spacing.minCoeff();
  double sum = 0, largest = 0;
  const std::size_t sites = twice.displacement.size() / Dim;
  for (std::size_t site = 0; site < sites; ++site) {
    double squared = 0;
    for (int c = 0; c < Dim; ++c)
      squared += std::pow(single.displacement[Dim * site + c] - twice.displacement[Dim * site + c], 2);
    sum += std::sqrt(squared) / voxel;
    largest = std::max(largest, std::sqrt(squared) / voxel);
  }
  row.add("float_mean_voxels", sum / static_cast<double>(sites));
  row.add("float_max_voxels", largest);
  row.outcome = "compared";
  if (!std::isfinite(sum) || !std::isfinite(single.end_value)) row.complaints.push_back("a value is not finite");
  return row;
}

template Row compare_precision(const std::string&, const Pair<2>&, const RegistrationOptions&);
template Row compare_precision(const std::string&, const Pair<3>&, const RegistrationOptions&);

}  // namespace saltus::benchmark
