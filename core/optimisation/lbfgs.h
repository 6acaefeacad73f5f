#pragma once

#include "core/optimisation/objective.h"

#include <functional>

namespace saltus {

struct MinimiseOptions {
  int max_iterations = 60;
  double tolerance = 1e-3;  ///< ends when five iterations give less than this share of the whole decrease
  int history = 6;
  int max_line_search = 20;
};

enum class MinimiseTermination { Converged, IterationLimit, LineSearchFailed, Stopped };

/// What one accepted iteration did.
struct MinimiseStep {
  int iteration = 0;
  double energy = 0;    ///< smooth part plus sparsity
  double sparsity = 0;  ///< of that, the sparsity term
  double step = 0;
  double optimality = 0;  ///< sqrt(pseudo-gradient . preconditioned pseudo-gradient), relative to its first value
};

struct MinimiseSummary {
  MinimiseTermination termination = MinimiseTermination::Converged;
  int iterations = 0, evaluations = 0;
  double energy_before = 0, energy_after = 0;
};

/// Minimises from x, in place. Limited-memory quasi-Newton in the metric of the objective's preconditioner, with the
/// orthant-wise treatment of the sparsity term (Andrew and Gao, 2007) carried from signs to groups: groups at zero stay
/// there while their gradient is shorter than the weight, and a group that would turn against its direction becomes
/// exactly zero. Backtracking line search; the energy never rises on an accepted step; a non-finite energy shortens the
/// step. `accepted` is called after each accepted step and says whether to go on. Throws NumericalFailure when the
/// energy at the start is not finite.
template <class T>
MinimiseSummary minimise(Objective<T>& objective, const MinimiseOptions& options, std::vector<T>& x,
                         const std::function<bool(const MinimiseStep&)>& accepted);

}  // namespace saltus
