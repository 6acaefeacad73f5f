#include "core/momenta/spread_normals.h"

#include "core/support/errors.h"

#include <cmath>
#include <numbers>
#include <string>

namespace saltus {

template <int Dim>
std::vector<Eigen::Matrix<double, Dim, 1>> spread_normals(int count) {
  std::vector<Eigen::Matrix<double, Dim, 1>> normals;
  if (count == 0) return normals;
  const bool is_known = Dim == 2 ? count == 4 || count == 8 : count == 3 || count == 9 || count == 13;
  if (!is_known)
    throw InvalidInput("parameter orientations is " + std::to_string(count) + " and the images have " +
                       std::to_string(Dim) + " dimensions; it must be " + (Dim == 2 ? "0, 4 or 8" : "0, 3, 9 or 13"));
  for (int axis = 0; axis < Dim; ++axis) normals.push_back(Eigen::Matrix<double, Dim, 1>::Unit(axis));
  if constexpr (Dim == 2) {
    for (int k = 1; k < count; ++k) {
      const double angle = std::numbers::pi * k / count;
      if (2 * k != count) normals.push_back({std::cos(angle), std::sin(angle)});
    }
  } else if (count > 3) {
    for (int z = 0; z <= 1; ++z)
      for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
          const int nonzero = (x != 0) + (y != 0) + (z != 0);
          if (nonzero < 2 || (nonzero == 3 && count == 9) || (z == 0 && y < 0)) continue;
          normals.push_back(Eigen::Vector3d(x, y, z).normalized());
        }
  }
  return normals;
}

template std::vector<Eigen::Matrix<double, 2, 1>> spread_normals<2>(int);
template std::vector<Eigen::Matrix<double, 3, 1>> spread_normals<3>(int);

}  // namespace saltus
