#include <algorithm>
#include <cmath>

#include "core/kernels/kernel_profile.h"

namespace saltus {
namespace {

class WendlandProfile final : public KernelProfile {
 public:
  explicit WendlandProfile(double sigma) : sigma_(sigma) {}
  std::string name() const override { return "wendland"; }
  double width() const override { return sigma_; }
  double support() const override { return sigma_; }
  double value(double r) const override { return rest(r) * rest(r); }
  // With q = (1 - |r|/sigma)_+: the integral of q^2 from 0 is sigma (1 - q^3) / 3, and once more
  // sigma |r| / 3 - sigma^2 (1 - q^4) / 12.
  double first_integral(double r) const override {
    const double q = rest(r);
    return std::copysign(sigma_ * (1 - q * q * q) / 3, r);
  }
  double second_integral(double r) const override {
    const double q = rest(r);
    return sigma_ * std::abs(r) / 3 - sigma_ * sigma_ * (1 - q * q * q * q) / 12;
  }

 private:
  double rest(double r) const { return std::max(0.0, 1 - std::abs(r) / sigma_); }
  double sigma_;
};

}  // namespace

std::unique_ptr<KernelProfile> make_wendland_profile(double sigma_mm) {
  return std::make_unique<WendlandProfile>(sigma_mm);
}

}  // namespace saltus
