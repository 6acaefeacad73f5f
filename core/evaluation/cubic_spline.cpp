#include "core/evaluation/cubic_spline.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace saltus {
namespace {

const double kPole = std::sqrt(3.0) - 2.0;

/// Turns the samples of one line into spline coefficients.
void filter_line(std::vector<double>& line) {
  const auto n = static_cast<std::ptrdiff_t>(line.size());
  if (n < 2) return;
  for (double& value : line) value *= (1 - kPole) * (1 - 1 / kPole);
  // Causal start: the mirrored line's geometric sum, summed in full.
  double power = kPole, mirrored = std::pow(kPole, static_cast<double>(n - 1));
  double start = line[0] + mirrored * line[n - 1];
  mirrored *= mirrored / kPole;
  for (std::ptrdiff_t k = 1; k < n - 1; ++k) {
    start += (power + mirrored) * line[k];
    power *= kPole;
    mirrored /= kPole;
  }
  line[0] = start / (1 - power * power);
  for (std::ptrdiff_t k = 1; k < n; ++k) line[k] += kPole * line[k - 1];
  line[n - 1] = kPole / (kPole * kPole - 1) * (kPole * line[n - 2] + line[n - 1]);
  for (std::ptrdiff_t k = n - 2; k >= 0; --k) line[k] = kPole * (line[k + 1] - line[k]);
}

int mirrored_index(int index, int size) {
  if (size == 1) return 0;
  const int period = 2 * (size - 1);
  index = std::abs(index) % period;
  return index < size ? index : period - index;
}

}  // namespace

template <int Dim>
CubicSpline<Dim>::CubicSpline(const Volume<Dim>& image)
    : size_(image.grid.size), coefficients_(image.samples.begin(), image.samples.end()) {
  const auto total = static_cast<std::ptrdiff_t>(coefficients_.size());
  std::ptrdiff_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const std::ptrdiff_t length = size_[axis];
    const std::ptrdiff_t lines = total / length;
#pragma omp parallel for schedule(static)
    for (std::ptrdiff_t number = 0; number < lines; ++number) {
      const std::ptrdiff_t first = number / stride * stride * length + number % stride;
      std::vector<double> line(length);
      for (std::ptrdiff_t k = 0; k < length; ++k) line[k] = coefficients_[first + k * stride];
      filter_line(line);
      for (std::ptrdiff_t k = 0; k < length; ++k) coefficients_[first + k * stride] = line[k];
    }
    stride *= length;
  }
}

template <int Dim>
double CubicSpline<Dim>::operator()(const Vector<Dim>& index) const {
  std::array<std::array<double, 4>, Dim> weights;
  std::array<std::array<std::size_t, 4>, Dim> offsets;
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const int cell = static_cast<int>(std::floor(index[axis]));
    const double t = index[axis] - cell, s = 1 - t;
    weights[axis] = {s * s * s / 6, 2.0 / 3 - t * t * (1 - t / 2), 2.0 / 3 - s * s * (1 - s / 2), t * t * t / 6};
    for (int k = 0; k < 4; ++k)
      offsets[axis][k] = stride * static_cast<std::size_t>(mirrored_index(cell + k - 1, size_[axis]));
    stride *= static_cast<std::size_t>(size_[axis]);
  }
  double sum = 0;
  for (int tap = 0; tap < (1 << (2 * Dim)); ++tap) {
    double weight = 1;
    std::size_t at = 0;
    for (int axis = 0; axis < Dim; ++axis) {
      const int k = (tap >> (2 * axis)) & 3;
      weight *= weights[axis][k];
      at += offsets[axis][k];
    }
    sum += weight * coefficients_[at];
  }
  return sum;
}

template class CubicSpline<2>;
template class CubicSpline<3>;

}  // namespace saltus
