#include "core/registration/move_points.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "core/phantom/make_phantom.h"
#include "core/support/errors.h"
#include "tests/support/analytic_scene.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

using testing::vector_at;

struct Rectangle {
  Phantom<2> phantom;
  RegistrationInput<2> input;
  RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ssd, Preset::Balanced);

  Rectangle() {
    PhantomOptions scene = default_phantom_options(PhantomKind::Rectangle);
    scene.size = {48, 48, 1};
    scene.slip_mm = 4;
    phantom = make_phantom<2>(scene);
    input = testing::pair_of(phantom);
    options.pyramid.levels = 2;
    options.pyramid.finest_level = 0;
    options.momenta.width_voxels = 7;
    options.momenta.scales = 2;
    options.momenta.sparsity = 0;
    // To the minimum: before it, what opens beside the interface (0.8 to 1.2) is that of the last step taken.
    options.optimisation.max_iterations = 150;
    options.optimisation.tolerance = 1e-4;
  }
};

// Two oracles: off the interface the displacement field, followed from every voxel by another scheme; beside it the
// truth of the phantom, whose two sides move by half the slip each way.
TEST(MovePoints, AgreesWithTheFieldOffTheInterfaceAndIsSharpAtIt) {
  Rectangle scene;
  const Vector<2> middle = scene.phantom.fixed.grid.to_world(Vector<2>(23.5, 23.5));
  std::vector<Vector<2>>& points = scene.input.fixed_points;
  for (int i = -3; i <= 3; ++i)
    for (double off : {-9.3, -4.4, -0.1, 0.1, 4.4, 9.3}) points.push_back(middle + Vector<2>(2.1 * i, off));
  const RegistrationResult<2> found = register_images(scene.input, scene.options);
  ASSERT_EQ(found.moved_points.size(), points.size());
  double off_interface = 0, particles = 0, field = 0, volume = 0;
  int near = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const TransportedPoint<2>& moved = found.moved_points[i];
    ASSERT_EQ(moved.ending, TrajectoryEnd::Complete) << i << ": " << to_string(moved.ending);
    const Vector<2> u = moved.position - points[i], interpolated = vector_at(found.displacement, points[i]);
    const double off = points[i][1] - middle[1];
    if (std::abs(off) > 1) {
      off_interface = std::max(off_interface, (u - interpolated).norm());
      continue;
    }
    // The truth of the nearest voxel is that of the side.
    const Vector<2> truth =
        vector_at(scene.phantom.displacement, Vector<2>(points[i] + Vector<2>(0, off > 0 ? 1.5 : -1.5)));
    particles += std::abs(u[0] - truth[0]);
    field += std::abs(interpolated[0] - truth[0]);
    volume += moved.fundamental.determinant();
    ++near;
  }
  EXPECT_LT(off_interface, 0.1) << "voxels";
  EXPECT_LT(particles / near, 0.5) << "mm beside the interface";
  EXPECT_GT(field / near, 1.2) << "interpolation mixes two sides that are 4 mm apart";
  EXPECT_NEAR(volume / near, 1, 0.2);
}

TEST(MovePoints, GoesThroughDirectionsAndAffineStart) {
  Rectangle scene;
  scene.options.model = Model::Gaussian;  // nothing jumps: field and particles are the same everywhere
  scene.options.optimisation.max_iterations = 4;
  const double c = std::cos(0.4), s = std::sin(0.4);
  Matrix<2> turn;
  turn << c, -s, s, c;
  for (ImageGrid<2>* grid : {&scene.input.fixed.grid, &scene.input.moving.grid}) {
    grid->direction = turn;
    grid->origin = Vector<2>(-30, 12);
  }
  scene.input.start.linear += 0.02 * turn;
  scene.input.start.offset = -0.02 * turn * scene.input.fixed.grid.to_world(Vector<2>(23.5, 23.5));
  const Vector<2> point = scene.input.fixed.grid.to_world(Vector<2>(20, 34));
  scene.input.fixed_points = {point};
  const RegistrationResult<2> found = register_images(scene.input, scene.options);
  EXPECT_LT((found.moved_points[0].position - point - vector_at(found.displacement, point)).norm(), 0.05);
  Matrix<2> differences = Matrix<2>::Identity();
  for (int a = 0; a < 2; ++a)
    differences.col(a) += (vector_at(found.displacement, Vector<2>(point + Vector<2>::Unit(a))) -
                           vector_at(found.displacement, Vector<2>(point - Vector<2>::Unit(a)))) /
                          2;
  EXPECT_LT((found.moved_points[0].fundamental - differences).norm(), 0.05);
}

TEST(MovePoints, RefusesAPointThatIsNotFinite) {
  Rectangle scene;
  scene.input.fixed_points = {Vector<2>(0, 0), Vector<2>(std::nan(""), 1)};
  try {
    register_images(scene.input, scene.options);
    FAIL();
  } catch (const InvalidInput& error) {
    EXPECT_NE(std::string(error.what()).find("point 2"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace saltus
