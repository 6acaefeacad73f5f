#include "core/kernels/separable_convolution.h"

#include "core/kernels/block_columns.h"
#include "core/kernels/direct_lines.h"
#include "core/support/line_vector.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <stdexcept>

namespace saltus {

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps, Combine combine,
                   const T* in, T* out) {
  if (in == out && taps.parts().size() > 1)
    throw std::logic_error("a field cannot take the place of itself where a row is no mirror image");
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

/// How many planes convolve_planes takes together: the fewest whose lines fill their groups but for a few percent, as
/// far as the second cache holds them.
template <class T>
std::size_t planes_together(std::size_t lines_a_plane, std::size_t plane) {
  constexpr std::size_t most_bytes = 384 << 10;
  const auto lanes_a_line = [&](std::size_t planes) {
    const Lines lines{planes * lines_a_plane, 0, 0};
    return static_cast<double>(lines.groups<T>() * kRegisterLanes<T>) / static_cast<double>(lines.lines);
  };
  std::size_t best = 1;
  for (std::size_t planes = 2; planes * plane * sizeof(T) <= most_bytes && lanes_a_line(best) > 1.03; ++planes)
    if (lanes_a_line(planes) < lanes_a_line(best)) best = planes;
  return best;
}

}  // namespace

template <class T>
void convolve_planes(const Lattice<3>& lattice, int channels, const AxisTaps<T>& along_y, const AxisTaps<T>& along_x,
                     Combine combine, const T* in, T* out) {
  const auto width = static_cast<std::size_t>(lattice.size[0]), height = static_cast<std::size_t>(lattice.size[1]),
             planes = static_cast<std::size_t>(lattice.size[2]), values = static_cast<std::size_t>(channels);
  const std::size_t line = width * values, together = planes_together<T>(height, height * line);
  const std::size_t slabs = (planes + together - 1) / together, slab_size = together * height * line;
  const auto strips_of = [&](std::size_t slab) {
    return Strips{at_most(together, planes, slab * together), height, line};
  };
  const auto lines_of = [&](std::size_t slab) {
    return Lines{at_most(together, planes, slab * together) * height, width, values};
  };
  const bool is_far = planes * height * line * sizeof(T) > kFarBytes;
  // Few slabs cannot be shared out: then threads share each of them.
  const auto threads = static_cast<std::size_t>(threads_of_loop(lattice.sites()));
  const bool shares_slabs = (slabs + threads - 1) / threads * threads > slabs + slabs / 4;
  LineVector<T> shared(shares_slabs ? slab_size : 0);
#pragma omp parallel num_threads(static_cast <int>(threads))
  {
    StripScratch<T> strip_scratch(height, longest_reach(along_y));
    LineScratch<T> line_scratch(width, values, longest_reach(along_x));
    LineVector<T> own(shares_slabs ? 0 : slab_size);
    const auto pass_along_y = [&](std::size_t slab, std::size_t strip, T* between) {
      bool adds = false;
      for (const MirroredTaps<T>& part : along_y.parts()) {
        convolve_strip(strips_of(slab), strip, part, adds, false, in + slab * slab_size, between, strip_scratch);
        adds = true;
      }
    };
    const auto pass_along_x = [&](std::size_t slab, std::size_t group, const T* between) {
      // What y reads next, unless it is near anyhow.
      const std::size_t first = group * kRegisterLanes<T>, next = (slab + 1) * slab_size + first * line;
      Soon<T> soon;
      if (is_far && slab + 1 < slabs && first < lines_of(slab + 1).lines)
        soon = {at_most(kRegisterLanes<T>, lines_of(slab + 1).lines, first), in + next, nullptr};
      bool adds = combine == Combine::Add;
      for (const MirroredTaps<T>& part : along_x.parts()) {
        convolve_line_group(lines_of(slab), group, part, adds, between, out + slab * slab_size, soon, line_scratch);
        adds = true;
      }
    };
    if (shares_slabs) {
      for (std::size_t slab = 0; slab < slabs; ++slab) {
#pragma omp for schedule(static)
        for (std::size_t strip = 0; strip < strips_of(slab).template all<T>(); ++strip)
          pass_along_y(slab, strip, shared.data());
#pragma omp for schedule(static)
        for (std::size_t group = 0; group < lines_of(slab).template groups<T>(); ++group)
          pass_along_x(slab, group, shared.data());
      }
    } else {
#pragma omp for schedule(static)
      for (std::size_t slab = 0; slab < slabs; ++slab) {
        for (std::size_t strip = 0; strip < strips_of(slab).template all<T>(); ++strip)
          pass_along_y(slab, strip, own.data());
        for (std::size_t group = 0; group < lines_of(slab).template groups<T>(); ++group)
          pass_along_x(slab, group, own.data());
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
