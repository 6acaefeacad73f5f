#include "core/kernels/separable_convolution.h"

#include "core/kernels/block_columns.h"
#include "core/kernels/direct_lines.h"
#include "core/support/thread_count.h"

namespace saltus {

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps, Combine combine,
                   const T* in, T* out) {
  const std::size_t count = static_cast<std::size_t>(lattice.size[axis]);
  std::size_t inner = static_cast<std::size_t>(channels), outer = 1;
  for (int a = 0; a < axis; ++a) inner *= static_cast<std::size_t>(lattice.size[a]);
  for (int a = axis + 1; a < Dim; ++a) outer *= static_cast<std::size_t>(lattice.size[a]);
  const bool in_parallel = is_worth_threads(lattice.sites());
  bool adds = combine == Combine::Add;
  for (const MirroredTaps<T>& part : taps.parts()) {
    if (axis == 0)
      convolve_lines(outer, count, inner, part, adds, in_parallel, in, out);
    else
      convolve_strips(outer, count, inner, part, adds, in_parallel, in, out);
    adds = true;
  }
}

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int axis, const AxisTaps<T>& taps, Combine combine,
                   const BlockMask<Dim>& in_at, const T* in, const BlockMask<Dim>& out_at, T* out) {
  if (in_at.is_all() && out_at.is_all()) return convolve_axis<Dim, T>(lattice, Dim, axis, taps, combine, in, out);
  for (const MirroredTaps<T>& part : taps.parts()) {
    convolve_block_columns<Dim, T>(lattice, axis, part, combine, in_at, in, out_at, out);
    combine = Combine::Add;
  }
}

#define SALTUS_CONVOLVE(DIM, T)                                                                                     \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, int, const AxisTaps<T>&, Combine, const T*, T*);    \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, const AxisTaps<T>&, Combine, const BlockMask<DIM>&, \
                                      const T*, const BlockMask<DIM>&, T*);
SALTUS_CONVOLVE(2, float)
SALTUS_CONVOLVE(3, float)
SALTUS_CONVOLVE(2, double)
SALTUS_CONVOLVE(3, double)
#undef SALTUS_CONVOLVE

}  // namespace saltus
