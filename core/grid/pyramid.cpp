#include "core/grid/pyramid.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// What one target sample is made of along one axis: weights of samples that follow each other, from `first` on, which
/// may lie beyond the border and then mean the border's sample.
struct Taps {
  int first;
  std::vector<double> weights;
};

/// The Gaussian at two neighbouring samples, read between them.
Taps taps_at(double position, int length, double sigma_samples) {
  const double inside = std::clamp(position, 0.0, static_cast<double>(length - 1));
  const int low = std::min(static_cast<int>(inside), std::max(length - 2, 0));
  const double fraction = inside - low;
  const int radius = static_cast<int>(std::ceil(3 * sigma_samples));
  const auto gaussian = [&](int j) {
    return std::abs(j) > radius ? 0 : radius == 0 ? 1 : std::exp(-0.5 * j * j / (sigma_samples * sigma_samples));
  };
  double total = 0;
  for (int j = -radius; j <= radius; ++j) total += gaussian(j);
  Taps taps{low - radius, {}};
  for (int j = -radius; j <= radius + 1; ++j)
    taps.weights.push_back(((1 - fraction) * gaussian(j) + fraction * gaussian(j - 1)) / total);
  return taps;
}

/// Only what the target keeps is computed.
template <class T>
std::vector<T> reduce_axis(std::size_t outer, int length, std::size_t inner, const std::vector<Taps>& targets,
                           const std::vector<T>& in) {
  std::vector<T> out(outer * targets.size() * inner, T(0));
#pragma omp parallel for collapse(2) schedule(static)
  for (std::size_t o = 0; o < outer; ++o)
    for (std::size_t t = 0; t < targets.size(); ++t) {
      T* to = out.data() + (o * targets.size() + t) * inner;
      int index = targets[t].first;
      for (double weight : targets[t].weights) {
        const T* from = in.data() + (o * length + std::clamp(index++, 0, length - 1)) * inner;
        const T w = static_cast<T>(weight);
        for (std::size_t k = 0; k < inner; ++k) to[k] += w * from[k];
      }
    }
  return out;
}

}  // namespace

template <int Dim, class T>
std::vector<T> downsampled(const Lattice<Dim>& lattice, const std::vector<T>& samples, const Lattice<Dim>& target,
                           double smoothing) {
  // The last axis first: there whole planes add up, and what is left for the others is small.
  std::vector<T> result;
  const std::vector<T>* reached = &samples;
  for (int axis = Dim - 1; axis >= 0; --axis) {
    const int length = lattice.size[axis];
    const double ratio = target.spacing[axis] / lattice.spacing[axis];
    const double sigma =
        length == 1 ? 0 : (ratio > 1 + 1e-9 ? std::max(smoothing, 0.5) : std::max(smoothing, 0.0)) * ratio;
    const double start = (target.offset[axis] - lattice.offset[axis]) / lattice.spacing[axis];
    if (sigma == 0 && ratio == 1 && start == 0 && target.size[axis] == length) continue;
    std::vector<Taps> targets;
    for (int t = 0; t < target.size[axis]; ++t) targets.push_back(taps_at(start + t * ratio, length, sigma));
    std::size_t inner = 1, outer = 1;
    for (int before = 0; before < axis; ++before) inner *= static_cast<std::size_t>(lattice.size[before]);
    for (int after = axis + 1; after < Dim; ++after) outer *= static_cast<std::size_t>(target.size[after]);
    result = reduce_axis(outer, length, inner, targets, *reached);
    reached = &result;
  }
  if (reached == &samples) return samples;
  return result;
}

template std::vector<float> downsampled(const Lattice<2>&, const std::vector<float>&, const Lattice<2>&, double);
template std::vector<float> downsampled(const Lattice<3>&, const std::vector<float>&, const Lattice<3>&, double);
template std::vector<double> downsampled(const Lattice<2>&, const std::vector<double>&, const Lattice<2>&, double);
template std::vector<double> downsampled(const Lattice<3>&, const std::vector<double>&, const Lattice<3>&, double);

}  // namespace saltus
