#pragma once

#include "core/optimisation/objective.h"
#include "core/support/short_float.h"

#include <deque>
#include <functional>
#include <utility>
#include <vector>

namespace saltus {

struct MinimiseOptions {
  int max_iterations = 60;
  double tolerance = 1e-3;          ///< ends when five iterations give less than this share of the whole decrease
  double decrease_before = 0;       ///< that a run before this one brought, and that is part of the whole
  double optimality_tolerance = 0;  ///< ends when the optimality residual falls to this share of its reference
  double optimality_reference = 0;  ///< residual that others are shares of; 0: that at the start
  /// Ends when the square of the optimality residual is at most this share of what noise alone makes of it where the
  /// run began (Objective::noise_gradient): what still pulls is then mostly noise. 0: does not. Not where there is more
  /// outside the working set (std::logic_error).
  double noise_tolerance = 0;
  /// Pairs kept, at least 1 (std::logic_error). A step along which no curvature is seen leaves none; where as many are
  /// kept, the oldest one goes all the same.
  int history = 6;
  int max_line_search = 20;
};

enum class MinimiseTermination {
  Converged,   ///< the optimality residual fell to its tolerance
  Settled,     ///< the energy fell no more by a share that counts
  NoiseFloor,  ///< what pulls is mostly noise, see MinimiseOptions::noise_tolerance
  IterationLimit,
  LineSearchFailed,  ///< no step along the last direction lowers the energy
  Stopped            ///< `accepted` said so
};

/// What one accepted iteration did.
struct MinimiseStep {
  int iteration = 0;
  double energy = 0;    ///< smooth part plus sparsity
  double sparsity = 0;  ///< of that, the sparsity term
  double step = 0;
  double optimality = 0;  ///< optimality residual after the step, as a share of the reference
};

struct MinimiseSummary {
  MinimiseTermination termination = MinimiseTermination::Converged;
  int iterations = 0, evaluations = 0;
  double energy_before = 0, energy_after = 0;
  double optimality = 0;        ///< residual at the end, as a share of the reference
  double first_optimality = 0;  ///< residual at the start, absolute
};

/// What pairs hold of a value. They are a model of the curvature, which a digit or two less serve as well.
template <class T>
struct StoredOf {
  using Type = T;
};
template <>
struct StoredOf<float> {
  using Type = ShortFloat;
};
template <class T>
using Stored = typename StoredOf<T>::Type;

/// A step s and the change y of the gradient along it, with 1 / (s . y) and, as far as Objective::evaluate gives that,
/// y preconditioned. Of s and y as they are stored, so that s . y is above 0 and the model positive definite for them;
/// y preconditioned is rounded by itself.
template <class T>
struct CurvaturePair {
  std::vector<Stored<T>> s, y, y_preconditioned;
  double rho = 0;
};

/// Where a minimisation stands after an accepted step, or, with x alone (or with pairs of the same unknowns, from an
/// energy whose curvature was much like this one's), before it begins: all that it needs to go on as if it had never
/// been interrupted, bit by bit. Memory: 2 vectors of the size of x and one of what lies outside the sparsity ranges,
/// while it minimises 2 more of the first and one more of the second; and of the pairs 2 * history and history, of half
/// as many bytes for float.
template <class T>
struct MinimiserState {
  MinimiserState() = default;
  explicit MinimiserState(std::vector<T> start) : x(std::move(start)) {}

  std::vector<T> x;
  std::vector<T> gradient, preconditioned;  ///< of the smooth part at x, see Objective::evaluate
  std::deque<CurvaturePair<T>> pairs;       ///< oldest first
  std::vector<double> energies;             ///< at the start and after each accepted step; empty before the start
  double first_optimality = 0;              ///< residual at the start, absolute
  double noise_optimality = 0;              ///< what noise alone makes of it, at the start; 0: not known
  int evaluations = 0;
  int looked_at = 0;    ///< iteration after which all that is outside the working set was looked at last
  int look_gap = 0;     ///< iterations from there to the next look
  int revised_at = -1;  ///< iteration after which a look let in more than little last; -1: none
  int settled_at = -1;  ///< iteration after which the energy had settled and only what joined kept it going; -1: none

  bool has_begun() const { return !energies.empty(); }
  int iterations() const { return has_begun() ? static_cast<int>(energies.size()) - 1 : 0; }  ///< accepted steps
};

/// Whether the last five iterations gave at most `tolerance` of the whole decrease, of which `before` came before these
/// energies (at the start and after each iteration). Not after fewer.
bool has_settled(const std::vector<double>& energies, double before, double tolerance);

/// Minimises from a state, in place. Limited-memory quasi-Newton in the metric of the objective's preconditioner, with
/// the orthant-wise treatment of the sparsity term (Andrew and Gao, 2007) carried from signs to groups: groups at zero
/// stay there while their gradient is shorter than the weight, and a group that would turn against its direction
/// becomes exactly zero. Backtracking line search; the energy never rises on an accepted step; an energy or gradient
/// that is not finite shortens the step. The optimality residual is sqrt(g . P g) with g the subgradient of least
/// length of the whole energy and P the preconditioner: 0 exactly at a stationary point. The objective may revise its
/// working set after each step; pairs hold 0 for unknowns that they were made without, which leaves s . y as it is.
/// What is outside the working set is looked at after five iterations, then after ten more and so on up to forty, after
/// five again once a look let in more than a twentieth of a range, and before a run ends for any reason but its limit
/// or being stopped: one that converges does so where no more than that wants to take part, and that little is part of
/// x. One that had settled when more joined goes on for five iterations at least, and ends when these bring too little
/// as well. `accepted` is called after each accepted step, when the state is complete, and says whether to go on.
///
/// A state that has begun goes on after its last step, of which `accepted` is not told again; the summary counts from
/// the beginning. When the objective throws, the state is still that of the last accepted step. Throws NumericalFailure
/// when the energy at the start or its gradient is not finite.
template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, MinimiserState<T>& state,
                         const std::function<bool(const MinimiseStep&)>& accepted);

/// The same from x alone, in place; x is the last accepted point also when the objective throws.
template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, std::vector<T>& x,
                         const std::function<bool(const MinimiseStep&)>& accepted);

}  // namespace saltus
