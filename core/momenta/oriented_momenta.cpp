#include "core/momenta/oriented_momenta.h"

#include "core/support/errors.h"
#include "core/support/reduction.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>

namespace saltus {
namespace {

/// Distance of an element's corners from its middle, in cells: far enough not to see where samples lie, near enough to
/// see how an interface is curved.
constexpr double kCornerDistance = 2;
constexpr double kUnitLength = 1e-6;

template <int Dim>
using Vec = Eigen::Matrix<double, Dim, 1>;

/// Rows n, t_1, ..: right-handed.
template <int Dim>
Eigen::Matrix<double, Dim, Dim> axes_of(const Vec<Dim>& normal) {
  Eigen::Matrix<double, Dim, Dim> axes;
  axes.row(0) = normal.transpose();
  if constexpr (Dim == 2) {
    axes.row(1) << -normal[1], normal[0];
  } else {
    int least = 0;
    for (int a = 1; a < 3; ++a)
      if (std::abs(normal[a]) < std::abs(normal[least])) least = a;
    const Vec<3> first = normal.cross(Vec<3>::Unit(least)).normalized();
    axes.row(1) = first.transpose();
    axes.row(2) = normal.cross(first).transpose();
  }
  return axes;
}

}  // namespace

template <int Dim>
Index<Dim> sites_apart(const Lattice<Dim>& lattice, double width_mm, int spacing) {
  Index<Dim> apart{};
  for (int a = 0; a < Dim; ++a) {
    const double in_half_a_width = std::floor(width_mm / 2 / lattice.spacing[a] + 1e-9);
    apart[a] = static_cast<int>(std::clamp(in_half_a_width, 1.0, static_cast<double>(spacing)));
  }
  return apart;
}

template <int Dim>
std::size_t sites_with_room(const Lattice<Dim>& lattice, double width_mm, int spacing) {
  const Index<Dim> apart = sites_apart(lattice, width_mm, spacing);
  std::size_t count = 0;
  for (int free = -1; free < Dim; ++free) {  // the axis along which a site is no multiple; none
    std::size_t sites = 1;
    for (int a = 0; a < Dim; ++a) {
      const int multiples = (lattice.size[a] + apart[a] - 1) / apart[a];
      sites *= static_cast<std::size_t>(a == free ? lattice.size[a] - multiples : multiples);
    }
    count += sites;
  }
  return count;
}

template <int Dim, class T>
OrientedMomenta<Dim, T>::OrientedMomenta(const OrientedOptions<Dim>& options)
    : options_(options), sites_(options.lattice.sites()) {
  if (sites_ > std::numeric_limits<Element>::max() / std::max<std::size_t>(1, options.normals.size()))
    throw InvalidInput("a lattice of " + std::to_string(sites_) + " sites is too large for " +
                       std::to_string(options.normals.size()) +
                       " oblique normals; set orientations to 0 or end at a coarser level");
  if (options.spacing < 1)
    throw InvalidInput("the spacing of oriented momenta is " + std::to_string(options.spacing) +
                       "; it must be 1 or more");
  if (!(options.normal_share > 0))
    throw InvalidInput("the width of oriented momenta along their normal is " + std::to_string(options.normal_share) +
                       " times that in their plane; it must be above 0");
  const Lattice<Dim>& lattice = options_.lattice;
  apart_ = sites_apart(lattice, options.width_mm, options.spacing);
  Lattice<Dim> sparse = lattice;  // of what has room along all axes
  for (int a = 0; a < Dim; ++a) sparse.spacing[a] *= apart_[a];
  for (const Vec<Dim>& normal : options_.normals) {
    if (!(std::abs(normal.norm() - 1) < kUnitLength))
      throw InvalidInput("a normal of oriented momenta has length " + std::to_string(normal.norm()) + "; it must be 1");
    Orientation orientation;
    orientation.axes = axes_of<Dim>(normal);
    for (int a = 1; a < Dim; ++a)
      if (std::abs(normal[a]) * lattice.spacing[a] >
          (1 + kUnitLength) * std::abs(normal[orientation.steepest]) * lattice.spacing[orientation.steepest])
        orientation.steepest = a;
    AveragedWendland<double> exact[Dim];
    for (int k = 0; k < Dim; ++k) {
      const double cell = cell_along<Dim>(k == 0 ? lattice : sparse, orientation.axes.row(k).transpose());
      const double width = k == 0 ? options_.normal_width_mm() : options_.width_mm;
      exact[k] = AveragedWendland<double>(width, cell);
      orientation.profiles[k] = AveragedWendland<T>(width, cell);
    }
    std::size_t count = 1;
    for (int a = 0; a < Dim; ++a) {
      double extent = 0;
      for (int k = 0; k < Dim; ++k) extent += std::abs(orientation.axes(k, a)) * (exact[k].sigma + 2 * exact[k].half);
      orientation.reach[a] = static_cast<int>(std::ceil(extent / lattice.spacing[a]));
      count *= static_cast<std::size_t>(2 * orientation.reach[a] + 1);
    }
    const double factor = options_.weight * lattice.cell_volume() * lattice.cell_volume();
    for (std::size_t i = 0; i < count; ++i) {
      std::size_t rest = i;
      Vec<Dim> apart;
      for (int a = 0; a < Dim; ++a) {
        const std::size_t length = static_cast<std::size_t>(2 * orientation.reach[a] + 1);
        apart[a] = (static_cast<int>(rest % length) - orientation.reach[a]) * lattice.spacing[a];
        rest /= length;
      }
      const Vec<Dim> turned = orientation.axes * apart;
      double gram = factor * exact[0].slope_gram(turned[0]);
      for (int k = 1; k < Dim; ++k) gram *= exact[k].value_gram(turned[k]);
      orientation.gram.push_back(static_cast<T>(gram));
    }
    orientations_.push_back(std::move(orientation));
  }
}

template <int Dim, class T>
double OrientedMomenta<Dim, T>::sites_of_each(std::size_t normal) const {
  double sites = 1;
  for (int a = 0; a < Dim; ++a)
    if (a != steepest_axis(normal)) sites *= apart_[a];
  return sites;
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::place(const std::vector<Element>& elements, std::vector<T>& corners) const {
  const Lattice<Dim>& lattice = options_.lattice;
  corners.resize(kCornerValues * elements.size());
#pragma omp parallel for schedule(static)
  for (std::size_t e = 0; e < elements.size(); ++e) {
    Eigen::Matrix<double, Dim, Dim> axes = orientations_[normal_of(elements[e])].axes;
    const std::size_t site = site_of(elements[e]);
    if (std::binary_search(turned_.begin(), turned_.end(), elements[e])) {
      const Vec<Dim> from = axes.row(0).transpose();
      const Vec<Dim> to =
          Eigen::Map<const Eigen::Matrix<T, Dim, 1>>(turned_normals_.data() + Dim * site).template cast<double>();
      const Vec<Dim> both = from + to;
      for (int j = 1; j < Dim; ++j) axes.row(j) -= axes.row(j).dot(to) / (1 + from.dot(to)) * both.transpose();
      axes.row(0) = to.transpose();
    }
    Vec<Dim> at;
    std::size_t rest = site;
    for (int a = 0; a < Dim; ++a) {
      const std::size_t length = static_cast<std::size_t>(lattice.size[a]);
      at[a] = lattice.offset[a] + static_cast<double>(rest % length) * lattice.spacing[a];
      rest /= length;
    }
    for (int k = 0; k < Dim; ++k) {
      Vec<Dim> corner = at;
      const double turn = 2 * std::numbers::pi * k / Dim;
      for (int j = 1; j < Dim; ++j) {
        const Vec<Dim> axis = axes.row(j).transpose();
        corner += kCornerDistance * cell_along<Dim>(lattice, axis) * (j == 1 ? std::cos(turn) : std::sin(turn)) * axis;
      }
      for (int a = 0; a < Dim; ++a) corners[kCornerValues * e + Dim * k + a] = static_cast<T>(corner[a]);
    }
  }
}

template <int Dim, class T>
auto OrientedMomenta<Dim, T>::placement(const T* corners) -> Placement {
  using Column = Eigen::Matrix<T, Dim, 1>;
  const auto corner = [&](int k) { return Eigen::Map<const Column>(corners + Dim * k); };
  Placement place;
  if constexpr (Dim == 2) {
    place.at = (corner(0) + corner(1)) / 2;
    const Column t = (corner(0) - corner(1)).normalized();
    place.axes << t[1], -t[0], t[0], t[1];
  } else {
    place.at = (corner(0) + corner(1) + corner(2)) / 3;
    const Column first = (2 * corner(0) - corner(1) - corner(2)) / 3, second = corner(1) - corner(2);
    const Column n = first.cross(second).normalized(), t = first.normalized();
    place.axes.row(0) = n.transpose();
    place.axes.row(1) = t.transpose();
    place.axes.row(2) = n.cross(t).transpose();
  }
  return place;
}

template <int Dim, class T>
double OrientedMomenta<Dim, T>::penalty(const std::vector<Element>& elements, const T* momenta, T* gradient) const {
  const Lattice<Dim>& lattice = options_.lattice;
  const auto length = static_cast<std::size_t>(lattice.size[0]), rows = static_cast<std::size_t>(lattice.size[1]);
  const std::size_t lines = sites_ / length;
  std::vector<double> product(elements.size());  // momentum times its gradient
  // Of the elements with one normal those that have a momentum, and where those of each row begin: of rows that follow
  // each other they are one after the other.
  struct Moving {
    int x, tap;  ///< `tap`: from that of the plane's first site, as `gram` lies
    std::array<T, kComponents> momentum;
  };
  std::vector<Moving> moving;
  std::vector<std::size_t> row_begin(lines + 1);
  for (std::size_t begin = 0; begin < elements.size();) {
    const std::size_t normal = normal_of(elements[begin]);
    const Orientation& orientation = orientations_[normal];
    const int taps_in_row = 2 * orientation.reach[0] + 1, rows_of_taps = 2 * orientation.reach[1] + 1;
    std::size_t end = begin, row = 0;
    moving.clear();
    for (; end < elements.size() && normal_of(elements[end]) == normal; ++end) {
      const T* c = momenta + kComponents * end;
      if (std::all_of(c, c + kComponents, [](T value) { return value == T(0); })) continue;
      const std::size_t site = site_of(elements[end]);
      while (row <= site / length) row_begin[row++] = moving.size();
      const int x = static_cast<int>(site % length), y = static_cast<int>(site / length % rows);
      Moving one{x, taps_in_row * y + x, {}};
      std::copy_n(c, kComponents, one.momentum.begin());
      moving.push_back(one);
    }
    while (row < row_begin.size()) row_begin[row++] = moving.size();
#pragma omp parallel for schedule(static)
    for (std::size_t e = begin; e < end; ++e) {
      Index<Dim> at, low, high;
      std::size_t rest = site_of(elements[e]);
      for (int a = 0; a < Dim; ++a) {
        const std::size_t extent = static_cast<std::size_t>(lattice.size[a]);
        at[a] = static_cast<int>(rest % extent);
        rest /= extent;
        low[a] = std::max(0, at[a] - orientation.reach[a]);
        high[a] = std::min(lattice.size[a], at[a] + orientation.reach[a] + 1);
      }
      T sum[kComponents] = {};
      const int planes_begin = Dim == 3 ? low[Dim - 1] : 0, planes_end = Dim == 3 ? high[Dim - 1] : 1;
      for (int z = planes_begin; z < planes_end; ++z) {
        const std::size_t plane = rows * static_cast<std::size_t>(z);
        int first_tap = taps_in_row * (orientation.reach[1] - at[1]) + orientation.reach[0] - at[0];
        if constexpr (Dim == 3) first_tap += taps_in_row * rows_of_taps * (z - at[2] + orientation.reach[2]);
        const std::size_t last = row_begin[plane + static_cast<std::size_t>(high[1])];
        for (std::size_t i = row_begin[plane + static_cast<std::size_t>(low[1])]; i < last; ++i) {
          const Moving& other = moving[i];
          if (other.x < low[0] || other.x >= high[0]) continue;
          const T tap = orientation.gram[static_cast<std::size_t>(first_tap + other.tap)];
          for (std::size_t j = 0; j < kComponents; ++j) sum[j] += tap * other.momentum[j];
        }
      }
      for (int j = 0; j < kComponents; ++j) {
        gradient[kComponents * e + j] += sum[j];
        product[e] += static_cast<double>(momenta[kComponents * e + j]) * sum[j];
      }
    }
    begin = end;
  }
  return ordered_sum(product.size(), [&](std::size_t e) { return product[e]; }) / 2;
}

template <int Dim, class T>
double OrientedMomenta<Dim, T>::stiffness(std::size_t normal) const {
  const Vec<Dim> n = orientations_[normal].axes.row(0).transpose();
  const double cell = cell_along<Dim>(options_.lattice, n);
  return options_.weight * options_.lattice.cell_volume() * cell *
         AveragedWendland<double>(options_.normal_width_mm(), cell).slope_gram(0);
}

template Index<2> sites_apart<2>(const Lattice<2>&, double, int);
template Index<3> sites_apart<3>(const Lattice<3>&, double, int);
template std::size_t sites_with_room(const Lattice<2>&, double, int);
template std::size_t sites_with_room(const Lattice<3>&, double, int);
template class OrientedMomenta<2, float>;
template class OrientedMomenta<3, float>;
template class OrientedMomenta<2, double>;
template class OrientedMomenta<3, double>;

}  // namespace saltus
