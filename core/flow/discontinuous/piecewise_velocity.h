#pragma once

#include "core/grid/image_grid.h"

#include <vector>

namespace saltus {

/// A switching surface H(t, x) = 0 and its derivatives at one place and time. H is any function that changes sign at
/// the surface; it need not be a distance. With g = grad H: normal n = g/|g|, speed of the surface along it
/// c = -H_t/|g|.
template <int Dim>
struct SurfaceJet {
  bool exists = true;  ///< false beyond the edge of a surface that ends; nothing else is then meant
  double value = 0;    ///< H
  Vector<Dim> gradient = Vector<Dim>::Zero();
  double rate = 0;  ///< H_t
  Matrix<Dim> hessian = Matrix<Dim>::Zero();
  Vector<Dim> rate_gradient = Vector<Dim>::Zero();  ///< grad H_t

  /// dH/dt along a motion with velocity v: |g| (n.v - c).
  double along(const Vector<Dim>& v) const { return gradient.dot(v) + rate; }
};

template <int Dim>
struct VelocityJet {
  Vector<Dim> value = Vector<Dim>::Zero();     ///< mm per unit time
  Matrix<Dim> jacobian = Matrix<Dim>::Zero();  ///< D v
};

/// For each surface the side on which a point is: +1 where H > 0, -1 where H < 0, 0 where the surface is not met.
using Sides = std::vector<signed char>;

/// A velocity that is smooth on either side of finitely many switching surfaces and may jump across them (Bao et al.,
/// section 4). Each one-sided velocity must be defined a little beyond its surface: a step is taken first and cut at
/// the crossing afterwards. Positions: mm in the frame (grid/lattice.h). Safe for concurrent calls.
template <int Dim>
class PiecewiseVelocity {
 public:
  virtual ~PiecewiseVelocity() = default;
  virtual int surfaces() const = 0;
  virtual SurfaceJet<Dim> surface(int which, double t, const Vector<Dim>& x) const = 0;
  /// The velocity that continues smoothly what points on `sides` see.
  virtual VelocityJet<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const = 0;
  /// Replaces `found` by all surfaces that can be met within `reach` mm of x about time t, in ascending order.
  virtual void surfaces_near(double t, const Vector<Dim>& x, double reach, std::vector<int>& found) const;
  /// Times at which velocity or surfaces are not smooth in time, ascending.
  virtual std::vector<double> time_breaks() const { return {}; }
};

/// The same motion backwards: time -t stands for t.
template <int Dim>
class ReversedVelocity final : public PiecewiseVelocity<Dim> {
 public:
  /// `forward` stays owned by the caller and must outlive this.
  explicit ReversedVelocity(const PiecewiseVelocity<Dim>& forward) : forward_(forward) {}
  int surfaces() const override { return forward_.surfaces(); }
  SurfaceJet<Dim> surface(int which, double t, const Vector<Dim>& x) const override;
  VelocityJet<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const override;
  void surfaces_near(double t, const Vector<Dim>& x, double reach, std::vector<int>& found) const override;
  std::vector<double> time_breaks() const override;

 private:
  const PiecewiseVelocity<Dim>& forward_;
};

}  // namespace saltus
