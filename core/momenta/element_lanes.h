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

/// A register of values lies on a tile of the lattice: lanes are sites of two rows, which take turns. An element is a
/// turned box, which tiles fill better than as many sites of one row do (3-D: nearly a quarter fewer of them, 16
/// lanes).
template <class T>
constexpr int kTileWidth = static_cast<int>(kRegisterLanes<T>) / 2;

/// Values as a vector field, component after component. Within one, an even row and the odd one that follows it take
/// turns, value by value, so that a tile is one register wherever it begins along x. Rows have room for the lanes of
/// tiles that reach beyond the lattice, and where a plane has an odd number of them there is one more.
template <int Dim, class T>
class PaddedField {
 public:
  /// `values` must outlive this.
  PaddedField(const Lattice<Dim>& lattice, std::vector<T>& values)
      : values_(values),
        length_(static_cast<std::size_t>(lattice.size[0])),
        rows_(static_cast<std::size_t>(lattice.size[1])),
        planes_(Dim == 3 ? static_cast<std::size_t>(lattice.size[Dim - 1]) : 1),
        two_rows_(two_rows(lattice)),
        plane_(plane(lattice)) {}

  /// How far two rows are from the next two, and a plane from the next one.
  static std::size_t two_rows(const Lattice<Dim>& lattice) {
    return 2 * static_cast<std::size_t>(lattice.size[0] + kTileWidth<T>);
  }
  static std::size_t plane(const Lattice<Dim>& lattice) {
    return two_rows(lattice) * static_cast<std::size_t>((lattice.size[1] + 1) / 2);
  }
  T* component(int c) const { return values_.data() + static_cast<std::size_t>(c) * size(); }

  void clear() { values_.assign(Dim * size(), T(0)); }
  /// From an interleaved field; 0 in the padding. Threads inside.
  void assign(const T* field) {
    values_.resize(Dim * size());
    const std::size_t padded_rows = 2 * (plane_ / two_rows_);
#pragma omp parallel for schedule(static)
    for (std::size_t z = 0; z < planes_; ++z)
      for (std::size_t y = 0; y < padded_rows; ++y)
        for (int c = 0; c < Dim; ++c) {
          T* to = component(c) + row_begin(y, z);
          const std::size_t length = y < rows_ ? length_ : 0;
          const T* from = field + Dim * length_ * (z * rows_ + y) + static_cast<std::size_t>(c);
          for (std::size_t x = 0; x < length; ++x) to[2 * x] = from[Dim * x];
          for (std::size_t x = length; x < two_rows_ / 2; ++x) to[2 * x] = T(0);
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
                component(c)[row_begin(y, z) + 2 * x];
  }

 private:
  std::size_t row_begin(std::size_t y, std::size_t z) const { return plane_ * z + two_rows_ * (y / 2) + y % 2; }
  std::size_t size() const { return plane_ * planes_; }

  std::vector<T>& values_;
  std::size_t length_, rows_, planes_, two_rows_, plane_;
};

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
/// `reaches` says. Lanes beyond its reach have a shape of 0; lanes beyond the lattice are in its padding. The tiles are
/// those of that range, whatever it is, but come in an order of its own.
template <int Dim, class T, class Lanes>
[[gnu::always_inline]] inline void visit_lanes(const Lattice<Dim>& lattice, const std::array<T, Dim>& reaches,
                                               const ElementPlacement<Dim, T>& place, int begin, int end,
                                               Lanes&& lanes) {
  constexpr int kWidth = kTileWidth<T>, kShift = std::bit_width(static_cast<unsigned>(kWidth)) - 1;
  // The tiles of as many pairs of rows as a register has lanes are found together, where they begin and how many, and
  // listed before they are visited: row by row that took as long as all that lanes() does, and how many tiles a pair
  // has no processor foresees.
  using Pairs = Register<T>;
  using WholePairs = decltype(Pairs{} < Pairs{});
  using Whole = std::remove_cvref_t<decltype(WholePairs{}[0])>;
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
  Register<T> along_row, across_rows;
  for (int i = 0; i < 2 * kWidth; ++i) {
    along_row[i] = static_cast<T>(i / 2);
    across_rows[i] = static_cast<T>(i % 2);
  }
  for (int k = 0; k < Dim; ++k) {
    step[k] = place.axes(k, 0) * h;
    per_step[k] = std::abs(step[k]) < T(1e-3) * h ? T(0) : 1 / step[k];
    to_next_row[k] = place.axes(k, 1) * spacing;
    beside[k] = along_row * step[k] + across_rows * to_next_row[k];
  }
  const std::size_t two_rows = PaddedField<Dim, T>::two_rows(lattice), plane = PaddedField<Dim, T>::plane(lattice);
  std::size_t corner = two_rows * static_cast<std::size_t>(low[1] / 2);
  if constexpr (Dim == 3) corner += plane * static_cast<std::size_t>(low[2]);
  const T low_x = static_cast<T>(low[0]), high_x = static_cast<T>(high[0] - 1);
  const int of_plane = (high[1] - low[1] + 1) / 2;  // pairs of rows
  const int all_pairs = of_plane * (Dim == 3 ? high[Dim - 1] - low[Dim - 1] : 1);

  constexpr int kListed = (Dim == 2 ? 1 : 16) * kPairs;
  std::array<Whole, kListed> begins;   // of tiles, from the corner
  std::array<T, kListed> places[Dim];  // of their first lanes
  int listed = 0;
  WholePairs z{}, pair;  // of each pair, from the corner
  for (int i = 0; i < kPairs; ++i) pair[i] = i;
  for (int first_pair = 0; first_pair < all_pairs; first_pair += kPairs) {
    for (int planes = 0; Dim == 3 && planes < kPairs; planes += of_plane) {
      const WholePairs is_beyond = pair >= of_plane;
      z -= is_beyond;
      pair -= is_beyond & of_plane;
    }
    const Pairs from_middle = __builtin_convertvector(2 * pair + low[1], Pairs) * spacing - centre[1];
    Pairs across[Dim];  // along the axes at x = 0 of the first row of each
    Pairs least[2] = {Pairs{} + low_x, Pairs{} + low_x}, most[2] = {Pairs{} + high_x, Pairs{} + high_x};  // by row
    for (int k = 0; k < Dim; ++k) {
      across[k] = place.axes(k, 1) * from_middle - place.axes(k, 0) * centre[0];
      if constexpr (Dim == 3)
        across[k] += place.axes(k, 2) *
                     (__builtin_convertvector(z + low[2], Pairs) * static_cast<T>(lattice.spacing[2]) - centre[2]);
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
    // Of each row the sites from the first within reach (or a thousandth of a site beyond it) to the last. Rounding may
    // take one at its ends away, where the shape is next to nothing. A row without any may still make its pair a site
    // longer.
    for (int of_pair = 0; of_pair < 2; ++of_pair) {
      const WholePairs is_there = least[of_pair] <= most[of_pair] + 1;
      least[of_pair] = is_there ? least[of_pair] : Pairs{} + (high_x + 1);
      most[of_pair] = is_there ? most[of_pair] : Pairs{} - 1;
    }
    const Pairs first = least[0] < least[1] ? least[0] : least[1], last = most[0] > most[1] ? most[0] : most[1];
    const WholePairs first_x = __builtin_convertvector(first + T(0.999), WholePairs),
                     reached = __builtin_convertvector(last, WholePairs),
                     last_x = reached < high[0] - 1 ? reached : WholePairs{} + (high[0] - 1);
    WholePairs tiles = (last_x - first_x + kWidth) >> kShift;  // below 1 where there are none
    WholePairs at = 2 * first_x + static_cast<Whole>(two_rows) * pair;
    if constexpr (Dim == 3) at += static_cast<Whole>(plane) * z;
    Pairs places_of[Dim];
    for (int k = 0; k < Dim; ++k) places_of[k] = across[k] + step[k] * __builtin_convertvector(first_x, Pairs);
    if constexpr (Dim == 2) {
      // One register of pairs or two is all that there is: visited as they are found.
      std::array<Whole, kPairs> counts;
      std::memcpy(begins.data(), &at, sizeof at);
      std::memcpy(counts.data(), &tiles, sizeof tiles);
      for (int k = 0; k < Dim; ++k) store<T>(places_of[k], places[k].data());
      const std::size_t pairs = static_cast<std::size_t>(std::min(kPairs, all_pairs - first_pair));
      for (std::size_t i = 0; i < pairs; ++i) {
        std::size_t here = corner + static_cast<std::size_t>(begins[i]);
        Register<T> r[Dim];
        for (int k = 0; k < Dim; ++k) r[k] = places[k][i] + beside[k];
        for (Whole tile = 0; tile < counts[i]; ++tile, here += 2 * kWidth) {
          lanes(here, r);
          for (int k = 0; k < Dim; ++k) r[k] += static_cast<T>(kWidth) * step[k];
        }
      }
    } else {
      // The first tiles of all pairs, then the second ones and so on; visited when there might be no room for more.
      const bool is_last = first_pair + kPairs >= all_pairs;
      tiles = z < (all_pairs / of_plane) ? tiles : WholePairs{};
      for (PickedLanes<T> picked(tiles > 0);;) {
        if (picked.count() > 0) {
          picked.store(at, begins.data() + listed);
          for (int k = 0; k < Dim; ++k) picked.store(places_of[k], places[k].data() + listed);
          listed += picked.count();
          tiles -= 1;
          at += 2 * kWidth;
          for (int k = 0; k < Dim; ++k) places_of[k] += static_cast<T>(kWidth) * step[k];
          picked = PickedLanes<T>(tiles > 0);
        }
        const bool has_more = picked.count() > 0;
        if (listed + kPairs > kListed || (is_last && !has_more)) {
          for (int i = 0; i < listed; ++i) {
            const std::size_t tile = static_cast<std::size_t>(i);
            Register<T> r[Dim];
            for (int k = 0; k < Dim; ++k) r[k] = places[k][tile] + beside[k];
            lanes(corner + static_cast<std::size_t>(begins[tile]), r);
          }
          listed = 0;
        }
        if (!has_more) break;
      }
    }
    pair += kPairs;
  }
}

}  // namespace saltus
