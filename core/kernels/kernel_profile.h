#pragma once

#include <memory>
#include <string>
#include <vector>

namespace saltus {

/// One-dimensional even kernel k0 with k0(0) = 1. The d-dimensional kernel is the product over the grid's axes
/// (Bao et al., section 3.3), so one profile is all that a new kernel needs.
///
/// Momenta are cell averages, so a kernel is only ever used through its integrals: the profile gives k0 and its first
/// and second antiderivative in closed form, and no derivative of k0 is ever sampled.
class KernelProfile {
 public:
  virtual ~KernelProfile() = default;
  virtual std::string name() const = 0;
  virtual double width() const = 0;                              ///< sigma, mm
  virtual double support() const = 0;                            ///< |r| beyond which k0 is (taken as) 0, mm
  virtual double value(double r) const = 0;                      ///< k0(r)
  virtual double first_integral(double r) const = 0;             ///< odd antiderivative of k0
  virtual double second_integral(double r) const = 0;            ///< even antiderivative of first_integral
  double mass() const { return 2 * first_integral(support()); }  ///< integral of k0, mm
};

/// exp(-r^2 / sigma^2), cut where it is below 1e-5.
std::unique_ptr<KernelProfile> make_gaussian_profile(double sigma_mm);

/// ((1 - |r|/sigma)_+)^2, the C0 Wendland kernel: not differentiable at 0, so that its first order can jump.
std::unique_ptr<KernelProfile> make_wendland_profile(double sigma_mm);

/// Convolution weights along one axis with spacing h, for t = -radius..radius at [t + radius]. Order 0 sits at the
/// samples; order 1 at the faces between them, source face i at (i + 1/2) h, so that a sheet of first-order momentum
/// makes a jump between two samples and none of them lies inside it. B is the box of width h and unit mass (a cell
/// average), L = B * B the hat, `mass` the kernel's integral, m the momentum:
///
///   value:      sample <- sample    h/mass         k0 * L  at t h             (sums to about 1)
///   slope:      sample <- face      h sigma/mass   k0' * B at (t - 1/2) h     = sigma/mass (k0(t h) - k0((t-1) h))
///   curvature:  face <- face       -h sigma^2/mass k0'' * L at t h            (holds the 4/sigma Dirac of C0 Wendland)
///   slope_gram: sample <- face      h sigma/mass   k0' * L at (t - 1/2) h     (pairs the two orders in energies)
///
/// The double averages make the Gram matrices of value and curvature positive semi-definite, and energies converge as
/// h -> 0. No derivative of k0 is ever sampled: each tap is a difference of k0 or its antiderivatives.
///
/// To the last bit value and curvature are even about t = 0; slope and slope_gram are odd about t = 1/2, but for the
/// tap at -radius, which is not 0 where a kernel is cut.
struct KernelTaps {
  int radius = 0;
  std::vector<double> value, slope, curvature, slope_gram;
};

KernelTaps cell_averaged_taps(const KernelProfile& profile, double spacing_mm);

}  // namespace saltus
