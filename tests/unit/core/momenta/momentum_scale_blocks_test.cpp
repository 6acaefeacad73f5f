// A scale whose momenta are 0 outside given blocks.
#include <gtest/gtest.h>

#include <limits>
#include <utility>

#include "core/momenta/momentum_scale.h"
#include "tests/support/random_blocks.h"
#include "tests/support/random_fields.h"
#include "tests/unit/core/momenta/momentum_scale_cases.h"

namespace saltus {
namespace {

using testing::Momenta;
using testing::random_values;

class MomentumScaleBlocksTest : public testing::MomentumScaleTest {};

// Oracle: the same everywhere, with 0 where there is no momentum. What stands outside the blocks is a NaN.
template <int Dim>
void expect_same_in_blocks(MomentumScaleOptions<Dim> made) {
  if constexpr (Dim == 2)
    made.lattice = {{35, 22}, {1.0, 1.5}, {}};
  else
    made.lattice = {{21, 14, 17}, {1.0, 1.3, 2.1}, {}};
  MomentumScale<Dim, double> scale(made);
  const Momenta<Dim> m(scale, 13);
  const std::size_t field = scale.field_size();
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  for (std::uint64_t seed = 1; seed < 5; ++seed) {
    const double share = seed == 1 ? 0.03 : seed == 2 ? 0.0 : 0.2;
    MomentumMasks<Dim> at = scale.everywhere(), wanted = at;
    const auto limit = [&](BlockMask<Dim>& some, BlockMask<Dim>& more, std::uint64_t number) {
      if (some.is_empty()) return;
      some = testing::random_blocks<Dim>(made.lattice, number, share);
      more = testing::random_blocks<Dim>(made.lattice, number + 50, 0.1);
      more |= some;
    };
    if (seed > 3) limit(at.zeroth, wanted.zeroth, 10 * seed);
    for (int axis = 0; axis < Dim; ++axis) limit(at.first[axis], wanted.first[axis], 10 * seed + 1 + axis);

    const auto limited = [&](const double* values, const BlockMask<Dim>& mask, double outside) {
      return testing::only_in<Dim, double>(made.lattice, mask, {values, values + field}, outside);
    };
    // Momenta (and wherever `targets` is asked for them) of both kinds.
    std::vector<double> zeroth0, zeroth_nan, first0, first_nan;
    if (!m.zeroth.empty()) {
      zeroth0 = limited(m.zeroth.data(), at.zeroth, 0);
      zeroth_nan = limited(m.zeroth.data(), at.zeroth, nan);
    }
    for (std::size_t axis = 0; axis < Dim && !m.first.empty(); ++axis)
      for (const auto& [all, outside] : {std::pair{&first0, 0.0}, {&first_nan, nan}}) {
        const std::vector<double> one = limited(m.first.data() + axis * field, at.first[axis], outside);
        all->insert(all->end(), one.begin(), one.end());
      }
    const auto or_null = [](auto& values) { return values.empty() ? nullptr : values.data(); };

    std::vector<double> expected(field), found(field, nan);
    scale.synthesise(or_null(zeroth0), or_null(first0), expected.data());
    const BlockMask<Dim> reached = scale.synthesise(or_null(zeroth_nan), or_null(first_nan), at, found.data());
    const std::vector<char> is_reached = testing::site_flags<Dim>(made.lattice, reached);
    for (std::size_t i = 0; i < field; ++i)
      ASSERT_NEAR(is_reached[i / Dim] ? found[i] : 0.0, expected[i], 1e-12) << "velocity " << i;

    const std::vector<double> w = random_values(field, 5 + seed);
    std::vector<double> zeroth(field), first(first0.size()), some_zeroth(field, nan), some_first(first0.size(), nan);
    const auto expect_in = [&](const BlockMask<Dim>& mask, const double* some, const double* all, const char* what) {
      const std::vector<char> flags = testing::site_flags<Dim>(made.lattice, mask);
      for (std::size_t i = 0; i < field; ++i)
        if (flags[i / Dim]) {
          ASSERT_NEAR(some[i], all[i], 1e-12) << what << " " << i;
        }
    };
    scale.synthesise_transpose(w.data(), zeroth.data(), or_null(first));
    scale.synthesise_transpose(w.data(), wanted, some_zeroth.data(), or_null(some_first));
    expect_in(wanted.zeroth, some_zeroth.data(), zeroth.data(), "dual of order 0");
    for (std::size_t axis = 0; axis < Dim && !first.empty(); ++axis)
      expect_in(wanted.first[axis], some_first.data() + axis * field, first.data() + axis * field, "dual of order 1");

    const double penalty = scale.penalty(or_null(zeroth0), or_null(first0), zeroth.data(), or_null(first));
    EXPECT_NEAR(
        scale.penalty(or_null(zeroth_nan), or_null(first_nan), at, wanted, some_zeroth.data(), or_null(some_first)),
        penalty, 1e-12 * (1 + penalty));
    if (!zeroth0.empty()) expect_in(wanted.zeroth, some_zeroth.data(), zeroth.data(), "gradient of order 0");
    for (std::size_t axis = 0; axis < Dim && !first.empty(); ++axis)
      expect_in(wanted.first[axis], some_first.data() + axis * field, first.data() + axis * field, "gradient");
  }
}

TEST_P(MomentumScaleBlocksTest, ReadsAndMakesNothingOutsideTheGivenBlocks) {
  expect_same_in_blocks<2>(made<2>());
  expect_same_in_blocks<3>(made<3>());
}

INSTANTIATE_TEST_SUITE_P(Orders, MomentumScaleBlocksTest, testing::all_orders_cases(),
                         [](const auto& info) { return name_of(info.param); });

}  // namespace
}  // namespace saltus
