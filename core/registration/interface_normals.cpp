#include "core/registration/interface_normals.h"

#include "core/grid/interpolation.h"
#include "core/kernels/separable_convolution.h"
#include "core/registration/field_derivative.h"
#include "core/support/free_memory.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace saltus {
namespace {

constexpr int kMeans = 6;  // over three samples, one of the other: a standard deviation of 2
constexpr double kLeastShare = 0.3;
constexpr int kBeside = 4;  // sites asked, about as far as the means of a velocity on the same lattice reach
const double kAlongAxis = std::cos(6 * std::numbers::pi / 180);

template <int Dim, class T>
bool is_along_axis(const T* normal) {
  return std::any_of(normal, normal + Dim, [](T value) { return std::abs(value) > kAlongAxis; });
}

/// The largest value within so many sites along each axis.
template <int Dim, class T>
std::vector<T> largest_within(const Lattice<Dim>& lattice, std::vector<T> values, int reach) {
  std::vector<T> from(values.size());
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    std::swap(from, values);
    const std::size_t length = static_cast<std::size_t>(lattice.size[axis]), block = stride * length,
                      blocks = values.size() / block, far = static_cast<std::size_t>(reach);
#pragma omp parallel for collapse(2) schedule(static)
    for (std::size_t begin = 0; begin < blocks; ++begin)
      for (std::size_t i = 0; i < length; ++i) {
        const std::size_t first = i - std::min(i, far), last = std::min(length - 1, i + far);
        T* to = values.data() + begin * block + i * stride;
        std::copy_n(from.data() + begin * block + first * stride, stride, to);
        for (std::size_t k = first + 1; k <= last; ++k) {
          const T* other = from.data() + begin * block + k * stride;
          for (std::size_t j = 0; j < stride; ++j) to[j] = std::max(to[j], other[j]);
        }
      }
    stride *= length;
  }
  return values;
}

}  // namespace

template <int Dim, class T>
InterfaceNormals<Dim, T>::InterfaceNormals(const Lattice<Dim>& lattice, const Field<T>& velocity)
    : lattice_(lattice), tensor_(kPairs * lattice.sites()) {
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_derivatives<Dim>(lattice, velocity, slab,
                           [&](std::size_t site, const Eigen::Matrix<T, Dim, Dim>& derivative) {
                             T* tensor = tensor_.data() + kPairs * site;
                             for (int a = 0; a < Dim; ++a)
                               for (int b = a; b < Dim; ++b) *tensor++ = derivative.col(a).dot(derivative.col(b));
                           });
  std::vector<double> taps = {1};  // whole numbers until the end, so that both halves are the same
  for (int mean = 0; mean < kMeans; ++mean) {
    std::vector<double> wider(taps.size() + 2);
    for (std::size_t i = 0; i < taps.size(); ++i)
      for (std::size_t beside = 0; beside < 3; ++beside) wider[i + beside] += taps[i];
    taps = std::move(wider);
  }
  for (double& tap : taps) tap /= std::pow(3.0, kMeans);
  const AxisTaps<T> smoothing(taps);
  for (std::size_t axis = 0; axis < Dim; ++axis) {
    const int size = lattice.size[axis];
    within_[axis].resize(static_cast<std::size_t>(size));
    for (int at = 0; at < size; ++at)
      for (int tap = -kMeans; tap <= kMeans; ++tap)
        if (at + tap >= 0 && at + tap < size)
          within_[axis][static_cast<std::size_t>(at)] += taps[static_cast<std::size_t>(tap + kMeans)];
  }
  Field<T> smoothed(tensor_.size());
  for (int axis = 0; axis < Dim; ++axis) {
    convolve_axis<Dim, T>(lattice, kPairs, axis, smoothing, Combine::Replace, tensor_.data(), smoothed.data());
    std::swap(tensor_, smoothed);
  }
}

template <int Dim, class T>
typename InterfaceNormals<Dim, T>::Normals InterfaceNormals<Dim, T>::on(const Lattice<Dim>& lattice,
                                                                        bool with_strengths) const {
  std::vector<T> normals(Dim * lattice.sites()), strength(lattice.sites());
  const SitePlacement<Dim, T> place(lattice, lattice_);
  const auto tensor_at = [&](const Index<Dim>& index) {
    static constexpr T none[Dim] = {};
    return LinearCell<Dim, T>(lattice_, place(index, none)).template value<kPairs>(tensor_.data());
  };
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      const std::array<T, kPairs> values = tensor_at(index);
      for (int a = 0, k = 0; a < Dim; k += Dim - a++) strength[site] += values[static_cast<std::size_t>(k)];
    });
  // The first eigenvalue is no more than the trace and no less than its mean: where the trace shows already that a site
  // is weak, which it does at most of them, it is not asked for.
  const T largest_trace = *std::max_element(strength.begin(), strength.end());
  const T least_trace = static_cast<T>(0.99 * kLeastShare * kLeastShare / Dim) * largest_trace;
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      if (strength[site] < least_trace) {
        strength[site] = 0;
        return;
      }
      const std::array<T, kPairs> values = tensor_at(index);
      Eigen::Matrix<double, Dim, Dim> tensor;
      for (int a = 0, k = 0; a < Dim; ++a)
        for (int b = a; b < Dim; ++b, ++k) tensor(a, b) = tensor(b, a) = values[static_cast<std::size_t>(k)];
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, Dim, Dim>> solver;
      solver.computeDirect(tensor);
      strength[site] = static_cast<T>(std::sqrt(std::max(0.0, solver.eigenvalues()[Dim - 1])));
      for (int a = 0; a < Dim; ++a) normals[Dim * site + a] = static_cast<T>(solver.eigenvectors()(a, Dim - 1));
    });
  const T least = static_cast<T>(kLeastShare) * *std::max_element(strength.begin(), strength.end());
  std::size_t strong = 0, oblique = 0;
  for (std::size_t site = 0; site < strength.size(); ++site) {
    T* n = normals.data() + Dim * site;
    const bool is_strong = strength[site] > least;
    strong += is_strong;
    oblique += is_strong && !is_along_axis<Dim>(n);
    if (is_strong) continue;
    std::fill(n, n + Dim, T(0));
    strength[site] = 0;
  }
  if (with_strengths)
    make_shares(lattice, strength);
  else
    free_vector(strength);
  return {std::move(normals), std::move(strength),
          strong > 0 ? static_cast<double>(oblique) / static_cast<double>(strong) : 0.0};
}

/// Of what lies around, at the sites of `lattice`. At the border a part of the neighbourhood is not there, which says
/// nothing of the rest.
template <int Dim, class T>
void InterfaceNormals<Dim, T>::make_shares(const Lattice<Dim>& lattice, std::vector<T>& strength) const {
  std::array<std::vector<double>, Dim> scale;
  for (std::size_t axis = 0; axis < Dim; ++axis)
    for (int i = 0; i < lattice.size[axis]; ++i) {
      const double at =
          (lattice.offset[axis] + i * lattice.spacing[axis] - lattice_.offset[axis]) / lattice_.spacing[axis];
      const long nearest = std::clamp(std::lround(at), 0l, lattice_.size[axis] - 1l);
      scale[axis].push_back(1 / std::sqrt(within_[axis][static_cast<std::size_t>(nearest)]));
    }
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      double whole = strength[site];
      for (std::size_t axis = 0; axis < Dim; ++axis) whole *= scale[axis][static_cast<std::size_t>(index[axis])];
      strength[site] = static_cast<T>(whole);
    });
  const std::vector<T> most = largest_within<Dim>(lattice, strength, kBeside);
  for (std::size_t site = 0; site < strength.size(); ++site)
    if (strength[site] > T(0)) strength[site] /= most[site];
}

template <int Dim, class T>
void InterfaceNormals<Dim, T>::leave_out_axes(std::vector<T>& normals) {
  for (std::size_t i = 0; i < normals.size(); i += Dim)
    if (is_along_axis<Dim>(normals.data() + i))
      std::fill_n(normals.begin() + static_cast<std::ptrdiff_t>(i), Dim, T(0));
}

template class InterfaceNormals<2, float>;
template class InterfaceNormals<3, float>;
template class InterfaceNormals<2, double>;
template class InterfaceNormals<3, double>;

}  // namespace saltus
