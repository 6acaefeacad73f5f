#include "core/momenta/element_lanes.h"
#include "core/momenta/oriented_momenta.h"
#include "core/support/reduction.h"

#include <algorithm>
#include <array>

// The velocity and the energy of transported elements.

namespace saltus {
namespace {

/// Values V and slopes S of an element's profiles at one register of sites.
template <int Dim, class T>
struct Shapes {
  using V = Register<T>;
  using Ends = typename AveragedWendland<T>::template Ends<V>;
  Ends ends[Dim];
  V value[Dim], slope[Dim];

  Shapes(const AveragedWendland<T>* p, const V* r) {
    for (int k = 0; k < Dim; ++k) {
      ends[k] = p[k].ends(r[k]);
      value[k] = p[k].value_scale * p[k].value_shape(ends[k]);
      slope[k] = p[k].slope_scale * p[k].slope_shape(ends[k]);
    }
  }
  /// Product of the values along the axes other than these.
  V others(int k, int l = -1) const {
    V product{};
    product += T(1);
    for (int axis = 0; axis < Dim; ++axis)
      if (axis != k && axis != l) product *= value[axis];
    return product;
  }
};

/// An element's profiles, with all slopes in units of sigma along the normal: what a derivative along any N is told in.
template <int Dim, class T>
std::array<AveragedWendland<T>, Dim> in_units_of_normal(const AveragedWendland<T> (&profiles)[Dim]) {
  std::array<AveragedWendland<T>, Dim> p;
  std::copy_n(profiles, Dim, p.begin());
  for (int k = 1; k < Dim; ++k) p[k].slope_scale *= p[0].sigma / p[k].sigma;
  return p;
}

template <int Dim, class T>
bool is_idle(const T* momentum) {
  return std::all_of(momentum, momentum + Dim - 1, [](T value) { return value == T(0); });
}

}  // namespace

template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_transported(const std::vector<Element>& elements,
                                              const std::vector<TransportedElement<Dim, T>>& transported,
                                              const T* at_start, T* velocity) const {
  if (elements.empty()) return;
  using Column = Eigen::Matrix<T, Dim, 1>;
  PaddedField<Dim, T> sum(options_.lattice, by_component_);
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  sum.clear();
  for_ranges_of_planes(options_.lattice.size[Dim - 1], kPlanesTogether<Dim>, [&](int begin, int end) {
    for (std::size_t e = 0; e < elements.size(); ++e) {
      if (is_idle<Dim, T>(at_start + kComponents * e)) continue;
      const TransportedElement<Dim, T>& one = transported[e];
      const Orientation& orientation = orientations_[normal_of(elements[e])];
      const Column along = one.place.axes * one.derivative, first = factor * one.first, zeroth = factor * one.zeroth;
      const auto p = in_units_of_normal<Dim, T>(orientation.profiles);
      visit_lanes<Dim, T>(options_.lattice, orientation.reaches(), one.place, begin, end,
                          [&](std::size_t at, const Register<T>* r) {
                            const Shapes<Dim, T> shapes(p.data(), r);
                            Register<T> derived{};
                            for (int k = 0; k < Dim; ++k) derived += along[k] * shapes.slope[k] * shapes.others(k);
                            const Register<T> whole = shapes.others(-1);
                            for (int a = 0; a < Dim; ++a) {
                              T* to = sum.component(a) + at;
                              store<T>(load<T>(to) + (derived * first[a] + whole * zeroth[a]), to);
                            }
                          });
    }
    sum.add_to(velocity, begin, end);
  });
}

/// Duals of what one element is, from that of the velocity in `by_component_`; of N and the position if it `Moves`.
template <int Dim, class T>
template <bool Moves>
TransportedElement<Dim, T> OrientedMomenta<Dim, T>::transported_dual(const Orientation& orientation,
                                                                     const TransportedElement<Dim, T>& one) const {
  using Column = Eigen::Matrix<T, Dim, 1>;
  const PaddedField<Dim, T> dual(options_.lattice, by_component_);
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  const T per_sigma = static_cast<T>(1 / options_.normal_width_mm());
  const Column along = one.place.axes * one.derivative, first = factor * one.first, zeroth = factor * one.zeroth;
  const auto p = in_units_of_normal<Dim, T>(orientation.profiles);
  Register<T> to_first[Dim] = {}, to_zeroth[Dim] = {}, to_along[Dim] = {}, force[Dim] = {};
  visit_lanes<Dim, T>(options_.lattice, orientation.reaches(), one.place, 0, options_.lattice.size[Dim - 1],
                      [&](std::size_t at, const Register<T>* r) {
                        const Shapes<Dim, T> shapes(p.data(), r);
                        Register<T> derived{}, of_first{}, of_zeroth{};
                        for (int k = 0; k < Dim; ++k) derived += along[k] * shapes.slope[k] * shapes.others(k);
                        const Register<T> whole = shapes.others(-1);
                        for (int a = 0; a < Dim; ++a) {
                          const Register<T> d = load<T>(dual.component(a) + at);
                          to_first[a] += derived * d;
                          to_zeroth[a] += whole * d;
                          of_first += first[a] * d;
                          of_zeroth += zeroth[a] * d;
                        }
                        for (int k = 0; Moves && k < Dim; ++k) {
                          const Register<T> others = shapes.others(k);
                          to_along[k] += of_first * shapes.slope[k] * others;
                          Register<T> bend =
                              along[k] * p[k].slope_scale * p[k].slope_shape_derivative(shapes.ends[k]) * others;
                          for (int j = 0; j < Dim; ++j)
                            if (j != k)
                              bend += along[j] * per_sigma * shapes.slope[j] * shapes.slope[k] * shapes.others(j, k);
                          force[k] += of_first * bend + of_zeroth * (per_sigma * shapes.slope[k] * others);
                        }
                      });
  TransportedElement<Dim, T> out{};
  Column of_along, of_place;
  for (int a = 0; a < Dim; ++a) {
    out.first[a] = factor * sum_of<T>(to_first[a]);
    out.zeroth[a] = factor * sum_of<T>(to_zeroth[a]);
    of_along[a] = sum_of<T>(to_along[a]);
    of_place[a] = -sum_of<T>(force[a]);
  }
  out.derivative = one.place.axes.transpose() * of_along;
  out.place.at = one.place.axes.transpose() * of_place;
  return out;
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_transported_adjoint(const std::vector<Element>& elements,
                                                      const std::vector<TransportedElement<Dim, T>>& transported,
                                                      const T* at_start, const T* velocity_dual, bool moves,
                                                      std::vector<TransportedElement<Dim, T>>& duals) const {
  if (elements.empty()) return;
  PaddedField<Dim, T>(options_.lattice, by_component_).assign(velocity_dual);
#pragma omp parallel for schedule(dynamic, 16)
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const Orientation& orientation = orientations_[normal_of(elements[e])];
    duals[e] = moves && !is_idle<Dim, T>(at_start + kComponents * e)
                   ? transported_dual<true>(orientation, transported[e])
                   : transported_dual<false>(orientation, transported[e]);
  }
}

template <int Dim, class T>
double OrientedMomenta<Dim, T>::energy(const std::vector<Element>& elements,
                                       const std::vector<TransportedElement<Dim, T>>& transported) const {
  using Column = Eigen::Matrix<double, Dim, 1>;
  const double factor = options_.weight * options_.lattice.cell_volume() * options_.lattice.cell_volume();
  // What one pulls at another.
  const auto product = [&](std::size_t e, std::size_t f) {
    if (normal_of(elements[e]) != normal_of(elements[f])) return 0.0;
    const Orientation& orientation = orientations_[normal_of(elements[e])];
    const auto& one = transported[e];
    const auto& other = transported[f];
    const Column apart =
        orientation.axes * (one.place.at.template cast<double>() - other.place.at.template cast<double>());
    double value[Dim], cross[Dim], slope[Dim];
    for (int k = 0; k < Dim; ++k) {
      const AveragedWendland<double> p(k == 0 ? options_.normal_width_mm() : options_.width_mm,
                                       2 * static_cast<double>(orientation.profiles[k].half));
      if (std::abs(apart[k]) > p.sigma + 2 * p.half) return 0.0;
      const double unit = options_.normal_width_mm() / p.sigma;  // see in_units_of_normal
      value[k] = p.value_gram(apart[k]);
      cross[k] = unit * p.cross_gram(apart[k]);
      slope[k] = unit * unit * p.slope_gram(apart[k]);
    }
    const auto others = [&](int k, int l) {
      double rest = 1;
      for (int axis = 0; axis < Dim; ++axis)
        if (axis != k && axis != l) rest *= value[axis];
      return rest;
    };
    const auto as_double = [](const auto& column) { return Column(column.template cast<double>()); };
    const Column from = orientation.axes * as_double(one.derivative),
                 to = orientation.axes * as_double(other.derivative);
    const Column first = as_double(one.first), zeroth = as_double(one.zeroth);
    const Column other_first = as_double(other.first), other_zeroth = as_double(other.zeroth);
    double sum = zeroth.dot(other_zeroth) * others(-1, -1);
    for (int k = 0; k < Dim; ++k) {
      sum += (zeroth.dot(other_first) * to[k] - first.dot(other_zeroth) * from[k]) * cross[k] * others(k, -1);
      for (int l = 0; l < Dim; ++l)
        sum += first.dot(other_first) * from[k] * to[l] *
               (k == l ? slope[k] * others(k, -1) : -cross[k] * cross[l] * others(k, l));
    }
    return sum;
  };
  return factor / 2 * ordered_sum(elements.size(), [&](std::size_t e) {
           double row = product(e, e);
           for (std::size_t f = 0; f < e; ++f) row += 2 * product(e, f);
           return row;
         });
}

#define SALTUS_OF_TRANSPORTED(Dim, T)                                                                        \
  template void OrientedMomenta<Dim, T>::add_transported(                                                    \
      const std::vector<Element>&, const std::vector<TransportedElement<Dim, T>>&, const T*, T*) const;      \
  template void OrientedMomenta<Dim, T>::add_transported_adjoint(                                            \
      const std::vector<Element>&, const std::vector<TransportedElement<Dim, T>>&, const T*, const T*, bool, \
      std::vector<TransportedElement<Dim, T>>&) const;                                                       \
  template double OrientedMomenta<Dim, T>::energy(const std::vector<Element>&,                               \
                                                  const std::vector<TransportedElement<Dim, T>>&) const;
SALTUS_OF_TRANSPORTED(2, float)
SALTUS_OF_TRANSPORTED(3, float)
SALTUS_OF_TRANSPORTED(2, double)
SALTUS_OF_TRANSPORTED(3, double)
#undef SALTUS_OF_TRANSPORTED

}  // namespace saltus
