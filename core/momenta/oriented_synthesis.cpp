#include "core/momenta/oriented_momenta.h"

#include "core/support/registers.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>

#ifdef _OPENMP
#include <omp.h>
#endif

// The velocity of elements and its transpose: all that visits the sites around an element.

namespace saltus {
namespace {

/// Duals of the corners from those of the middle and the axes (rows).
template <int Dim, class T>
void corners_adjoint(const T* corners, const Eigen::Matrix<T, Dim, 1>& at_dual, Eigen::Matrix<T, Dim, Dim> axes_dual,
                     T* dual) {
  using Column = Eigen::Matrix<T, Dim, 1>;
  using Corner = Eigen::Map<const Column>;
  const auto corner = [&](int k) { return Corner(corners + Dim * k); };
  const auto add = [&](int k, const Column& terms) { Eigen::Map<Column>(dual + Dim * k) += terms; };
  if constexpr (Dim == 2) {
    const Column apart = corner(0) - corner(1);
    const T length = apart.norm();
    const Column t = apart / length;
    Column t_dual = axes_dual.row(1).transpose();
    t_dual += Column(-axes_dual(0, 1), axes_dual(0, 0));
    const Column apart_dual = (t_dual - t * t.dot(t_dual)) / length;
    add(0, at_dual / 2 + apart_dual);
    add(1, at_dual / 2 - apart_dual);
  } else {
    const T root = static_cast<T>(1 / std::numbers::sqrt3);
    const Column first = (2 * corner(0) - corner(1) - corner(2)) / 3, second = (corner(1) - corner(2)) * root;
    const Column normal = first.cross(second);
    const T area = normal.norm(), length = first.norm();
    const Column n = normal / area, t1 = first / length;
    const Column t2_dual = axes_dual.row(2).transpose();
    const Column n_dual = axes_dual.row(0).transpose() + t1.cross(t2_dual);
    const Column t1_dual = axes_dual.row(1).transpose() + t2_dual.cross(n);
    const Column normal_dual = (n_dual - n * n.dot(n_dual)) / area;
    const Column first_dual = second.cross(normal_dual) + (t1_dual - t1 * t1.dot(t1_dual)) / length;
    const Column second_dual = normal_dual.cross(first);
    add(0, at_dual / 3 + first_dual * T(2) / 3);
    add(1, at_dual / 3 - first_dual / 3 + second_dual * root);
    add(2, at_dual / 3 - first_dual / 3 - second_dual * root);
  }
}

}  // namespace

/// Rows of `by_component_` have room for the lanes that reach beyond a row of the lattice.
template <int Dim, class T>
std::size_t OrientedMomenta<Dim, T>::padded_row() const {
  return static_cast<std::size_t>(options_.lattice.size[0]) + kRegisterLanes<T>;
}

/// Calls lanes(at, r) for the sites of the lattice that an element can reach, a register of them side by side along x
/// at a time, in planes [begin, end) of the last axis: `at` is where the first one's value stands in a field of padded
/// rows, `r` their places along the element's axes. Lanes beyond the element's reach have a shape of 0; lanes beyond
/// the row are in its padding.
template <int Dim, class T>
template <class Lanes>
[[gnu::always_inline]] inline void OrientedMomenta<Dim, T>::visit_lanes(const Orientation& orientation,
                                                                        const Placement& place, int begin, int end,
                                                                        Lanes&& lanes) const {
  constexpr int kRows = 16;  // whose ends are found together
  constexpr int kWidth = static_cast<int>(kRegisterLanes<T>);
  const Lattice<Dim>& lattice = options_.lattice;
  // Nothing else than finite places can be on the lattice.
  if (!place.at.allFinite() || !place.axes.allFinite()) return;
  Index<Dim> low, high;  // sites of the box around it, high excluded
  T centre[Dim];         // from site 0, mm
  for (int a = 0; a < Dim; ++a) {
    T extent = 0;
    for (int k = 0; k < Dim; ++k) extent += std::abs(place.axes(k, a)) * orientation.profiles[k].reach();
    centre[a] = static_cast<T>(static_cast<double>(place.at[a]) - lattice.offset[a]);
    const double h = lattice.spacing[a], from = std::ceil((centre[a] - extent) / h),
                 to = std::floor((centre[a] + extent) / h) + 1;
    const double first = a == Dim - 1 ? begin : 0, last = a == Dim - 1 ? end : lattice.size[a];
    if (!(from < last && to > first)) return;
    low[a] = static_cast<int>(std::max(first, from));
    high[a] = static_cast<int>(std::min(last, to));
  }
  const T h = static_cast<T>(lattice.spacing[0]);
  T step[Dim], per_step[Dim];  // 0: what divides by nearly nothing bounds no row
  Register<T> beside[Dim];     // from the first lane
  for (int k = 0; k < Dim; ++k) {
    step[k] = place.axes(k, 0) * h;
    per_step[k] = std::abs(step[k]) < T(1e-3) * h ? T(0) : 1 / step[k];
    T lanes_beside[kWidth];
    for (int i = 0; i < kWidth; ++i) lanes_beside[i] = static_cast<T>(i) * step[k];
    beside[k] = load<T>(lanes_beside);
  }
  const std::size_t row = padded_row();
  const int planes_begin = Dim == 3 ? low[Dim - 1] : 0, planes_end = Dim == 3 ? high[Dim - 1] : 1;
  for (int z = planes_begin; z < planes_end; ++z) {
    T of_plane[Dim];  // along the axes at x = y = 0
    for (int k = 0; k < Dim; ++k) {
      of_plane[k] = -place.axes(k, 0) * centre[0];
      if constexpr (Dim == 3) of_plane[k] += place.axes(k, 2) * (static_cast<T>(z * lattice.spacing[2]) - centre[2]);
    }
    for (int y = low[1]; y < high[1]; y += kRows) {
      T across[Dim][kRows];  // along the axes at x = 0 of each row
      T least[kRows], most[kRows];
      for (int i = 0; i < kRows; ++i) {
        least[i] = static_cast<T>(low[0]);
        most[i] = static_cast<T>(high[0] - 1);
      }
      const T spacing = static_cast<T>(lattice.spacing[1]);
      for (int k = 0; k < Dim; ++k) {
        const T reach = orientation.profiles[k].reach();
#pragma omp simd
        for (int i = 0; i < kRows; ++i)
          across[k][i] = of_plane[k] + place.axes(k, 1) * (static_cast<T>(y + i) * spacing - centre[1]);
        if (per_step[k] == T(0)) continue;
          // |across + step x| <= reach
#pragma omp simd
        for (int i = 0; i < kRows; ++i) {
          const T one = (-reach - across[k][i]) * per_step[k], other = (reach - across[k][i]) * per_step[k];
          const T smaller = one < other ? one : other, larger = one < other ? other : one;
          least[i] = least[i] > smaller ? least[i] : smaller;
          most[i] = most[i] < larger ? most[i] : larger;
        }
      }
      int first[kRows], last[kRows];
#pragma omp simd
      for (int i = 0; i < kRows; ++i) {
        // Rounding may take a site at the ends of a row away, where the shape is next to nothing.
        const bool is_empty = !(least[i] <= most[i] + 1);
        first[i] = is_empty ? 1 : static_cast<int>(std::floor(least[i]));
        last[i] = is_empty ? 0 : static_cast<int>(std::ceil(most[i]));
      }
      const int rows = std::min(kRows, high[1] - y);
      for (int i = 0; i < rows; ++i) {
        const int begin_x = std::max(first[i], low[0]), end_x = std::min(last[i], high[0] - 1);
        std::size_t at = row * static_cast<std::size_t>(y + i) + static_cast<std::size_t>(begin_x);
        if constexpr (Dim == 3) at += row * static_cast<std::size_t>(lattice.size[1]) * static_cast<std::size_t>(z);
        for (int x = begin_x; x <= end_x; x += kWidth, at += kWidth) {
          Register<T> r[Dim];
          for (int k = 0; k < Dim; ++k) r[k] = (across[k][i] + step[k] * static_cast<T>(x)) + beside[k];
          lanes(at, r);
        }
      }
    }
  }
}

/// What the product of the profiles' shapes is short of.
template <int Dim, class T>
T OrientedMomenta<Dim, T>::shape_scale(const Orientation& orientation) {
  T scale = orientation.profiles[0].slope_scale;
  for (int k = 1; k < Dim; ++k) scale *= orientation.profiles[k].value_scale;
  return scale;
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_velocity(const std::vector<Element>& elements, const T* corners, const T* momenta,
                                           T* velocity) const {
  if (elements.empty()) return;
  const int planes = options_.lattice.size[Dim - 1];
  const auto length = static_cast<std::size_t>(options_.lattice.size[0]);
  const std::size_t row = padded_row(), rows = sites_ / length, rows_of_plane = rows / static_cast<std::size_t>(planes);
  const std::size_t field = row * rows;
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  by_component_.assign(Dim * field, T(0));
#ifdef _OPENMP
  const int parts = std::max(1, std::min(planes, omp_get_max_threads()));
#else
  const int parts = 1;
#endif
  // A thread owns a range of planes; whatever that is, a site hears of the elements in their order.
#pragma omp parallel for schedule(static, 1) num_threads(parts)
  for (int part = 0; part < parts; ++part) {
    const int begin = planes * part / parts, end = planes * (part + 1) / parts;
    for (std::size_t e = 0; e < elements.size(); ++e) {
      const T* c = momenta + kComponents * e;
      if (std::all_of(c, c + kComponents, [](T value) { return value == T(0); })) continue;
      const Placement place = placement(corners + kCornerValues * e);
      const Orientation& orientation = orientations_[normal_of(elements[e])];
      const T scale = factor * shape_scale(orientation);
      T vector[Dim] = {};
      for (int j = 1; j < Dim; ++j)
        for (int a = 0; a < Dim; ++a) vector[a] += scale * c[j - 1] * place.axes(j, a);
      AveragedWendland<T> p[Dim];
      std::copy_n(orientation.profiles, Dim, p);
      T* out = by_component_.data();
      visit_lanes(orientation, place, begin, end, [&](std::size_t at, const Register<T>* r) {
        Register<T> shape = p[0].slope_shape(p[0].ends(r[0]));
        for (int k = 1; k < Dim; ++k) shape *= p[k].value_shape(p[k].ends(r[k]));
        for (int a = 0; a < Dim; ++a) {
          T* to = out + static_cast<std::size_t>(a) * field + at;
          store<T>(load<T>(to) + shape * vector[a], to);
        }
      });
    }
    for (std::size_t i = rows_of_plane * begin; i < rows_of_plane * end; ++i)
      for (std::size_t x = 0; x < length; ++x)
        for (int a = 0; a < Dim; ++a)
          velocity[Dim * (length * i + x) + a] += by_component_[static_cast<std::size_t>(a) * field + row * i + x];
  }
}

/// What a dual of the velocity pulls at an element, with shape = product of f_k(r_k) and g = vector . dual: sums over
/// the sites of shape times dual and, if it `Moves`, of g f_k' (product of the others), and the turning moments of the
/// latter. Axes only turn, so what they would stretch or shear does not count: pairs k < l, r_l times term k less r_k
/// times term l.
template <int Dim, class T>
template <bool Moves>
auto OrientedMomenta<Dim, T>::pull(const Orientation& orientation, const Placement& place,
                                   const Eigen::Matrix<T, Dim, 1>& vector) const -> Pull {
  constexpr int kPairs = Dim * (Dim - 1) / 2;
  const std::size_t field = padded_row() * (sites_ / static_cast<std::size_t>(options_.lattice.size[0]));
  AveragedWendland<T> p[Dim];
  std::copy_n(orientation.profiles, Dim, p);
  T v[Dim];
  for (int a = 0; a < Dim; ++a) v[a] = vector[a];
  const T* dual = by_component_.data();
  Register<T> pulled[Dim] = {}, force[Dim] = {}, turning[kPairs] = {};
  visit_lanes(orientation, place, 0, options_.lattice.size[Dim - 1], [&](std::size_t at, const Register<T>* r) {
    typename AveragedWendland<T>::template Ends<Register<T>> ends[Dim];
    Register<T> own[Dim], f[Dim];
    for (int k = 0; k < Dim; ++k) {
      own[k] = load<T>(dual + static_cast<std::size_t>(k) * field + at);
      ends[k] = p[k].ends(r[k]);
      f[k] = k == 0 ? p[k].slope_shape(ends[k]) : p[k].value_shape(ends[k]);
    }
    Register<T> shape = f[0] * f[1];
    if constexpr (Dim == 3) shape *= f[2];
    for (int a = 0; a < Dim; ++a) pulled[a] += shape * own[a];
    if constexpr (Moves) {
      Register<T> g = v[0] * own[0];
      for (int a = 1; a < Dim; ++a) g += v[a] * own[a];
      Register<T> term[Dim];
      for (int k = 0; k < Dim; ++k) {
        term[k] = g * (k == 0 ? p[k].slope_shape_derivative(ends[k]) : p[k].value_shape_derivative(ends[k]));
        for (int other = 0; other < Dim; ++other)
          if (other != k) term[k] *= f[other];
        force[k] += term[k];
      }
      for (int k = 0, pair = 0; k < Dim; ++k)
        for (int l = k + 1; l < Dim; ++l, ++pair) turning[pair] += term[k] * r[l] - term[l] * r[k];
    }
  });
  const T scale = shape_scale(orientation);
  const auto total = [scale](const Register<T>& lanes) {
    T sum = 0;
    for (std::size_t i = 0; i < kRegisterLanes<T>; ++i) sum += lanes[i];
    return scale * sum;
  };
  Pull found;
  for (int k = 0, pair = 0; k < Dim; ++k) {
    found.pulled[k] = total(pulled[k]);
    found.force[k] = total(force[k]);
    found.turning(k, k) = 0;
    for (int l = k + 1; l < Dim; ++l, ++pair) {
      found.turning(k, l) = total(turning[pair]) / 2;
      found.turning(l, k) = -found.turning(k, l);
    }
  }
  return found;
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_velocity_adjoint(const std::vector<Element>& elements, const T* corners,
                                                   const T* momenta, const T* velocity_dual, T* momenta_dual,
                                                   T* corners_dual) const {
  using Column = Eigen::Matrix<T, Dim, 1>;
  if (elements.empty()) return;
  const auto length = static_cast<std::size_t>(options_.lattice.size[0]);
  const std::size_t row = padded_row(), rows = sites_ / length, field = row * rows;
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  by_component_.resize(Dim * field);
#pragma omp parallel for schedule(static)
  for (std::size_t i = 0; i < rows; ++i)
    for (int a = 0; a < Dim; ++a) {
      T* to = by_component_.data() + static_cast<std::size_t>(a) * field + row * i;
      for (std::size_t x = 0; x < length; ++x) to[x] = velocity_dual[Dim * (length * i + x) + a];
      std::fill(to + length, to + row, T(0));  // lanes beyond the row count nothing
    }
#pragma omp parallel for schedule(dynamic, 16)
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const Orientation& orientation = orientations_[normal_of(elements[e])];
    const Placement place = placement(corners + kCornerValues * e);
    const T* c = momenta + kComponents * e;
    const bool moves = corners_dual && !std::all_of(c, c + kComponents, [](T value) { return value == T(0); });
    Column vector = Column::Zero();  // the momentum
    for (int j = 1; j < Dim; ++j) vector += factor * c[j - 1] * place.axes.row(j).transpose();
    const Pull found = moves ? pull<true>(orientation, place, vector) : pull<false>(orientation, place, vector);
    for (int j = 1; j < Dim; ++j)
      momenta_dual[kComponents * e + j - 1] += factor * place.axes.row(j).dot(found.pulled.transpose());
    if (!moves) continue;
    // r_k = axes_k . (x - at): x - at = sum over l of r_l axes_l.
    const Column at_dual = -(place.axes.transpose() * found.force);
    Eigen::Matrix<T, Dim, Dim> axes_dual = found.turning * place.axes;
    for (int j = 1; j < Dim; ++j) axes_dual.row(j) += factor * c[j - 1] * found.pulled.transpose();
    corners_adjoint<Dim, T>(corners + kCornerValues * e, at_dual, axes_dual, corners_dual + kCornerValues * e);
  }
}

template void OrientedMomenta<2, float>::add_velocity(const std::vector<Element>&, const float*, const float*,
                                                      float*) const;
template void OrientedMomenta<2, float>::add_velocity_adjoint(const std::vector<Element>&, const float*, const float*,
                                                              const float*, float*, float*) const;
template void OrientedMomenta<2, double>::add_velocity(const std::vector<Element>&, const double*, const double*,
                                                       double*) const;
template void OrientedMomenta<2, double>::add_velocity_adjoint(const std::vector<Element>&, const double*,
                                                               const double*, const double*, double*, double*) const;
template void OrientedMomenta<3, float>::add_velocity(const std::vector<Element>&, const float*, const float*,
                                                      float*) const;
template void OrientedMomenta<3, float>::add_velocity_adjoint(const std::vector<Element>&, const float*, const float*,
                                                              const float*, float*, float*) const;
template void OrientedMomenta<3, double>::add_velocity(const std::vector<Element>&, const double*, const double*,
                                                       double*) const;
template void OrientedMomenta<3, double>::add_velocity_adjoint(const std::vector<Element>&, const double*,
                                                               const double*, const double*, double*, double*) const;

}  // namespace saltus
