#include "core/momenta/oriented_momenta.h"

#include "core/support/errors.h"
#include "core/support/reduction.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
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
  const Lattice<Dim>& lattice = options_.lattice;
  for (const Vec<Dim>& normal : options_.normals) {
    if (!(std::abs(normal.norm() - 1) < kUnitLength))
      throw InvalidInput("a normal of oriented momenta has length " + std::to_string(normal.norm()) + "; it must be 1");
    Orientation orientation;
    orientation.axes = axes_of<Dim>(normal);
    AveragedWendland<double> exact[Dim];
    for (int k = 0; k < Dim; ++k) {
      const double cell = cell_along<Dim>(lattice, orientation.axes.row(k).transpose());
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
void OrientedMomenta<Dim, T>::turn(std::vector<T> normals) {
  ++turns_;
  turned_normals_ = std::move(normals);
  turned_.clear();
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

/// Calls lanes(site, count, start, step) for the sites of the lattice that an element can reach, kLanes of a row along
/// x at a time, in planes [begin, end) of the last axis: `start` is the first site's place along the element's axes,
/// `step` from one site to the next. Of the lanes `count` lie in the row; those of them that lie beyond the element's
/// reach have a shape of 0.
template <int Dim, class T>
template <class Lanes>
void OrientedMomenta<Dim, T>::visit_lanes(const Orientation& orientation, const Placement& place, int begin, int end,
                                          Lanes&& lanes) const {
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
  T step[Dim], per_step[Dim];  // 0: what divides by nearly nothing leaves rows as they are
  for (int k = 0; k < Dim; ++k) {
    step[k] = place.axes(k, 0) * h;
    per_step[k] = std::abs(step[k]) < T(1e-3) * h ? T(0) : 1 / step[k];
  }
  const int planes_begin = Dim == 3 ? low[Dim - 1] : 0, planes_end = Dim == 3 ? high[Dim - 1] : 1;
  for (int z = planes_begin; z < planes_end; ++z)
    for (int y = low[1]; y < high[1]; ++y) {
      T across[Dim];  // along the axes at x = 0 of the row
      T least = static_cast<T>(low[0]), most = static_cast<T>(high[0] - 1);
      for (int k = 0; k < Dim; ++k) {
        across[k] =
            -place.axes(k, 0) * centre[0] + place.axes(k, 1) * (static_cast<T>(y * lattice.spacing[1]) - centre[1]);
        if constexpr (Dim == 3) across[k] += place.axes(k, 2) * (static_cast<T>(z * lattice.spacing[2]) - centre[2]);
        // |across + step x| <= reach
        if (per_step[k] == T(0)) continue;
        const T reach = orientation.profiles[k].reach();
        const T one = (-reach - across[k]) * per_step[k], other = (reach - across[k]) * per_step[k];
        least = std::max(least, std::min(one, other));
        most = std::min(most, std::max(one, other));
      }
      if (!(least <= most + 1)) continue;
      const int first = std::max(low[0], static_cast<int>(std::floor(least)));
      const int last = std::min(high[0] - 1, static_cast<int>(std::ceil(most)));
      if (first > last) continue;
      std::size_t site =
          static_cast<std::size_t>(first) + static_cast<std::size_t>(lattice.size[0]) * static_cast<std::size_t>(y);
      if constexpr (Dim == 3)
        site += static_cast<std::size_t>(lattice.size[0]) * static_cast<std::size_t>(lattice.size[1]) *
                static_cast<std::size_t>(z);
      for (int x = first; x <= last; x += kLanes, site += kLanes) {
        T start[Dim];
        for (int k = 0; k < Dim; ++k) start[k] = across[k] + step[k] * static_cast<T>(x);
        lanes(site, std::min(kLanes, lattice.size[0] - x), start, step);
      }
    }
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_velocity(const std::vector<Element>& elements, const T* corners, const T* momenta,
                                           T* velocity) const {
  if (elements.empty()) return;
  const int planes = options_.lattice.size[Dim - 1];
  const std::size_t plane = sites_ / static_cast<std::size_t>(planes);
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  by_component_.assign(Dim * sites_ + kLanes, T(0));
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
      const auto& p = orientation.profiles;
      visit_lanes(orientation, place, begin, end, [&](std::size_t site, int count, const T* start, const T* step) {
        T shape[kLanes];
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) {
          const T x = static_cast<T>(i);
          shape[i] = p[0].slope(start[0] + x * step[0]);
          for (int k = 1; k < Dim; ++k) shape[i] *= p[k].value(start[k] + x * step[k]);
        }
        for (int a = 0; a < Dim; ++a) {
          T* out = by_component_.data() + static_cast<std::size_t>(a) * sites_ + site;
          if (count == kLanes) {  // what is stored in part delays whoever reads it next
#pragma omp simd
            for (int i = 0; i < kLanes; ++i) out[i] += shape[i] * vector[a];
          } else {
#pragma omp simd
            for (int i = 0; i < kLanes; ++i)
              if (i < count) out[i] += shape[i] * vector[a];
          }
        }
      });
    }
    for (std::size_t site = plane * begin; site < plane * end; ++site)
      for (int a = 0; a < Dim; ++a)
        velocity[Dim * site + a] += by_component_[static_cast<std::size_t>(a) * sites_ + site];
  }
}

template <int Dim, class T>
void OrientedMomenta<Dim, T>::add_velocity_adjoint(const std::vector<Element>& elements, const T* corners,
                                                   const T* momenta, const T* velocity_dual, T* momenta_dual,
                                                   T* corners_dual) const {
  using Column = Eigen::Matrix<T, Dim, 1>;
  if (elements.empty()) return;
  const int planes = options_.lattice.size[Dim - 1];
  const T factor = static_cast<T>(options_.weight * options_.lattice.cell_volume());
  by_component_.resize(Dim * sites_ + kLanes);
#pragma omp parallel for schedule(static)
  for (std::size_t site = 0; site < sites_; ++site)
    for (int a = 0; a < Dim; ++a)
      by_component_[static_cast<std::size_t>(a) * sites_ + site] = velocity_dual[Dim * site + a];
#pragma omp parallel for schedule(dynamic, 16)
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const Orientation& orientation = orientations_[normal_of(elements[e])];
    const auto& p = orientation.profiles;
    const Placement place = placement(corners + kCornerValues * e);
    const T* c = momenta + kComponents * e;
    const bool moves = corners_dual && !std::all_of(c, c + kComponents, [](T value) { return value == T(0); });
    Column vector = Column::Zero(), pulled;  // the momentum, and sum of shape times dual
    for (int j = 1; j < Dim; ++j) vector += factor * c[j - 1] * place.axes.row(j).transpose();
    // With shape = product of f_k(r_k): sums of g f_k' (product of the others), and of the same times r; lane by lane.
    T pulled_lanes[Dim][kLanes] = {}, force_lanes[Dim][kLanes] = {}, turning_lanes[Dim][Dim][kLanes] = {};
    visit_lanes(orientation, place, 0, planes, [&](std::size_t site, int count, const T* start, const T* step) {
      // Whole lanes are read, for which the buffer is long enough; beyond the row they count nothing.
      T own[Dim][kLanes], r[Dim][kLanes], f[Dim][kLanes];
      for (int a = 0; a < Dim; ++a) {
        const T* dual = by_component_.data() + static_cast<std::size_t>(a) * sites_ + site;
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) own[a][i] = i < count ? dual[i] : T(0);
      }
      for (int k = 0; k < Dim; ++k)
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) r[k][i] = start[k] + static_cast<T>(i) * step[k];
#pragma omp simd
      for (int i = 0; i < kLanes; ++i) f[0][i] = p[0].slope(r[0][i]);
      for (int k = 1; k < Dim; ++k)
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) f[k][i] = p[k].value(r[k][i]);
      T shape[kLanes];
#pragma omp simd
      for (int i = 0; i < kLanes; ++i) shape[i] = f[0][i] * f[1][i];
      if constexpr (Dim == 3)
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) shape[i] *= f[2][i];
      for (int a = 0; a < Dim; ++a)
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) pulled_lanes[a][i] += shape[i] * own[a][i];
      if (!moves) return;
      T g[kLanes] = {};
      for (int a = 0; a < Dim; ++a)
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) g[i] += vector[a] * own[a][i];
      for (int k = 0; k < Dim; ++k) {
        T term[kLanes];
        if (k == 0)
#pragma omp simd
          for (int i = 0; i < kLanes; ++i) term[i] = g[i] * p[0].slope_derivative(r[0][i]);
        else
#pragma omp simd
          for (int i = 0; i < kLanes; ++i) term[i] = g[i] * p[k].slope(r[k][i]) * p[k].per_sigma;
        for (int other = 0; other < Dim; ++other) {
          if (other == k) continue;
#pragma omp simd
          for (int i = 0; i < kLanes; ++i) term[i] *= f[other][i];
        }
#pragma omp simd
        for (int i = 0; i < kLanes; ++i) force_lanes[k][i] += term[i];
        for (int l = 0; l < Dim; ++l)
#pragma omp simd
          for (int i = 0; i < kLanes; ++i) turning_lanes[k][l][i] += term[i] * r[l][i];
      }
    });
    const auto total = [](const T* lanes) { return std::accumulate(lanes, lanes + kLanes, T(0)); };
    Column force;
    Eigen::Matrix<T, Dim, Dim> turning;
    for (int k = 0; k < Dim; ++k) {
      pulled[k] = total(pulled_lanes[k]);
      force[k] = total(force_lanes[k]);
      for (int l = 0; l < Dim; ++l) turning(k, l) = total(turning_lanes[k][l]);
    }
    for (int j = 1; j < Dim; ++j)
      momenta_dual[kComponents * e + j - 1] += factor * place.axes.row(j).dot(pulled.transpose());
    if (!moves) continue;
    // r_k = axes_k . (x - at): x - at = sum over l of r_l axes_l.
    const Column at_dual = -(place.axes.transpose() * force);
    Eigen::Matrix<T, Dim, Dim> axes_dual = turning * place.axes;
    for (int j = 1; j < Dim; ++j) axes_dual.row(j) += factor * c[j - 1] * pulled.transpose();
    corners_adjoint<Dim, T>(corners + kCornerValues * e, at_dual, axes_dual, corners_dual + kCornerValues * e);
  }
}

template <int Dim, class T>
double OrientedMomenta<Dim, T>::penalty(const std::vector<Element>& elements, const T* momenta, T* gradient) {
  scratch_.resize(kComponents * sites_);
  const Lattice<Dim>& lattice = options_.lattice;
  std::vector<double> product(elements.size());  // momentum times its gradient
  for (std::size_t begin = 0; begin < elements.size();) {
    const std::size_t normal = normal_of(elements[begin]);
    std::size_t end = begin;
    for (; end < elements.size() && normal_of(elements[end]) == normal; ++end)
      for (int j = 0; j < kComponents; ++j)
        scratch_[kComponents * site_of(elements[end]) + j] = momenta[kComponents * end + j];
    const Orientation& orientation = orientations_[normal];
#pragma omp parallel for schedule(static)
    for (std::size_t e = begin; e < end; ++e) {
      Index<Dim> at, low, high;
      std::size_t rest = site_of(elements[e]);
      for (int a = 0; a < Dim; ++a) {
        const std::size_t length = static_cast<std::size_t>(lattice.size[a]);
        at[a] = static_cast<int>(rest % length);
        rest /= length;
        low[a] = std::max(0, at[a] - orientation.reach[a]);
        high[a] = std::min(lattice.size[a], at[a] + orientation.reach[a] + 1);
      }
      T sum[kComponents] = {};
      const int planes_begin = Dim == 3 ? low[Dim - 1] : 0, planes_end = Dim == 3 ? high[Dim - 1] : 1;
      for (int z = planes_begin; z < planes_end; ++z)
        for (int y = low[1]; y < high[1]; ++y) {
          std::size_t row = static_cast<std::size_t>(y),
                      tap = static_cast<std::size_t>(y - at[1] + orientation.reach[1]);
          if constexpr (Dim == 3) {
            row += static_cast<std::size_t>(lattice.size[1]) * static_cast<std::size_t>(z);
            tap += static_cast<std::size_t>(2 * orientation.reach[1] + 1) *
                   static_cast<std::size_t>(z - at[2] + orientation.reach[2]);
          }
          const T* values = scratch_.data() + kComponents * static_cast<std::size_t>(lattice.size[0]) * row;
          const T* taps = orientation.gram.data() + static_cast<std::size_t>(2 * orientation.reach[0] + 1) * tap +
                          (orientation.reach[0] - at[0]);
          for (int x = low[0]; x < high[0]; ++x)
            for (int j = 0; j < kComponents; ++j) sum[j] += taps[x] * values[kComponents * x + j];
        }
      for (int j = 0; j < kComponents; ++j) {
        gradient[kComponents * e + j] += sum[j];
        product[e] += static_cast<double>(momenta[kComponents * e + j]) * sum[j];
      }
    }
    for (std::size_t e = begin; e < end; ++e)
      for (int j = 0; j < kComponents; ++j) scratch_[kComponents * site_of(elements[e]) + j] = 0;
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
