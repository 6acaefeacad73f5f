#pragma once

#include "core/optimisation/lbfgs.h"

#include <vector>

namespace saltus {

/// What a round is planned with before it begins: most end well before their limit.
inline constexpr int usual_iterations = 40;

/// How many iterations a minimisation will still take, from its energies (at the start and after each iteration). It
/// settles when the share r that five iterations bring of the whole decrease falls to a tolerance; r falls about as
/// 1 / k^2 with the iterations k, so it gets there after k sqrt(r / tolerance). Before five iterations: the usual
/// number. Never beyond the limit. Progress for people, nothing is decided by it.
double expected_iterations_left(const std::vector<double>& energies, const MinimiseOptions& how);

}  // namespace saltus
