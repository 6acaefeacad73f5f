#include "core/optimisation/lbfgs.h"

#include "core/optimisation/group_orthants.h"
#include "core/optimisation/long_vectors.h"
#include "core/optimisation/preconditioner.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>

namespace saltus {
namespace {

/// Iterations from one look at what is outside the working set to the next: few enough at first that what is missing
/// joins soon; twice as many each time that hardly anything joined, so that looks in vain hardly show.
constexpr int kFirstLookGap = 5, kLargestLookGap = 40;
/// The share of a range that has to join for a look not to have been in vain, and for a run to go on.
constexpr double kLeastJoined = 0.05;
/// Iterations that have to bring something for a run to go on, and that what joins has to show what it is worth.
constexpr int kTrial = 5;
/// Steps that are tried from a kink, whatever their energies. Of images the first changes the velocity's displacement
/// by half a voxel (Objective::first_step), kinks are a voxel apart, and a step that is too long becomes a tenth to six
/// tenths of it. So near by the energy is straight on either side, and what still shorter ones find is how values are
/// rounded.
constexpr int kStepsFromKink = 3;

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

/// change = now - before, in one way through memory
template <class T>
void store_change(const std::vector<T>& now, const std::vector<T>& before, std::vector<Stored<T>>& change) {
  const std::size_t count = before.size();
  change.resize(count);
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) change[i] = now[i] - before[i];
}

/// sum += factor terms, and other . sum of what that gives
template <class T>
double add_and_dot(double factor, const std::vector<Stored<T>>& terms, const std::vector<Stored<T>>& other,
                   std::vector<T>& sum) {
  const T f = static_cast<T>(factor);
  const Stored<T>*term = terms.data(), *weight = other.data();
  T* to = sum.data();
  return ordered_sum(sum.size(), [=](std::size_t i) {
    to[i] += f * static_cast<T>(term[i]);
    return static_cast<T>(weight[i]) * to[i];  // of floats one has 8 binary digits
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

/// One run of `minimise`: its state, and beside it three vectors.
template <class T>
class Minimisation {
 public:
  using Accepted = std::function<bool(const MinimiseStep&)>;
  Minimisation(Objective<T>& objective, const MinimiseOptions& options, MinimiserState<T>& state,
               const Accepted& accepted)
      : objective_(objective),
        options_(options),
        state_(state),
        accepted_(accepted),
        preconditioner_(objective.sparsity(), objective.size()) {
    if (options.history < 1) throw std::logic_error("L-BFGS keeps at least one pair");
  }

  MinimiseSummary run();

 private:
  enum class Next { Step, Again, End };

  void begin();
  Next next();
  Next end(MinimiseTermination why);
  Next end_unless_more_joins(MinimiseTermination why);
  bool tell();
  void measure_optimality();
  bool step();
  bool try_along(const std::deque<CurvaturePair<T>>& pairs, int most_steps);
  bool leave_kink();
  void find_direction(const std::deque<CurvaturePair<T>>& pairs);
  void move_on();

  Evaluation evaluate(const std::vector<T>& at, std::vector<T>& gradient, std::vector<T>& preconditioned,
                      double& sparsity, bool between_sides = false);
  bool is_due(int iteration) const;
  Revision revise();
  Revision revise_after_look(int iteration);
  bool joins_here();
  void find_pseudo();
  void fit();

  const std::vector<GroupSparsity>& ranges() const { return objective_.sparsity(); }
  /// The subgradient at state_.x, as long as next_gradient_ holds it.
  const std::vector<T>& pseudo() const { return ranges().empty() ? state_.gradient : next_gradient_; }
  double reference() const {
    return options_.optimality_reference > 0 ? options_.optimality_reference : state_.first_optimality;
  }

  Objective<T>& objective_;
  const MinimiseOptions& options_;
  MinimiserState<T>& state_;
  const Accepted& accepted_;
  Preconditioner preconditioner_;
  MinimiseSummary summary_;

  // `next_gradient_` is the pseudo-gradient until the next point is evaluated, and used up on the way to a direction;
  // `candidate_` is first the direction, then the point it leads to. A step that was too long has them made again,
  // which hardly shows: most steps are taken at the first trial.
  std::vector<T> next_gradient_, next_preconditioned_, candidate_;
  bool is_used_ = false;  ///< next_gradient_ is no longer the pseudo-gradient

  double optimality_ = 0;                        ///< residual at state_.x, absolute
  double step_ = 0, energy_ = 0, sparsity_ = 0;  ///< of the point found last
  bool has_forgotten_ = false;                   ///< that point was found without the pairs
  bool is_told_ = true;                          ///< whether `accepted` knows of the last step
};

template <class T>
MinimiseSummary Minimisation<T>::run() {
  if (state_.has_begun())
    fit();
  else
    begin();
  for (Next what = Next::Again; what != Next::End;) {
    measure_optimality();
    what = tell() ? next() : end(MinimiseTermination::Stopped);
    if (what != Next::Step) continue;
    const int iteration = state_.iterations() + 1;
    const bool is_look = is_due(iteration);
    objective_.look_everywhere(is_look);
    if (!step()) {
      what = end_unless_more_joins(MinimiseTermination::LineSearchFailed);
      continue;
    }
    move_on();
    const Revision revision = is_look ? revise_after_look(iteration) : revise();
    if (revision.has_changed) fit();
    is_told_ = false;
  }
  summary_.iterations = state_.iterations();
  summary_.evaluations = state_.evaluations;
  summary_.energy_before = state_.energies.front();
  summary_.energy_after = state_.energies.back();
  summary_.first_optimality = state_.first_optimality;
  return summary_;
}

template <class T>
void Minimisation<T>::begin() {
  objective_.look_everywhere(true);
  state_.gradient.resize(objective_.size());
  state_.preconditioned.resize(preconditioner_.dense_size());
  const Evaluation start = evaluate(state_.x, state_.gradient, state_.preconditioned, sparsity_);
  if (!start.is_valid)
    throw NumericalFailure("the energy at the start or its gradient is not finite; check the images for NaN and Inf");
  state_.energies = {start.value};
  revise_after_look(0);
  state_.look_gap = kFirstLookGap;
  fit();
  objective_.look_everywhere(false);
  if (!(options_.noise_tolerance > 0)) return;
  if (objective_.has_more())
    throw std::logic_error("noise is looked at where nothing can join: the look forgets what wanted to");
  if (!objective_.noise_gradient(state_.x, next_gradient_, next_preconditioned_)) return;
  ++state_.evaluations;
  const double square = preconditioner_.dense_square(next_gradient_, next_preconditioned_);
  // What is not finite says nothing; the run then ends for other reasons.
  if (std::isfinite(square)) state_.noise_optimality = std::sqrt(std::max(0.0, square));
}

template <class T>
void Minimisation<T>::measure_optimality() {
  find_pseudo();
  optimality_ = std::sqrt(std::max(0.0, preconditioner_.dot(pseudo(), pseudo(), state_.preconditioned)));
  if (state_.iterations() == 0) state_.first_optimality = optimality_;
  summary_.optimality = reference() > 0 ? optimality_ / reference() : 0;
}

/// Of the last step; false where `accepted` wants no more.
template <class T>
bool Minimisation<T>::tell() {
  if (is_told_) return true;
  is_told_ = true;
  return accepted_({state_.iterations(), state_.energies.back(), sparsity_, step_, summary_.optimality});
}

template <class T>
auto Minimisation<T>::next() -> Next {
  const int done = state_.iterations();
  if (optimality_ <= options_.optimality_tolerance * reference())
    return end_unless_more_joins(MinimiseTermination::Converged);
  if (optimality_ * optimality_ <= options_.noise_tolerance * state_.noise_optimality * state_.noise_optimality)
    return end_unless_more_joins(MinimiseTermination::NoiseFloor);
  if (done >= kTrial && (state_.settled_at < 0 || done - state_.settled_at >= kTrial)) {
    if (!has_settled(state_.energies, options_.decrease_before, options_.tolerance)) {
      state_.settled_at = -1;
    } else if (state_.settled_at >= 0 || (state_.revised_at != done && !joins_here())) {
      return end(MinimiseTermination::Settled);  // what joined last was worth too little, and nobody else is let in
    } else {
      state_.settled_at = done;
      return Next::Again;
    }
  }
  return done >= options_.max_iterations ? end(MinimiseTermination::IterationLimit) : Next::Step;
}

template <class T>
auto Minimisation<T>::end(MinimiseTermination why) -> Next {
  summary_.termination = why;
  return Next::End;
}

template <class T>
auto Minimisation<T>::end_unless_more_joins(MinimiseTermination why) -> Next {
  return joins_here() ? Next::Again : end(why);
}

/// Finds a point with less energy: candidate_, with its gradients. False if there is none along the quasi-Newton
/// direction, nor, where the model of the curvature was wrong, along steepest descent, nor between the sides of a kink.
template <class T>
bool Minimisation<T>::step() {
  has_forgotten_ = is_used_ = false;
  if (try_along(state_.pairs, options_.max_line_search)) return true;
  if (!state_.pairs.empty()) {
    has_forgotten_ = true;
    if (try_along({}, options_.max_line_search)) return true;
  }
  return leave_kink();
}

/// The same along the steepest descent between the sides of a kink that state_.x may lie on.
template <class T>
bool Minimisation<T>::leave_kink() {
  double sparsity_here = 0;
  const Evaluation here = evaluate(state_.x, next_gradient_, next_preconditioned_, sparsity_here, true);
  if (!here.is_valid || next_gradient_ == state_.gradient) return false;
  std::swap(next_gradient_, state_.gradient);
  std::swap(next_preconditioned_, state_.preconditioned);
  has_forgotten_ = true;
  find_pseudo();
  is_used_ = false;
  return try_along({}, std::min(kStepsFromKink, options_.max_line_search));
}

template <class T>
bool Minimisation<T>::try_along(const std::deque<CurvaturePair<T>>& pairs, int most_steps) {
  find_direction(pairs);
  if (!(dot(pseudo(), candidate_) < 0)) return false;
  const double energy = state_.energies.back();
  step_ = pairs.empty() ? objective_.first_step(candidate_) : 1.0;
  for (int trial = 0; trial < most_steps; ++trial) {
    if (trial > 0) find_direction(pairs);
    walk(state_.x, step_, candidate_);
    project(ranges(), state_.x, pseudo(), candidate_);
    const std::vector<T>& pull = pseudo();
    const double expected = ordered_sum(candidate_.size(), [&](std::size_t i) {
      return static_cast<double>(pull[i]) * (static_cast<double>(candidate_[i]) - state_.x[i]);
    });
    const Evaluation found = evaluate(candidate_, next_gradient_, next_preconditioned_, sparsity_);
    energy_ = found.value;
    if (found.is_valid && found.value < energy && found.value <= energy + 1e-4 * expected) return true;
    // Minimum of the parabola through both values and the slope, kept within a safe range.
    double factor = 0.25;
    if (found.is_valid && expected < 0) {
      const double excess = found.value - energy - expected;
      if (excess > 0) factor = std::clamp(-expected / (2 * excess), 0.1, 0.6);
    }
    step_ *= factor;
  }
  return false;
}

template <class T>
void Minimisation<T>::find_direction(const std::deque<CurvaturePair<T>>& pairs) {
  if (is_used_) find_pseudo();
  quasi_newton_direction(preconditioner_, pairs, state_.preconditioned, next_gradient_, candidate_);
  if (!ranges().empty()) find_pseudo();
  align(ranges(), state_.x, pseudo(), candidate_);
  is_used_ = true;
}

/// The state moves on to the new point. A pair that tells of no curvature is not kept, nor, where it has taken its
/// place, the oldest one.
template <class T>
void Minimisation<T>::move_on() {
  if (has_forgotten_) state_.pairs.clear();
  CurvaturePair<T> pair;
  if (static_cast<int>(state_.pairs.size()) >= options_.history) {
    pair = std::move(state_.pairs.front());
    state_.pairs.pop_front();
  }
  store_change(candidate_, state_.x, pair.s);
  store_change(next_gradient_, state_.gradient, pair.y);
  store_change(next_preconditioned_, state_.preconditioned, pair.y_preconditioned);
  const double curvature = dot(pair.s, pair.y);
  const double size = preconditioner_.dot(pair.y, pair.y, pair.y_preconditioned);
  if (curvature > 1e-8 * std::abs(size) && size > 0) {
    pair.rho = 1 / curvature;
    state_.pairs.push_back(std::move(pair));
  }
  std::swap(candidate_, state_.x);
  std::swap(next_gradient_, state_.gradient);
  std::swap(next_preconditioned_, state_.preconditioned);
  state_.energies.push_back(energy_);
}

template <class T>
Evaluation Minimisation<T>::evaluate(const std::vector<T>& at, std::vector<T>& gradient, std::vector<T>& preconditioned,
                                     double& sparsity, bool between_sides) {
  ++state_.evaluations;
  Evaluation found = between_sides ? objective_.evaluate_between_sides(at, gradient, preconditioned)
                                   : objective_.evaluate(at, gradient, preconditioned);
  sparsity = sparsity_energy(ranges(), at);
  found.value += sparsity;
  found.is_valid = found.is_valid && std::isfinite(found.value) &&
                   std::isfinite(preconditioner_.dot(gradient, gradient, preconditioned));
  return found;
}

/// Depends on the state alone, so that a run that is taken up again looks when it would have.
template <class T>
bool Minimisation<T>::is_due(int iteration) const {
  return !objective_.has_more() || static_cast<long long>(iteration) - state_.looked_at >= state_.look_gap;
}

template <class T>
Revision Minimisation<T>::revise() {
  // A vector that changes its length is there twice for a while, and this one is not needed then.
  if (!ranges().empty()) candidate_ = {};
  return objective_.revise(state_);
}

/// The last evaluation looked everywhere, at state_.x: lets in what wants to take part.
template <class T>
Revision Minimisation<T>::revise_after_look(int iteration) {
  const Revision revision = revise();
  state_.looked_at = iteration;
  const bool is_more = revision.joined > kLeastJoined;
  state_.look_gap = is_more ? kFirstLookGap : 2 * std::clamp(state_.look_gap, kFirstLookGap, kLargestLookGap / 2);
  if (is_more) state_.revised_at = iteration;
  return revision;
}

/// Before a run ends where it has not looked: whether something that was outside the working set wants to take part.
template <class T>
bool Minimisation<T>::joins_here() {
  const int iteration = state_.iterations();
  if (!objective_.has_more() || state_.looked_at == iteration) return false;
  objective_.look_everywhere(true);
  double sparsity_here = 0;
  evaluate(state_.x, next_gradient_, next_preconditioned_, sparsity_here);
  const Revision revision = revise_after_look(iteration);
  if (revision.has_changed) fit();
  return revision.joined > kLeastJoined;
}

template <class T>
void Minimisation<T>::find_pseudo() {
  next_gradient_ = state_.gradient;
  make_pseudo(ranges(), state_.x, next_gradient_);
}

/// Makes the vectors exactly as large as the objective wants: what it dropped must not stay allocated.
template <class T>
void Minimisation<T>::fit() {
  preconditioner_ = Preconditioner(ranges(), objective_.size());
  next_gradient_ = std::vector<T>(objective_.size());
  next_preconditioned_ = std::vector<T>(preconditioner_.dense_size());
  candidate_ = {};
}

}  // namespace

bool has_settled(const std::vector<double>& energies, double before, double tolerance) {
  if (energies.size() <= kTrial) return false;
  const double whole = before + energies.front() - energies.back();
  return energies[energies.size() - 1 - kTrial] - energies.back() <= tolerance * whole;
}

template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, MinimiserState<T>& state,
                         const std::function<bool(const MinimiseStep&)>& accepted) {
  return Minimisation<T>(objective, options, state, accepted).run();
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
