#pragma once

#include "core/optimisation/objective.h"

#include <functional>

namespace saltus {

struct MinimiseOptions {
  int max_iterations = 60;
  double tolerance = 1e-3;          ///< ends when five iterations give less than this share of the whole decrease
  double optimality_tolerance = 0;  ///< ends when the optimality residual falls to this share of its reference
  double optimality_reference = 0;  ///< residual that others are shares of; 0: that at the start
  int history = 6;
  int max_line_search = 20;
};

enum class MinimiseTermination {
  Converged,  ///< the optimality residual fell to its tolerance
  Settled,    ///< the energy fell no more by a share that counts
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

/// Minimises from x, in place. Limited-memory quasi-Newton in the metric of the objective's preconditioner, with the
/// orthant-wise treatment of the sparsity term (Andrew and Gao, 2007) carried from signs to groups: groups at zero stay
/// there while their gradient is shorter than the weight, and a group that would turn against its direction becomes
/// exactly zero. Backtracking line search; the energy never rises on an accepted step; a non-finite energy shortens the
/// step. The optimality residual is sqrt(g . P g) with g the subgradient of least length of the whole energy and P the
/// preconditioner: 0 exactly at a stationary point. `accepted` is called after each accepted step and says whether to
/// go on. Throws NumericalFailure when the energy at the start is not finite.
template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, std::vector<T>& x,
                         const std::function<bool(const MinimiseStep&)>& accepted);

}  // namespace saltus
