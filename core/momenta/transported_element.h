#pragma once

#include <Eigen/Core>

namespace saltus {

/// Where an element of oriented momenta is and how its kernel is turned.
template <int Dim, class T>
struct ElementPlacement {
  Eigen::Matrix<T, Dim, 1, Eigen::DontAlign> at;      ///< mm in the frame
  Eigen::Matrix<T, Dim, Dim, Eigen::DontAlign> axes;  ///< rows: n, t_1, ..
};

/// What Ad* of a flow makes of an element, the functional w -> -sigma m . d_n w: w -> m_0 . w - sigma m_1 . (N . grad)
/// w where it is now. In duals `place.axes` means nothing.
template <int Dim, class T>
struct TransportedElement {
  using Column = Eigen::Matrix<T, Dim, 1, Eigen::DontAlign>;
  ElementPlacement<Dim, T> place;  ///< of its kernel
  Column derivative;               ///< N; no unit vector
  Column first, zeroth;            ///< m_1, m_0
};

}  // namespace saltus
