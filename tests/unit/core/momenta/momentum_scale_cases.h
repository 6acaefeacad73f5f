#pragma once

#include <gtest/gtest.h>

#include <ostream>
#include <string>
#include <vector>

#include "core/momenta/momentum_scale.h"
#include "tests/support/random_fields.h"

namespace saltus::testing {

template <int Dim>
Lattice<Dim> small_lattice() {
  if constexpr (Dim == 2)
    return {{9, 7}, {1.0, 1.5}, {0.3, -0.2}};
  else
    return {{6, 5, 4}, {1.0, 1.3, 2.1}, {}};
}

template <int Dim>
MomentumScaleOptions<Dim> options_of(Orders orders, KernelSum kernel) {
  return {std::move(kernel), small_lattice<Dim>(), orders, 2.5, 0.8};
}

struct OrdersCase {
  Orders orders;
  const char* kernel;
};

inline std::string name_of(const OrdersCase& how) {
  const char* orders = how.orders == Orders::Zeroth ? "Zeroth" : how.orders == Orders::First ? "First" : "Both";
  return std::string(orders) + "_" + how.kernel;
}
inline void PrintTo(const OrdersCase& how, std::ostream* out) { *out << name_of(how); }

class MomentumScaleTest : public ::testing::TestWithParam<OrdersCase> {
 protected:
  /// Three components, so that what is kept from one to the next is used twice.
  static KernelSum mixed() {
    return KernelSum(
        {{2.0, make_wendland_profile(3.2)}, {1.0, make_wendland_profile(7.5)}, {0.5, make_gaussian_profile(1.4)}});
  }
  template <int Dim>
  MomentumScaleOptions<Dim> made() const {
    const std::string kernel = GetParam().kernel;
    return options_of<Dim>(GetParam().orders, kernel == "gaussian"   ? KernelSum(make_gaussian_profile(1.8))
                                              : kernel == "wendland" ? KernelSum(make_wendland_profile(3.2))
                                                                     : mixed());
  }
};

/// Random momenta with the pointers that a scale wants.
template <int Dim>
struct Momenta {
  std::vector<double> zeroth, first;
  Momenta(const MomentumScale<Dim, double>& scale, std::uint64_t seed) {
    if (has_zeroth(scale.options().orders)) zeroth = random_values(scale.field_size(), seed);
    if (scale.has_first_order()) first = random_values(Dim * scale.field_size(), seed + 1);
  }
  const double* zeroth_or_null() const { return zeroth.empty() ? nullptr : zeroth.data(); }
  const double* first_or_null() const { return first.empty() ? nullptr : first.data(); }
};

/// Each order alone and both, with each kind of kernel.
inline auto all_orders_cases() {
  return ::testing::Values(OrdersCase{Orders::Zeroth, "gaussian"}, OrdersCase{Orders::Zeroth, "wendland"},
                           OrdersCase{Orders::First, "wendland"}, OrdersCase{Orders::First, "gaussian"},
                           OrdersCase{Orders::ZerothAndFirst, "wendland"},
                           OrdersCase{Orders::ZerothAndFirst, "gaussian"}, OrdersCase{Orders::Zeroth, "sum"},
                           OrdersCase{Orders::First, "sum"}, OrdersCase{Orders::ZerothAndFirst, "sum"});
}

}  // namespace saltus::testing
