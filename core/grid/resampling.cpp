#include "core/grid/resampling.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

namespace saltus {
namespace {

template <int Dim>
std::size_t plane_of(const Lattice<Dim>& lattice, int channels) {
  std::size_t scalars = static_cast<std::size_t>(channels);
  for (int axis = 0; axis + 1 < Dim; ++axis) scalars *= static_cast<std::size_t>(lattice.size[axis]);
  return scalars;
}

template <int Value>
using Constant = std::integral_constant<std::size_t, static_cast<std::size_t>(Value)>;

/// Four values at any address.
template <class T>
struct FourOf {
  typedef T Type __attribute__((vector_size(4 * sizeof(T))));
};
template <class T>
using Four = typename FourOf<T>::Type;
template <class T>
void load_four(const T* from, Four<T>& values) {  // not returned: older processors have no register for four doubles
  std::memcpy(&values, from, sizeof values);
}
template <class T>
void store_four(const Four<T>& values, T* to) {
  std::memcpy(to, &values, sizeof values);
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
    for (int j = 0, begin = 0, next = 0; j <= last; ++j) {
      int end = next;
      while (end < target.size[axis] && taps_[axis][static_cast<std::size_t>(end)].low <= j) ++end;
      gatherings_[axis].push_back({begin, end, shares_[axis].size()});
      for (int i = begin; i < end; ++i) {
        const Tap tap = taps_[axis][static_cast<std::size_t>(i)];
        shares_[axis].push_back(last == 0 ? T(1) : tap.low == j ? T(1) - tap.fraction : tap.fraction);
      }
      begin = next;
      next = end;
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

/// resize_axis along x for 3 channels. One value behind either's last is read and written.
template <int Dim, class T>
void LatticeInterpolation<Dim, T>::resize_rows_of_3(std::size_t rows, const T* in, T* out) const {
  const std::size_t from = static_cast<std::size_t>(source_.size[0]), step = from > 1 ? 3 : 0;
  for (std::size_t row = 0; row < rows; ++row, in += 3 * from)
    for (const Tap tap : taps_[0]) {
      const T* at = in + 3 * static_cast<std::size_t>(tap.low);
      // The fourth is another site's, which comes after and takes its place.
      Four<T> low, high;
      load_four<T>(at, low);
      load_four<T>(at + step, high);
      store_four<T>((T(1) - tap.fraction) * low + tap.fraction * high, out);
      out += 3;
    }
}

/// Every source sample gathers from the targets of the cells on either side, in their order.
template <int Dim, class T>
template <class Inner>
void LatticeInterpolation<Dim, T>::transpose_axis(int axis, std::size_t outer, Inner inner, const T* in, T* out) const {
  for (std::size_t o = 0; o < outer; ++o, in += taps_[axis].size() * inner)
    for (const Gathering gathering : gatherings_[axis]) {
      const T* share = shares_[axis].data() + gathering.share;
      if constexpr (std::is_same_v<Inner, Constant<2>>) {  // summed in a register
        typedef T Two __attribute__((vector_size(2 * sizeof(T))));
        Two sum = {}, values;
        for (int i = gathering.begin; i < gathering.end; ++i, ++share) {
          std::memcpy(&values, in + 2 * static_cast<std::size_t>(i), sizeof values);
          sum += *share * values;
        }
        std::memcpy(out, &sum, sizeof sum);
        out += 2;
        continue;
      }
      std::fill_n(out, static_cast<std::size_t>(inner), T(0));
      for (int i = gathering.begin; i < gathering.end; ++i, ++share) {
        const T w = *share;
        const T* value = in + static_cast<std::size_t>(i) * inner;
#pragma omp simd
        for (std::size_t k = 0; k < inner; ++k) out[k] += w * value[k];
      }
      out += inner;
    }
}

/// transpose_axis along x for 3 channels. One value behind the last of `in` is read.
template <int Dim, class T>
void LatticeInterpolation<Dim, T>::transpose_rows_of_3(std::size_t rows, const T* in, T* out) const {
  const std::size_t row_length = 3 * taps_[0].size();
  const T* const end = out + 3 * rows * gatherings_[0].size();
  for (std::size_t row = 0; row < rows; ++row, in += row_length)
    for (const Gathering gathering : gatherings_[0]) {
      Four<T> sum = {};
      const T* share = shares_[0].data() + gathering.share;
      for (int i = gathering.begin; i < gathering.end; ++i, ++share) {
        Four<T> values;
        load_four<T>(in + 3 * static_cast<std::size_t>(i), values);
        sum += *share * values;
      }
      if (out + 3 < end)  // as above
        store_four<T>(sum, out);
      else
        for (int c = 0; c < 3; ++c) out[c] = sum[c];
      out += 3;
    }
}

/// `channels` as a constant where it can be: rows along x are as short as that.
template <int Dim, class T>
template <bool is_added, class Channels>
void LatticeInterpolation<Dim, T>::resize_plane(const T* source, int plane, Scratch& scratch, T* out,
                                                Channels channels) const {
  const Tap tap = taps_[Dim - 1][static_cast<std::size_t>(plane)];
  const T* a = source + static_cast<std::size_t>(tap.low) * source_plane_;
  const T* b = a + (source_.size[Dim - 1] > 1 ? source_plane_ : 0);
  const T w = tap.fraction;
  scratch[0].resize(source_plane_ + 1);
  T* between = scratch[0].data();
#pragma omp simd
  for (std::size_t k = 0; k < source_plane_; ++k) between[k] = (T(1) - w) * a[k] + w * b[k];
  if constexpr (Dim == 2) {
    resize_axis<is_added>(0, 1, channels, between, out);
  } else {
    const std::size_t rows = static_cast<std::size_t>(source_.size[1]), row = taps_[0].size() * channels;
    scratch[1].resize(rows * row + 1);
    if constexpr (std::is_same_v<Channels, Constant<3>>)
      resize_rows_of_3(rows, between, scratch[1].data());
    else
      resize_axis<false>(0, rows, channels, between, scratch[1].data());
    resize_axis<is_added>(1, 1, row, scratch[1].data(), out);
  }
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::take_plane(const T* source, int plane, Scratch& scratch, T* out) const {
  if (channels_ == Dim)
    resize_plane<false>(source, plane, scratch, out, Constant<Dim>());
  else
    resize_plane<false>(source, plane, scratch, out, static_cast<std::size_t>(channels_));
}

template <int Dim, class T>
void LatticeInterpolation<Dim, T>::transpose_plane(const T* values, int plane, Scratch& scratch) {
  T* reduced = reduced_.data() + static_cast<std::size_t>(plane) * source_plane_;
  const std::size_t channels = static_cast<std::size_t>(channels_);
  const bool is_vector = channels_ == Dim;
  if constexpr (Dim == 2) {
    if (is_vector)
      transpose_axis(0, 1, Constant<Dim>(), values, reduced);
    else
      transpose_axis(0, 1, channels, values, reduced);
  } else {
    const std::size_t rows = gatherings_[1].size(), row = taps_[0].size() * channels;
    scratch[0].resize(rows * row + 1);
    transpose_axis(1, 1, row, values, scratch[0].data());
    if (is_vector)
      transpose_rows_of_3(rows, scratch[0].data(), reduced);
    else
      transpose_axis(0, rows, channels, scratch[0].data(), reduced);
  }
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
    const Gathering gathering = gatherings_[Dim - 1][j];
    const T* share = shares_[Dim - 1].data() + gathering.share;
    for (int i = gathering.begin; i < gathering.end; ++i, ++share) {
      const T w = *share;
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
        resize_plane<true>(source, plane, scratch, out, Constant<Dim>());
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
