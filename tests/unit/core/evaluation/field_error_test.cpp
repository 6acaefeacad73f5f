#include "core/evaluation/field_error.h"

#include <gtest/gtest.h>

#include "core/evaluation/field_sampling.h"
#include "core/evaluation/grid_agreement.h"
#include "core/support/errors.h"
#include "tests/unit/core/evaluation/fields.h"

namespace saltus {
namespace {

// Linear interpolation reproduces an affine field exactly, wherever the grid lies in the world.
template <int Dim>
void expect_affine_field_is_reproduced() {
  const ImageGrid<Dim> grid = oblique_grid<Dim>();
  const Matrix<Dim> a = skewed_gradient<Dim>();
  auto u = [&a](const Vector<Dim>& x) -> Vector<Dim> { return a * x + Vector<Dim>::Constant(0.3); };
  const VectorVolume<Dim> field = make_field(grid, u);
  std::vector<Vector<Dim>> points, moved;
  for (double at : {0.0, 0.13, 3.5, 6.999, 8.0}) {
    points.push_back(grid.to_world(Vector<Dim>::Constant(at)));
    moved.push_back(points.back() + u(points.back()));
  }
  const auto transformed = transform_points(field, points);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_LT((transformed[i] - moved[i]).norm(), 1e-5);
  EXPECT_LT(summarise(landmark_errors(field, points, moved)).max, 1e-5);
}

TEST(FieldSampling, ReproducesAffineFields2D) { expect_affine_field_is_reproduced<2>(); }
TEST(FieldSampling, ReproducesAffineFields3D) { expect_affine_field_is_reproduced<3>(); }

TEST(FieldSampling, TakesTheBordersValueOutside) {
  const ImageGrid<3> grid = oblique_grid<3>();
  const VectorVolume<3> field = make_field(grid, [](const Vector<3>& x) { return x; });
  EXPECT_LT((displacement_at(field, grid.to_world({-4, 3, 2})) - grid.to_world({0, 3, 2})).norm(), 1e-5);
  EXPECT_LT((displacement_at(field, grid.to_world({100, 3, 55})) - grid.to_world({8, 3, 12})).norm(), 1e-5);
}

TEST(FieldSampling, WorksWithASingleSlice) {
  ImageGrid<3> grid;
  grid.size = {4, 4, 1};
  const VectorVolume<3> field = make_field(grid, [](const Vector<3>& x) { return x; });
  EXPECT_EQ(displacement_at(field, {1.5, 2, 7}), Vector<3>(1.5, 2, 0));
}

TEST(LandmarkErrors, AreDistancesAfterTheMotion) {
  ImageGrid<2> grid;
  grid.size = {8, 8};
  const VectorVolume<2> field = make_field(grid, [](const Vector<2>&) { return Vector<2>(3, 0); });
  EXPECT_EQ(landmark_errors<2>(field, {{1, 1}, {2, 2}}, {{4, 1}, {5, 6}}), (std::vector<double>{0, 4}));
  EXPECT_EQ(landmark_distances<2>({{1, 1}}, {{4, 5}}), std::vector<double>{5});
}

TEST(LandmarkErrors, RefuseListsThatDoNotMatch) {
  const VectorVolume<2> field(oblique_grid<2>());
  EXPECT_THROW(landmark_errors<2>(field, {{1, 1}}, {}), InvalidInput);
  EXPECT_THROW(landmark_errors<2>(field, {}, {}), InvalidInput);
}

TEST(EndpointErrors, CountWhereTheMaskSays) {
  const ImageGrid<2> grid = oblique_grid<2>();
  const VectorVolume<2> truth(grid);
  VectorVolume<2> field(grid);
  field.component(0)[5] = 3;
  field.component(1)[5] = 4;
  Volume<2> mask(grid);
  mask.samples[5] = mask.samples[6] = 1;
  EXPECT_EQ(endpoint_errors<2>(field, truth, mask), (std::vector<double>{5, 0}));
  EXPECT_EQ(endpoint_errors<2>(field, truth).size(), grid.voxels());
  EXPECT_THROW(endpoint_errors<2>(field, truth, Volume<2>(grid)), InvalidInput);
  ImageGrid<2> other = grid;
  other.spacing[0] *= 1.1;
  EXPECT_THROW(endpoint_errors<2>(field, VectorVolume<2>(other)), InvalidInput);
}

TEST(GridAgreement, ForgivesRoundingButNotShifts) {
  const ImageGrid<3> grid = oblique_grid<3>();
  ImageGrid<3> rounded = grid;
  for (int axis = 0; axis < 3; ++axis) rounded.origin[axis] = static_cast<float>(grid.origin[axis] + 1e-6);
  rounded.spacing *= 1 + 1e-6;
  EXPECT_TRUE(do_grids_agree(grid, rounded));
  rounded.origin[1] += 0.1;
  EXPECT_FALSE(do_grids_agree(grid, rounded));
}

}  // namespace
}  // namespace saltus
