#include "core/optimisation/lbfgs.h"

#include "core/support/errors.h"
#include "core/support/reduction.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <tuple>
#include <type_traits>

namespace saltus {
namespace {

/// Iterations from one look at what is outside the working set to the next: few enough at first that what is missing
/// joins soon; twice as many each time that hardly anything joined, so that looks in vain hardly show.
constexpr int kFirstLookGap = 5, kLargestLookGap = 40;
/// The share of a range that has to join for a look not to have been in vain, and for a run to go on.
constexpr double kLeastJoined = 0.05;

template <class A, class B>
double dot(const std::vector<A>& a, const std::vector<B>& b) {
  return ordered_sum(a.size(), [&](std::size_t i) { return static_cast<double>(a[i]) * static_cast<double>(b[i]); });
}

template <class Term, class T>
void add_scaled(double factor, std::size_t count, const Term* terms, T* sum) {
  const T f = static_cast<T>(factor);
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) sum[i] += f * static_cast<T>(terms[i]);
}

template <class Term, class T>
void add_scaled(double factor, const std::vector<Term>& terms, std::vector<T>& sum) {
  add_scaled(factor, sum.size(), terms.data(), sum.data());
}

/// direction = start + step direction
template <class T>
void walk(const std::vector<T>& start, double step, std::vector<T>& direction) {
  const T f = static_cast<T>(step);
  const std::size_t count = direction.size();
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) direction[i] = start[i] + f * direction[i];
}

template <class T>
void scale_by(T factor, std::vector<T>& values) {
  const std::size_t count = values.size();
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) values[i] *= factor;
}

/// before = now - before, as pairs hold it
template <class T>
void make_change(const std::vector<T>& now, std::vector<T>& before) {
  const std::size_t count = before.size();
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) before[i] = static_cast<Stored<T>>(now[i] - before[i]);
}

template <class T>
void store(const std::vector<T>& values, std::vector<Stored<T>>& stored) {
  const std::size_t count = values.size();
  stored.resize(count);
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) stored[i] = values[i];
}

template <class T, class Count>
double square(const T* values, Count count) {
  double sum = 0;
  for (int k = 0; k < count; ++k) sum += static_cast<double>(values[k]) * values[k];
  return sum;
}

/// What `with` gives for the size of the range's groups: a constant where it is one that fields have.
template <class With>
auto with_group_size(const GroupSparsity& range, With&& with) {
  switch (range.group) {
    case 1:
      return with(std::integral_constant<int, 1>());
    case 2:
      return with(std::integral_constant<int, 2>());
    case 3:
      return with(std::integral_constant<int, 3>());
    default:
      return with(range.group);
  }
}

/// Calls visit(first value of the group, the group's weight, its size) for every group.
template <class Visit>
void for_groups(const GroupSparsity& range, Visit&& visit) {
  with_group_size(range, [&](auto size) {
    const std::size_t groups = (range.end - range.begin) / static_cast<std::size_t>(size);
#pragma omp parallel for schedule(static) if (is_worth_threads(groups))
    for (std::size_t g = 0; g < groups; ++g)
      visit(range.begin + g * static_cast<std::size_t>(size), range.weight_of(g), size);
  });
}

template <class T>
double sparsity_energy(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x) {
  double energy = 0;
  for (const GroupSparsity& range : ranges) {
    energy += with_group_size(range, [&](auto size) {
      const std::size_t groups = (range.end - range.begin) / static_cast<std::size_t>(size);
      return ordered_sum(groups, [&](std::size_t g) {
        const double sum = square(x.data() + range.begin + g * static_cast<std::size_t>(size), size);
        return sum > 0 ? range.weight_of(g) * std::sqrt(sum) : 0.0;  // that of a group kept at zero is infinite
      });
    });
  }
  return energy;
}

/// Turns the gradient of the smooth part into the subgradient of least length of the whole. Outside the ranges, where
/// it is preconditioned by the objective, nothing changes.
template <class T>
void make_pseudo(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, std::vector<T>& gradient) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight, auto group) {
      if (weight == 0) return;
      const double sum = square(x.data() + at, group);
      if (sum > 0) {
        const double size = std::sqrt(sum);
        for (int k = 0; k < group; ++k) gradient[at + k] += static_cast<T>(weight * x[at + k] / size);
        return;
      }
      const double pull = square(gradient.data() + at, group);
      const T keep = static_cast<T>(pull > weight * weight ? 1 - weight / std::sqrt(pull) : 0);
      for (int k = 0; k < group; ++k) gradient[at + k] *= keep;
    });
}

/// P, the preconditioner: a number on each sparsity range; elsewhere what the objective has made of a vector, which
/// comes with it as `dense` (see Objective::evaluate).
class Preconditioner {
 public:
  Preconditioner(const std::vector<GroupSparsity>& ranges, std::size_t size) {
    for (const GroupSparsity& range : ranges)
      if (range.begin < range.end) pieces_.push_back({range.begin, range.end, 0, range.inverse_stiffness, true});
    std::sort(pieces_.begin(), pieces_.end(), [](const Piece& a, const Piece& b) { return a.begin < b.begin; });
    std::size_t at = 0;
    for (std::size_t p = 0, ranged = pieces_.size(); p <= ranged; ++p) {
      const std::size_t next = p < ranged ? pieces_[p].begin : size;
      if (at < next) {
        pieces_.push_back({at, next, dense_size_, 1, false});
        dense_size_ += next - at;
      }
      if (p < ranged) at = pieces_[p].end;
    }
  }

  /// a . P a, of what lies outside the ranges
  template <class T>
  double dense_square(const std::vector<T>& a, const std::vector<T>& dense) const {
    double sum = 0;
    for (const Piece& piece : pieces_) {
      if (piece.is_range) continue;
      const T *left = a.data() + piece.begin, *right = dense.data() + piece.at;
      sum += ordered_sum(piece.end - piece.begin,
                         [&](std::size_t i) { return static_cast<double>(left[i]) * static_cast<double>(right[i]); });
    }
    return sum;
  }

  /// Length of the vectors called `dense`.
  std::size_t dense_size() const { return dense_size_; }

  /// a . P b
  template <class T>
  double dot(const std::vector<T>& a, const std::vector<T>& b, const std::vector<T>& dense) const {
    double sum = 0;
    for (const Piece& piece : pieces_) {
      const T *left = a.data() + piece.begin, *right = piece.values(b, dense);
      sum += piece.factor * ordered_sum(piece.end - piece.begin, [&](std::size_t i) {
               return static_cast<double>(left[i]) * static_cast<double>(right[i]);
             });
    }
    return sum;
  }

  /// sum += P b
  template <class T>
  void add(const std::vector<T>& b, const std::vector<T>& dense, std::vector<T>& sum) const {
    for (const Piece& piece : pieces_)
      add_scaled(piece.factor, piece.end - piece.begin, piece.values(b, dense), sum.data() + piece.begin);
  }

  /// sum = scale (sum - alpha_k P y_k, the last pair first), in blocks that stay in the caches
  template <class T>
  void subtract(const std::deque<CurvaturePair<T>>& pairs, const std::vector<double>& alpha, T scale,
                std::vector<T>& sum) const {
    constexpr std::size_t most = 4096;
    for (const Piece& piece : pieces_) {
      const std::size_t blocks = (piece.end - piece.begin + most - 1) / most;
#pragma omp parallel for schedule(static) if (is_worth_threads(piece.end - piece.begin))
      for (std::size_t b = 0; b < blocks; ++b) {
        const std::size_t begin = b * most, count = std::min(most, piece.end - piece.begin - begin);
        T* values = sum.data() + piece.begin + begin;
        for (std::size_t k = pairs.size(); k-- > 0;) {
          const T f = static_cast<T>(-alpha[k] * piece.factor);
          const Stored<T>* y = piece.values(pairs[k].y, pairs[k].y_preconditioned) + begin;
#pragma omp simd
          for (std::size_t i = 0; i < count; ++i) values[i] += f * static_cast<T>(y[i]);
        }
#pragma omp simd
        for (std::size_t i = 0; i < count; ++i) values[i] *= scale;
      }
    }
  }

 private:
  struct Piece {
    std::size_t begin, end, at;  ///< `at`: where it begins in `dense`
    double factor;
    bool is_range;
    template <class T>
    const T* values(const std::vector<T>& b, const std::vector<T>& dense) const {
      return is_range ? b.data() + begin : dense.data() + at;
    }
  };
  std::vector<Piece> pieces_;
  std::size_t dense_size_ = 0;
};

/// sum += factor terms, and other . sum of what that gives
template <class T>
double add_and_dot(double factor, const std::vector<Stored<T>>& terms, const std::vector<Stored<T>>& other,
                   std::vector<T>& sum) {
  const T f = static_cast<T>(factor);
  const Stored<T>*term = terms.data(), *weight = other.data();
  T* to = sum.data();
  return ordered_sum(sum.size(), [=](std::size_t i) {
    to[i] += f * static_cast<T>(term[i]);
    return static_cast<double>(weight[i]) * static_cast<double>(to[i]);
  });
}

/// direction = -H pseudo-gradient by the two-loop recursion, with H_0 the scaled preconditioner. `remainder` is the
/// pseudo-gradient, which is used up. What one pair changes and what the next one asks of that are one pass, since
/// memory is what this waits for.
template <class T>
void quasi_newton_direction(const Preconditioner& preconditioner, const std::deque<CurvaturePair<T>>& pairs,
                            const std::vector<T>& preconditioned, std::vector<T>& remainder,
                            std::vector<T>& direction) {
  direction.assign(remainder.size(), T(0));
  preconditioner.add(remainder, preconditioned, direction);
  if (pairs.empty()) return scale_by(T(-1), direction);

  const std::size_t last = pairs.size() - 1;
  std::vector<double> alpha(pairs.size());
  for (std::size_t k = last + 1; k-- > 0;)
    alpha[k] = pairs[k].rho * (k == last ? dot(pairs[k].s, remainder)
                                         : add_and_dot(-alpha[k + 1], pairs[k + 1].y, pairs[k].s, remainder));
  const double curvature = preconditioner.dot(pairs[last].y, pairs[last].y, pairs[last].y_preconditioned);
  preconditioner.subtract(pairs, alpha, static_cast<T>(curvature > 0 ? 1 / (pairs[last].rho * curvature) : 1),
                          direction);
  double share = alpha[0] - pairs[0].rho * dot(pairs[0].y, direction);
  for (std::size_t k = 0; k < last; ++k)
    share = alpha[k + 1] - pairs[k + 1].rho * add_and_dot(share, pairs[k].s, pairs[k + 1].y, direction);
  add_scaled(share, pairs[last].s, direction);
  scale_by(T(-1), direction);
}

/// Groups at zero move only where their own subgradient points.
template <class T>
void align(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
           std::vector<T>& direction) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight, auto group) {
      if (weight == 0 || square(x.data() + at, group) > 0) return;
      double agreement = 0;
      for (int k = 0; k < group; ++k) agreement -= static_cast<double>(direction[at + k]) * pseudo[at + k];
      if (agreement > 0) return;
      for (int k = 0; k < group; ++k) direction[at + k] = 0;
    });
}

/// Groups that turned against x (or, from zero, against their subgradient) become exactly zero.
template <class T>
void project(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
             std::vector<T>& candidate) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight, auto group) {
      if (weight == 0) return;
      const bool from_zero = square(x.data() + at, group) == 0;
      double agreement = 0;
      for (int k = 0; k < group; ++k)
        agreement += static_cast<double>(candidate[at + k]) * (from_zero ? -pseudo[at + k] : x[at + k]);
      if (agreement > 0) return;
      for (int k = 0; k < group; ++k) candidate[at + k] = 0;
    });
}

}  // namespace

template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, MinimiserState<T>& state,
                         const std::function<bool(const MinimiseStep&)>& accepted) {
  const std::vector<GroupSparsity>& ranges = objective.sparsity();
  Preconditioner preconditioner(ranges, objective.size());
  // Beside the state's vectors there are these alone. `next_gradient` is the pseudo-gradient until the next point is
  // evaluated, and used up on the way to a direction; `candidate` is first the direction, then the point it leads to.
  // A step that was too long has them made again, which hardly shows: most steps are taken at the first trial.
  std::vector<T> next_gradient, next_preconditioned, candidate;
  // Exactly as large as the objective wants: what it dropped must not stay allocated.
  const auto fit = [&] {
    preconditioner = Preconditioner(ranges, objective.size());
    next_gradient = std::vector<T>(objective.size());
    next_preconditioned = std::vector<T>(preconditioner.dense_size());
    candidate = {};
  };
  const std::deque<CurvaturePair<T>> no_pairs;

  const auto total = [&](const std::vector<T>& at, std::vector<T>& g, std::vector<T>& p, double& sparse) {
    ++state.evaluations;
    Evaluation evaluation = objective.evaluate(at, g, p);
    sparse = sparsity_energy(ranges, at);
    evaluation.value += sparse;
    evaluation.is_valid =
        evaluation.is_valid && std::isfinite(evaluation.value) && std::isfinite(preconditioner.dot(g, g, p));
    return evaluation;
  };
  MinimiseSummary summary;
  const auto ended = [&](MinimiseTermination why) {
    summary.termination = why;
    summary.iterations = state.iterations();
    summary.evaluations = state.evaluations;
    summary.energy_before = state.energies.front();
    summary.energy_after = state.energies.back();
    summary.first_optimality = state.first_optimality;
    return summary;
  };

  // Depends on the state alone, so that a run that is taken up again looks when it would have.
  const auto is_due = [&](int iteration) {
    return !objective.has_more() || static_cast<long long>(iteration) - state.looked_at >= state.look_gap;
  };
  // A vector that changes its length is there twice for a while, and `candidate` is not needed then.
  const auto revise = [&] {
    if (!ranges.empty()) candidate = {};
    return objective.revise(state);
  };
  // The last evaluation looked everywhere, at state.x: lets in what wants to take part.
  const auto revise_after_look = [&](int iteration) {
    const Revision revision = revise();
    state.looked_at = iteration;
    const bool is_more = revision.joined > kLeastJoined;
    state.look_gap = is_more ? kFirstLookGap : 2 * std::clamp(state.look_gap, kFirstLookGap, kLargestLookGap / 2);
    if (is_more) state.revised_at = iteration;
    return revision;
  };

  if (options.history < 1) throw std::logic_error("L-BFGS keeps at least one pair");
  if (!state.has_begun()) {
    objective.look_everywhere(true);
    state.gradient.resize(objective.size());
    state.preconditioned.resize(preconditioner.dense_size());
    double sparse_at_start = 0;
    const Evaluation start = total(state.x, state.gradient, state.preconditioned, sparse_at_start);
    if (!start.is_valid)
      throw NumericalFailure("the energy at the start or its gradient is not finite; check the images for NaN and Inf");
    state.energies = {start.value};
    revise_after_look(0);
    state.look_gap = kFirstLookGap;
    fit();
    objective.look_everywhere(false);
    if (options.noise_tolerance > 0 && objective.has_more())
      throw std::logic_error("noise is looked at where nothing can join: the look forgets what wanted to");
    if (options.noise_tolerance > 0 && objective.noise_gradient(state.x, next_gradient, next_preconditioned)) {
      ++state.evaluations;
      const double square = preconditioner.dense_square(next_gradient, next_preconditioned);
      // What is not finite says nothing; the run then ends for other reasons.
      if (std::isfinite(square)) state.noise_optimality = std::sqrt(std::max(0.0, square));
    }
  } else {
    fit();
  }

  // Before a run ends where it has not looked: whether something that was outside the working set wants to take part.
  const auto joins_here = [&](int iteration) {
    if (!objective.has_more() || state.looked_at == iteration) return false;
    objective.look_everywhere(true);
    double sparse_here = 0;
    total(state.x, next_gradient, next_preconditioned, sparse_here);
    const Revision revision = revise_after_look(iteration);
    if (revision.has_changed) fit();
    return revision.joined > kLeastJoined;
  };

  bool is_told = true;  // whether `accepted` knows of the last step
  double sparse = 0, step = 0;
  for (;;) {
    const int done = state.iterations();
    const double energy = state.energies.back();
    const auto find_pseudo = [&] {
      next_gradient = state.gradient;
      make_pseudo(ranges, state.x, next_gradient);
    };
    find_pseudo();
    const std::vector<T>& pseudo = ranges.empty() ? state.gradient : next_gradient;
    const double optimality = std::sqrt(std::max(0.0, preconditioner.dot(pseudo, pseudo, state.preconditioned)));
    if (done == 0) state.first_optimality = optimality;
    const double reference = options.optimality_reference > 0 ? options.optimality_reference : state.first_optimality;
    summary.optimality = reference > 0 ? optimality / reference : 0;
    if (!is_told && !accepted({done, energy, sparse, step, summary.optimality}))
      return ended(MinimiseTermination::Stopped);
    is_told = true;
    if (optimality <= options.optimality_tolerance * reference) {
      if (joins_here(done)) continue;
      return ended(MinimiseTermination::Converged);
    }
    if (optimality * optimality <= options.noise_tolerance * state.noise_optimality * state.noise_optimality) {
      if (joins_here(done)) continue;
      return ended(MinimiseTermination::NoiseFloor);
    }
    if (done >= 5 && (state.settled_at < 0 || done - state.settled_at >= 5)) {
      const double recent = state.energies[done - 5] - energy;
      const double whole = options.decrease_before + state.energies[0] - energy;
      if (recent > options.tolerance * whole) {
        state.settled_at = -1;
      } else {
        // What joins gets five iterations to show what it is worth. If that is too little, nobody else is let in.
        if (state.settled_at >= 0 || (state.revised_at != done && !joins_here(done)))
          return ended(MinimiseTermination::Settled);
        state.settled_at = done;
        continue;
      }
    }
    if (done >= options.max_iterations) return ended(MinimiseTermination::IterationLimit);

    const bool is_look = is_due(done + 1);
    objective.look_everywhere(is_look);
    bool found = false, has_forgotten = false, is_used = false;  // what next_gradient is at the top
    double next_energy = 0, next_sparse = 0;
    for (int attempt = 0; attempt < 2 && !found; ++attempt) {
      if (attempt == 1) {
        if (state.pairs.empty()) break;
        has_forgotten = true;  // the model of the curvature was wrong: start again from steepest descent
      }
      const std::deque<CurvaturePair<T>>& pairs = has_forgotten ? no_pairs : state.pairs;
      const auto find_direction = [&] {
        if (is_used) find_pseudo();
        quasi_newton_direction(preconditioner, pairs, state.preconditioned, next_gradient, candidate);
        if (!ranges.empty()) find_pseudo();
        align(ranges, state.x, pseudo, candidate);
        is_used = true;
      };
      find_direction();
      if (!(dot(pseudo, candidate) < 0)) continue;
      step = pairs.empty() ? objective.first_step(candidate) : 1.0;
      for (int trial = 0; trial < options.max_line_search; ++trial) {
        if (trial > 0) find_direction();
        walk(state.x, step, candidate);
        project(ranges, state.x, pseudo, candidate);
        const double expected = ordered_sum(candidate.size(), [&](std::size_t i) {
          return static_cast<double>(pseudo[i]) * (static_cast<double>(candidate[i]) - state.x[i]);
        });
        const Evaluation evaluation = total(candidate, next_gradient, next_preconditioned, next_sparse);
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
      if (joins_here(done)) continue;
      return ended(MinimiseTermination::LineSearchFailed);
    }

    // The state moves on to the new point, and the vectors of the old one become the changes.
    for (const auto& [now, before] : {std::tie(candidate, state.x), std::tie(next_gradient, state.gradient),
                                      std::tie(next_preconditioned, state.preconditioned)}) {
      make_change(now, before);
      std::swap(now, before);
    }
    if (has_forgotten) state.pairs.clear();
    const double curvature = dot(candidate, next_gradient);
    const double size = preconditioner.dot(next_gradient, next_gradient, next_preconditioned);
    if (curvature > 1e-8 * std::abs(size) && size > 0) {
      CurvaturePair<T> pair;
      if (static_cast<int>(state.pairs.size()) >= options.history) {
        pair = std::move(state.pairs.front());
        state.pairs.pop_front();
      }
      store(candidate, pair.s);
      store(next_gradient, pair.y);
      store(next_preconditioned, pair.y_preconditioned);
      pair.rho = 1 / curvature;
      state.pairs.push_back(std::move(pair));
    }
    state.energies.push_back(next_energy);
    sparse = next_sparse;
    const Revision revision = is_look ? revise_after_look(done + 1) : revise();
    if (revision.has_changed) fit();
    is_told = false;
  }
}

template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, std::vector<T>& x,
                         const std::function<bool(const MinimiseStep&)>& accepted) {
  MinimiserState<T> state(std::move(x));
  try {
    const MinimiseSummary summary = minimise(objective, options, state, accepted);
    x = std::move(state.x);
    return summary;
  } catch (...) {
    x = std::move(state.x);
    throw;
  }
}

#define SALTUS_MINIMISE(T)                                                                     \
  template MinimiseSummary minimise(Objective<T>&, const MinimiseOptions&, MinimiserState<T>&, \
                                    const std::function<bool(const MinimiseStep&)>&);          \
  template MinimiseSummary minimise(Objective<T>&, const MinimiseOptions&, std::vector<T>&,    \
                                    const std::function<bool(const MinimiseStep&)>&);
SALTUS_MINIMISE(float)
SALTUS_MINIMISE(double)
#undef SALTUS_MINIMISE

}  // namespace saltus
