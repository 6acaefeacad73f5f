#pragma once

#include <Eigen/LU>

#include "core/grid/image_grid.h"

namespace saltus {

/// The orthonormal matrix next to one that is nearly so, by Newton's iteration for the polar factor: headers round.
template <int Dim>
Matrix<Dim> nearest_rotation(Matrix<Dim> matrix) {
  for (int step = 0; step < 5; ++step) {
    const double deviation = (matrix.transpose() * matrix - Matrix<Dim>::Identity()).cwiseAbs().maxCoeff();
    if (deviation < 1e-14) break;
    matrix = 0.5 * (matrix + matrix.inverse().transpose()).eval();
  }
  return matrix;
}

}  // namespace saltus
