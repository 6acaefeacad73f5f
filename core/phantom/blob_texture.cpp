#include "core/phantom/blob_texture.h"

#include <array>
#include <cmath>
#include <utility>

#include "core/support/random.h"

namespace saltus {

template <int Dim>
BlobTexture<Dim>::BlobTexture(std::vector<Scale> scales, std::uint64_t seed)
    : scales_(std::move(scales)), seed_(seed) {}

template <int Dim>
double BlobTexture<Dim>::operator()(const Vector<Dim>& world) const {
  constexpr int kNeighbours = Dim == 2 ? 9 : 27;
  double sum = 0;
  for (std::size_t level = 0; level < scales_.size(); ++level) {
    const Vector<Dim> lattice = world / scales_[level].radius_mm;
    std::array<std::int64_t, 3> home{};
    for (int axis = 0; axis < Dim; ++axis) home[axis] = static_cast<std::int64_t>(std::floor(lattice[axis]));
    double value = 0;
    for (int neighbour = 0; neighbour < kNeighbours; ++neighbour) {
      std::array<std::int64_t, 3> cell = home;
      for (int axis = 0, rest = neighbour; axis < Dim; ++axis, rest /= 3) cell[axis] += rest % 3 - 1;
      // 16 bits for each coordinate and for the amplitude come from a single draw.
      const std::uint64_t bits =
          random_bits(seed_, {static_cast<std::int64_t>(level), cell[0], cell[1], Dim == 3 ? cell[2] : 0});
      double squared = 0;
      for (int axis = 0; axis < Dim; ++axis) {
        const double place = (static_cast<double>((bits >> (16 * axis)) & 0xffff) + 0.5) / 65536.0;
        const double offset = lattice[axis] - static_cast<double>(cell[axis]) - place;
        squared += offset * offset;
      }
      if (squared >= 1) continue;
      const double amplitude = (static_cast<double>(bits >> 48) + 0.5) / 32768.0 - 1.0;
      const double bump = (1 - squared) * (1 - squared);
      value += amplitude * bump * bump;
    }
    sum += scales_[level].amplitude * value;
  }
  return sum;
}

template class BlobTexture<2>;
template class BlobTexture<3>;

}  // namespace saltus
