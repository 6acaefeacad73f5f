#include "core/grid/resampling.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace saltus {
namespace {

template <int Dim>
std::size_t plane_of(const Lattice<Dim>& lattice, int channels) {
  std::size_t scalars = static_cast<std::size_t>(channels);
  for (int axis = 0; axis + 1 < Dim; ++axis) scalars *= static_cast<std::size_t>(lattice.size[axis]);
  return scalars;
}

}  // namespace

template <int Dim, class T>
LatticeInterpolation<Dim, T>::LatticeInterpolation(const Lattice<Dim>& source, const Lattice<Dim>& target, int channels)
    : source_(source),
      target_(target),
      channels_(channels),
      identity_(source == target),
      source_plane_(plane_of(source, channels)),
      target_plane_(plane_of(target, channels)) {
  if (identity_) return;
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
  }
}

/// Views `in` as [outer][source's length][inner] scalars and `out` alike.
template <int Dim, class T>
template <bool is_added, class Inner>
void LatticeInterpolation<Dim, T>::resize_axis(int axis, std::size_t outer, Inner inner, const T* in, T* out) const {
  const std::size_t from = static_cast<std::size_t>(source_.size[axis]), step = from > 1 ? inner : 0;
  for (std::size_t o = 0; o < outer; ++o, in += from * inner)
    for (const Tap tap : taps_[axis]) {
      const T *a = in + static_cast<std::size_t>(tap.low) * inner, *b = a + step;
      const T w = tap.fraction;
#pragma omp simd
      for (std::size_t k = 0; k < inner; ++k) out[k] = (is_added ? out[k] : T(0)) + ((T(1) - w) * a[k] + w * b[k]);
      out += inner;
    }
}

template <int Dim, class T>
template <class Inner>
void LatticeInterpolation<Dim, T>::transpose_axis(int axis, std::size_t outer, Inner inner, const T* in, T* out) const {
  const std::size_t from = static_cast<std::size_t>(source_.size[axis]), to = taps_[axis].size();
  // Every source sample gathers from the targets of the cells on either side, in their order.
  for (std::size_t o = 0; o < outer; ++o, in += to * inner)
    for (std::size_t j = 0; j < from; ++j, out += inner) {
      std::fill_n(out, static_cast<std::size_t>(inner), T(0));
      for (int i = first_[axis][j > 0 ? j - 1 : 0]; i < first_[axis][j + 1]; ++i) {
        const Tap tap = taps_[axis][static_cast<std::size_t>(i)];
        const T w = from == 1 ? T(1) : static_cast<std::size_t>(tap.low) == j ? T(1) - tap.fraction : tap.fraction;
        const T* value = in + static_cast<std::size_t>(i) * inner;
#pragma omp simd
        for (std::size_t k = 0; k < inner; ++k) out[k] += w * value[k];
      }
    }
}

/// Along the last axis between two planes of the source, then within the plane, down to x. `channels` as a constant
/// where it can be: rows along x are as short as that.
template <int Dim, class T>
template <bool is_added, class Channels>
void LatticeInterpolation<Dim, T>::resize_plane(const T* source, int plane, Scratch& scratch, T* out,
                                                Channels channels) const {
  const Tap tap = taps_[Dim - 1][static_cast<std::size_t>(plane)];
  const T* a = source + static_cast<std::size_t>(tap.low) * source_plane_;
  const T* b = a + (source_.size[Dim - 1] > 1 ? source_plane_ : 0);
  const T w = tap.fraction;
  scratch[0].resize(source_plane_);
  T* between = scratch[0].data();
#pragma omp simd
  for (std::size_t k = 0; k < source_plane_; ++k) between[k] = (T(1) - w) * a[k] + w * b[k];
  if constexpr (Dim == 3) {
    const std::size_t row = static_cast<std::size_t>(source_.size[0]) * channels;
    scratch[1].resize(row * taps_[1].size());
    resize_axis<false>(1, 1, row, between, scratch[1].data());
    between = scratch[1].data();
  }
  resize_axis<is_added>(0, Dim == 3 ? taps_[1].size() : 1, channels, between, out);
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::take_plane(const T* source, int plane, Scratch& scratch, T* out) const {
  if (channels_ == Dim)
    resize_plane<false>(source, plane, scratch, out, std::integral_constant<std::size_t, Dim>());
  else
    resize_plane<false>(source, plane, scratch, out, static_cast<std::size_t>(channels_));
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::transpose_plane(const T* values, int plane, Scratch& scratch) {
  T* reduced = reduced_.data() + static_cast<std::size_t>(plane) * source_plane_;
  const std::size_t channels = static_cast<std::size_t>(channels_);
  T* rows = reduced;
  if constexpr (Dim == 3) {
    scratch[0].resize(static_cast<std::size_t>(source_.size[0]) * channels * taps_[1].size());
    rows = scratch[0].data();
  }
  const std::size_t count = Dim == 3 ? taps_[1].size() : 1;
  if (channels_ == Dim)
    transpose_axis(0, count, std::integral_constant<std::size_t, Dim>(), values, rows);
  else
    transpose_axis(0, count, channels, values, rows);
  if constexpr (Dim == 3) transpose_axis(1, 1, static_cast<std::size_t>(source_.size[0]) * channels, rows, reduced);
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::begin_transpose() {
  reduced_.resize(taps_[Dim - 1].size() * source_plane_);
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::finish_transpose(T* source) const {
  const std::size_t from = static_cast<std::size_t>(source_.size[Dim - 1]);
#pragma omp parallel for schedule(static) if (is_worth_threads(target_.sites()))
  for (std::size_t j = 0; j < from; ++j) {
    T* sum = source + j * source_plane_;
    std::fill_n(sum, source_plane_, T(0));
    for (int i = first_[Dim - 1][j > 0 ? j - 1 : 0]; i < first_[Dim - 1][j + 1]; ++i) {
      const Tap tap = taps_[Dim - 1][static_cast<std::size_t>(i)];
      const T w = from == 1 ? T(1) : static_cast<std::size_t>(tap.low) == j ? T(1) - tap.fraction : tap.fraction;
      const T* value = reduced_.data() + static_cast<std::size_t>(i) * source_plane_;
#pragma omp simd
      for (std::size_t k = 0; k < source_plane_; ++k) sum[k] += w * value[k];
    }
  }
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::add_to(const T* source, T* target) const {
  if (identity_) {
    const std::size_t count = static_cast<std::size_t>(channels_) * target_.sites();
#pragma omp parallel for simd schedule(static)
    for (std::size_t i = 0; i < count; ++i) target[i] += source[i];
    return;
  }
#pragma omp parallel if (is_worth_threads(target_.sites()))
  {
    Scratch scratch;
#pragma omp for schedule(static)
    for (int plane = 0; plane < target_.size[Dim - 1]; ++plane) {
      T* out = target + static_cast<std::size_t>(plane) * target_plane_;
      if (channels_ == Dim)
        resize_plane<true>(source, plane, scratch, out, std::integral_constant<std::size_t, Dim>());
      else
        resize_plane<true>(source, plane, scratch, out, static_cast<std::size_t>(channels_));
    }
  }
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::transpose(const T* target, T* source) {
  if (identity_) {
    std::copy(target, target + static_cast<std::size_t>(channels_) * target_.sites(), source);
    return;
  }
  begin_transpose();
#pragma omp parallel if (is_worth_threads(target_.sites()))
  {
    Scratch scratch;
#pragma omp for schedule(static)
    for (int plane = 0; plane < target_.size[Dim - 1]; ++plane)
      transpose_plane(target + static_cast<std::size_t>(plane) * target_plane_, plane, scratch);
  }
  finish_transpose(source);
}

template class LatticeInterpolation<2, float>;
template class LatticeInterpolation<3, float>;
template class LatticeInterpolation<2, double>;
template class LatticeInterpolation<3, double>;

}  // namespace saltus
