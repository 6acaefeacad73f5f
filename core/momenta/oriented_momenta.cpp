#include "core/momenta/oriented_momenta.h"

#include "core/support/errors.h"
#include "core/support/reduction.h"
#include "core/support/registers.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
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

/// Width of a site's cell along a direction: that of a cube is the same for all.
template <int Dim>
double cell_along(const Lattice<Dim>& lattice, const Vec<Dim>& direction) {
  double square = 0;
  for (int a = 0; a < Dim; ++a) square += std::pow(direction[a] * lattice.spacing[a], 2);
  return std::sqrt(square);
}

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
  const Lattice<Dim>& lattice = options_.lattice;
  Lattice<Dim> sparse = lattice;  // of what has room along all axes
  for (int a = 0; a < Dim; ++a) {
    const double in_half_a_width = std::floor(options.width_mm / 2 / lattice.spacing[a] + 1e-9);
    apart_[a] = static_cast<int>(std::clamp(in_half_a_width, 1.0, static_cast<double>(options.spacing)));
    sparse.spacing[a] *= apart_[a];
  }
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
      exact[k] = AveragedWendland<double>(options_.width_mm, cell);
      orientation.profiles[k] = AveragedWendland<T>(options_.width_mm, cell);
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
bool OrientedMomenta<Dim, T>::has_room(Element element) const {
  std::size_t rest = site_of(element);
  for (int a = 0; a < Dim; ++a) {
    const auto length = static_cast<std::size_t>(options_.lattice.size[a]);
    if (a != steepest_axis(normal_of(element)) && rest % length % static_cast<std::size_t>(apart_[a]) != 0)
      return false;
    rest /= length;
  }
  return true;
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::turn(std::vector<T> normals) {
  ++turns_;
  turned_normals_ = std::move(normals);
  turned_.clear();
  candidates_.clear();
  if (turned_normals_.empty()) return;
  for (std::size_t site = 0; site < sites_; ++site) {
    Eigen::Map<Eigen::Matrix<T, Dim, 1>> n(turned_normals_.data() + Dim * site);
    if (n.squaredNorm() == T(0)) continue;
    double most = 0;
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < orientations_.size(); ++k) {
      const double along = n.template cast<double>().dot(options_.normals[k]);
      if (std::abs(along) <= std::abs(most)) continue;
      most = along;
      nearest = k;
    }
    if (most < 0) n = -n;
    turned_.push_back(static_cast<Element>(nearest * sites_ + site));
  }
  std::sort(turned_.begin(), turned_.end());
  std::copy_if(turned_.begin(), turned_.end(), std::back_inserter(candidates_), [&](Element e) { return has_room(e); });
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
      T vector[Dim] = {};
      for (int j = 1; j < Dim; ++j)
        for (int a = 0; a < Dim; ++a) vector[a] += factor * c[j - 1] * place.axes(j, a);
      const Orientation& orientation = orientations_[normal_of(elements[e])];
      AveragedWendland<T> p[Dim];
      std::copy_n(orientation.profiles, Dim, p);
      T* out = by_component_.data();
      visit_lanes(orientation, place, begin, end, [&](std::size_t at, const Register<T>* r) {
        Register<T> shape = p[0].slope(p[0].ends(r[0]));
        for (int k = 1; k < Dim; ++k) shape *= p[k].value(p[k].ends(r[k]));
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
      f[k] = k == 0 ? p[k].slope(ends[k]) : p[k].value(ends[k]);
    }
    Register<T> shape = f[0] * f[1];
    if constexpr (Dim == 3) shape *= f[2];
    for (int a = 0; a < Dim; ++a) pulled[a] += shape * own[a];
    if constexpr (Moves) {
      Register<T> g = v[0] * own[0];
      for (int a = 1; a < Dim; ++a) g += v[a] * own[a];
      Register<T> term[Dim];
      for (int k = 0; k < Dim; ++k) {
        term[k] = g * (k == 0 ? p[k].slope_derivative(ends[k]) : p[k].slope(ends[k]) * p[k].per_sigma);
        for (int other = 0; other < Dim; ++other)
          if (other != k) term[k] *= f[other];
        force[k] += term[k];
      }
      for (int k = 0, pair = 0; k < Dim; ++k)
        for (int l = k + 1; l < Dim; ++l, ++pair) turning[pair] += term[k] * r[l] - term[l] * r[k];
    }
  });
  const auto total = [](const Register<T>& lanes) {
    T sum = 0;
    for (std::size_t i = 0; i < kRegisterLanes<T>; ++i) sum += lanes[i];
    return sum;
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

template <int Dim, class T>
double OrientedMomenta<Dim, T>::penalty(const std::vector<Element>& elements, const T* momenta, T* gradient) const {
  const Lattice<Dim>& lattice = options_.lattice;
  const auto length = static_cast<std::size_t>(lattice.size[0]);
  std::vector<double> product(elements.size());  // momentum times its gradient
  // Of the elements with one normal those that have a momentum, by rows along x.
  std::vector<std::size_t> row_begin(sites_ / length + 1), moving;
  std::vector<int> x_of;
  for (std::size_t begin = 0; begin < elements.size();) {
    const std::size_t normal = normal_of(elements[begin]);
    std::size_t end = begin, row = 0;
    moving.clear();
    x_of.clear();
    for (; end < elements.size() && normal_of(elements[end]) == normal; ++end) {
      const T* c = momenta + kComponents * end;
      if (std::all_of(c, c + kComponents, [](T value) { return value == T(0); })) continue;
      const std::size_t site = site_of(elements[end]);
      while (row <= site / length) row_begin[row++] = moving.size();
      moving.push_back(end);
      x_of.push_back(static_cast<int>(site % length));
    }
    while (row < row_begin.size()) row_begin[row++] = moving.size();
    const Orientation& orientation = orientations_[normal];
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
      for (int z = planes_begin; z < planes_end; ++z)
        for (int y = low[1]; y < high[1]; ++y) {
          std::size_t line = static_cast<std::size_t>(y),
                      tap = static_cast<std::size_t>(y - at[1] + orientation.reach[1]);
          if constexpr (Dim == 3) {
            line += static_cast<std::size_t>(lattice.size[1]) * static_cast<std::size_t>(z);
            tap += static_cast<std::size_t>(2 * orientation.reach[1] + 1) *
                   static_cast<std::size_t>(z - at[2] + orientation.reach[2]);
          }
          const T* taps = orientation.gram.data() + static_cast<std::size_t>(2 * orientation.reach[0] + 1) * tap +
                          (orientation.reach[0] - at[0]);
          for (std::size_t i = row_begin[line]; i < row_begin[line + 1]; ++i) {
            if (x_of[i] < low[0] || x_of[i] >= high[0]) continue;
            for (int j = 0; j < kComponents; ++j) sum[j] += taps[x_of[i]] * momenta[kComponents * moving[i] + j];
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
         AveragedWendland<double>(options_.width_mm, cell).slope_gram(0);
}

template class OrientedMomenta<2, float>;
template class OrientedMomenta<3, float>;
template class OrientedMomenta<2, double>;
template class OrientedMomenta<3, double>;

}  // namespace saltus
