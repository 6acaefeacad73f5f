#pragma once

#include "core/grid/cell_lanes.h"
#include "core/grid/interpolation.h"
#include "core/support/registers.h"

#include <algorithm>
#include <cstring>
#include <type_traits>

namespace saltus {

// Values of fields at neighbouring sites, as CellLanes takes and gives them: into lanes and back.

/// The first `count` vectors of an interleaved field; 0 beyond them.
template <int Dim, class T>
[[gnu::always_inline]] inline LaneVectors<T> vectors_of(const T* field, int count) {
  using Vector = typename CellRows<T>::Vector;
  LaneVectors<T> vectors;
  if (count < static_cast<int>(vectors.size())) vectors.fill(Vector{});
  for (int lane = 0; lane + 1 < count; ++lane)
    if constexpr (Dim == 3)
      std::memcpy(&vectors[lane], field + Dim * lane, sizeof(Vector));  // with the first component of the next one
    else
      vectors[lane] = Vector{field[Dim * lane], field[Dim * lane + 1]};
  vectors[count - 1] = Vector{};
  for (int c = 0; c < Dim; ++c) vectors[count - 1][c] = field[Dim * (count - 1) + c];
  return vectors;
}
/// The same, by component.
template <int Dim, class T>
[[gnu::always_inline]] inline LanePoints<Dim, T> by_component(const LaneVectors<T>& vectors) {
  LanePoints<Dim, T> values;
  for (int lane = 0; lane < CellLanes<Dim, T>::kLanes; ++lane)
    for (int c = 0; c < Dim; ++c) values[c][lane] = vectors[lane][c];
  return values;
}
/// Writes one of an interleaved field.
template <int Dim, class Vector, class T>
[[gnu::always_inline]] inline void put(const Vector& vector, T* to) {
  for (int c = 0; c < Dim; ++c) to[c] = vector[c];
}

/// The first `count` values of an interleaved field, by component; 0 beyond them.
template <int Dim, class T>
[[gnu::always_inline]] inline LanePoints<Dim, T> lanes_of(const T* field, int count) {
  constexpr int lanes = CellLanes<Dim, T>::kLanes, step = static_cast<int>(kRegisterLanes<T>);
  LanePoints<Dim, T> values{};
  if (kHasRegisters && count == lanes) {
    for (int lane = 0; lane < lanes; lane += step) {
      Register<T> components[Dim];
      Interleaved<Dim, T>::load(field + Dim * lane, components);
      for (int c = 0; c < Dim; ++c) store<T>(components[c], values[c].data() + lane);
    }
    return values;
  }
  for (int lane = 0; lane < count; ++lane)
    for (int c = 0; c < Dim; ++c) values[c][lane] = field[Dim * lane + c];
  return values;
}
/// Writes them.
template <int Dim, class T>
[[gnu::always_inline]] inline void put_lanes(const LanePoints<Dim, T>& values, int count, T* field) {
  constexpr int lanes = CellLanes<Dim, T>::kLanes, step = static_cast<int>(kRegisterLanes<T>);
  if (kHasRegisters && count == lanes) {
    for (int lane = 0; lane < lanes; lane += step) {
      Register<T> components[Dim];
      for (int c = 0; c < Dim; ++c) components[c] = load(values[c].data() + lane);
      Interleaved<Dim, T>::store(components, field + Dim * lane);
    }
    return;
  }
  for (int lane = 0; lane < count; ++lane)
    for (int c = 0; c < Dim; ++c) field[Dim * lane + c] = values[c][lane];
}

/// The first `count` values of a field of scalars, 0 beyond them; and such values written. All at once where they fill
/// the lanes.
template <class Lanes, class T>
[[gnu::always_inline]] inline Lanes scalars_of(const T* field, int count) {
  static_assert(std::is_same_v<typename Lanes::value_type, T>);
  Lanes values{};
  if (count == static_cast<int>(values.size()))
    std::memcpy(values.data(), field, sizeof values);
  else
    std::copy_n(field, count, values.begin());
  return values;
}
template <class Lanes, class T>
[[gnu::always_inline]] inline void put_scalars(const Lanes& values, int count, T* field) {
  static_assert(std::is_same_v<typename Lanes::value_type, T>);
  if (count == static_cast<int>(values.size()))
    std::memcpy(field, values.data(), sizeof values);
  else
    std::copy_n(values.begin(), count, field);
}

/// What SitePlacement says of the sites from `index` on along x, with displacements `mm`.
template <int Dim, class T>
[[gnu::always_inline]] inline LanePoints<Dim, T> placed(const SitePlacement<Dim, T>& place, const Index<Dim>& index,
                                                        const LanePoints<Dim, T>& mm) {
  LanePoints<Dim, T> at;
  for (int axis = 0; axis < Dim; ++axis) {
    const double scale = place.scale[axis], shift = place.shift[axis], per_mm = place.per_mm[axis];
#pragma omp simd
    for (int lane = 0; lane < CellLanes<Dim, T>::kLanes; ++lane)
      at[axis][lane] = static_cast<T>((index[axis] + (axis == 0 ? lane : 0)) * scale + shift +
                                      static_cast<double>(mm[axis][lane]) * per_mm);
  }
  return at;
}

}  // namespace saltus
