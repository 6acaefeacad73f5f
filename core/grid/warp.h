#pragma once

#include "core/grid/lattice.h"
#include "core/grid/resampling.h"
#include "core/grid/volume.h"

namespace saltus {

/// Scalar samples somewhere in space, seen from the frame of the registration: index coordinates of the frame point p
/// (mm) are linear * p + offset.
template <int Dim, class T>
struct FramedImage {
  Lattice<Dim> lattice;  ///< only the size is used
  std::vector<T> samples;
  Matrix<Dim> linear;
  Vector<Dim> offset;
};

/// A displacement u at the sites of a lattice, mm, interleaved: as it is, or interpolated to there (not the identity).
template <int Dim, class T>
struct Displacement {
  const T* field = nullptr;  ///< null: 0 everywhere
  LatticeInterpolation<Dim, T>* to_sites = nullptr;
};

/// What a slope is where a point lies on an inner sample, at which linear interpolation has a kink: that of the cell
/// above, or the mean of both. On the outermost samples it is 0.
enum class OnSample { Upper, Mean };

/// out(x) = image(x + u(x)) at the sites of `points`, linear; beyond the image the border's value is used. `slopes`,
/// where it is not null: the derivative of out(x) by u(x), 1/mm, interleaved, on samples as `sides` says.
template <int Dim, class T>
void warp(const FramedImage<Dim, T>& image, const Lattice<Dim>& points, const Displacement<Dim, T>& displacement,
          T* out, T* slopes = nullptr, OnSample sides = OnSample::Upper);
template <int Dim, class T>
void warp(const FramedImage<Dim, T>& image, const Lattice<Dim>& points, const T* displacement, T* out,
          T* slopes = nullptr, OnSample sides = OnSample::Upper) {
  warp<Dim, T>(image, points, Displacement<Dim, T>{displacement}, out, slopes, sides);
}

/// The adjoint of `warp`, for the field that the displacement is made of (`to_sites` as there, null where it lies at
/// the sites): displacement_dual = dual * slopes. Without `to_sites` it may be `slopes` itself.
template <int Dim, class T>
void warp_adjoint(const T* dual, const T* slopes, const Lattice<Dim>& points, LatticeInterpolation<Dim, T>* to_sites,
                  T* displacement_dual);

/// What a warped image's derivative is: dual(x) for image(x + u(x)).
template <int Dim, class T>
struct WarpedDual {
  const FramedImage<Dim, T>* image;
  const T* dual;
};

/// displacement_dual = sum over the images, all warped with the same displacement, of dual * gradient of image at x +
/// u(x): the adjoint of `warp`, for the field that the displacement is made of. Where that lies at the sites,
/// displacement_dual may be the field itself.
template <int Dim, class T>
void warp_adjoint(const std::vector<WarpedDual<Dim, T>>& warped, const Lattice<Dim>& points,
                  const Displacement<Dim, T>& displacement, T* displacement_dual, OnSample sides = OnSample::Upper);
template <int Dim, class T>
void warp_adjoint(const std::vector<WarpedDual<Dim, T>>& warped, const Lattice<Dim>& points, const T* displacement,
                  T* displacement_dual, OnSample sides = OnSample::Upper) {
  warp_adjoint<Dim, T>(warped, points, Displacement<Dim, T>{displacement}, displacement_dual, sides);
}

}  // namespace saltus
