#include "core/optimisation/group_orthants.h"

#include "core/support/reduction.h"
#include "core/support/thread_count.h"

#include <cmath>
#include <type_traits>

namespace saltus {
namespace {

template <class T, class Count>
double square(const T* values, Count count) {
  double sum = 0;
  for (int k = 0; k < count; ++k) sum += static_cast<double>(values[k]) * values[k];
  return sum;
}

/// What `with` gives for the size of the range's groups: a constant where it is one that fields have.
template <class With>
auto with_group_size(const GroupSparsity& range, With&& with) {
  switch (range.group) {
    case 1:
      return with(std::integral_constant<int, 1>());
    case 2:
      return with(std::integral_constant<int, 2>());
    case 3:
      return with(std::integral_constant<int, 3>());
    default:
      return with(range.group);
  }
}

/// Calls visit(first value of the group, the group's weight, its size) for every group.
template <class Visit>
void for_groups(const GroupSparsity& range, Visit&& visit) {
  with_group_size(range, [&](auto size) {
    const std::size_t groups = (range.end - range.begin) / static_cast<std::size_t>(size);
#pragma omp parallel for schedule(static) if (is_worth_threads(groups))
    for (std::size_t g = 0; g < groups; ++g)
      visit(range.begin + g * static_cast<std::size_t>(size), range.weight_of(g), size);
  });
}

}  // namespace

template <class T>
double sparsity_energy(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x) {
  double energy = 0;
  for (const GroupSparsity& range : ranges) {
    energy += with_group_size(range, [&](auto size) {
      const std::size_t groups = (range.end - range.begin) / static_cast<std::size_t>(size);
      return ordered_sum(groups, [&](std::size_t g) {
        const double sum = square(x.data() + range.begin + g * static_cast<std::size_t>(size), size);
        return sum > 0 ? range.weight_of(g) * std::sqrt(sum) : 0.0;  // that of a group kept at zero is infinite
      });
    });
  }
  return energy;
}

template <class T>
void make_pseudo(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, std::vector<T>& gradient) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight, auto group) {
      if (weight == 0) return;
      const double sum = square(x.data() + at, group);
      if (sum > 0) {
        const double size = std::sqrt(sum);
        for (int k = 0; k < group; ++k) gradient[at + k] += static_cast<T>(weight * x[at + k] / size);
        return;
      }
      const double pull = square(gradient.data() + at, group);
      const T keep = static_cast<T>(pull > weight * weight ? 1 - weight / std::sqrt(pull) : 0);
      for (int k = 0; k < group; ++k) gradient[at + k] *= keep;
    });
}

template <class T>
void align(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
           std::vector<T>& direction) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight, auto group) {
      if (weight == 0 || square(x.data() + at, group) > 0) return;
      double agreement = 0;
      for (int k = 0; k < group; ++k) agreement -= static_cast<double>(direction[at + k]) * pseudo[at + k];
      if (agreement > 0) return;
      for (int k = 0; k < group; ++k) direction[at + k] = 0;
    });
}

template <class T>
void project(const std::vector<GroupSparsity>& ranges, const std::vector<T>& x, const std::vector<T>& pseudo,
             std::vector<T>& candidate) {
  for (const GroupSparsity& range : ranges)
    for_groups(range, [&](std::size_t at, double weight, auto group) {
      if (weight == 0) return;
      const bool from_zero = square(x.data() + at, group) == 0;
      double agreement = 0;
      for (int k = 0; k < group; ++k)
        agreement += static_cast<double>(candidate[at + k]) * (from_zero ? -pseudo[at + k] : x[at + k]);
      if (agreement > 0) return;
      for (int k = 0; k < group; ++k) candidate[at + k] = 0;
    });
}

#define SALTUS_ORTHANTS(T)                                                                               \
  template double sparsity_energy(const std::vector<GroupSparsity>&, const std::vector<T>&);             \
  template void make_pseudo(const std::vector<GroupSparsity>&, const std::vector<T>&, std::vector<T>&);  \
  template void align(const std::vector<GroupSparsity>&, const std::vector<T>&, const std::vector<T>&,   \
                      std::vector<T>&);                                                                  \
  template void project(const std::vector<GroupSparsity>&, const std::vector<T>&, const std::vector<T>&, \
                        std::vector<T>&);
SALTUS_ORTHANTS(float)
SALTUS_ORTHANTS(double)
#undef SALTUS_ORTHANTS

}  // namespace saltus
