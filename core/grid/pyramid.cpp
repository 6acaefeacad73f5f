#include "core/grid/pyramid.h"

#include "core/grid/resampling.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

template <class T>
void smooth_axis(std::size_t outer, int length, std::size_t inner, double sigma_samples, const std::vector<T>& in,
                 std::vector<T>& out) {
  const int radius = static_cast<int>(std::ceil(3 * sigma_samples));
  std::vector<double> weights;
  double total = 0;
  for (int j = -radius; j <= radius; ++j) {
    weights.push_back(std::exp(-0.5 * j * j / (sigma_samples * sigma_samples)));
    total += weights.back();
  }
#pragma omp parallel for collapse(2) schedule(static)
  for (std::size_t o = 0; o < outer; ++o)
    for (int i = 0; i < length; ++i) {
      T* to = out.data() + (o * length + i) * inner;
      std::fill(to, to + inner, T(0));
      for (int j = -radius; j <= radius; ++j) {
        const T w = static_cast<T>(weights[j + radius] / total);
        const T* from = in.data() + (o * length + std::clamp(i + j, 0, length - 1)) * inner;
        for (std::size_t k = 0; k < inner; ++k) to[k] += w * from[k];
      }
    }
}

}  // namespace

template <int Dim, class T>
std::vector<T> downsampled(const Lattice<Dim>& lattice, const std::vector<T>& samples, const Lattice<Dim>& target,
                           double smoothing) {
  std::vector<T> smooth = samples, next(samples.size());
  std::size_t inner = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const std::size_t length = static_cast<std::size_t>(lattice.size[axis]);
    const double ratio = target.spacing[axis] / lattice.spacing[axis];
    const double sigma = (ratio > 1 + 1e-9 ? std::max(smoothing, 0.5) : smoothing) * ratio;
    if (sigma > 0 && length > 1) {
      smooth_axis(samples.size() / (length * inner), lattice.size[axis], inner, sigma, smooth, next);
      std::swap(smooth, next);
    }
    inner *= length;
  }
  if (lattice == target) return smooth;
  std::vector<T> result(target.sites(), T(0));
  LatticeInterpolation<Dim, T>(lattice, target, 1).add_to(smooth.data(), result.data());
  return result;
}

template std::vector<float> downsampled(const Lattice<2>&, const std::vector<float>&, const Lattice<2>&, double);
template std::vector<float> downsampled(const Lattice<3>&, const std::vector<float>&, const Lattice<3>&, double);
template std::vector<double> downsampled(const Lattice<2>&, const std::vector<double>&, const Lattice<2>&, double);
template std::vector<double> downsampled(const Lattice<3>&, const std::vector<double>&, const Lattice<3>&, double);

}  // namespace saltus
