#include "core/kernels/separable_convolution.h"

#include "core/kernels/block_columns.h"
#include "core/kernels/direct_lines.h"
#include "core/support/line_vector.h"
#include "core/support/thread_count.h"

#include <algorithm>

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
      convolve_lines<T>({outer, count, inner}, part, adds, in_parallel, in, out);
    else
      convolve_strips<T>({outer, count, inner}, part, adds, in_parallel, in, out);
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

namespace {

template <class T>
std::size_t longest_reach(const AxisTaps<T>& taps) {
  std::size_t reach = 0;
  for (const MirroredTaps<T>& part : taps.parts()) reach = std::max(reach, part.reach());
  return reach;
}

}  // namespace

template <class T>
void convolve_planes(const Lattice<3>& lattice, int channels, const AxisTaps<T>& along_y, const AxisTaps<T>& along_x,
                     Combine combine, const T* in, T* out) {
  const auto width = static_cast<std::size_t>(lattice.size[0]), height = static_cast<std::size_t>(lattice.size[1]),
             values = static_cast<std::size_t>(channels);
  const Strips strips{1, height, width * values};
  const Lines lines{height, width, values};
  const std::size_t plane = height * width * values;
  const int planes = lattice.size[2], threads = threads_worth(lattice.sites());
  // Few planes cannot be shared out: then threads share each of them.
  const bool shares_planes = (planes + threads - 1) / threads * threads > planes + planes / 4;
  LineVector<T> shared(shares_planes ? plane : 0);
#pragma omp parallel num_threads(threads)
  {
    StripScratch<T> strip_scratch(height, longest_reach(along_y));
    LineScratch<T> line_scratch(width, values, longest_reach(along_x));
    LineVector<T> own(shares_planes ? 0 : plane);
    const auto convolve_strip_of = [&](int z, std::size_t strip, T* between) {
      bool adds = false;
      for (const MirroredTaps<T>& part : along_y.parts()) {
        convolve_strip(strips, strip, part, adds, in + z * plane, between, strip_scratch);
        adds = true;
      }
    };
    const auto convolve_group_of = [&](int z, std::size_t group, const T* between) {
      bool adds = combine == Combine::Add;
      for (const MirroredTaps<T>& part : along_x.parts()) {
        convolve_line_group(lines, group, part, adds, between, out + z * plane, line_scratch);
        adds = true;
      }
    };
    if (shares_planes) {
      for (int z = 0; z < planes; ++z) {
#pragma omp for schedule(static)
        for (std::size_t strip = 0; strip < strips.all<T>(); ++strip) convolve_strip_of(z, strip, shared.data());
#pragma omp for schedule(static)
        for (std::size_t group = 0; group < lines.groups<T>(); ++group) convolve_group_of(z, group, shared.data());
      }
    } else {
#pragma omp for schedule(static)
      for (int z = 0; z < planes; ++z) {
        for (std::size_t strip = 0; strip < strips.all<T>(); ++strip) convolve_strip_of(z, strip, own.data());
        for (std::size_t group = 0; group < lines.groups<T>(); ++group) convolve_group_of(z, group, own.data());
      }
    }
  }
}
template void convolve_planes(const Lattice<3>&, int, const AxisTaps<float>&, const AxisTaps<float>&, Combine,
                              const float*, float*);
template void convolve_planes(const Lattice<3>&, int, const AxisTaps<double>&, const AxisTaps<double>&, Combine,
                              const double*, double*);

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
