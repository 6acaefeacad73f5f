#include "core/kernels/separable_convolution.h"

#include <algorithm>

namespace saltus {
namespace {

/// `count` neighbouring outputs at once: the sums stay in registers, each tap costs one load and one multiply-add.
constexpr int kBlock = 64;

/// target[0..n) (+)= sum over taps of row(i) values; rows are `stride` scalars apart, row 0 is `first_row`.
template <class T>
inline void accumulate_block(const T* source, std::ptrdiff_t stride, const T* taps, int count, int n, Combine combine,
                             T* target) {
  if (n == kBlock) {
    T sum[kBlock];
    for (int k = 0; k < kBlock; ++k) sum[k] = combine == Combine::Add ? target[k] : T(0);
    for (int t = 0; t < count; ++t) {
      const T w = taps[t];
      const T* row = source - t * stride;
#pragma omp simd
      for (int k = 0; k < kBlock; ++k) sum[k] += w * row[k];
    }
    for (int k = 0; k < kBlock; ++k) target[k] = sum[k];
    return;
  }
  if (combine == Combine::Replace) std::fill(target, target + n, T(0));
  for (int t = 0; t < count; ++t) {
    const T w = taps[t];
    const T* row = source - t * stride;
#pragma omp simd
    for (int k = 0; k < n; ++k) target[k] += w * row[k];
  }
}

/// The taps that fall inside when the output is at `i` of `length`: j from first to last inclusive, source row i - j.
struct Reach {
  int first, last;
  Reach(int i, int length, int radius) : first(std::max(-radius, i - (length - 1))), last(std::min(radius, i)) {}
};

}  // namespace

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const std::vector<T>& taps, Combine combine,
                   const T* in, T* out) {
  const int radius = static_cast<int>(taps.size() / 2);
  const int length = lattice.size[axis];
  std::size_t inner = static_cast<std::size_t>(channels), outer = 1;
  for (int a = 0; a < axis; ++a) inner *= static_cast<std::size_t>(lattice.size[a]);
  for (int a = axis + 1; a < Dim; ++a) outer *= static_cast<std::size_t>(lattice.size[a]);

  if (axis == 0) {
    // Lines are contiguous: blocks of outputs whose taps all fall inside, and single sites near both ends.
#pragma omp parallel for schedule(static)
    for (std::size_t o = 0; o < outer; ++o) {
      const T* line = in + o * inner * length;
      T* target = out + o * inner * length;
      const int safe_begin = std::min(radius, length), safe_end = std::max(safe_begin, length - radius);
      const auto single = [&](int i) {
        const Reach reach(i, length, radius);
        accumulate_block(line + static_cast<std::ptrdiff_t>(i - reach.first) * channels, channels,
                         taps.data() + reach.first + radius, reach.last - reach.first + 1, channels, combine,
                         target + static_cast<std::ptrdiff_t>(i) * channels);
      };
      for (int i = 0; i < safe_begin; ++i) single(i);
      const int scalars = (safe_end - safe_begin) * channels;
      for (int k = 0; k < scalars; k += kBlock)
        accumulate_block(line + static_cast<std::ptrdiff_t>(safe_begin + radius) * channels + k, channels, taps.data(),
                         2 * radius + 1, std::min(kBlock, scalars - k), combine,
                         target + static_cast<std::ptrdiff_t>(safe_begin) * channels + k);
      for (int i = safe_end; i < length; ++i) single(i);
    }
    return;
  }
#pragma omp parallel for collapse(2) schedule(static)
  for (std::size_t o = 0; o < outer; ++o)
    for (int i = 0; i < length; ++i) {
      const Reach reach(i, length, radius);
      const T* source = in + (o * length + static_cast<std::size_t>(i - reach.first)) * inner;
      T* target = out + (o * length + static_cast<std::size_t>(i)) * inner;
      for (std::size_t k = 0; k < inner; k += kBlock)
        accumulate_block(source + k, static_cast<std::ptrdiff_t>(inner), taps.data() + reach.first + radius,
                         reach.last - reach.first + 1, static_cast<int>(std::min<std::size_t>(kBlock, inner - k)),
                         combine, target + k);
    }
}

template void convolve_axis<2, float>(const Lattice<2>&, int, int, const std::vector<float>&, Combine, const float*,
                                      float*);
template void convolve_axis<3, float>(const Lattice<3>&, int, int, const std::vector<float>&, Combine, const float*,
                                      float*);
template void convolve_axis<2, double>(const Lattice<2>&, int, int, const std::vector<double>&, Combine, const double*,
                                       double*);
template void convolve_axis<3, double>(const Lattice<3>&, int, int, const std::vector<double>&, Combine, const double*,
                                       double*);

}  // namespace saltus
