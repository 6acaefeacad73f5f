#pragma once

#include "core/grid/lattice.h"
#include "core/momenta/transported_element.h"
#include "core/support/registers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {

// For sources of the core alone (see registers.h): visits of the sites around an element of oriented momenta.

/// A register of values lies on a tile of the lattice: half of the lanes side by side along x, the others beside them
/// in the next row. An element is a turned box, which tiles fill better than as many sites of one row do (3-D: nearly a
/// quarter fewer of them, 16 lanes).
template <class T>
constexpr int kTileWidth = static_cast<int>(kRegisterLanes<T>) / 2;
template <class T>
struct TileRow {
  typedef T Type __attribute__((vector_size(kRegisterBytes / 2)));
};

template <class T, int... Lane>
[[gnu::always_inline]] inline Register<T> load_tile(const T* from, std::size_t row,
                                                    std::integer_sequence<int, Lane...>) {
  typename TileRow<T>::Type first, second;
  std::memcpy(&first, from, sizeof first);
  std::memcpy(&second, from + row, sizeof second);
  return __builtin_shufflevector(first, second, Lane...);
}
/// The tile that begins at `from`, in rows that begin `row` values apart.
template <class T>
[[gnu::always_inline]] inline Register<T> load_tile(const T* from, std::size_t row) {
  return load_tile<T>(from, row, std::make_integer_sequence<int, static_cast<int>(kRegisterLanes<T>)>());
}
template <class T>
[[gnu::always_inline]] inline void store_tile(const Register<T>& values, T* to, std::size_t row) {
  std::memcpy(to, &values, sizeof values / 2);
  std::memcpy(to + row, reinterpret_cast<const char*>(&values) + sizeof values / 2, sizeof values / 2);
}

/// Values as a vector field, component after component, with room for the lanes of tiles that reach beyond a row of the
/// lattice, and a row more where a plane has an odd number of them: tiles begin in even rows.
template <int Dim, class T>
class PaddedField {
 public:
  /// `values` must outlive this.
  PaddedField(const Lattice<Dim>& lattice, std::vector<T>& values)
      : values_(values),
        length_(static_cast<std::size_t>(lattice.size[0])),
        row_(row(lattice)),
        rows_(static_cast<std::size_t>(lattice.size[1])),
        planes_(Dim == 3 ? static_cast<std::size_t>(lattice.size[Dim - 1]) : 1) {}

  static std::size_t row(const Lattice<Dim>& lattice) {
    return static_cast<std::size_t>(lattice.size[0] + kTileWidth<T>);
  }
  static std::size_t rows_of_plane(const Lattice<Dim>& lattice) {
    return static_cast<std::size_t>(lattice.size[1] + lattice.size[1] % 2);
  }
  std::size_t row() const { return row_; }
  T* component(int c) const { return values_.data() + static_cast<std::size_t>(c) * size(); }

  void clear() { values_.assign(Dim * size(), T(0)); }
  /// From an interleaved field; 0 in the padding. Threads inside.
  void assign(const T* field) {
    values_.resize(Dim * size());
#pragma omp parallel for schedule(static)
    for (std::size_t z = 0; z < planes_; ++z)
      for (std::size_t y = 0; y < padded_rows(); ++y)
        for (int c = 0; c < Dim; ++c) {
          T* to = component(c) + row_ * (z * padded_rows() + y);
          const std::size_t length = y < rows_ ? length_ : 0;
          const T* from = field + Dim * length_ * (z * rows_ + y) + static_cast<std::size_t>(c);
          for (std::size_t x = 0; x < length; ++x) to[x] = from[Dim * x];
          std::fill(to + length, to + row_, T(0));
        }
  }
  /// Adds planes [begin, end) of the last axis to an interleaved field.
  void add_to(T* field, int begin, int end) const {
    const std::size_t first = static_cast<std::size_t>(begin), last = static_cast<std::size_t>(end);
    for (std::size_t z = Dim == 3 ? first : 0; z < (Dim == 3 ? last : 1); ++z)
      for (std::size_t y = Dim == 3 ? 0 : first; y < (Dim == 3 ? rows_ : last); ++y)
        for (std::size_t x = 0; x < length_; ++x)
          for (int c = 0; c < Dim; ++c)
            field[Dim * (length_ * (z * rows_ + y) + x) + static_cast<std::size_t>(c)] +=
                component(c)[row_ * (z * padded_rows() + y) + x];
  }

 private:
  std::size_t padded_rows() const { return rows_ + rows_ % 2; }
  std::size_t size() const { return row_ * padded_rows() * planes_; }

  std::vector<T>& values_;
  std::size_t length_, row_, rows_, planes_;
};

/// Sum of the lanes.
template <class T>
[[gnu::always_inline]] inline T sum_of(const Register<T>& lanes) {
  T sum = 0;
  for (std::size_t i = 0; i < kRegisterLanes<T>; ++i) sum += lanes[i];
  return sum;
}

/// Calls visit(begin, end) for ranges of planes of the last axis, one for each thread, which begin at multiples of
/// `together`. A thread that owns its planes hears of elements in their order, however many threads there are.
template <class Visit>
void for_ranges_of_planes(int planes, int together, Visit&& visit) {
  const int ranges = (planes + together - 1) / together;
#ifdef _OPENMP
  const int parts = std::max(1, std::min(ranges, omp_get_max_threads()));
#else
  const int parts = 1;
#endif
#pragma omp parallel for schedule(static, 1) num_threads(parts)
  for (int part = 0; part < parts; ++part)
    visit(together * (ranges * part / parts), std::min(planes, together * (ranges * (part + 1) / parts)));
}
/// What tiles want of that: rows are planes in 2-D, and a tile has two.
template <int Dim>
constexpr int kPlanesTogether = Dim == 2 ? 2 : 1;

/// Calls lanes(at, r) for the sites of the lattice that an element can reach, a tile of them at a time, in planes
/// [begin, end) of the last axis (in 2-D a range of for_ranges_of_planes): `at` is where the first one's value stands
/// in a component of a PaddedField, `r` their places along the element's axes, along which it reaches as far as
/// `reaches` says. Lanes beyond its reach have a shape of 0; lanes beyond the lattice are in its padding.
template <int Dim, class T, class Lanes>
[[gnu::always_inline]] inline void visit_lanes(const Lattice<Dim>& lattice, const std::array<T, Dim>& reaches,
                                               const ElementPlacement<Dim, T>& place, int begin, int end,
                                               Lanes&& lanes) {
  constexpr int kWidth = kTileWidth<T>, kShift = std::bit_width(static_cast<unsigned>(kWidth)) - 1;
  // The tiles of as many pairs of rows as a register has lanes are found together: where they begin, and how many. Row
  // by row that took as long as all that lanes() does.
  using Pairs = Register<T>;
  using WholePairs = decltype(Pairs{} < Pairs{});
  constexpr int kPairs = static_cast<int>(kRegisterLanes<T>);
  // Nothing else than finite places can be on the lattice.
  if (!place.at.allFinite() || !place.axes.allFinite()) return;
  Index<Dim> low, high;  // sites of the box around it, high excluded
  T centre[Dim];         // from site 0, mm
  for (int a = 0; a < Dim; ++a) {
    T extent = 0;
    for (int k = 0; k < Dim; ++k) extent += std::abs(place.axes(k, a)) * reaches[static_cast<std::size_t>(k)];
    centre[a] = static_cast<T>(static_cast<double>(place.at[a]) - lattice.offset[a]);
    const double h = lattice.spacing[a], from = std::ceil((centre[a] - extent) / h),
                 to = std::floor((centre[a] + extent) / h) + 1;
    const double first = a == Dim - 1 ? begin : 0, last = a == Dim - 1 ? end : lattice.size[a];
    if (!(from < last && to > first)) return;
    low[a] = static_cast<int>(std::max(first, from));
    high[a] = static_cast<int>(std::min(last, to));
  }
  low[1] -= low[1] % 2;
  const T h = static_cast<T>(lattice.spacing[0]), spacing = static_cast<T>(lattice.spacing[1]);
  T step[Dim], to_next_row[Dim];
  T per_step[Dim];          // 0: what divides by nearly nothing bounds no row
  Register<T> beside[Dim];  // from the first lane
  for (int k = 0; k < Dim; ++k) {
    step[k] = place.axes(k, 0) * h;
    per_step[k] = std::abs(step[k]) < T(1e-3) * h ? T(0) : 1 / step[k];
    to_next_row[k] = place.axes(k, 1) * spacing;
    T lanes_beside[2 * kWidth];
    for (int i = 0; i < 2 * kWidth; ++i)
      lanes_beside[i] = static_cast<T>(i % kWidth) * step[k] + static_cast<T>(i / kWidth) * to_next_row[k];
    beside[k] = load<T>(lanes_beside);
  }
  Pairs rows;  // that come before the first one of each pair
  for (int i = 0; i < kPairs; ++i) rows[i] = static_cast<T>(2 * i);
  const std::size_t row = PaddedField<Dim, T>::row(lattice);
  const int planes_begin = Dim == 3 ? low[Dim - 1] : 0, planes_end = Dim == 3 ? high[Dim - 1] : 1;
  const T low_x = static_cast<T>(low[0]), high_x = static_cast<T>(high[0] - 1);
  for (int z = planes_begin; z < planes_end; ++z) {
    T of_plane[Dim];  // along the axes at x = y = 0
    for (int k = 0; k < Dim; ++k) {
      of_plane[k] = -place.axes(k, 0) * centre[0];
      if constexpr (Dim == 3) of_plane[k] += place.axes(k, 2) * (static_cast<T>(z * lattice.spacing[2]) - centre[2]);
    }
    for (int y = low[1]; y < high[1]; y += 2 * kPairs) {
      Pairs across[Dim];  // along the axes at x = 0 of the first row of each
      Pairs least[2] = {Pairs{} + low_x, Pairs{} + low_x}, most[2] = {Pairs{} + high_x, Pairs{} + high_x};  // by row
      for (int k = 0; k < Dim; ++k) {
        across[k] = of_plane[k] + place.axes(k, 1) * ((static_cast<T>(y) + rows) * spacing - centre[1]);
        if (per_step[k] == T(0)) continue;
        // |across + step x| <= reach
        const T reach = std::abs(reaches[static_cast<std::size_t>(k)] * per_step[k]);
        for (int of_pair = 0; of_pair < 2; ++of_pair) {
          const Pairs middle = (across[k] + static_cast<T>(of_pair) * to_next_row[k]) * -per_step[k];
          const Pairs from = middle - reach, to = middle + reach;
          least[of_pair] = least[of_pair] > from ? least[of_pair] : from;
          most[of_pair] = most[of_pair] < to ? most[of_pair] : to;
        }
      }
      for (int of_pair = 0; of_pair < 2; ++of_pair) {
        // Rounding may take a site at the ends of a row away, where the shape is next to nothing.
        const WholePairs is_there = least[of_pair] <= most[of_pair] + 1;
        least[of_pair] = is_there ? least[of_pair] : Pairs{} + (high_x + 1);
        most[of_pair] = is_there ? most[of_pair] : Pairs{} - 1;
      }
      const Pairs first = least[0] < least[1] ? least[0] : least[1], last = most[0] > most[1] ? most[0] : most[1];
      const WholePairs first_x = __builtin_convertvector(first, WholePairs),
                       reached = __builtin_convertvector(last + T(0.999), WholePairs),
                       last_x = reached < high[0] - 1 ? reached : WholePairs{} + (high[0] - 1),
                       tiles = (last_x - first_x + kWidth) >> kShift;
      T places[Dim][kPairs];  // of the first lane
      for (int k = 0; k < Dim; ++k) store<T>(across[k] + step[k] * __builtin_convertvector(first_x, Pairs), places[k]);
      std::array<std::remove_cvref_t<decltype(first_x[0])>, kPairs> begins, counts;
      std::memcpy(begins.data(), &first_x, sizeof first_x);
      std::memcpy(counts.data(), &tiles, sizeof tiles);
      std::size_t of_row = row * static_cast<std::size_t>(y);
      if constexpr (Dim == 3) of_row += row * PaddedField<Dim, T>::rows_of_plane(lattice) * static_cast<std::size_t>(z);
      const std::size_t pairs = static_cast<std::size_t>(std::min(kPairs, (high[1] - y + 1) / 2));
      for (std::size_t i = 0; i < pairs; ++i, of_row += 2 * row) {
        std::size_t at = of_row + static_cast<std::size_t>(begins[i]);
        Register<T> r[Dim];
        for (int k = 0; k < Dim; ++k) r[k] = places[k][i] + beside[k];
        for (int tile = 0; tile < counts[i]; ++tile, at += kWidth) {
          lanes(at, r);
          for (int k = 0; k < Dim; ++k) r[k] += static_cast<T>(kWidth) * step[k];
        }
      }
    }
  }
}

}  // namespace saltus
