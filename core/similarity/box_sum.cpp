#include "core/similarity/box_sum.h"

#include <algorithm>

namespace saltus {

template <int Dim, class T>
void BoxSum<Dim, T>::apply(int channels, T* field) {
  const std::size_t count = lattice_.sites() * static_cast<std::size_t>(channels);
  scratch_.resize(std::max(scratch_.size(), count));
  T* in = field;
  T* out = scratch_.data();
  std::size_t inner = static_cast<std::size_t>(channels);
  for (int axis = 0; axis < Dim; ++axis) {
    const int length = lattice_.size[axis];
    if (radius_[axis] > 0 && length > 1) {
      const int radius = std::min(radius_[axis], length - 1);
      const std::size_t outer = count / (inner * static_cast<std::size_t>(length));
      // Running sums are kept in double: a float sum would drift along a line and flat windows would not look flat.
      // Lines along x are short rows of `channels`; along other axes whole rows run together, in strips.
      const std::size_t strip = std::min<std::size_t>(inner, 256);
      const std::size_t strips = (inner + strip - 1) / strip;
#pragma omp parallel for collapse(2) schedule(static)
      for (std::size_t o = 0; o < outer; ++o)
        for (std::size_t part = 0; part < strips; ++part) {
          const std::size_t begin = part * strip, width = std::min(strip, inner - begin);
          const T* source = in + o * inner * length + begin;
          T* target = out + o * inner * length + begin;
          double sum[256] = {};
          for (int i = 0; i < radius; ++i)
            for (std::size_t k = 0; k < width; ++k) sum[k] += source[i * inner + k];
          for (int i = 0; i < length; ++i) {
            const T* entering = i + radius < length ? source + (i + radius) * inner : nullptr;
            const T* leaving = i - radius - 1 >= 0 ? source + (i - radius - 1) * inner : nullptr;
            T* to = target + i * inner;
            if (entering && leaving) {
#pragma omp simd
              for (std::size_t k = 0; k < width; ++k)
                to[k] = static_cast<T>(sum[k] += double(entering[k]) - leaving[k]);
            } else {
              for (std::size_t k = 0; k < width; ++k)
                to[k] = static_cast<T>(sum[k] +=
                                       (entering ? double(entering[k]) : 0.0) - (leaving ? double(leaving[k]) : 0.0));
            }
          }
        }
      std::swap(in, out);
    }
    inner *= static_cast<std::size_t>(length);
  }
  if (in != field) std::copy(in, in + count, field);
}

template class BoxSum<2, float>;
template class BoxSum<3, float>;
template class BoxSum<2, double>;
template class BoxSum<3, double>;

}  // namespace saltus
