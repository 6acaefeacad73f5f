#pragma once

#include <cstdint>
#include <vector>

#include "core/grid/image_grid.h"

namespace saltus {

/// A random texture without period or border: per scale, a lattice of cells with one blob `a (1 - r^2/R^2)^4` each,
/// at a random place of its cell and with a random amplitude in [-1, 1]. Closed form at every point, C3.
template <int Dim>
class BlobTexture {
 public:
  struct Scale {
    double radius_mm = 1;  ///< R, where the blob ends; also the size of a cell
    double amplitude = 1;
  };

  BlobTexture(std::vector<Scale> scales, std::uint64_t seed);

  /// Texture at a world point; zero mean. |value| stays below 2^Dim times the sum of the amplitudes.
  double operator()(const Vector<Dim>& world) const;

 private:
  std::vector<Scale> scales_;
  std::uint64_t seed_;
};

}  // namespace saltus
