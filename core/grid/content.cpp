#include "core/grid/content.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/grid/crop.h"
#include "core/support/thread_count.h"

namespace saltus {
namespace {

constexpr double kShareOfPlane = 1.0 / 1000;

/// Rows along x: where one begins, and whether it lies on the border along another axis.
struct Row {
  std::size_t first;
  bool is_border;
};
template <int Dim>
Row row_at(const Lattice<Dim>& lattice, int slab, int row) {
  const auto nx = static_cast<std::size_t>(lattice.size[0]);
  const auto is_end = [&](int axis, int i) { return i == 0 || i == lattice.size[axis] - 1; };
  if constexpr (Dim == 2) return {static_cast<std::size_t>(slab) * nx, is_end(1, slab)};
  return {
      (static_cast<std::size_t>(slab) * static_cast<std::size_t>(lattice.size[1]) + static_cast<std::size_t>(row)) * nx,
      is_end(1, row) || is_end(2, slab)};
}

/// Rows of a slab of the last axis.
template <int Dim>
int rows_of_slab(const Lattice<Dim>& lattice) {
  return Dim == 3 ? lattice.size[1] : 1;
}

/// Not a number where the border is hidden.
template <int Dim>
double background(const Lattice<Dim>& lattice, const float* samples, const float* weights) {
  std::vector<float> border;
  const auto take = [&](std::size_t site) {
    if (!weights || weights[site] > 0) border.push_back(samples[site]);
  };
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    for (int r = 0; r < rows_of_slab(lattice); ++r) {
      const Row row = row_at(lattice, slab, r);
      const std::size_t last = row.first + static_cast<std::size_t>(lattice.size[0]) - 1;
      const std::size_t step = row.is_border ? 1 : std::max<std::size_t>(1, last - row.first);
      for (std::size_t site = row.first; site <= last; site += step) take(site);
    }
  if (border.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = border.begin() + static_cast<std::ptrdiff_t>(border.size() / 2);
  std::nth_element(border.begin(), middle, border.end());
  return *middle;
}

struct PlaneCount {
  std::size_t seen = 0, shown = 0;
  bool shows() const { return static_cast<double>(shown) > kShareOfPlane * static_cast<double>(seen); }
};

}  // namespace

template <int Dim>
IndexBox<Dim> content_box(const Lattice<Dim>& lattice, const float* samples, const float* weights, double tolerance) {
  const double level = background(lattice, samples, weights);
  std::array<std::vector<PlaneCount>, Dim> planes;
  for (int axis = 0; axis < Dim; ++axis) planes[axis].resize(static_cast<std::size_t>(lattice.size[axis]));
#pragma omp parallel if (is_worth_threads(lattice.sites()))
  {
    std::array<std::vector<PlaneCount>, Dim> own;  // not a copy of what others may be adding to
    for (int axis = 0; axis < Dim; ++axis) own[axis].resize(planes[axis].size());
    const int nx = lattice.size[0];
    std::vector<std::uint32_t> seen(static_cast<std::size_t>(nx)), shown(seen.size());  // of a slab's planes across x
#pragma omp for schedule(static) nowait
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab) {
      std::fill(seen.begin(), seen.end(), 0u);
      std::fill(shown.begin(), shown.end(), 0u);
      for (int r = 0; r < rows_of_slab(lattice); ++r) {
        const std::size_t first = row_at(lattice, slab, r).first;
        const float *values = samples + first, *weight = weights ? weights + first : nullptr;
        std::uint32_t row_seen = 0, row_shown = 0;
#pragma omp simd reduction(+ : row_seen, row_shown)
        for (int x = 0; x < nx; ++x) {
          const std::uint32_t sees = weight ? weight[x] > 0 : 1;
          // Never background without one.
          const std::uint32_t shows = sees & static_cast<std::uint32_t>(!(std::abs(values[x] - level) <= tolerance));
          seen[x] += sees;
          shown[x] += shows;
          row_seen += sees;
          row_shown += shows;
        }
        for (int axis = 1; axis < Dim; ++axis) {
          PlaneCount& plane = own[axis][static_cast<std::size_t>(axis == Dim - 1 ? slab : r)];
          plane.seen += row_seen;
          plane.shown += row_shown;
        }
      }
      for (std::size_t x = 0; x < seen.size(); ++x) {
        own[0][x].seen += seen[x];
        own[0][x].shown += shown[x];
      }
    }
#pragma omp critical(saltus_content_box)
    for (int axis = 0; axis < Dim; ++axis)
      for (std::size_t i = 0; i < planes[axis].size(); ++i) {
        planes[axis][i].seen += own[axis][i].seen;
        planes[axis][i].shown += own[axis][i].shown;
      }
  }
  IndexBox<Dim> box;
  for (int axis = 0; axis < Dim; ++axis) {
    const auto shows = [](const PlaneCount& plane) { return plane.shows(); };
    const auto first = std::find_if(planes[axis].begin(), planes[axis].end(), shows);
    const auto last = std::find_if(planes[axis].rbegin(), planes[axis].rend(), shows);
    if (first == planes[axis].end()) return {{}, lattice.size};
    box.begin[axis] = static_cast<int>(first - planes[axis].begin());
    box.end[axis] = static_cast<int>(planes[axis].rend() - last);
  }
  return box;
}

template <int Dim>
Lattice<Dim> part_around(const Lattice<Dim>& lattice, const Vector<Dim>& low, const Vector<Dim>& high, double margin) {
  Lattice<Dim> part = lattice;
  for (int axis = 0; axis < Dim; ++axis) {
    const int last = lattice.size[axis] - 1;
    const auto index = [&](double mm) { return (mm - lattice.offset[axis]) / lattice.spacing[axis]; };
    const auto clamped = [&](double at) { return static_cast<int>(std::clamp(at, 0.0, static_cast<double>(last))); };
    constexpr double rounding = 1e-6;  // of a sample: mm and back
    const int begin = clamped(std::floor(index(low[axis]) - margin + rounding)),
              end = clamped(std::ceil(index(high[axis]) + margin - rounding));
    part.size[axis] = end - begin + 1;
    part.offset[axis] += begin * lattice.spacing[axis];
  }
  return part;
}

template <int Dim>
std::vector<float> samples_of_part(const Lattice<Dim>& whole, const std::vector<float>& samples,
                                   const Lattice<Dim>& part) {
  Index<Dim> begin, end;
  for (int axis = 0; axis < Dim; ++axis) {
    begin[axis] = static_cast<int>(std::lround((part.offset[axis] - whole.offset[axis]) / whole.spacing[axis]));
    end[axis] = begin[axis] + part.size[axis];
  }
  return samples_in_box<Dim>(whole.size, samples, begin, end);
}

#define SALTUS_CONTENT(DIM)                                                                               \
  template IndexBox<DIM> content_box(const Lattice<DIM>&, const float*, const float*, double);            \
  template Lattice<DIM> part_around(const Lattice<DIM>&, const Vector<DIM>&, const Vector<DIM>&, double); \
  template std::vector<float> samples_of_part(const Lattice<DIM>&, const std::vector<float>&, const Lattice<DIM>&);
SALTUS_CONTENT(2)
SALTUS_CONTENT(3)
#undef SALTUS_CONTENT

}  // namespace saltus
