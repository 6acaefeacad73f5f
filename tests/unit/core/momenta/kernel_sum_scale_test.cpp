// Scales whose kernel is a sum of kernels of several widths.
#include <gtest/gtest.h>

#include <limits>

#include "core/momenta/momentum_scale.h"
#include "core/support/errors.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::random_values;

// Oracle: linearity. The sum of two widths makes what both make, in their shares, and the jumps of a sheet add.
TEST(KernelSumScale, MakesTheWeightedSumOfWhatItsComponentsMake) {
  const Lattice<2> where{{40, 33}, {1.0, 1.3}, {}};
  const KernelSum both({{3.0, make_wendland_profile(5)}, {1.0, make_wendland_profile(13)}});
  EXPECT_DOUBLE_EQ(both.width(), 7);
  EXPECT_EQ(both.name(), "wendland sum");
  MomentumScale<2, double> sum({both, where, Orders::ZerothAndFirst, 1.5, 0.5});
  const std::vector<double> zeroth = random_values(sum.field_size(), 1), first = random_values(2 * sum.field_size(), 2);
  std::vector<double> v(sum.field_size()), expected(v.size(), 0.0), part(v.size());
  sum.synthesise(zeroth.data(), first.data(), v.data());
  for (const KernelComponent& component : both.components()) {
    // sigma of the whole instead of sigma_q.
    const double a1 = 0.5 * both.width() / component.profile->width();
    MomentumScale<2, double> alone({component.profile, where, Orders::ZerothAndFirst, 1.5, a1});
    alone.synthesise(zeroth.data(), first.data(), part.data());
    for (std::size_t i = 0; i < v.size(); ++i) expected[i] += component.weight * part[i];
  }
  for (std::size_t i = 0; i < v.size(); ++i) ASSERT_NEAR(v[i], expected[i], 1e-12);
}

TEST(KernelSumScale, OfOneComponentIsThatKernelBitByBit) {
  const Lattice<3> where{{12, 9, 8}, {1.0, 1.3, 2}, {}};
  MomentumScale<3, float> alone({make_wendland_profile(6), where, Orders::ZerothAndFirst, 1.5, 0.5});
  MomentumScale<3, float> sum({KernelSum(std::vector<KernelComponent>{{7.0, make_wendland_profile(6)}}), where,
                               Orders::ZerothAndFirst, 1.5, 0.5});
  const std::vector<double> values = random_values(4 * alone.field_size(), 1);
  const std::vector<float> m(values.begin(), values.end());
  std::vector<float> a(alone.field_size()), b(a.size());
  alone.synthesise(m.data(), m.data() + a.size(), a.data());
  sum.synthesise(m.data(), m.data() + a.size(), b.data());
  EXPECT_EQ(a, b);
}

TEST(KernelSumScale, RefusesWhatIsNoKernel) {
  EXPECT_THROW(KernelSum(std::vector<KernelComponent>{}), InvalidInput);
  EXPECT_THROW(KernelSum({{1.0, make_wendland_profile(6)}, {0.0, make_wendland_profile(6)}}), InvalidInput);
  EXPECT_THROW(KernelSum({{std::numeric_limits<double>::quiet_NaN(), make_wendland_profile(6)}}), InvalidInput);
  EXPECT_THROW(KernelSum(std::vector<KernelComponent>{{1.0, nullptr}}), InvalidInput);
  EXPECT_THROW((MomentumScale<2, double>({{}, {{9, 7}, {1.0, 1.5}, {}}, Orders::Zeroth, 1.0, 1.0})), InvalidInput);
}

}  // namespace
}  // namespace saltus
