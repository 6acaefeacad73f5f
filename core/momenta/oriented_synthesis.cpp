#include "core/momenta/oriented_momenta.h"

#include "core/momenta/element_lanes.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <numbers>

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
  PaddedField<Dim, T> sum(options_.lattice, by_component_);
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  sum.clear();
  for_ranges_of_planes(options_.lattice.size[Dim - 1], kPlanesTogether<Dim>, [&](int begin, int end) {
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
      T* out[Dim];
      for (int a = 0; a < Dim; ++a) out[a] = sum.component(a);
      visit_lanes<Dim, T>(options_.lattice, orientation.reaches(), place, begin, end,
                          [=](std::size_t at, const Register<T>* r) {
                            Register<T> shape = p[0].slope_shape(p[0].ends(r[0]));
                            for (int k = 1; k < Dim; ++k) shape *= p[k].value_shape(p[k].ends(r[k]));
                            for (int a = 0; a < Dim; ++a) {
                              T* to = out[a] + at;
                              store<T>(load<T>(to) + shape * vector[a], to);
                            }
                          });
    }
    sum.add_to(velocity, begin, end);
  });
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
  AveragedWendland<T> p[Dim];
  std::copy_n(orientation.profiles, Dim, p);
  T v[Dim];
  for (int a = 0; a < Dim; ++a) v[a] = vector[a];
  const PaddedField<Dim, T> duals(options_.lattice, by_component_);
  const T* dual[Dim];
  for (int a = 0; a < Dim; ++a) dual[a] = duals.component(a);
  Register<T> pulled[Dim] = {}, force[Dim] = {}, turning[kPairs] = {};
  visit_lanes<Dim, T>(
      options_.lattice, orientation.reaches(), place, 0, options_.lattice.size[Dim - 1],
      [&](std::size_t at, const Register<T>* r) {
        typename AveragedWendland<T>::template Ends<Register<T>> ends[Dim];
        Register<T> own[Dim], f[Dim];
        for (int k = 0; k < Dim; ++k) {
          own[k] = load<T>(dual[k] + at);
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
  const auto total = [scale](const Register<T>& lanes) { return scale * sum_of<T>(lanes); };
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
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  PaddedField<Dim, T>(options_.lattice, by_component_).assign(velocity_dual);
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
