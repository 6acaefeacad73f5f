#include "core/evaluation/cubic_spline.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/core/evaluation/fields.h"

namespace saltus {
namespace {

template <int Dim>
void expect_samples_are_reproduced(Index<Dim> size) {
  ImageGrid<Dim> grid;
  grid.size = size;
  const Volume<Dim> image = make_image(grid, [](const Vector<Dim>& x) { return std::sin(37.7 * x.dot(x) + x[0]); });
  const CubicSpline<Dim> spline(image);
  for_each_voxel(grid, [&](std::size_t voxel, const Vector<Dim>& index) {
    EXPECT_NEAR(spline(index), image.samples[voxel], 1e-6) << index.transpose();
  });
}

TEST(CubicSpline, ReproducesSamples) {
  expect_samples_are_reproduced<2>({13, 9});
  expect_samples_are_reproduced<2>({1, 7});
  expect_samples_are_reproduced<2>({2, 3});
  expect_samples_are_reproduced<3>({40, 5, 6});
}

// Oracle: a cubic spline's error for a smooth function falls as h^4; here h = 1/8 of a radian.
TEST(CubicSpline, IsFourthOrderBetweenSamples) {
  auto error_at = [](double h) {
    ImageGrid<2> grid;
    grid.size = {static_cast<int>(16 / h), static_cast<int>(16 / h)};
    // Even about the first sample, so that the mirrored border is exact; the other border is far away.
    const CubicSpline<2> spline(
        make_image(grid, [h](const Vector<2>& x) { return 1e3 * std::cos(h * x[0]) * std::cos(0.7 * h * x[1]); }));
    double worst = 0;
    for (double x = 0; x < 8; x += 0.37)
      for (double y = 0; y < 8; y += 0.41)
        worst = std::max(worst, std::abs(spline({x / h, y / h}) / 1e3 - std::cos(x) * std::cos(0.7 * y)));
    return worst;
  };
  const double coarse = error_at(0.5), fine = error_at(0.25);
  EXPECT_LT(coarse, 1e-3);
  EXPECT_GT(coarse / fine, 11);
}

}  // namespace
}  // namespace saltus
