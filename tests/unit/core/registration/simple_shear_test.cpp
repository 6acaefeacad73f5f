#include "core/registration/simple_shear.h"

#include "core/support/thread_count.h"
#include "tests/support/many_threads.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace saltus {
namespace {

/// v = A x, sampled in double.
template <int Dim>
Field<double> affine(const Lattice<Dim>& lattice, const Matrix<Dim>& a) {
  Field<double> velocity(Dim * lattice.sites());
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      Vector<Dim> x;
      for (int axis = 0; axis < Dim; ++axis) x[axis] = index[axis] * lattice.spacing[axis];
      const Vector<Dim> v = a * x;
      for (int c = 0; c < Dim; ++c) velocity[Dim * site + c] = v[c];
    });
  return velocity;
}

const Lattice<2> plane{{9, 7}, {1.5, 0.5}, {}};
const Lattice<3> block{{6, 5, 7}, {1, 2, 0.75}, {}};

TEST(SimpleShear, IsThatOfTheMatrixWhereTheFieldIsLinear) {
  Matrix<2> stretch, rotation, narrowing;
  narrowing << 1, 0, 0, 0;
  stretch << 1, 0, 0, -1;
  rotation << 0, -1, 1, 0;
  EXPECT_NEAR(simple_shear(plane, affine(plane, narrowing)), 1, 1e-9);
  EXPECT_NEAR(simple_shear(plane, affine(plane, stretch)), 2, 1e-9);
  EXPECT_NEAR(simple_shear(plane, affine(plane, rotation)), 2, 1e-9);
  Matrix<3> turn = Matrix<3>::Zero();
  turn(0, 2) = 3, turn(2, 0) = -3;
  EXPECT_NEAR(simple_shear(block, affine(block, turn)), 2, 1e-9);
}

TEST(SimpleShear, HasNoBoundButTheOneToldForASlipInAnyDirection) {
  for (double degrees : {0.0, 17.0, 45.0, 110.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const Vector<2> n(std::cos(angle), std::sin(angle)), t(-n[1], n[0]);
    EXPECT_EQ(simple_shear(plane, affine(plane, Matrix<2>(t * n.transpose()))), 1e6) << degrees;
  }
  const Vector<3> n = Vector<3>(1, 2, -2) / 3, t = Vector<3>(2, 1, 2) / 3;
  EXPECT_EQ(simple_shear(block, affine(block, Matrix<3>(t * n.transpose()))), 1e6);
  EXPECT_NEAR(simple_shear(block, affine(block, Matrix<3>(n * n.transpose()))), 1, 1e-9);  // opens
}

TEST(SimpleShear, IsZeroWhereNothingChanges) {
  EXPECT_EQ(simple_shear(plane, Field<float>(2 * plane.sites(), 3.0f)), 0);
  EXPECT_EQ(simple_shear(Lattice<3>{{1, 1, 1}, {1, 1, 1}, {}}, Field<float>(3, 1.0f)), 0);
}

// Of independent normal entries the means of |D|^4 and |D^2|^2 are 24 and 12 in 2-D, 99 and 33 in 3-D. Velocities that
// are independent from sample to sample have such differences where they are central and spacings are even.
TEST(SimpleShear, IsTwoOrThreeByChance) {
  std::mt19937 random(5);
  std::normal_distribution<float> normal;
  const Lattice<2> wide{{400, 400}, {1, 1}, {}};
  Field<float> flat(2 * wide.sites());
  for (float& value : flat) value = normal(random);
  EXPECT_NEAR(simple_shear(wide, flat), 2, 0.03);
  const Lattice<3> deep{{60, 60, 60}, {1, 1, 1}, {}};
  Field<float> solid(3 * deep.sites());
  for (float& value : solid) value = normal(random);
  EXPECT_NEAR(simple_shear(deep, solid), 3, 0.1);
}

// v = (d psi / dy, -d psi / dx), psi a sum of many waves in all directions, is isotropic: 112 / 24.
TEST(SimpleShear, IsFourteenThirdsByChanceWhereVolumeIsKept) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> phase(0, 2 * std::numbers::pi);
  const Lattice<2> wide{{256, 256}, {1, 1}, {}};
  double sum = 0;
  constexpr int runs = 8;
  for (int run = 0; run < runs; ++run) {
    Field<double> velocity(2 * wide.sites(), 0.0);
    for (int wave = 0; wave < 30; ++wave) {
      const double angle = phase(random), shift = phase(random), kx = 0.3 * std::cos(angle), ky = 0.3 * std::sin(angle);
      for (int y = 0; y < wide.size[1]; ++y)
        for (int x = 0; x < wide.size[0]; ++x) {
          const double slope = std::cos(kx * x + ky * y + shift);
          velocity[2 * (256 * y + x)] += ky * slope;
          velocity[2 * (256 * y + x) + 1] -= kx * slope;
        }
    }
    sum += simple_shear(wide, velocity);
  }
  EXPECT_NEAR(sum / runs, 14.0 / 3, 0.35);
}

TEST(SimpleShear, IsZeroWhereTheFieldIsNotFinite) {
  Field<double> velocity(2 * plane.sites(), 1.0);
  for (double value : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    velocity[30] = value;
    EXPECT_EQ(simple_shear(plane, velocity), 0);
  }
}

// A layer in which all shears, in the middle of a motion that is smooth and larger: fourth powers tell the layer.
TEST(SimpleShear, TellsALayerFromWhatMovesSmoothlyBesides) {
  const Lattice<2> image{{96, 96}, {1, 1}, {}};
  const auto with_jump = [&](double jump) {
    Field<double> velocity(2 * image.sites());
    for (int slab = 0; slab < image.size[1]; ++slab)
      visit_slab<2>(image, slab, [&](const Index<2>& index, std::size_t site) {
        const double across = 0.6 * index[0] + 0.8 * index[1] - 67;
        const double along = jump / 2 * std::tanh(across / 3);
        velocity[2 * site] = 0.8 * along + 8 * std::sin(index[0] / 15.0) * std::cos(index[1] / 20.0);
        velocity[2 * site + 1] = -0.6 * along + 8 * std::cos(index[0] / 18.0) * std::sin(index[1] / 14.0);
      });
    return simple_shear(image, velocity);
  };
  EXPECT_LT(with_jump(0), 3);
  EXPECT_GT(with_jump(12), 5);
}

template <class T>
Field<T> noise(std::size_t count) {
  std::mt19937 random(2);
  std::normal_distribution<T> normal;
  Field<T> values(count);
  for (T& value : values) value = normal(random);
  return values;
}

/// Sorted by others, from differences that are written out here.
template <int Dim, class T>
void expect_medians(const Lattice<Dim>& lattice) {
  const Field<T> field = noise<T>(Dim * lattice.sites());
  const Matrix<Dim> usual = usual_derivative(lattice, field);
  for (int axis = 0; axis < Dim; ++axis)
    for (int c = 0; c < Dim; ++c) {
      std::vector<T> entries;
      for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
        visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t) {
          const auto at = [&](int step) {
            Index<Dim> other = index;
            other[axis] = std::clamp(other[axis] + step, 0, lattice.size[axis] - 1);
            std::size_t site = 0;
            for (int a = Dim - 1; a >= 0; --a) site = site * lattice.size[a] + other[a];
            return std::pair(field[Dim * site + c], other[axis]);
          };
          const auto [above, last] = at(1);
          const auto [below, first] = at(-1);
          entries.push_back(last == first ? T(0)
                                          : (above - below) / static_cast<T>((last - first) * lattice.spacing[axis]));
        });
      std::sort(entries.begin(), entries.end());
      EXPECT_EQ(usual(c, axis), entries[entries.size() / 2]) << c << " along " << axis;
    }
}

TEST(UsualDerivative, IsTheMedianOfEachEntry) {
  expect_medians<2, float>(plane);
  expect_medians<2, double>(plane);
  expect_medians<3, float>(block);
  expect_medians<3, double>({{5, 1, 4}, {1, 2, 0.75}, {}});
}

// As it would be seen if the frame did not turn and stretch.
TEST(UsualDerivative, OfAFrameThatTurnsHidesNoSlip) {
  const Lattice<3> image{{24, 24, 24}, {1, 2, 1.5}, {}};
  Matrix<3> turn;
  turn << 0.05, -0.2, 0.1, 0.2, -0.05, 0, -0.1, 0.03, 0.02;
  Field<double> slip(3 * image.sites()), turned = affine(image, turn);
  for (int slab = 0; slab < image.size[2]; ++slab)
    visit_slab<3>(image, slab, [&](const Index<3>& index, std::size_t site) {
      const double along = 2 * std::tanh((0.6 * index[0] + 0.8 * index[1] * 2 - 26) / 3);
      slip[3 * site] = 0.8 * along;
      slip[3 * site + 1] = -0.6 * along;
    });
  for (std::size_t i = 0; i < slip.size(); ++i) turned[i] += slip[i];
  const double seen = simple_shear(image, slip, usual_derivative(image, slip));
  EXPECT_GT(seen, 100);
  EXPECT_LT(simple_shear(image, turned), 4);
  EXPECT_NEAR(simple_shear(image, turned, usual_derivative(image, turned)), seen, 1e-6 * seen);
  EXPECT_EQ(shear_of_slip(image, turned), simple_shear(image, turned, usual_derivative(image, turned)));
}

// A layer in which all shears and which is most of the image, beside a part that turns: what is left of that without
// the shear of most is no simple shear.
TEST(UsualDerivative, OfWhatSlidesInMostOfTheFrameHidesNoSlip) {
  const Lattice<2> image{{3, 200}, {1, 1}, {}};
  Field<double> layer(2 * image.sites());
  for (int slab = 0; slab < image.size[1]; ++slab)
    visit_slab<2>(image, slab, [&](const Index<2>& index, std::size_t site) {
      const int beyond = std::max(0, slab - 120);
      layer[2 * site] = std::min(slab, 120) - 0.5 * beyond;
      layer[2 * site + 1] = beyond > 0 ? 0.5 * (index[0] - 1) : 0;
    });
  const double as_it_is = simple_shear(image, layer);
  EXPECT_GT(as_it_is, 10);
  EXPECT_LT(simple_shear(image, layer, usual_derivative(image, layer)), 7);
  EXPECT_EQ(shear_of_slip(image, layer), as_it_is);
}

TEST(SimpleShear, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const Field<float> velocity = noise<float>(3 * block.sites());
  const auto with = [&](int threads) {
    const ThreadCount count(threads);
    return simple_shear(block, velocity, usual_derivative(block, velocity));
  };
  EXPECT_EQ(with(1), with(2));
  EXPECT_EQ(with(1), with(5));
}

}  // namespace
}  // namespace saltus
