#include "core/evaluation/warp_image.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/support/errors.h"
#include "tests/unit/core/evaluation/fields.h"

namespace saltus {
namespace {

// Every interpolation that is at least linear reproduces an affine intensity, across grids that differ in everything.
template <int Dim>
void expect_affine_intensity_is_reproduced(Interpolation interpolation, double tolerance) {
  ImageGrid<Dim> moving_grid;  // contains the fixed grid with room to spare
  for (int axis = 0; axis < Dim; ++axis) {
    moving_grid.size[axis] = 90;
    moving_grid.spacing[axis] = 1.5;
    moving_grid.origin[axis] = -65;
  }
  const Vector<Dim> slope = Vector<Dim>::LinSpaced(0.7, -1.3);
  const Vector<Dim> shift = Vector<Dim>::LinSpaced(2.2, -1.9);
  const Volume<Dim> moving = make_image(moving_grid, [&](const Vector<Dim>& y) { return 5 + slope.dot(y); });
  const auto field = make_field(oblique_grid<Dim>(), [&](const Vector<Dim>&) { return shift; });
  const Volume<Dim> warped = warp_image(moving, field, {.interpolation = interpolation});
  EXPECT_EQ(warped.grid, field.grid);
  for_each_voxel(field.grid, [&](std::size_t voxel, const Vector<Dim>& x) {
    EXPECT_NEAR(warped.samples[voxel], 5 + slope.dot(x + shift), tolerance);
  });
}

TEST(WarpImage, ReproducesAffineIntensities) {
  expect_affine_intensity_is_reproduced<2>(Interpolation::Linear, 1e-4);
  expect_affine_intensity_is_reproduced<3>(Interpolation::Linear, 1e-4);
  // The spline's mirrored border bends a slope; 15 voxels further in that is 0.27^15 of it.
  expect_affine_intensity_is_reproduced<2>(Interpolation::BSpline, 1e-4);
  expect_affine_intensity_is_reproduced<3>(Interpolation::BSpline, 1e-4);
}

TEST(WarpImage, NearestKeepsLabels) {
  ImageGrid<2> grid;
  grid.size = {5, 1};
  Volume<2> labels(grid);
  labels.samples = {0, 7, 7, 3, 3};
  const auto field = make_field(grid, [](const Vector<2>&) { return Vector<2>(0.6, 0); });
  EXPECT_EQ(warp_image(labels, field, {.interpolation = Interpolation::Nearest}).samples,
            (std::vector<float>{7, 7, 3, 3, 3}));
}

TEST(WarpImage, OutsideIsTheBorderOrWhatWasAskedFor) {
  ImageGrid<2> grid;
  grid.size = {3, 3};
  const Volume<2> image = make_image(grid, [](const Vector<2>& x) { return x[0]; });
  const auto field = make_field(grid, [](const Vector<2>&) { return Vector<2>(1.4, 0); });
  EXPECT_FLOAT_EQ(warp_image(image, field).samples[2], 2);
  const Volume<2> marked = warp_image(image, field, {.outside = -1000.0f});
  EXPECT_FLOAT_EQ(marked.samples[0], 1.4f);
  EXPECT_FLOAT_EQ(marked.samples[1], 2);  // 0.4 voxels beyond the last centre: still within the voxel
  EXPECT_FLOAT_EQ(marked.samples[2], -1000);
}

TEST(WarpImage, NamesItsInterpolations) {
  for (std::string name : {"linear", "nearest", "bspline"}) EXPECT_EQ(to_string(parse_interpolation(name)), name);
  EXPECT_THROW(parse_interpolation("cubic"), InvalidInput);
}

}  // namespace
}  // namespace saltus
