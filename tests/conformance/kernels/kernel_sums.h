#pragma once

#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include "core/kernels/kernel_sum.h"

namespace saltus::testing {

/// A kernel as momenta see it, for a width in mm. A new kernel or combination joins the suites by one more entry.
struct NamedKernel {
  std::string name;
  std::function<KernelSum(double sigma)> make;
  double cut = 0;         ///< what its support leaves out, as a share
  bool has_jump = false;  ///< whether its first order jumps: all components are C0 Wendland
};
inline void PrintTo(const NamedKernel& kernel, std::ostream* out) { *out << kernel.name; }

inline std::vector<NamedKernel> named_kernels() {
  return {{"gaussian", [](double s) { return KernelSum(make_gaussian_profile(s)); }, 1e-5, false},
          {"wendland", [](double s) { return KernelSum(make_wendland_profile(s)); }, 0, true},
          {"wendland_sum",
           [](double s) {
             return KernelSum({{2.0, make_wendland_profile(0.8 * s)}, {1.0, make_wendland_profile(1.7 * s)}});
           },
           0, true},
          {"mixed_sum",
           [](double s) {
             return KernelSum({{1.0, make_wendland_profile(s)}, {1.0, make_gaussian_profile(1.2 * s)}});
           },
           1e-5, false}};
}

}  // namespace saltus::testing
