// The slip surface of a motion. Oracles: sheets of momenta whose place, normal, area and jump are known in closed form,
// and registered phantoms with their truth.
#include "core/slip/measure_slip.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "tests/support/many_threads.h"

#include "core/phantom/make_phantom.h"
#include "core/phantom/scene.h"
#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"
#include "tests/unit/core/slip/made_sheet.h"

namespace saltus {
namespace {

using testing::MadeSheet;

template <int Dim>
Lattice<Dim> lattice_of_size(int size) {
  Lattice<Dim> lattice;
  lattice.size.fill(size);
  lattice.spacing.fill(1);
  lattice.offset.fill(0);
  return lattice;
}

/// Worst and mean of what a surface should be, by closed forms for its places in the fixed image.
template <int Dim>
struct Errors {
  double off = 0, largest_off = 0, tilt = 0, jump = 0, gap = 0, area = 0, true_jump = 0;

  Errors(
      const SlipSurface<Dim>& surface, const std::function<double(const Vector<Dim>&)>& distance,
      const std::function<Vector<Dim>(const Vector<Dim>&)>& normal,
      const std::function<Vector<Dim>(const Vector<Dim>&)>& jump_of,
      const std::function<bool(const Vector<Dim>&)>& counts = [](const Vector<Dim>&) { return true; }) {
    for (const SlipPoint<Dim>& point : surface.points) {
      if (!counts(point.position)) continue;
      const Vector<Dim> n = normal(point.position), expected = jump_of(point.position);
      const double sign = point.normal.dot(n) < 0 ? -1 : 1, away = std::abs(distance(point.position));
      EXPECT_NEAR(point.normal.norm(), 1, 1e-9);
      EXPECT_NEAR(point.jump.dot(point.normal), 0, 1e-6);
      off += point.area * away;
      largest_off = std::max(largest_off, away);
      tilt += point.area * (point.normal - sign * n).norm();
      jump += point.area * (sign * point.jump - expected).norm();
      true_jump += point.area * expected.norm();
      gap += point.area * std::abs(point.gap_mm);
      area += point.area;
    }
    for (double* sum : {&off, &tilt, &jump, &gap, &true_jump}) *sum /= area;
  }
  std::string text() const {
    std::ostringstream out;
    out << "off " << off << " (most " << largest_off << ") tilt " << tilt << " jump " << jump << " of " << true_jump
        << " gap " << gap << " area " << area;
    return out.str();
  }
};

TEST(MeasureSlip, FindsALineAtAnyAngle) {
  for (double degrees : {0.0, 15.0, 45.0, 80.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const Vector<2> t(std::cos(angle), std::sin(angle)), n(-t[1], t[0]), middle(39.7, 40.2);
    const auto distance = [&](const Vector<2>& x) { return n.dot(x - middle); };
    const auto normal = [&](const Vector<2>&) { return n; };
    const MadeSheet<2> made(lattice_of_size<2>(81), distance, normal,
                            [&](const Vector<2>&) { return Vector<2>(5 * t); });
    const SlipSurface<2> surface = made.surface();
    // psi goes the other way than v.
    // Beside the border a sheet is cut off, and so are the samples that tell its jump.
    const auto is_inner = [](const Vector<2>& x) { return (x.array() > 9).all() && (x.array() < 71).all(); };
    const Errors<2> found(
        surface, distance, normal, [&](const Vector<2>&) { return Vector<2>(-5 * t); }, is_inner);
    const double length = 80 / std::max(std::abs(t[0]), std::abs(t[1]));
    EXPECT_NEAR(summarise(surface).area, length, 0.05 * length) << degrees;
    EXPECT_LT(found.off, 0.1);
    EXPECT_LT(found.largest_off, 0.5);
    EXPECT_LT(found.tilt, 0.05);
    EXPECT_LT(found.jump, 0.05 * 5);
    EXPECT_LT(found.gap, 0.1);
    EXPECT_EQ(summarise(surface).parts, 1);
  }
}

TEST(MeasureSlip, FindsACircle) {
  const Vector<2> middle(40, 40.3);
  const double radius = 24, jump = 4;
  const auto distance = [&](const Vector<2>& x) { return (x - middle).norm() - radius; };
  const auto normal = [&](const Vector<2>& x) { return Vector<2>((x - middle).normalized()); };
  const auto tangent = [&](const Vector<2>& x) { return Vector<2>(-normal(x)[1], normal(x)[0]); };
  const MadeSheet<2> made(lattice_of_size<2>(81), distance, normal,
                          [&](const Vector<2>& x) { return Vector<2>(jump * tangent(x)); });
  const SlipSurface<2> surface = made.surface();
  const Errors<2> found(surface, distance, normal, [&](const Vector<2>& x) { return Vector<2>(-jump * tangent(x)); });
  const double length = 2 * std::numbers::pi * radius;
  EXPECT_NEAR(found.area, length, 0.03 * length);
  EXPECT_LT(found.off, 0.3);
  EXPECT_LT(found.largest_off, 0.5);
  EXPECT_LT(found.jump, 0.1 * jump);
  EXPECT_LT(found.gap, 0.15);
  EXPECT_EQ(summarise(surface).parts, 1);
  for (const SlipPoint<2>& point : surface.points) EXPECT_GT(point.normal.dot(normal(point.position)), 0.9);
}

TEST(MeasureSlip, FindsATiltedPlane) {
  const Vector<3> n = Vector<3>(1, 2, -1.5).normalized(), t = n.cross(Vector<3>::Unit(0)).normalized(),
                  middle(15.3, 16, 15.8);
  const auto distance = [&](const Vector<3>& x) { return n.dot(x - middle); };
  const auto normal = [&](const Vector<3>&) { return n; };
  const MadeSheet<3> made(lattice_of_size<3>(32), distance, normal, [&](const Vector<3>&) { return Vector<3>(3 * t); });
  const SlipSurface<3> surface = made.surface();
  const auto is_inner = [&](const Vector<3>& x) { return (x - middle).norm() < 8; };
  const Errors<3> found(
      surface, distance, normal, [&](const Vector<3>&) { return Vector<3>(-3 * t); }, is_inner);
  EXPECT_NEAR(found.area, std::numbers::pi * 64, 0.05 * std::numbers::pi * 64);
  EXPECT_LT(found.off, 0.1);
  EXPECT_LT(found.tilt, 0.05);
  EXPECT_LT(found.jump, 0.06 * 3);
  EXPECT_LT(found.gap, 0.1);
}

// A ball that turns in its socket.
TEST(MeasureSlip, FindsASphere) {
  const Vector<3> middle(20, 19.6, 20.2);
  const double radius = 12, turn = 0.2;
  const auto distance = [&](const Vector<3>& x) { return (x - middle).norm() - radius; };
  const auto normal = [&](const Vector<3>& x) { return Vector<3>((x - middle).normalized()); };
  const auto jump = [&](const Vector<3>& x) { return Vector<3>(turn * Vector<3>::Unit(2).cross(radius * normal(x))); };
  const MadeSheet<3> made(lattice_of_size<3>(41), distance, normal, jump, 6);
  const SlipSurface<3> surface = made.surface();
  const Errors<3> found(surface, distance, normal, [&](const Vector<3>& x) { return Vector<3>(-jump(x)); });
  const double area = 4 * std::numbers::pi * radius * radius;
  EXPECT_NEAR(found.area, area, 0.05 * area);
  EXPECT_LT(found.off, 0.3);
  EXPECT_LT(found.jump, 0.05 * found.true_jump);
  EXPECT_LT(found.gap, 0.15);
  for (const SlipPoint<3>& point : surface.points) {
    if (jump(point.position).norm() < 0.3 * turn * radius) continue;  // about the poles hardly anything slides
    EXPECT_LT(std::abs(distance(point.position)), 0.6);
  }
}

struct Slip {
  std::unique_ptr<Scene<2>> scene;
  RegistrationResult<2> found;

  Slip(InterfaceShape shape, double degrees, int orientations, int size = 96) {
    PhantomOptions options = default_phantom_options(PhantomKind::Slip);
    options.interface = shape;
    options.size = {size, size, 1};
    options.angle_deg = degrees;
    options.radius_mm = size * 0.28;
    scene = make_scene<2>(options);
    const Phantom<2> phantom = make_phantom<2>(options);
    RegistrationInput<2> input = testing::pair_of(phantom);
    RegistrationOptions how = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
    how.threads = 1;
    how.momenta.orientations = orientations;
    found = register_images<2>(input, how);
  }
  Errors<2> errors(const SlipSurface<2>& surface) const {
    const auto distance = [&](const Vector<2>& x) { return scene->interface_distance(x); };
    const auto normal = [&](const Vector<2>& x) {
      Vector<2> n;
      for (int c = 0; c < 2; ++c)
        n[c] = distance(x + 0.01 * Vector<2>::Unit(c)) - distance(x - 0.01 * Vector<2>::Unit(c));
      return Vector<2>(n.normalized());
    };
    const auto jump = [&](const Vector<2>& x) {
      const Vector<2> on = x - distance(x) * normal(x), up = on + 1e-6 * normal(x), down = on - 1e-6 * normal(x);
      return Vector<2>(scene->to_moving(up) - up - scene->to_moving(down) + down);
    };
    return Errors<2>(surface, distance, normal, jump);
  }
};

// What a registration of noisy images finds is not the truth; that is in these tolerances too. Where the images end,
// nothing tells how far tissue slides.
void expect_the_interface(const Slip& slip, double extent) {
  const SlipSurface<2>& surface = slip.found.slip;
  SlipSurface<2> main = surface;
  std::erase_if(main.points, [&](const SlipPoint<2>& point) { return point.part > 0; });
  const Errors<2> found = slip.errors(main);
  EXPECT_LT(found.off, 0.5) << "mean distance, voxels";
  EXPECT_NEAR(found.area, extent, 0.05 * extent);
  EXPECT_NEAR(summarise(main).jump_mean_mm, found.true_jump, 0.12 * found.true_jump);
  EXPECT_LT(found.gap, 0.35);
  EXPECT_GT(found.area, 0.9 * summarise(surface).area) << "what is elsewhere is little";
  const auto sliding = [](const SlipSurface<2>& of) { return summarise(of).area * summarise(of).jump_mean_mm; };
  EXPECT_GT(sliding(main), 0.95 * sliding(surface)) << "what slides elsewhere is little";
}

TEST(MeasureSlip, FindsTheInterfaceOfARegisteredLine) {
  const double c = std::cos(15 * std::numbers::pi / 180);
  expect_the_interface(Slip(InterfaceShape::Line, 15, 8), 96 / c);
}

TEST(MeasureSlip, FindsTheInterfaceOfARegisteredCircle) {
  expect_the_interface(Slip(InterfaceShape::Circle, 0, 8), 2 * std::numbers::pi * 0.28 * 96);
}

// Nothing but momenta along the axes, whose jumps are steps. Where the images end these may go on along the border: the
// width of a kernel beside it is left out.
TEST(MeasureSlip, FindsALineThatAxisAlignedMomentaMadeOfSteps) {
  const Slip slip(InterfaceShape::Line, 30, 0);
  SlipSurface<2> main = slip.found.slip;
  std::erase_if(main.points, [&](const SlipPoint<2>& point) {
    return point.part > 0 || point.position.minCoeff() < 6 || point.position.maxCoeff() > 95 - 6;
  });
  const Errors<2> found = slip.errors(main);
  EXPECT_LT(found.off, 1.0);
  EXPECT_LT(found.tilt, 0.3);
}

/// A line at 20 degrees.
MadeSheet<2> oblique_line(double along, double across, int time_steps = 2) {
  const Vector<2> t(std::cos(0.35), std::sin(0.35)), n(-t[1], t[0]), middle(30, 30);
  return MadeSheet<2>(
      lattice_of_size<2>(61), [=](const Vector<2>& x) { return n.dot(x - middle); },
      [=](const Vector<2>&) { return n; }, [=](const Vector<2>&) { return Vector<2>(along * t + across * n); }, 9,
      time_steps);
}

// A line that stays, 3 samples from where images may end.
TEST(MeasureSlip, LeavesOutWhatImagesDoNotTell) {
  const auto at_x = [](double x) {
    return MadeSheet<2>(
        lattice_of_size<2>(61), [=](const Vector<2>& at) { return at[0] - x; },
        [](const Vector<2>&) { return Vector<2>(1, 0); }, [](const Vector<2>&) { return Vector<2>(0, 4); });
  };
  EXPECT_TRUE(at_x(57).surface().points.empty()) << "the fixed image ends";
  const MadeSheet<2> inner = at_x(30);
  const SlipSurface<2> whole = inner.surface();
  EXPECT_NEAR(summarise(whole).area, 60, 3);
  ImageGrid<2> moving = inner.grid();
  moving.size[0] = 34;
  EXPECT_TRUE(inner.surface(inner.grid(), {}, moving).points.empty()) << "the moving image ends";
  // Of a line that leaves the images most is told, so all of it is there.
  moving = inner.grid();
  moving.size[1] = 40;
  EXPECT_EQ(inner.surface(inner.grid(), {}, moving).points.size(), whole.points.size());
}

// The same motion in a world that is turned, moved and stretched on the way to the moving image.
TEST(MeasureSlip, GoesThroughDirectionsAndAffineStart) {
  const MadeSheet<2> made = oblique_line(4, 0);
  const SlipSurface<2> plain = made.surface();
  ImageGrid<2> grid = made.grid();
  const double c = std::cos(0.7), s = std::sin(0.7);
  grid.direction << c, -s, s, c;
  grid.origin = Vector<2>(-40, 13);
  const AffineMap<2> start{1.5 * Matrix<2>::Identity(), Vector<2>(3, 4)};
  const SlipSurface<2> turned = made.surface(grid, start);
  ASSERT_EQ(turned.points.size(), plain.points.size());
  ASSERT_GT(plain.points.size(), 40u);
  const double sign = turned.points[0].normal.dot(grid.direction * plain.points[0].normal);
  EXPECT_NEAR(std::abs(sign), 1, 1e-9);
  for (std::size_t i = 0; i < plain.points.size(); ++i) {
    const SlipPoint<2>&a = plain.points[i], &b = turned.points[i];
    EXPECT_NEAR((b.position - grid.origin - grid.direction * a.position).norm(), 0, 1e-9);
    EXPECT_NEAR((b.jump - sign * 1.5 * (grid.direction * a.jump)).norm(), 0, 1e-6);
    EXPECT_NEAR(b.gap_mm, 1.5 * a.gap_mm, 5e-3);
    EXPECT_NEAR(b.area, a.area, 1e-9);
  }
}

TEST(MeasureSlip, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const MadeSheet<2> made = oblique_line(4, 0);
  std::vector<SlipSurface<2>> found;
  for (int threads : {1, 2}) {
    omp_set_num_threads(threads);
    found.push_back(made.surface());
  }
  ASSERT_EQ(found[0].points.size(), found[1].points.size());
  for (std::size_t i = 0; i < found[0].points.size(); ++i) {
    EXPECT_EQ(found[0].points[i].position, found[1].points[i].position);
    EXPECT_EQ(found[0].points[i].jump, found[1].points[i].jump);
    EXPECT_EQ(found[0].points[i].gap_mm, found[1].points[i].gap_mm);
  }
}

// Momenta m_i may have a part along i. The forward flow opens a gap of 1 mm, so psi closes one.
TEST(MeasureSlip, TellsGapsFromOverlaps) {
  for (double opening : {1.0, -1.0}) {
    MomentumScaleOptions<2> options;
    options.kernel = make_wendland_profile(9);
    options.lattice = lattice_of_size<2>(49);
    options.orders = Orders::First;
    MomentumScale<2, float> scale(options);
    std::vector<float> first(2 * scale.field_size(), 0.0f);
    // A sheet one face thick jumps by -6 h / sigma times its momentum.
    for (int x = 0; x < 49; ++x) {
      const std::size_t site = static_cast<std::size_t>(24 * 49 + x);
      first[scale.field_size() + 2 * site] = static_cast<float>(-2 * 9 / 6.0);
      first[scale.field_size() + 2 * site + 1] = static_cast<float>(-opening * 9 / 6.0);
    }
    MomentumPointers<float> momenta;
    momenta.first = first.data();
    GeodesicShooting<2, float> shooting({&scale}, options.lattice, 4, Evolution::Carried);
    shooting.shoot({momenta});
    ImageGrid<2> grid;
    grid.size = options.lattice.size;
    const Field<float> backward = backward_map<2, float>(options.lattice, options.lattice, shooting.velocities());
    const SlipSurface<2> surface = measure_slip<2>(jump_elements<2, float>(scale, momenta),
                                                   {options.lattice, shooting.velocities(), grid, backward, {}, grid});
    int count = 0;
    for (const SlipPoint<2>& point : surface.points) {
      if (std::abs(point.position[0] - 24) > 12) continue;
      EXPECT_NEAR(point.gap_mm, -opening, 0.15) << point.position.transpose();
      EXPECT_NEAR(point.jump.norm(), 2, 0.15);
      ++count;
    }
    EXPECT_GT(count, 15);
  }
}

TEST(MeasureSlip, IsEmptyWhereNothingJumps) {
  const MadeSheet<2> made = oblique_line(0, 0);
  const SlipSurface<2> surface = made.surface();
  EXPECT_TRUE(surface.points.empty());
  EXPECT_TRUE(made.elements().empty());
}

}  // namespace
}  // namespace saltus
