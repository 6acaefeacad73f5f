#include "core/grid/resampling.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// Views a field as [outer][length][inner] around one axis; `inner` counts scalars.
template <int Dim>
struct AxisView {
  std::size_t outer = 1, inner = 1;
  AxisView(const Index<Dim>& size, int axis, int channels) : inner(static_cast<std::size_t>(channels)) {
    for (int a = 0; a < axis; ++a) inner *= static_cast<std::size_t>(size[a]);
    for (int a = axis + 1; a < Dim; ++a) outer *= static_cast<std::size_t>(size[a]);
  }
};

}  // namespace

template <int Dim, class T>
LatticeInterpolation<Dim, T>::LatticeInterpolation(const Lattice<Dim>& source, const Lattice<Dim>& target, int channels)
    : source_(source), target_(target), channels_(channels), identity_(source == target) {
  if (identity_) return;
  Index<Dim> size = source.size;
  for (int axis = 0; axis < Dim; ++axis) {
    const int last = source.size[axis] - 1;
    taps_[axis].resize(static_cast<std::size_t>(target.size[axis]));
    for (int i = 0; i < target.size[axis]; ++i) {
      const double at =
          std::clamp((i * target.spacing[axis] + target.offset[axis] - source.offset[axis]) / source.spacing[axis], 0.0,
                     double(last));
      const int low = std::min(static_cast<int>(at), std::max(last - 1, 0));
      taps_[axis][static_cast<std::size_t>(i)] = {low, static_cast<T>(at - low)};
    }
    first_[axis].resize(static_cast<std::size_t>(source.size[axis]) + 1);
    for (int low = 0, i = 0; low <= source.size[axis]; ++low) {
      while (i < target.size[axis] && taps_[axis][static_cast<std::size_t>(i)].low < low) ++i;
      first_[axis][static_cast<std::size_t>(low)] = i;
    }
    if (axis + 1 == Dim) break;  // the last axis goes straight from and to the target
    size[axis] = target.size[axis];
    std::size_t count = static_cast<std::size_t>(channels);
    for (int extent : size) count *= static_cast<std::size_t>(extent);
    scratch_[axis % 2].resize(std::max(scratch_[axis % 2].size(), count));
  }
}

template <int Dim, class T>
template <bool is_added>
void LatticeInterpolation<Dim, T>::resize_axis(int axis, const Index<Dim>& size, const T* in, T* out) const {
  const AxisView<Dim> view(size, axis, channels_);
  const std::size_t from = static_cast<std::size_t>(size[axis]), to = taps_[axis].size();
  const std::size_t inner = view.inner;
#pragma omp parallel for collapse(2) schedule(static)
  for (std::size_t o = 0; o < view.outer; ++o)
    for (std::size_t i = 0; i < to; ++i) {
      const Tap tap = taps_[axis][i];
      const T* a = in + (o * from + static_cast<std::size_t>(tap.low)) * inner;
      const T* b = from > 1 ? a + inner : a;
      T* target = out + (o * to + i) * inner;
      const T w = tap.fraction;
#pragma omp simd
      for (std::size_t k = 0; k < inner; ++k)
        target[k] = (is_added ? target[k] : T(0)) + ((T(1) - w) * a[k] + w * b[k]);
    }
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::transpose_axis(int axis, const Index<Dim>& size, const T* in, T* out) const {
  // `size` is the source's size along `axis`; the target's is the number of taps.
  const AxisView<Dim> view(size, axis, channels_);
  const std::size_t from = static_cast<std::size_t>(size[axis]), to = taps_[axis].size();
  const std::size_t inner = view.inner;
  // Every source sample gathers from the targets of the cells on either side, in their order.
#pragma omp parallel for collapse(2) schedule(static)
  for (std::size_t o = 0; o < view.outer; ++o)
    for (std::size_t j = 0; j < from; ++j) {
      T* sum = out + (o * from + j) * inner;
      std::fill(sum, sum + inner, T(0));
      for (int i = first_[axis][j > 0 ? j - 1 : 0]; i < first_[axis][j + 1]; ++i) {
        const Tap tap = taps_[axis][static_cast<std::size_t>(i)];
        const T w = from == 1 ? T(1) : static_cast<std::size_t>(tap.low) == j ? T(1) - tap.fraction : tap.fraction;
        const T* value = in + (o * to + static_cast<std::size_t>(i)) * inner;
#pragma omp simd
        for (std::size_t k = 0; k < inner; ++k) sum[k] += w * value[k];
      }
    }
}

template <int Dim, class T>
template <bool is_added>
void LatticeInterpolation<Dim, T>::resize(const T* source, T* target) {
  const std::size_t count = static_cast<std::size_t>(channels_) * target_.sites();
  if (identity_) {
#pragma omp parallel for simd schedule(static)
    for (std::size_t i = 0; i < count; ++i) target[i] = (is_added ? target[i] : T(0)) + source[i];
    return;
  }
  Index<Dim> size = source_.size;
  const T* in = source;
  for (int axis = 0; axis + 1 < Dim; ++axis) {
    T* out = scratch_[axis % 2].data();
    resize_axis<false>(axis, size, in, out);
    size[axis] = target_.size[axis];
    in = out;
  }
  resize_axis<is_added>(Dim - 1, size, in, target);
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::add_to(const T* source, T* target) {
  resize<true>(source, target);
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::take(const T* source, T* target) {
  resize<false>(source, target);
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::transpose(const T* target, T* source) {
  if (identity_) {
    std::copy(target, target + static_cast<std::size_t>(channels_) * target_.sites(), source);
    return;
  }
  Index<Dim> size = target_.size;
  const T* in = target;
  for (int axis = Dim - 1; axis >= 0; --axis) {
    size[axis] = source_.size[axis];
    T* out = axis == 0 ? source : scratch_[(axis - 1) % 2].data();
    transpose_axis(axis, size, in, out);
    in = out;
  }
}

template class LatticeInterpolation<2, float>;
template class LatticeInterpolation<3, float>;
template class LatticeInterpolation<2, double>;
template class LatticeInterpolation<3, double>;

}  // namespace saltus
