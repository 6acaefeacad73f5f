#pragma once

#include <Eigen/Core>

#include <vector>

namespace saltus {

/// A set of unit normals, the axes first, that leaves no direction far from all of them; each stands for its opposite
/// as well. `count`: 4 or 8 in 2-D (evenly spaced), 3 (axes), 9 (and face diagonals) or 13 (and space diagonals) in
/// 3-D; 0 gives none. Throws InvalidInput for other numbers.
template <int Dim>
std::vector<Eigen::Matrix<double, Dim, 1>> spread_normals(int count);

}  // namespace saltus
