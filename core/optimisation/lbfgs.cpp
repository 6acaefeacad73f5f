#include "core/optimisation/lbfgs.h"

#include "core/support/errors.h"
#include "core/support/reduction.h"

#include <algorithm>
#include <cmath>
#include <deque>

namespace saltus {
namespace {

template <class T>
double dot(const std::vector<T>& a, const std::vector<T>& b) {
  return ordered_sum(a.size(), [&](std::size_t i) { return static_cast<double>(a[i]) * static_cast<double>(b[i]); });
}

template <class T>
void add_scaled(double factor, const std::vector<T>& terms, std::vector<T>& sum) {
  const T f = static_cast<T>(factor);
  const std::size_t count = sum.size();
#pragma omp parallel for simd schedule(static)
  for (std::size_t i = 0; i < count; ++i) sum[i] += f * terms[i];
}

template <class T>
double norm(const T* values, int count) {
  double sum = 0;
  for (int k = 0; k < count; ++k) sum += static_cast<double>(values[k]) * values[k];
  return std::sqrt(sum);
}

/// Calls visit(first value of the group, the group's weight) for every group.
template <class Visit>
void for_groups(const GroupSparsity& range, Visit&& visit) {
  const std::size_t groups = (range.end - range.begin) / static_cast<std::size_t>(range.group);
#pragma omp parallel for schedule(static)
  for (std::size_t g = 0; g < groups; ++g)
    visit(range.begin + g * static_cast<std::size_t>(range.group), range.weight_of(g));
}

template <class T>
double sparsity_energy(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x) {
  double energy = 0;
  for (const GroupSparsity& range : ranges) {
    const std::size_t groups = (range.end - range.begin) / static_cast<std::size_t>(range.group);
    energy += ordered_sum(groups, [&](std::size_t g) {
      const double size = norm(x.data() + range.begin + g * static_cast<std::size_t>(range.group), range.group);
      return size > 0 ? range.weight_of(g) * size : 0.0;  // the weight of a group kept at zero is infinite
    });
  }
  return energy;
}

/// Turns gradients of the smooth part into the subgradients of least length of the whole.
template <class T>
void make_pseudo(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, std::vector<T>& gradient,
                 std::vector<T>& preconditioned) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight) {
      if (weight == 0) return;
      const double size = norm(x.data() + at, range.group);
      if (size > 0) {
        for (int k = 0; k < range.group; ++k) {
          const T turn = static_cast<T>(weight * x[at + k] / size);
          gradient[at + k] += turn;
          preconditioned[at + k] += static_cast<T>(range.inverse_stiffness) * turn;
        }
        return;
      }
      const double pull = norm(gradient.data() + at, range.group);
      const T keep = static_cast<T>(pull > weight ? 1 - weight / pull : 0);
      for (int k = 0; k < range.group; ++k) {
        gradient[at + k] *= keep;
        preconditioned[at + k] *= keep;
      }
    });
}

template <class T>
struct Pair {
  std::vector<T> s, y, y_preconditioned;
  double rho;
};

/// direction = -H pseudo-gradient by the two-loop recursion, with H_0 the scaled preconditioner.
template <class T>
void quasi_newton_direction(const std::deque<Pair<T>>& pairs, const std::vector<T>& gradient,
                            const std::vector<T>& preconditioned, std::vector<T>& direction) {
  std::vector<double> alpha(pairs.size());
  std::vector<T> remainder = gradient;
  direction = preconditioned;
  for (std::size_t k = pairs.size(); k-- > 0;) {
    alpha[k] = pairs[k].rho * dot(pairs[k].s, remainder);
    add_scaled(-alpha[k], pairs[k].y, remainder);
    add_scaled(-alpha[k], pairs[k].y_preconditioned, direction);
  }
  if (!pairs.empty()) {
    const Pair<T>& last = pairs.back();
    const double curvature = dot(last.y, last.y_preconditioned);
    const T scale = static_cast<T>(curvature > 0 ? 1 / (last.rho * curvature) : 1);
    for (T& value : direction) value *= scale;
  }
  for (std::size_t k = 0; k < pairs.size(); ++k)
    add_scaled(alpha[k] - pairs[k].rho * dot(pairs[k].y, direction), pairs[k].s, direction);
  for (T& value : direction) value = -value;
}

/// Groups at zero move only where their own subgradient points.
template <class T>
void align(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
           std::vector<T>& direction) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight) {
      if (weight == 0 || norm(x.data() + at, range.group) > 0) return;
      double agreement = 0;
      for (int k = 0; k < range.group; ++k) agreement -= static_cast<double>(direction[at + k]) * pseudo[at + k];
      if (agreement > 0) return;
      for (int k = 0; k < range.group; ++k) direction[at + k] = 0;
    });
}

/// Groups that turned against x (or, from zero, against their subgradient) become exactly zero.
template <class T>
void project(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
             std::vector<T>& candidate) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight) {
      if (weight == 0) return;
      const bool from_zero = norm(x.data() + at, range.group) == 0;
      double agreement = 0;
      for (int k = 0; k < range.group; ++k)
        agreement += static_cast<double>(candidate[at + k]) * (from_zero ? -pseudo[at + k] : x[at + k]);
      if (agreement > 0) return;
      for (int k = 0; k < range.group; ++k) candidate[at + k] = 0;
    });
}

}  // namespace

template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, std::vector<T>& x,
                         const std::function<bool(const MinimiseStep&)>& accepted) {
  const std::vector<GroupSparsity>& ranges = objective.sparsity();
  const std::size_t count = objective.size();
  std::vector<T> gradient(count), preconditioned(count), next_gradient(count), next_preconditioned(count);
  std::vector<T> pseudo, pseudo_preconditioned, direction(count), candidate(count);
  std::deque<Pair<T>> pairs;
  MinimiseSummary summary;

  const auto total = [&](const std::vector<T>& at, std::vector<T>& g, std::vector<T>& p, double& sparse) {
    ++summary.evaluations;
    Evaluation evaluation = objective.evaluate(at, g, p);
    sparse = sparsity_energy(ranges, at);
    evaluation.value += sparse;
    evaluation.is_valid = evaluation.is_valid && std::isfinite(evaluation.value);
    return evaluation;
  };

  double sparse = 0;
  const Evaluation start = total(x, gradient, preconditioned, sparse);
  if (!start.is_valid)
    throw NumericalFailure("the energy at the start is not finite; check the images for NaN and Inf");
  double energy = summary.energy_before = summary.energy_after = start.value;
  std::vector<double> energies = {energy};
  double reference = options.optimality_reference, step = 0;

  for (int iteration = 1;; ++iteration) {
    pseudo = gradient;
    pseudo_preconditioned = preconditioned;
    make_pseudo(ranges, x, pseudo, pseudo_preconditioned);
    const double optimality = std::sqrt(std::max(0.0, dot(pseudo, pseudo_preconditioned)));
    if (iteration == 1) summary.first_optimality = optimality;
    if (reference == 0) reference = optimality;
    summary.optimality = reference > 0 ? optimality / reference : 0;
    if (iteration > 1 && !accepted({iteration - 1, energy, sparse, step, summary.optimality})) {
      summary.termination = MinimiseTermination::Stopped;
      return summary;
    }
    if (optimality <= options.optimality_tolerance * reference) {
      summary.termination = MinimiseTermination::Converged;
      return summary;
    }
    if (iteration > 5) {
      const double recent = energies[iteration - 6] - energy, whole = energies[0] - energy;
      if (recent <= options.tolerance * whole) {
        summary.termination = MinimiseTermination::Settled;
        return summary;
      }
    }
    if (iteration > options.max_iterations) {
      summary.termination = MinimiseTermination::IterationLimit;
      return summary;
    }

    bool found = false;
    double next_energy = 0, next_sparse = 0;
    for (int attempt = 0; attempt < 2 && !found; ++attempt) {
      if (attempt == 1) {
        if (pairs.empty()) break;
        pairs.clear();  // the model of the curvature was wrong: start again from steepest descent
      }
      quasi_newton_direction(pairs, pseudo, pseudo_preconditioned, direction);
      align(ranges, x, pseudo, direction);
      if (!(dot(pseudo, direction) < 0)) continue;
      step = pairs.empty() ? objective.first_step(direction) : 1.0;
      for (int trial = 0; trial < options.max_line_search; ++trial) {
        candidate = x;
        add_scaled(step, direction, candidate);
        project(ranges, x, pseudo, candidate);
        const Evaluation evaluation = total(candidate, next_gradient, next_preconditioned, next_sparse);
        const double expected = ordered_sum(count, [&](std::size_t i) {
          return static_cast<double>(pseudo[i]) * (static_cast<double>(candidate[i]) - x[i]);
        });
        if (evaluation.is_valid && evaluation.value < energy && evaluation.value <= energy + 1e-4 * expected) {
          next_energy = evaluation.value;
          found = true;
          break;
        }
        // Minimum of the parabola through both values and the slope, kept within a safe range.
        double factor = 0.25;
        if (evaluation.is_valid && expected < 0) {
          const double excess = evaluation.value - energy - expected;
          if (excess > 0) factor = std::clamp(-expected / (2 * excess), 0.1, 0.6);
        }
        step *= factor;
      }
    }
    if (!found) {
      summary.termination = MinimiseTermination::LineSearchFailed;
      return summary;
    }

    Pair<T> pair{candidate, next_gradient, next_preconditioned, 0};
    add_scaled(-1, x, pair.s);
    add_scaled(-1, gradient, pair.y);
    add_scaled(-1, preconditioned, pair.y_preconditioned);
    const double curvature = dot(pair.s, pair.y), size = dot(pair.y, pair.y_preconditioned);
    if (curvature > 1e-8 * std::abs(size) && size > 0) {
      pair.rho = 1 / curvature;
      pairs.push_back(std::move(pair));
      if (static_cast<int>(pairs.size()) > options.history) pairs.pop_front();
    }
    std::swap(x, candidate);
    std::swap(gradient, next_gradient);
    std::swap(preconditioned, next_preconditioned);
    energy = summary.energy_after = next_energy;
    sparse = next_sparse;
    summary.iterations = iteration;
    energies.push_back(energy);
  }
}

template MinimiseSummary minimise(Objective<float>&, const MinimiseOptions&, std::vector<float>&,
                                  const std::function<bool(const MinimiseStep&)>&);
template MinimiseSummary minimise(Objective<double>&, const MinimiseOptions&, std::vector<double>&,
                                  const std::function<bool(const MinimiseStep&)>&);

}  // namespace saltus
