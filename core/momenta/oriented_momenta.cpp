#include "core/momenta/oriented_momenta.h"

#include "core/support/errors.h"
#include "core/support/reduction.h"
#include "core/support/registers.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>

#ifdef _OPENMP
#include <omp.h>
#endif

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
    Index<Dim> taps;
    for (int a = 0; a < Dim; ++a) {
      double extent = 0;
      for (int k = 0; k < Dim; ++k) extent += std::abs(orientation.axes(k, a)) * (exact[k].sigma + 2 * exact[k].half);
      orientation.reach[a] = static_cast<int>(std::ceil(extent / lattice.spacing[a]));
      taps[a] = 2 * orientation.reach[a] + 1;
    }
    const double factor = options_.weight * lattice.cell_volume() * lattice.cell_volume();
    constexpr std::size_t lanes = kRegisterLanes<T>;
    orientation.row_of_taps = (static_cast<std::size_t>(taps[0]) + lanes - 1) / lanes * lanes;
    const std::size_t rows =
        static_cast<std::size_t>(std::accumulate(taps.begin() + 1, taps.end(), 1, std::multiplies()));
    orientation.gram.assign(orientation.row_of_taps * rows, T(0));
    for (std::size_t row = 0; row < rows; ++row)
      for (int x = 0; x < taps[0]; ++x) {
        Index<Dim> at{x, static_cast<int>(row) % taps[1]};
        if constexpr (Dim == 3) at[2] = static_cast<int>(row) / taps[1];
        Vec<Dim> apart;
        for (int a = 0; a < Dim; ++a) apart[a] = (at[a] - orientation.reach[a]) * lattice.spacing[a];
        const Vec<Dim> turned = orientation.axes * apart;
        double gram = factor * exact[0].slope_gram(turned[0]);
        for (int k = 1; k < Dim; ++k) gram *= exact[k].value_gram(turned[k]);
        orientation.gram[orientation.row_of_taps * row + static_cast<std::size_t>(x)] = static_cast<T>(gram);
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
  std::vector<T>& forces = penalty_.forces;
  std::vector<Index<Dim>>& sites = penalty_.sites;
  forces.assign(kComponents * elements.size(), T(0));
  sites.resize(elements.size());
  for (std::size_t begin = 0; begin < elements.size();) {
    const std::size_t normal = normal_of(elements[begin]);
    std::size_t end = begin;
    for (; end < elements.size() && elements[end] < (normal + 1) * sites_; ++end) {
      auto rest = static_cast<std::uint32_t>(elements[end] - normal * sites_);
      for (int a = 0; a < Dim; ++a) {
        const auto length = static_cast<std::uint32_t>(options_.lattice.size[a]);
        sites[end][a] = static_cast<int>(rest % length);
        rest /= length;
      }
    }
    const std::size_t at = kComponents * begin;
    add_forces(orientations_[normal], {sites.data() + begin, end - begin}, momenta + at, forces.data() + at);
    begin = end;
  }
  for (std::size_t i = 0; i < forces.size(); ++i) gradient[i] += forces[i];
  return ordered_sum(forces.size(), [&](std::size_t i) { return static_cast<double>(momenta[i]) * forces[i]; }) / 2;
}

/// forces += gram * momenta, of the elements with one normal at these sites (rising). The momenta of one plane at a
/// time are laid out as a field, 0 between them and beyond the ends of its rows: so a row of taps meets values that
/// follow each other, and nobody has to find out who is near.
template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_forces(const Orientation& orientation, std::span<const Index<Dim>> sites,
                                         const T* momenta, T* forces) const {
  const int rows = options_.lattice.size[1], planes = Dim == 3 ? options_.lattice.size[Dim - 1] : 1;
  const int reach_y = orientation.reach[1], reach_z = Dim == 3 ? orientation.reach[Dim - 1] : 0;
  const std::size_t row = static_cast<std::size_t>(options_.lattice.size[0]) + orientation.row_of_taps;
  const std::size_t plane = row * static_cast<std::size_t>(rows);
  const auto z_of = [&](std::size_t e) { return Dim == 3 ? sites[e][Dim - 1] : 0; };

#ifdef _OPENMP
  const std::size_t parts = static_cast<std::size_t>(omp_get_max_threads());
#else
  const std::size_t parts = 1;
#endif
  penalty_.planes.resize(std::max(parts, penalty_.planes.size()));
  for (std::vector<T>& field : penalty_.planes)  // 0 whenever nobody is at work on it
    field.resize(std::max(field.size(), kComponents * plane), T(0));
#pragma omp parallel for schedule(static, 1)
  for (std::size_t part = 0; part < parts; ++part) {
    const std::size_t part_begin = sites.size() * part / parts, part_end = sites.size() * (part + 1) / parts;
    if (part_begin == part_end) continue;
    std::vector<T>& field = penalty_.planes[part];
    const auto lay_out = [&](std::size_t e, auto value) {
      T* to = field.data() + row * static_cast<std::size_t>(sites[e][1]) +
              static_cast<std::size_t>(sites[e][0] + orientation.reach[0]);
      for (std::size_t c = 0; c < kComponents; ++c) to[c * plane] = value(c);
    };
    const int first = std::max(0, z_of(part_begin) - reach_z),
              last = std::min(planes - 1, z_of(part_end - 1) + reach_z);
    std::size_t source = 0, begin = part_begin, end = part_begin;
    while (source < sites.size() && z_of(source) < first) ++source;
    for (int z = first; z <= last; ++z) {
      const std::size_t sources = source;
      for (; source < sites.size() && z_of(source) == z; ++source)
        lay_out(source, [&](std::size_t c) { return momenta[kComponents * source + c]; });
      while (begin < part_end && z_of(begin) < z - reach_z) ++begin;
      while (end < part_end && z_of(end) <= z + reach_z) ++end;
      for (std::size_t e = begin; e < end && source > sources; ++e) {
        const int y = sites[e][1], low = std::max(0, y - reach_y), high = std::min(rows, y + reach_y + 1);
        const int rows_before = (2 * reach_y + 1) * (z - z_of(e) + reach_z) + low - y + reach_y;
        const T* taps = orientation.gram.data() + orientation.row_of_taps * static_cast<std::size_t>(rows_before);
        const T* values = field.data() + row * static_cast<std::size_t>(low) + static_cast<std::size_t>(sites[e][0]);
        Register<T> sums[kComponents] = {};
        for (int i = low; i < high; ++i, values += row)
          for (std::size_t x = 0; x < orientation.row_of_taps; x += kRegisterLanes<T>, taps += kRegisterLanes<T>)
            for (std::size_t c = 0; c < kComponents; ++c) sums[c] += load<T>(taps) * load<T>(values + c * plane + x);
        for (std::size_t c = 0; c < kComponents; ++c) forces[kComponents * e + c] += sum_of<T>(sums[c]);
      }
      for (std::size_t e = sources; e < source; ++e) lay_out(e, [](std::size_t) { return T(0); });
    }
  }
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
