#pragma once

#include "core/kernels/kernel_profile.h"

namespace saltus {

/// One kernel of a sum and its share of the mass.
struct KernelComponent {
  double weight = 1;
  std::shared_ptr<const KernelProfile> profile;
};

/// K = sum_q w_q K_q, each K_q the product over the axes of a profile with unit mass (sum of kernels: Risser et al.,
/// 2011). A sum of products is no product of sums, so each component costs its own sweeps over a lattice. A single
/// profile is a sum of one and converts by itself.
class KernelSum {
 public:
  KernelSum() = default;  ///< of nothing; a momentum scale refuses it
  KernelSum(std::unique_ptr<KernelProfile> profile)
      : KernelSum(std::shared_ptr<const KernelProfile>(std::move(profile))) {}
  KernelSum(std::shared_ptr<const KernelProfile> profile) : components_{{1, std::move(profile)}} {}
  /// Weights count relative to their sum. Throws InvalidInput when there is no component, a weight is not positive and
  /// finite, or a profile is missing.
  explicit KernelSum(std::vector<KernelComponent> components);

  const std::vector<KernelComponent>& components() const { return components_; }  ///< weights sum to 1
  std::string name() const;                                                       ///< "wendland", "wendland sum"
  double width() const;                                                           ///< sum_q w_q sigma_q, mm

 private:
  std::vector<KernelComponent> components_;
};

}  // namespace saltus
