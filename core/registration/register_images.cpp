#include "core/registration/register_images.h"

#include "core/grid/pyramid.h"
#include "core/optimisation/lbfgs.h"
#include "core/registration/finish.h"
#include "core/registration/matching_objective.h"
#include "core/registration/scales.h"
#include "core/support/errors.h"
#include "core/support/stopwatch.h"

#include <Eigen/LU>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <sstream>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {
namespace {

using Scalar = float;

template <int Dim>
std::string describe(const Index<Dim>& size) {
  std::string text;
  for (int extent : size) text += (text.empty() ? "" : "x") + std::to_string(extent);
  return text;
}

template <int Dim>
void check_volume(const char* what, const Volume<Dim>& volume) {
  const std::vector<std::string> found = problems(volume.grid);
  if (!found.empty()) throw InvalidInput(std::string(what) + " image: " + found.front());
  if (volume.grid.voxels() == 1)
    throw InvalidInput(std::string(what) + " image has a single voxel; there is nothing to register");
  if (volume.samples.size() != volume.grid.voxels())
    throw InvalidInput(std::string(what) + " image has " + std::to_string(volume.samples.size()) +
                       " samples; its grid needs " + std::to_string(volume.grid.voxels()));
  const auto bad =
      std::find_if(volume.samples.begin(), volume.samples.end(), [](float v) { return !std::isfinite(v); });
  if (bad != volume.samples.end())
    throw InvalidInput(std::string(what) + " image holds a value that is not finite at voxel " +
                       std::to_string(bad - volume.samples.begin()) + "; replace NaN and Inf before registering");
}

/// Largest distance, mm, between the places that two grids of one size give a corner voxel.
template <int Dim>
double largest_distance(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b) {
  double largest = 0;
  for (int bits = 0; bits < 1 << Dim; ++bits) {
    Vector<Dim> corner;
    for (int axis = 0; axis < Dim; ++axis) corner[axis] = bits >> axis & 1 ? a.size[axis] - 1 : 0;
    largest = std::max(largest, (a.to_world(corner) - b.to_world(corner)).norm());
  }
  return largest;
}

/// Share of a voxel by which headers may differ: some formats keep single precision.
constexpr double kSamePlace = 0.05;

template <int Dim>
void check_mask(const char* what, const std::optional<Volume<Dim>>& mask, const Volume<Dim>& image) {
  if (!mask) return;
  check_volume(what, *mask);
  if (mask->grid.size != image.grid.size)
    throw InvalidInput(std::string(what) + " is " + describe<Dim>(mask->grid.size) + "; its image is " +
                       describe<Dim>(image.grid.size) + ", they must be on the same grid");
  const double apart = largest_distance(mask->grid, image.grid);
  if (apart > kSamePlace * image.grid.spacing.minCoeff()) {
    std::ostringstream text;
    text << what << " lies up to " << apart << " mm from its image; resample it, they must be on the same grid";
    throw InvalidInput(text.str());
  }
  if (std::none_of(mask->samples.begin(), mask->samples.end(), [](float v) { return v > 0; }))
    throw InvalidInput(std::string(what) + " is 0 everywhere; it must be positive where the image counts");
}

template <int Dim>
void check_start(const AffineMap<Dim>& start) {
  if (!start.linear.allFinite() || !start.offset.allFinite())
    throw InvalidInput("the affine start holds a value that is not finite; give finite numbers or leave it out");
  if (!Eigen::FullPivLU<Matrix<Dim>>(start.linear).isInvertible())
    throw InvalidInput("the affine start has determinant 0; give a map that can be inverted or leave it out");
}

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

/// Intensities are scaled so that the fixed image's 1st to 99th percentile (of what its mask shows) is [0,1], both
/// images alike: weights then mean the same for every scanner. Nothing is clipped.
struct IntensityScale {
  double low = 0, factor = 1;

  explicit IntensityScale(std::vector<float> samples) {
    const auto percentile = [&](double share) {
      const auto at = samples.begin() + static_cast<std::ptrdiff_t>(share * (samples.size() - 1));
      std::nth_element(samples.begin(), at, samples.end());
      return static_cast<double>(*at);
    };
    double high = percentile(0.99);
    low = percentile(0.01);
    if (!(high > low)) {
      const auto [smallest, largest] = std::minmax_element(samples.begin(), samples.end());
      low = *smallest;
      high = *largest;
    }
    if (high > low) factor = 1 / (high - low);
  }

  std::vector<Scalar> operator()(const std::vector<float>& samples) const {
    std::vector<Scalar> scaled(samples.size());
    std::transform(samples.begin(), samples.end(), scaled.begin(),
                   [this](float v) { return static_cast<Scalar>((v - low) * factor); });
    return scaled;
  }
};

/// Some visible voxel of the fixed image must fall onto the moving image, or there is nothing to compare.
template <int Dim>
void check_overlap(const RegistrationInput<Dim>& input) {
  const ImageGrid<Dim>&fixed = input.fixed.grid, &moving = input.moving.grid;
  const AffineMap<Dim> to_moving = frame_to_index(input);
  const Lattice<Dim> lattice = lattice_of(fixed);
  std::atomic<bool> found = false;
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab) {
    if (found) continue;
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      if (input.fixed_mask && !(input.fixed_mask->samples[site] > 0)) return;
      Vector<Dim> at;
      for (int axis = 0; axis < Dim; ++axis) at[axis] = index[axis] * fixed.spacing[axis];
      const Vector<Dim> reached = to_moving(at);
      for (int axis = 0; axis < Dim; ++axis)
        if (!(reached[axis] >= -0.5 && reached[axis] <= moving.size[axis] - 0.5)) return;
      found = true;
    });
  }
  if (found) return;
  const auto corners = [](const ImageGrid<Dim>& grid) {
    Vector<Dim> last;
    for (int axis = 0; axis < Dim; ++axis) last[axis] = grid.size[axis] - 1;
    std::ostringstream text;
    const Vector<Dim> end = grid.to_world(last);
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? " " : "(") << grid.origin[axis];
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? " " : ") to (") << end[axis];
    return text.str() + ")";
  };
  throw InvalidInput("fixed and moving image do not overlap: they span " + corners(fixed) + " and " + corners(moving) +
                     " mm; check their origins and directions, or give an affine start");
}

std::vector<Scalar> binary(const std::vector<float>& mask) {
  std::vector<Scalar> weights(mask.size());
  std::transform(mask.begin(), mask.end(), weights.begin(), [](float v) { return v > 0 ? Scalar(1) : Scalar(0); });
  return weights;
}

/// The images of a registration, scaled, with their lattices; makes the levels of the pyramid.
template <int Dim>
class Pyramid {
 public:
  Pyramid(const RegistrationInput<Dim>& input, const RegistrationOptions& options)
      : input_(input),
        options_(options),
        fixed_lattice_(lattice_of(input.fixed.grid)),
        moving_lattice_(lattice_of(input.moving.grid)),
        to_moving_(frame_to_index(input)) {
    const IntensityScale scale(visible(input.fixed.samples, input.fixed_mask));
    fixed_ = scale(input.fixed.samples);
    moving_ = scale(input.moving.samples);
    if (input.fixed_mask) hide(binary(input.fixed_mask->samples), fixed_);
    if (input.moving_mask) hide(binary(input.moving_mask->samples), moving_);
  }

  const Lattice<Dim>& fixed_lattice() const { return fixed_lattice_; }

  MatchingLevel<Dim, Scalar> level(int level) const {
    MatchingLevel<Dim, Scalar> made;
    made.lattice = level_lattice(fixed_lattice_, level);
    const std::vector<Scalar> fixed_weights =
        input_.fixed_mask ? binary(input_.fixed_mask->samples) : std::vector<Scalar>{};
    made.fixed = reduced(fixed_lattice_, fixed_, fixed_weights, made.lattice);
    const double reference = *std::min_element(fixed_lattice_.spacing.begin(), fixed_lattice_.spacing.end());
    const Lattice<Dim> moving = level == 0 ? moving_lattice_ : coarsened(moving_lattice_, std::ldexp(reference, level));
    const std::vector<Scalar> moving_weights =
        input_.moving_mask ? binary(input_.moving_mask->samples) : std::vector<Scalar>{};
    made.moving = framed(moving_, moving_weights, moving);
    if (input_.fixed_mask) made.fixed_weights = downsampled(fixed_lattice_, fixed_weights, made.lattice);
    if (input_.moving_mask) made.moving_weights = framed(moving_weights, {}, moving);
    made.similarity_weight = options_.similarity_parameters.weight;
    made.divergence_weight = options_.flow.divergence_weight;
    made.time_steps = options_.flow.time_steps;
    made.evolution = options_.flow.evolution;
    return made;
  }

 private:
  static std::vector<float> visible(const std::vector<float>& samples, const std::optional<Volume<Dim>>& mask) {
    if (!mask) return samples;
    std::vector<float> shown;
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (mask->samples[i] > 0) shown.push_back(samples[i]);
    return shown;
  }

  /// What a mask hides takes the mean of what it shows, so that no hidden value reaches an interpolation or a window.
  static void hide(const std::vector<Scalar>& weights, std::vector<Scalar>& samples) {
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      sum += double(weights[i]) * samples[i];
      count += weights[i];
    }
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (weights[i] == 0) samples[i] = static_cast<Scalar>(sum / count);
  }

  /// Downsampled; near a mask's border the mean of what it shows, not a mixture with what it hides.
  static std::vector<Scalar> reduced(const Lattice<Dim>& from, const std::vector<Scalar>& samples,
                                     const std::vector<Scalar>& weights, const Lattice<Dim>& to) {
    if (weights.empty() || from == to) return downsampled(from, samples, to);
    std::vector<Scalar> weighted(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) weighted[i] = weights[i] * samples[i];
    std::vector<Scalar> plain = downsampled(from, samples, to);
    const std::vector<Scalar> sum = downsampled(from, weighted, to), share = downsampled(from, weights, to);
    for (std::size_t i = 0; i < plain.size(); ++i)
      if (share[i] > Scalar(1e-3)) plain[i] = sum[i] / share[i];
    return plain;
  }

  FramedImage<Dim, Scalar> framed(const std::vector<Scalar>& samples, const std::vector<Scalar>& weights,
                                  const Lattice<Dim>& lattice) const {
    FramedImage<Dim, Scalar> image;
    image.lattice = lattice;
    image.samples = reduced(moving_lattice_, samples, weights, lattice);
    // Index of the full image -> index of the level's image.
    for (int axis = 0; axis < Dim; ++axis) {
      const double ratio = moving_lattice_.spacing[axis] / lattice.spacing[axis];
      image.linear.row(axis) = ratio * to_moving_.linear.row(axis);
      image.offset[axis] = ratio * to_moving_.offset[axis] - lattice.offset[axis] / lattice.spacing[axis];
    }
    return image;
  }

  const RegistrationInput<Dim>& input_;
  const RegistrationOptions& options_;
  Lattice<Dim> fixed_lattice_, moving_lattice_;
  AffineMap<Dim> to_moving_;
  std::vector<Scalar> fixed_, moving_;
};

Termination termination_of(MinimiseTermination termination) {
  switch (termination) {
    case MinimiseTermination::Converged:
      return Termination::Converged;
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
                                        const ProgressCallback& progress) {
  check_volume("fixed", input.fixed);
  check_volume("moving", input.moving);
  check_mask("fixed mask", input.fixed_mask, input.fixed);
  check_mask("moving mask", input.moving_mask, input.moving);
  check_start(input.start);
  check_overlap(input);
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
  const Pyramid<Dim> pyramid(input, options);
  std::vector<PlacedScale<Dim, Scalar>> scales = make_scales<Dim, Scalar>(pyramid.fixed_lattice(), options);

  // Levels on which no scale takes part yet would have nothing to optimise.
  std::vector<int> levels;
  for (int level = options.pyramid.levels - 1; level >= options.pyramid.finest_level; --level)
    if (std::any_of(scales.begin(), scales.end(), [&](const auto& s) { return s.level >= level; }) ||
        level == options.pyramid.finest_level)
      levels.push_back(level);

  WorkMeter meter;
  std::vector<double> planned_until;
  double planned = 0;
  for (int level : levels) {
    planned += static_cast<double>(level_lattice(pyramid.fixed_lattice(), level).sites()) *
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
    now.max_iterations = options.optimisation.max_iterations;
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
    how.max_iterations = options.optimisation.max_iterations;
    how.tolerance = options.optimisation.tolerance;
    how.history = options.optimisation.history;
    LevelSummary level_summary;
    level_summary.level = now.level;
    level_summary.grid = describe<Dim>(level_images.lattice.size);
    level_summary.spacing_mm =
        *std::min_element(level_images.lattice.spacing.begin(), level_images.lattice.spacing.end());
    try {
      const MinimiseSummary found = minimise<Scalar>(*objective, how, momenta, [&](const MinimiseStep& taken) {
        const EnergyParts& parts = objective->parts();
        summary.history.push_back({now.level, taken.iteration, taken.energy, parts.similarity, parts.regularisation,
                                   taken.sparsity, taken.step, taken.optimality});
        now.iteration = taken.iteration;
        now.energy = taken.energy;
        now.similarity = parts.similarity;
        return report();
      });
      level_summary.iterations = found.iterations;
      level_summary.evaluations = found.evaluations;
      level_summary.energy_before = found.energy_before;
      level_summary.energy_after = found.energy_after;
      level_summary.termination = termination_of(found.termination);
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
  summarise_similarity(pyramid.level(0), options, backward, result);
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
