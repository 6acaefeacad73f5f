#include "tests/benchmark/measure.h"

#include <algorithm>
#include <cmath>

#include "core/evaluation/field_error.h"
#include "core/evaluation/field_sampling.h"
#include "core/evaluation/transition_width.h"
#include "core/phantom/interface_points.h"
#include "core/support/errors.h"
#include "core/support/stopwatch.h"

namespace saltus::benchmark {
namespace {

bool is_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
}

template <int Dim>
Vector<Dim> voxel_centre(const ImageGrid<Dim>& grid, std::size_t voxel) {
  Vector<Dim> index;
  for (int axis = 0; axis < Dim; ++axis) {
    index[axis] = static_cast<double>(voxel % grid.size[axis]);
    voxel /= grid.size[axis];
  }
  return grid.to_world(index);
}

/// Accepted steps whose energy is above that of the step before, on the same level and with the same sparsity weights.
int energy_rises(const RegistrationSummary& summary) {
  int rises = 0;
  for (std::size_t k = 1; k < summary.history.size(); ++k) {
    const IterationRecord &before = summary.history[k - 1], &now = summary.history[k];
    rises += now.level == before.level && now.round == before.round && now.energy > before.energy;
  }
  return rises;
}

template <int Dim>
void check_finite(const RegistrationResult<Dim>& result, Row& row) {
  bool finite = is_finite(result.displacement.samples) && is_finite(result.inverse_displacement.samples) &&
                is_finite(result.warped.samples) && is_finite(result.jacobian.samples);
  for (const MomentumField<Dim>& momentum : result.momenta) finite = finite && is_finite(momentum.vectors.samples);
  const RegistrationSummary& s = result.summary;
  for (double value : {s.similarity_before, s.similarity_after, s.hamiltonian_drift, s.active_first_order_share,
                       s.inverse_consistency_mm, s.min_jacobian, s.share_jacobian_not_positive})
    finite = finite && std::isfinite(value);
  for (const IterationRecord& record : s.history)
    finite = finite && std::isfinite(record.energy) && std::isfinite(record.optimality);
  if (!finite) row.complaints.push_back("a value is not finite");
}

template <int Dim>
double extent_mm(const ImageGrid<Dim>& grid, double voxels) {
  return voxels * grid.spacing.minCoeff();
}

/// Through `first` and back through `second`, in voxels, off the interface by 5 voxels: with the fields as a user has
/// them, linear between voxels. The interface is where the scene has it in the fixed image.
template <int Dim>
void add_round_trip(const std::string& key, const Pair<Dim>& pair, const VectorVolume<Dim>& first,
                    const VectorVolume<Dim>& second, Row& row) {
  const double margin = extent_mm(pair.input.fixed.grid, 5), voxel = pair.input.fixed.grid.spacing.minCoeff();
  std::vector<double> errors;
  for (std::size_t at = 0; at < first.grid.voxels(); ++at) {
    const Vector<Dim> start = voxel_centre(first.grid, at);
    Vector<Dim> reached = start;
    for (int c = 0; c < Dim; ++c) reached[c] += first.component(c)[at];
    const Vector<Dim> index = second.grid.to_index(reached);
    bool inside = true;
    for (int axis = 0; axis < Dim; ++axis)
      inside = inside && index[axis] >= 0 && index[axis] <= second.grid.size[axis] - 1;
    if (!inside) continue;
    if (pair.scene && std::abs(pair.scene->interface_distance(reached)) <= margin) continue;
    errors.push_back((reached + displacement_at(second, reached) - start).norm() / voxel);
  }
  if (errors.empty()) return;
  std::sort(errors.begin(), errors.end());
  row.add(key + "_mean_voxels", summarise(errors).mean);
  row.add(key + "_p95_voxels", quantile_of_sorted(errors, 0.95));
}

template <int Dim>
void add_folds(const Pair<Dim>& pair, const RegistrationResult<Dim>& result, Row& row) {
  std::size_t count = 0, folds = 0;
  for (std::size_t voxel = 0; voxel < result.jacobian.samples.size(); ++voxel) {
    if (pair.scene && pair.truth.masks.near.samples[voxel] > 0) continue;
    ++count;
    folds += !(result.jacobian.samples[voxel] > 0);
  }
  if (count > 0) row.add("folds_percent", 100.0 * static_cast<double>(folds) / static_cast<double>(count));
}

}  // namespace

template <int Dim>
Pair<Dim> pair_of(std::shared_ptr<const Scene<Dim>> scene, const ImageGrid<Dim>& grid, double noise,
                  std::uint64_t seed) {
  Pair<Dim> pair;
  pair.truth = sample_phantom(*scene, grid, noise, seed);
  pair.scene = std::move(scene);
  pair.input.fixed = pair.truth.fixed;
  pair.input.moving = pair.truth.moving;
  return pair;
}

template <int Dim>
Pair<Dim> pair_of(const PhantomOptions& options) {
  return pair_of<Dim>(std::shared_ptr<const Scene<Dim>>(make_scene<Dim>(options)), phantom_grid<Dim>(options),
                      options.noise, options.seed);
}

template <int Dim>
void add_truth(const Pair<Dim>& pair, const VectorVolume<Dim>& displacement, Row& row) {
  if (!pair.scene) return;
  const Phantom<Dim>& truth = pair.truth;
  const VectorVolume<Dim> nothing(truth.displacement.grid);
  row.add("before_mm", summarise(endpoint_errors(nothing, truth.displacement, {truth.masks.valid})).mean);
  row.add("error_mm", summarise(endpoint_errors(displacement, truth.displacement, {truth.masks.valid})).mean);
  Volume<Dim> near = truth.masks.near;
  bool any = false;
  for (std::size_t voxel = 0; voxel < near.samples.size(); ++voxel) {
    near.samples[voxel] *= truth.masks.valid.samples[voxel];
    any = any || near.samples[voxel] > 0;
  }
  if (!any) return;
  row.add("near_mm", summarise(endpoint_errors(displacement, truth.displacement, {near})).mean);
  const auto points = interface_points<Dim>(*pair.scene, truth.displacement.grid);
  if (points.empty()) return;
  const NormalJump normal =
      normal_jump(displacement, truth.displacement, points, extent_mm(truth.displacement.grid, 2));
  if (normal.points > 0) {
    row.add("opening_mm", normal.opening_mm);
    row.add("closing_mm", normal.closing_mm);
  }
  const TransitionWidth width = transition_width(displacement, points, extent_mm(truth.displacement.grid, 12));
  if (width.resolved > 0) row.add("transition_mm", width.width_mm);
  if (width.points > 0) {
    row.add("jump_mm", width.jump_mm);
    row.add("transition_resolved_share", static_cast<double>(width.resolved) / static_cast<double>(width.points));
  }
}

template <int Dim>
Row measure(const std::string& name, const Pair<Dim>& pair, const RegistrationOptions& options, Expected expected,
            std::optional<RegistrationResult<Dim>>* kept) {
  Row row;
  row.name = name;
  const Stopwatch watch;
  std::optional<RegistrationResult<Dim>> result;
  try {
    result = register_images<Dim>(pair.input, options);
    row.outcome = to_string(result->summary.termination);
  } catch (const InvalidInput& error) {
    row.outcome = std::string("refused: ") + error.what();
  } catch (const NumericalFailure& error) {
    row.outcome = std::string("failed: ") + error.what();
  } catch (const std::exception& error) {
    row.outcome = std::string("exception: ") + error.what();
    row.complaints.push_back("an exception without a name of ours");
  }
  row.add("cpu_seconds", watch.cpu_seconds());
  if (!result) {
    if (expected == Expected::Result) row.complaints.push_back("a result is expected");
    return row;
  }
  if (expected == Expected::Refusal) row.complaints.push_back("a refusal is expected");
  check_finite(*result, row);
  const RegistrationSummary& summary = result->summary;
  row.add("iterations", static_cast<double>(summary.history.size()));
  row.add("energy_rises", energy_rises(summary));
  if (energy_rises(summary) > 0) row.complaints.push_back("the energy rises");
  row.add("similarity_before", summary.similarity_before);
  row.add("similarity_after", summary.similarity_after);
  if (summary.hamiltonian_drift >= 0) row.add("hamiltonian_drift", summary.hamiltonian_drift);
  row.add("active_percent", 100 * summary.active_first_order_share);
  add_folds(pair, *result, row);
  add_round_trip("inverse", pair, result->inverse_displacement, result->displacement, row);
  add_round_trip("inverse_from_fixed", pair, result->displacement, result->inverse_displacement, row);
  add_truth(pair, result->displacement, row);
  if (kept) *kept = std::move(result);
  return row;
}

template <int Dim>
double largest_difference(const VectorVolume<Dim>& a, const VectorVolume<Dim>& b) {
  const std::vector<double> errors = endpoint_errors(a, b);
  return *std::max_element(errors.begin(), errors.end());
}

#define SALTUS_INSTANTIATE(Dim)                                                                                \
  template Pair<Dim> pair_of(std::shared_ptr<const Scene<Dim>>, const ImageGrid<Dim>&, double, std::uint64_t); \
  template Pair<Dim> pair_of(const PhantomOptions&);                                                           \
  template Row measure(const std::string&, const Pair<Dim>&, const RegistrationOptions&, Expected,             \
                       std::optional<RegistrationResult<Dim>>*);                                               \
  template void add_truth(const Pair<Dim>&, const VectorVolume<Dim>&, Row&);                                   \
  template double largest_difference(const VectorVolume<Dim>&, const VectorVolume<Dim>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus::benchmark
