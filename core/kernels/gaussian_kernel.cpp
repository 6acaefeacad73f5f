#include <cmath>
#include <numbers>

#include "core/kernels/kernel_profile.h"

namespace saltus {
namespace {

class GaussianProfile final : public KernelProfile {
 public:
  explicit GaussianProfile(double sigma) : sigma_(sigma) {}
  std::string name() const override { return "gaussian"; }
  double width() const override { return sigma_; }
  double support() const override { return sigma_ * std::sqrt(std::log(1e5)); }
  double value(double r) const override { return std::exp(-r * r / (sigma_ * sigma_)); }
  double first_integral(double r) const override {
    return 0.5 * std::sqrt(std::numbers::pi) * sigma_ * std::erf(r / sigma_);
  }
  double second_integral(double r) const override { return r * first_integral(r) + 0.5 * sigma_ * sigma_ * value(r); }

 private:
  double sigma_;
};

}  // namespace

std::unique_ptr<KernelProfile> make_gaussian_profile(double sigma_mm) {
  return std::make_unique<GaussianProfile>(sigma_mm);
}

}  // namespace saltus
