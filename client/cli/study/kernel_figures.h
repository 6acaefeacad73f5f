#pragma once

#include "client/cli/study/figure.h"
#include "core/kernels/kernel_profile.h"

namespace saltus::cli {

/// k0'(r) of a profile off r = 0, per mm, by central differences of k0; 0 at r = 0, where C0 Wendland has none.
double kernel_slope(const KernelProfile& profile, double r);

/// The Gaussian and the C0 Wendland kernel of one width, and their derivatives, along a line (the paper's figure of the
/// 1-D kernel).
Figure kernels_along_a_line(double width_mm);

/// The product kernels in the plane and their derivatives along x and y (the paper's figure of the 2-D kernel).
Figure kernels_in_the_plane(double width_mm);

}  // namespace saltus::cli
