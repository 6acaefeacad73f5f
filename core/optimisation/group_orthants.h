#pragma once

#include "core/optimisation/objective.h"

#include <vector>

namespace saltus {

// What the orthant-wise treatment of a sparsity term (Andrew and Gao, 2007) does with signs, here done with the
// directions of groups. All vectors have the length of x.

/// The sparsity term at x.
template <class T>
double sparsity_energy(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x);

/// Turns the gradient of the smooth part into the subgradient of least length of the whole. Outside the ranges, where
/// it is preconditioned by the objective, nothing changes.
template <class T>
void make_pseudo(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, std::vector<T>& gradient);

/// Groups at zero move only where their own subgradient points.
template <class T>
void align(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
           std::vector<T>& direction);

/// Groups that turned against x (or, from zero, against their subgradient) become exactly zero.
template <class T>
void project(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
             std::vector<T>& candidate);

}  // namespace saltus
