// Oracle: one scene and one motion, both functions of the world. How the grids lie must not matter.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "core/registration/register_images.h"
#include "tests/support/analytic_scene.h"

namespace saltus {
namespace {

using testing::AnalyticScene;
using testing::centred_grid;
using testing::for_voxels;
using testing::sampled;
using testing::vector_at;

template <int Dim>
Vector<Dim> motion(const Vector<Dim>& x) {
  Vector<Dim> u = Vector<Dim>::Zero();
  u[0] = 1.6 + 0.05 * x[1];
  u[1] = -1.1 - 0.05 * x[0];
  if constexpr (Dim == 3) u[2] = 0.8;
  return u * std::exp(-x.squaredNorm() / 400);
}

template <int Dim>
RegistrationOptions thorough() {
  RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced);
  options.pyramid.levels = 2;
  options.pyramid.finest_level = 0;
  options.momenta.width_voxels = 6;
  options.momenta.scales = 2;
  options.momenta.regularisation = 2e-5;
  options.optimisation.tolerance = 1e-4;
  options.optimisation.max_iterations = Dim == 2 ? 60 : 20;
  return options;
}

template <int Dim>
RegistrationInput<Dim> pair(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving, double radius, int blobs) {
  const AnalyticScene<Dim> scene(radius, 3, blobs, 11);
  RegistrationInput<Dim> input;
  input.fixed = sampled<Dim>(fixed, [&](const Vector<Dim>& x) { return scene(x + motion<Dim>(x)); });
  input.moving = sampled<Dim>(moving, scene);
  return input;
}

/// Mean and largest distance of two fields of the world within `radius`.
template <int Dim, class A, class B>
std::array<double, 2> distance(double radius, A&& a, B&& b) {
  double sum = 0, worst = 0;
  int count = 0;
  const ImageGrid<Dim> probe = [&] {
    Index<Dim> size;
    size.fill(15);
    return centred_grid<Dim>(size, Vector<Dim>::Constant(2 * radius / 14), Matrix<Dim>::Identity());
  }();
  for_voxels<Dim>(probe, [&](const Vector<Dim>& x, std::size_t) {
    if (x.norm() > radius) return;
    const double apart = (a(x) - b(x)).norm();
    sum += apart, worst = std::max(worst, apart), ++count;
  });
  return {sum / count, worst};
}

TEST(RegisterImagesGeometry, GivesTheSameWorldDisplacementOnObliqueAnisotropicGrids) {
  const ImageGrid<2> straight = centred_grid<2>({64, 64}, {1, 1}, Matrix<2>::Identity());
  const ImageGrid<2> oblique = centred_grid<2>({68, 48}, {1, 1.4}, Eigen::Rotation2Dd(0.6).toRotationMatrix());
  Matrix<2> mirrored;
  mirrored << 0, 1, 1, 0;
  const ImageGrid<2> other =
      centred_grid<2>({50, 72}, {1.3, 0.9}, Eigen::Rotation2Dd(-0.9).toRotationMatrix() * mirrored);
  const auto on = [&](const ImageGrid<2>& fixed, const ImageGrid<2>& moving) {
    return register_images<2>(pair<2>(fixed, moving, 18, 80), thorough<2>());
  };
  const RegistrationResult<2> reference = on(straight, straight);
  const auto field = [](const RegistrationResult<2>& result) {
    return [&](const Vector<2>& x) { return vector_at(result.displacement, x); };
  };
  EXPECT_LT((distance<2>(14, field(reference), motion<2>)[0]), 0.12);
  for (const auto& [fixed, moving] : {std::pair{oblique, straight}, {straight, other}, {oblique, other}}) {
    const RegistrationResult<2> result = on(fixed, moving);
    EXPECT_EQ(result.displacement.grid, fixed);
    EXPECT_EQ(result.inverse_displacement.grid, moving);
    const auto apart = distance<2>(14, field(result), field(reference));
    EXPECT_LT(apart[0], 0.1);
    EXPECT_LT(apart[1], 0.5);
    EXPECT_LT((distance<2>(14, field(result), motion<2>)[0]), 0.12);
    // psi(phi(y)) = y through both fields of the result.
    const auto back = distance<2>(
        12,
        [&](const Vector<2>& y) -> Vector<2> {
          const Vector<2> x = y + vector_at(result.inverse_displacement, y);
          return x + vector_at(result.displacement, x);
        },
        [](const Vector<2>& y) { return y; });
    EXPECT_LT(back[0], 0.05);
  }
}

TEST(RegisterImagesGeometry, GivesTheSameWorldDisplacementOnObliqueGridsInThreeDimensions) {
  const Matrix<3> turn =
      (Eigen::AngleAxisd(0.5, Vector<3>::UnitZ()) * Eigen::AngleAxisd(-0.4, Vector<3>::UnitX())).toRotationMatrix();
  const ImageGrid<3> straight = centred_grid<3>({26, 26, 26}, {1, 1, 1}, Matrix<3>::Identity());
  const ImageGrid<3> oblique = centred_grid<3>({28, 26, 15}, {1, 1.1, 2}, turn);
  const auto on = [&](const ImageGrid<3>& fixed, const ImageGrid<3>& moving) {
    return register_images<3>(pair<3>(fixed, moving, 9, 60), thorough<3>());
  };
  const RegistrationResult<3> reference = on(straight, straight), result = on(oblique, straight);
  const auto field = [](const RegistrationResult<3>& r) {
    return [&](const Vector<3>& x) { return vector_at(r.displacement, x); };
  };
  EXPECT_LT((distance<3>(7, field(reference), motion<3>)[0]), 0.25);
  EXPECT_LT((distance<3>(7, field(result), field(reference))[0]), 0.25);
}

// The start is part of u. Where it aligns the images already, sample for sample, u is the start and nothing else.
TEST(RegisterImagesGeometry, ContainsTheStartExactlyWhenItAlignsTheImages) {
  AffineMap<3> start;
  start.linear = Eigen::AngleAxisd(0.7, Vector<3>(1, 2, -1).normalized()).toRotationMatrix();
  start.offset = Vector<3>(12, -30, 5);
  RegistrationInput<3> input;
  const ImageGrid<3> grid =
      centred_grid<3>({18, 16, 10}, {1, 1.2, 2}, Eigen::AngleAxisd(0.3, Vector<3>::UnitY()).toRotationMatrix());
  input.fixed = sampled<3>(grid, AnalyticScene<3>(9, 3, 40, 3));
  input.moving = input.fixed;
  input.moving.grid.origin = start(grid.origin);
  input.moving.grid.direction = start.linear * grid.direction;
  input.start = start;
  const RegistrationResult<3> result = register_images<3>(input, thorough<3>());
  for_voxels<3>(grid, [&](const Vector<3>& x, std::size_t voxel) {
    const Vector<3> expected = start(x) - x;
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(result.displacement.component(c)[voxel], expected[c], 1e-3);
  });
  for_voxels<3>(input.moving.grid, [&](const Vector<3>& y, std::size_t voxel) {
    const Vector<3> expected = start.linear.transpose() * (y - start.offset) - y;
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(result.inverse_displacement.component(c)[voxel], expected[c], 1e-3);
  });
  for (float j : result.jacobian.samples) ASSERT_NEAR(j, 1, 2e-3);
}

// A start that scales and shears, with a motion left to find: u = start o psi - id.
TEST(RegisterImagesGeometry, FindsTheMotionThatIsLeftAfterAStart) {
  AffineMap<2> start;
  start.linear << 1.2, 0.15, -0.1, 0.9;
  start.offset = Vector<2>(7, -4);
  const AnalyticScene<2> scene(18, 3, 80, 11);
  const ImageGrid<2> fixed = centred_grid<2>({64, 64}, {1, 1}, Eigen::Rotation2Dd(0.2).toRotationMatrix());
  ImageGrid<2> moving = centred_grid<2>({90, 74}, {1, 1}, Eigen::Rotation2Dd(-0.4).toRotationMatrix());
  moving.origin += start.offset;
  // moving(start(z)) = scene(z), fixed(x) = scene(x + motion), so x + u = start(x + motion).
  RegistrationInput<2> input;
  const Matrix<2> inverse = start.linear.inverse();
  input.moving = sampled<2>(moving, [&](const Vector<2>& y) { return scene(inverse * (y - start.offset)); });
  input.fixed = sampled<2>(fixed, [&](const Vector<2>& x) { return scene(x + motion<2>(x)); });
  input.start = start;
  const RegistrationResult<2> result = register_images<2>(input, thorough<2>());
  const auto error = distance<2>(
      14, [&](const Vector<2>& x) { return vector_at(result.displacement, x); },
      [&](const Vector<2>& x) -> Vector<2> { return start(x + motion<2>(x)) - x; });
  EXPECT_LT(error[0], 0.15);
}

}  // namespace
}  // namespace saltus
