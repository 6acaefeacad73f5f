#include "core/kernels/kernel_sum.h"

#include "core/support/errors.h"

#include <cmath>

namespace saltus {

KernelSum::KernelSum(std::vector<KernelComponent> components) : components_(std::move(components)) {
  if (components_.empty()) throw InvalidInput("a sum of kernels has no component; give at least one");
  double sum = 0;
  for (const KernelComponent& component : components_) {
    if (!component.profile) throw InvalidInput("a sum of kernels has a component without a kernel; give each its own");
    if (!(component.weight > 0) || !std::isfinite(component.weight))
      throw InvalidInput("a kernel of a sum has the weight " + std::to_string(component.weight) +
                         "; it must be positive and finite");
    sum += component.weight;
  }
  for (KernelComponent& component : components_) component.weight /= sum;
}

std::string KernelSum::name() const {
  return components_.front().profile->name() + (components_.size() > 1 ? " sum" : "");
}

double KernelSum::width() const {
  double width = 0;
  for (const KernelComponent& component : components_) width += component.weight * component.profile->width();
  return width;
}

}  // namespace saltus
