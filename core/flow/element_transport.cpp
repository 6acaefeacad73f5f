#include "core/flow/element_transport.h"

#include "core/support/errors.h"

#include <Eigen/LU>

namespace saltus {
namespace {

constexpr int kSides = 2;
constexpr double kInPlane = 2, kOutward = 1;  ///< distances of points, in cells

/// A side's points are its middle, one outward of that, and two on either side along each axis of the plane.
constexpr int kMiddle = 0, kOut = 1;
constexpr int before(int axis) { return 2 * axis; }
constexpr int after(int axis) { return 2 * axis + 1; }

}  // namespace

/// An element's place, F, d_n F and momenta, and what these are made of.
template <int Dim, class T>
struct ElementTransport<Dim, T>::Moved {
  Column at, n, m, derivative, first, zeroth;
  Square F, inverse, dF;
  T per_distance[kSides][Dim];  ///< F a_k of a side is what two points of it differ by, times this
  Column apart;                 ///< of what both sides tell about F a_k
};

template <int Dim, class T>
ElementTransport<Dim, T>::ElementTransport(const Oriented& momenta, Evolution evolution)
    : momenta_(momenta),
      turns_(evolution == Evolution::Exact),
      sigma_(static_cast<T>(momenta.options().normal_width_mm())) {
  if (evolution == Evolution::Carried)
    throw InvalidInput("elements with evolution carried are carried by their corners and not transported as momenta");
}

template <int Dim, class T>
void ElementTransport<Dim, T>::place(const std::vector<Element>& elements, std::vector<T>& points) {
  std::vector<T> corners;
  momenta_.place(elements, corners);
  points.resize(kPointValues * elements.size());
  axes_.resize(elements.size());
  cell_.resize(elements.size());
#pragma omp parallel for schedule(static)
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto place = Oriented::placement(corners.data() + Oriented::kCornerValues * e);
    axes_[e] = place.axes;
    for (int k = 0; k < Dim; ++k)
      cell_[e][k] =
          static_cast<T>(cell_along<Dim>(momenta_.lattice(), place.axes.row(k).transpose().template cast<double>()));
    const Column n = place.axes.row(0).transpose();
    for (int side = 0; side < kSides; ++side) {
      const T sign = side == 0 ? T(-1) : T(1);
      const Column middle = place.at + sign / 2 * cell_[e][0] * n;
      const auto point = [&](int q) {
        return Eigen::Map<Column>(points.data() + kPointValues * e + Dim * (side * kPoints + q));
      };
      point(kMiddle) = middle;
      point(kOut) = middle + sign * static_cast<T>(kOutward) * cell_[e][0] * n;
      for (int k = 1; k < Dim; ++k) {
        const Column away = static_cast<T>(kInPlane) * cell_[e][k] * place.axes.row(k).transpose();
        point(before(k)) = middle - away;
        point(after(k)) = middle + away;
      }
    }
  }
}

template <int Dim, class T>
auto ElementTransport<Dim, T>::moved(std::size_t e, const T* points, const T* values) const -> Moved {
  const auto point = [&](int side, int q) {
    return Eigen::Map<const Column>(points + kPointValues * e + Dim * (side * kPoints + q));
  };
  Moved found;
  found.n = axes_[e].row(0).transpose();
  found.m.setZero();
  for (int j = 1; j < Dim; ++j) found.m += values[Oriented::kComponents * e + j - 1] * axes_[e].row(j).transpose();
  found.at = (point(0, kMiddle) + point(1, kMiddle)) / 2;
  Square along[kSides];  // columns F a_k
  for (int side = 0; side < kSides; ++side) {
    found.per_distance[side][0] = (side == 0 ? T(-1) : T(1)) / (static_cast<T>(kOutward) * cell_[e][0]);
    along[side].col(0) = found.per_distance[side][0] * (point(side, kOut) - point(side, kMiddle));
    for (int k = 1; k < Dim; ++k) {
      found.per_distance[side][k] = 1 / (2 * static_cast<T>(kInPlane) * cell_[e][k]);
      along[side].col(k) = found.per_distance[side][k] * (point(side, after(k)) - point(side, before(k)));
    }
  }
  for (int k = 0; k < Dim; ++k) found.apart[k] = static_cast<T>(k == 0 ? 1 + kOutward : 1) * cell_[e][0];
  found.F = (along[0] + along[1]) / 2 * axes_[e];
  found.inverse = found.F.inverse();
  found.first = found.inverse.transpose() * found.m;
  found.derivative = found.n;
  found.zeroth.setZero();
  found.dF.setZero();
  if (!turns_) return found;
  found.dF = (along[1] - along[0]) * found.apart.cwiseInverse().asDiagonal() * axes_[e];
  found.derivative = found.F * found.n;
  found.zeroth = sigma_ * (found.inverse.transpose() * (found.dF.transpose() * found.first));
  return found;
}

template <int Dim, class T>
void ElementTransport<Dim, T>::transport(const std::vector<T>& points, const T* values,
                                         std::vector<TransportedElement<Dim, T>>& out) const {
  out.resize(axes_.size());
#pragma omp parallel for schedule(static)
  for (std::size_t e = 0; e < axes_.size(); ++e) {
    const Moved found = moved(e, points.data(), values);
    out[e] = {{found.at, axes_[e]}, found.derivative, found.first, found.zeroth};
  }
}

template <int Dim, class T>
void ElementTransport<Dim, T>::adjoint(const std::vector<T>& points, const T* values,
                                       const std::vector<TransportedElement<Dim, T>>& duals, T* values_dual,
                                       T* points_dual) const {
#pragma omp parallel for schedule(static)
  for (std::size_t e = 0; e < axes_.size(); ++e) {
    const Moved found = moved(e, points.data(), values);
    Column first_dual = duals[e].first;
    Square F_dual = Square::Zero(), dF_dual = Square::Zero();
    // d F^-T = -F^-T dF^T F^-T: the dual of F in y = F^-T x is -y (F^-1 y_dual)^T.
    if (turns_) {
      const Column pulled = found.inverse * duals[e].zeroth;
      first_dual += sigma_ * (found.dF * pulled);
      dF_dual = sigma_ * found.first * pulled.transpose();
      F_dual = duals[e].derivative * found.n.transpose() - found.zeroth * pulled.transpose();
    }
    const Column m_dual = found.inverse * first_dual;
    F_dual -= found.first * m_dual.transpose();
    for (int j = 1; j < Dim; ++j) values_dual[Oriented::kComponents * e + j - 1] += axes_[e].row(j).dot(m_dual);
    if (!points_dual) continue;
    const Square of_mean = F_dual * axes_[e].transpose() / 2,
                 of_difference = dF_dual * axes_[e].transpose() * found.apart.cwiseInverse().asDiagonal();
    for (int side = 0; side < kSides; ++side) {
      const auto dual = [&](int q) {
        return Eigen::Map<Column>(points_dual + kPointValues * e + Dim * (side * kPoints + q));
      };
      dual(kMiddle) += duals[e].place.at / 2;
      for (int k = 0; k < Dim; ++k) {
        const Column terms =
            found.per_distance[side][k] * (of_mean.col(k) + (side == 0 ? T(-1) : T(1)) * of_difference.col(k));
        dual(k == 0 ? kOut : after(k)) += terms;
        dual(k == 0 ? kMiddle : before(k)) -= terms;
      }
    }
  }
}

template class ElementTransport<2, float>;
template class ElementTransport<3, float>;
template class ElementTransport<2, double>;
template class ElementTransport<3, double>;

}  // namespace saltus
