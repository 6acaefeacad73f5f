#include "core/grid/pyramid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/grid/resampling.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::random_values;

/// The definition: every sample smoothed, axis by axis, and only then read at the target's sites.
template <int Dim>
std::vector<double> smoothed_and_read(const Lattice<Dim>& lattice, std::vector<double> values,
                                      const Lattice<Dim>& target, double smoothing) {
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const int length = lattice.size[axis];
    const double ratio = target.spacing[axis] / lattice.spacing[axis];
    const double sigma = (ratio > 1 ? std::max(smoothing, 0.5) : smoothing) * ratio;
    if (sigma > 0 && length > 1) {
      const std::vector<double> before = values;
      const int radius = static_cast<int>(std::ceil(3 * sigma));
      for (std::size_t site = 0; site < values.size(); ++site) {
        const int i = static_cast<int>(site / stride % static_cast<std::size_t>(length));
        double sum = 0, total = 0;
        for (int j = -radius; j <= radius; ++j) {
          const double weight = std::exp(-0.5 * j * j / (sigma * sigma));
          const int from = std::clamp(i + j, 0, length - 1);
          sum += weight * before[site + (from - i) * static_cast<std::ptrdiff_t>(stride)];
          total += weight;
        }
        values[site] = sum / total;
      }
    }
    stride *= static_cast<std::size_t>(length);
  }
  std::vector<double> result(target.sites(), 0.0);
  LatticeInterpolation<Dim, double>(lattice, target, 1).add_to(values.data(), result.data());
  return result;
}

TEST(Downsampled, IsWhatSmoothingEverySampleAndReadingThemGives) {
  const Lattice<3> image = {{21, 17, 9}, {1, 1.2, 3}, {0.5, -1, 2}};
  const std::vector<double> samples = random_values(image.sites(), 1);
  for (const Lattice<3>& target : {coarsened(image, 2.0), coarsened(image, 4.0), coarsened(image, 16.0), image,
                                   Lattice<3>{{5, 4, 3}, {4.3, 4, 7}, {-2, 1, 3}}})  // partly outside
    for (double smoothing : {0.0, 0.4, 1.3}) {
      const std::vector<double> expected = smoothed_and_read(image, samples, target, smoothing),
                                found = downsampled(image, samples, target, smoothing);
      ASSERT_EQ(found.size(), expected.size());
      for (std::size_t i = 0; i < found.size(); ++i)
        ASSERT_NEAR(found[i], expected[i], 1e-13) << target.size[0] << " smoothing " << smoothing << " site " << i;
    }
}

TEST(Downsampled, LeavesAnAxisOfOneSampleAlone) {
  const Lattice<2> image = {{12, 1}, {1, 5}, {}};
  const std::vector<double> samples = random_values(image.sites(), 2);
  const Lattice<2> target = coarsened(image, 3.0);
  const std::vector<double> expected = smoothed_and_read(image, samples, target, 0.7),
                            found = downsampled(image, samples, target, 0.7);
  for (std::size_t i = 0; i < found.size(); ++i) ASSERT_NEAR(found[i], expected[i], 1e-13) << i;
}

TEST(Downsampled, WithNothingToDoIsTheSamples) {
  const Lattice<3> image = {{6, 5, 4}, {1, 1, 1}, {}};
  const std::vector<float> samples(image.sites(), 3.25f);
  EXPECT_EQ(downsampled(image, samples, image), samples);
}

}  // namespace
}  // namespace saltus
