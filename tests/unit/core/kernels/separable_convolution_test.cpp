// Oracle: the definition, summed directly in double.
#include "core/kernels/separable_convolution.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/kernels/kernel_profile.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_blocks.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

template <class T>
class SeparableConvolution : public ::testing::Test {};
using Scalars = ::testing::Types<float, double>;
TYPED_TEST_SUITE(SeparableConvolution, Scalars);

/// Random taps: any, or mirrored about 0 or about the middle between taps 0 and 1, or 0 and -1.
enum class Shape { Any, Even, Odd, OddAfter, OddBefore };
constexpr Shape kShapes[] = {Shape::Any, Shape::Even, Shape::Odd, Shape::OddAfter, Shape::OddBefore};

std::vector<double> random_row(int radius, Shape shape) {
  std::vector<double> row = testing::random_values(2 * static_cast<std::size_t>(radius) + 1, 3);
  if (shape == Shape::Any) return row;
  const int c = shape == Shape::OddAfter ? 1 : shape == Shape::OddBefore ? -1 : 0;
  const std::vector<double> any = row;
  for (int t = -radius; t <= radius; ++t) {
    const bool has_mirror = std::abs(c - t) <= radius;
    const double mirror = has_mirror ? any[static_cast<std::size_t>(c - t + radius)] : 0;
    double& tap = row[static_cast<std::size_t>(t + radius)];
    tap = !has_mirror ? 0 : shape == Shape::Even ? tap + mirror : tap - mirror;
  }
  return row;
}

template <int Dim, class T>
void expect_equal_to_brute_force(const Index<Dim>& size, int channels, int axis, int radius, Combine combine,
                                 Shape shape = Shape::Any) {
  Lattice<Dim> lattice;
  lattice.size = size;
  const std::size_t count = lattice.sites() * static_cast<std::size_t>(channels);
  const auto cast = [](const std::vector<double>& from) { return std::vector<T>(from.begin(), from.end()); };
  const std::vector<double> row = random_row(radius, shape);
  const std::vector<T> in = cast(testing::random_values(count, 1)), before = cast(testing::random_values(count, 2)),
                       taps = cast(row);
  std::vector<T> out = before;
  convolve_axis<Dim, T>(lattice, channels, axis, AxisTaps<T>(row), combine, in.data(), out.data());

  std::size_t stride = static_cast<std::size_t>(channels);
  for (int a = 0; a < axis; ++a) stride *= static_cast<std::size_t>(size[a]);
  const double tolerance = 8 * std::numeric_limits<T>::epsilon() * (2 * radius + 2);
  for (std::size_t k = 0; k < count; ++k) {
    const int i = static_cast<int>(k / stride % static_cast<std::size_t>(size[axis]));
    double expected = combine == Combine::Add ? double(before[k]) : 0.0;
    for (int j = -radius; j <= radius; ++j)
      if (i - j >= 0 && i - j < size[axis])
        expected += double(taps[static_cast<std::size_t>(j + radius)]) *
                    double(in[k - static_cast<std::size_t>(i) * stride + static_cast<std::size_t>(i - j) * stride]);
    ASSERT_NEAR(out[k], expected, tolerance) << "shape " << static_cast<int>(shape) << " axis " << axis << " radius "
                                             << radius << " channels " << channels << " at " << k;
  }
}

TYPED_TEST(SeparableConvolution, EqualsTheSumForAllAxesAndRadii) {
  for (Combine combine : {Combine::Replace, Combine::Add})
    for (int radius : {0, 1, 3, 8, 40})
      for (int channels : {1, 2, 3}) {
        // Lines and strips of whole registers and of less, and blocks of rows with a rest.
        for (int axis = 0; axis < 2; ++axis) {
          expect_equal_to_brute_force<2, TypeParam>({7, 5}, channels, axis, radius, combine);
          expect_equal_to_brute_force<2, TypeParam>({151, 33}, channels, axis, radius, combine);
          expect_equal_to_brute_force<2, TypeParam>({1, 9}, channels, axis, radius, combine);
        }
        for (int axis = 0; axis < 3; ++axis) {
          expect_equal_to_brute_force<3, TypeParam>({6, 5, 4}, channels, axis, radius, combine);
          expect_equal_to_brute_force<3, TypeParam>({23, 4, 11}, channels, axis, radius, combine);
        }
      }
}

// Any number of sides that is left of a block of rows, for rows of every kind.
TYPED_TEST(SeparableConvolution, EqualsTheSumForRowsThatMirrorThemselves) {
  for (Shape shape : kShapes)
    for (int radius = 1; radius <= 18; ++radius)
      for (Combine combine : {Combine::Replace, Combine::Add})
        for (int axis = 0; axis < 2; ++axis)
          expect_equal_to_brute_force<2, TypeParam>({50, 37}, 2, axis, radius, combine, shape);
}

// Lines that end anywhere in a register, also before the taps do.
TYPED_TEST(SeparableConvolution, EqualsTheSumForLinesOfVectorsOfAnyLength) {
  for (Combine combine : {Combine::Replace, Combine::Add})
    for (int radius = 1; radius <= 12; ++radius)
      for (int length = 1; length <= 40; length += length < 24 ? 1 : 8) {
        expect_equal_to_brute_force<2, TypeParam>({length, 3}, 2, 0, radius, combine, Shape::Even);
        expect_equal_to_brute_force<3, TypeParam>({length, 3, 2}, 3, 0, radius, combine, Shape::Even);
      }
}

// What was in `out` must not matter, not even a NaN.
TYPED_TEST(SeparableConvolution, ReplacesWhateverWasThere) {
  const Lattice<2> lattice{{70, 3}, {1, 1}, {}};
  const std::vector<TypeParam> in(lattice.sites(), TypeParam(1));
  const AxisTaps<TypeParam> taps({1, 2, 4});
  for (int axis : {0, 1}) {
    std::vector<TypeParam> out(lattice.sites(), std::numeric_limits<TypeParam>::quiet_NaN());
    convolve_axis<2, TypeParam>(lattice, 1, axis, taps, Combine::Replace, in.data(), out.data());
    EXPECT_EQ(out[70 + 35], TypeParam(7));
    EXPECT_EQ(out.front(), TypeParam(3));  // taps for j = -1 and 0: the source right of the first sample, and itself
    EXPECT_EQ(out.back(), TypeParam(6));
  }
}

// What is 0 is passed over; nothing else is. Oracle: the same field with a denormal everywhere, which is not 0.
TYPED_TEST(SeparableConvolution, GivesTheSameForFieldsThatAreZeroNearlyEverywhere) {
  const Lattice<3> lattice{{41, 23, 17}, {1, 1, 1}, {}};
  const std::size_t count = 3 * lattice.sites();
  const KernelTaps taps = cell_averaged_taps(*make_wendland_profile(5), 1.0);
  const std::vector<double> before = testing::random_values(count, 1);
  const AxisTaps<TypeParam> row(taps.slope);
  for (std::size_t at : {std::size_t{0}, count / 2, count - 3})
    for (Combine combine : {Combine::Replace, Combine::Add})
      for (int axis = 0; axis < 3; ++axis) {
        std::vector<TypeParam> sparse(count, TypeParam(0)), dense(count, std::numeric_limits<TypeParam>::denorm_min());
        sparse[at] = dense[at] = TypeParam(0.7);
        sparse[at + 2] = dense[at + 2] = TypeParam(-0.2);
        std::vector<TypeParam> out(before.begin(), before.end()), expected = out;
        convolve_axis<3, TypeParam>(lattice, 3, axis, row, combine, sparse.data(), out.data());
        convolve_axis<3, TypeParam>(lattice, 3, axis, row, combine, dense.data(), expected.data());
        for (std::size_t i = 0; i < count; ++i)
          ASSERT_NEAR(out[i], expected[i], 4 * std::numeric_limits<TypeParam>::epsilon()) << "at " << i;
      }
}

// Oracle: the same on the whole field, with 0 where nothing is given. What stands outside the blocks is a NaN.
template <int Dim, class T>
void expect_blocks_of_the_whole(const Lattice<Dim>& lattice) {
  const std::size_t count = Dim * lattice.sites();
  const T nan = std::numeric_limits<T>::quiet_NaN();
  const auto values = [&](std::uint64_t seed) {
    const std::vector<double> made = testing::random_values(count, seed);
    return std::vector<T>(made.begin(), made.end());
  };
  const auto all = BlockMask<Dim>::all(lattice), none = BlockMask<Dim>::none(lattice);
  for (double width : {2.0, 9.0}) {
    const KernelTaps taps = cell_averaged_taps(*make_wendland_profile(width), 1.0);
    for (const std::vector<double>& values_of_row : {taps.value, taps.slope, random_row(4, Shape::Any)})
      for (int axis = 0; axis < Dim; ++axis)
        for (std::uint64_t seed = 1; seed < 6; ++seed) {
          const AxisTaps<T> row(values_of_row);
          const BlockMask<Dim> in_at = seed == 1   ? all
                                       : seed == 2 ? none
                                                   : testing::random_blocks<Dim>(lattice, seed, 0.3);
          const BlockMask<Dim> out_at = seed == 3 ? all : testing::random_blocks<Dim>(lattice, seed + 10, 0.4);
          for (Combine combine : {Combine::Replace, Combine::Add}) {
            const std::vector<T> in = values(seed), before = values(seed + 20);
            std::vector<T> expected = before, out = testing::only_in<Dim, T>(lattice, out_at, before, nan);
            if (combine == Combine::Replace) std::fill(out.begin(), out.end(), nan);
            const std::vector<T> zeros_outside = testing::only_in<Dim, T>(lattice, in_at, in, T(0));
            convolve_axis<Dim, T>(lattice, Dim, axis, row, combine, zeros_outside.data(), expected.data());
            convolve_axis<Dim, T>(lattice, axis, row, combine, in_at,
                                  testing::only_in<Dim, T>(lattice, in_at, in, nan).data(), out_at, out.data());
            const std::vector<char> is_out = testing::site_flags<Dim>(lattice, out_at);
            for (std::size_t i = 0; i < count; ++i) {
              if (is_out[i / Dim])
                ASSERT_NEAR(out[i], expected[i], 60 * std::numeric_limits<T>::epsilon()) << "axis " << axis;
              else
                ASSERT_TRUE(std::isnan(out[i])) << "written outside, axis " << axis;
            }
          }
        }
  }
}

TYPED_TEST(SeparableConvolution, ReadsAndWritesTheGivenBlocksOnly) {
  expect_blocks_of_the_whole<2, TypeParam>({{41, 23}, {1, 1}, {}});
  expect_blocks_of_the_whole<2, TypeParam>({{2, 37}, {1, 1}, {}});
  expect_blocks_of_the_whole<3, TypeParam>({{22, 13, 31}, {1, 1, 1}, {}});
}

TYPED_TEST(SeparableConvolution, GivesTheSameBitsForAnyNumberOfThreads) {
  const Lattice<3> lattice{{37, 23, 19}, {1, 1, 1}, {}};
  const std::vector<double> values = testing::random_values(3 * lattice.sites(), 7);
  const std::vector<TypeParam> in(values.begin(), values.end());
  const testing::ManyThreads many;
  for (Shape shape : kShapes)
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<TypeParam> results[2];
      for (int threads : {1, 2}) {
        omp_set_num_threads(threads);
        results[threads - 1].resize(in.size());
        convolve_axis<3, TypeParam>(lattice, 3, axis, AxisTaps<TypeParam>(random_row(8, shape)), Combine::Replace,
                                    in.data(), results[threads - 1].data());
      }
      EXPECT_EQ(results[0], results[1]) << "along " << axis;
    }
}

// Oracle: the same into another field; a large one, whose rows begin with cache lines, is written past the caches.
TYPED_TEST(SeparableConvolution, MayReplaceAFieldByItself) {
  const testing::ManyThreads many;
  for (const Index<3>& size : {Index<3>{37, 23, 19}, {64, 42, 140}})
    for (int threads : {1, 2})
      for (const auto& [shape, radius] :
           {std::pair(Shape::Even, 8), {Shape::Even, 5}, {Shape::Odd, 8}, {Shape::OddAfter, 8}, {Shape::OddBefore, 8}})
        for (int axis = 0; axis < 3; ++axis) {
          omp_set_num_threads(threads);
          const Lattice<3> lattice{size, {1, 1, 1}, {}};
          const std::vector<double> values = testing::random_values(3 * lattice.sites(), 7);
          const AxisTaps<TypeParam> row(random_row(radius, shape));
          Field<TypeParam> in(values.begin(), values.end()), out(in.size(), TypeParam(7));
          convolve_axis<3, TypeParam>(lattice, 3, axis, row, Combine::Replace, in.data(), out.data());
          convolve_axis<3, TypeParam>(lattice, 3, axis, row, Combine::Replace, in.data(), in.data());
          EXPECT_TRUE(in == out) << "along " << axis << ", " << threads << " threads";
        }
}

// Oracle: the same in fields that begin within a cache line, which are not written past the caches.
TYPED_TEST(SeparableConvolution, AddsToALargeField) {
  const Lattice<3> lattice{{64, 42, 140}, {1, 1, 1}, {}};
  const std::size_t count = 3 * lattice.sites();
  const std::vector<double> values = testing::random_values(count, 7);
  for (Combine combine : {Combine::Replace, Combine::Add})
    for (Shape shape : {Shape::Even, Shape::Any})  // in one part and in two, of which the second one adds
      for (int axis = 0; axis < 3; ++axis) {
        const AxisTaps<TypeParam> row(random_row(8, shape));
        const Field<TypeParam> in(values.begin(), values.end());
        Field<TypeParam> out(count, TypeParam(7)), shifted(count + 1, TypeParam(7));
        convolve_axis<3, TypeParam>(lattice, 3, axis, row, combine, in.data(), out.data());
        convolve_axis<3, TypeParam>(lattice, 3, axis, row, combine, in.data(), shifted.data() + 1);
        EXPECT_TRUE(std::equal(out.begin(), out.end(), shifted.begin() + 1)) << "along " << axis;
      }
}

TYPED_TEST(SeparableConvolution, RefusesToReplaceAFieldByWhatTakesTwoPasses) {
  const Lattice<2> lattice{{9, 7}, {1, 1}, {}};
  const AxisTaps<TypeParam> row(random_row(2, Shape::Any));
  std::vector<TypeParam> values(lattice.sites());
  EXPECT_THROW((convolve_axis<2, TypeParam>(lattice, 1, 1, row, Combine::Replace, values.data(), values.data())),
               std::logic_error);
}

// Oracle: one axis after the other. Planes by themselves and several together, fewer planes than threads, and a field
// that is too large for the caches.
TYPED_TEST(SeparableConvolution, MakesOfPlanesTheBitsOfTwoPasses) {
  const testing::ManyThreads many;
  for (const Index<3>& size : {Index<3>{37, 23, 19}, {20, 16, 5}, {33, 50, 2}, {5, 7, 1}, {97, 101, 43}})
    for (int channels : {1, 3})
      for (Combine combine : {Combine::Replace, Combine::Add})
        for (Shape shape : {Shape::Even, Shape::Any, Shape::OddBefore}) {
          Lattice<3> lattice;
          lattice.size = size;
          const std::size_t count = lattice.sites() * static_cast<std::size_t>(channels);
          const AxisTaps<TypeParam> along_y(random_row(6, shape)), along_x(random_row(9, shape));
          const auto values = [&](std::uint64_t seed) {
            std::vector<double> made = testing::random_values(count, seed);
            std::fill_n(made.begin(), count / 3, 0.0);  // what is 0 is passed over
            return std::vector<TypeParam>(made.begin(), made.end());
          };
          const std::vector<TypeParam> in = values(1), before = values(2);
          std::vector<TypeParam> between(count), expected = before;
          convolve_axis<3, TypeParam>(lattice, channels, 1, along_y, Combine::Replace, in.data(), between.data());
          convolve_axis<3, TypeParam>(lattice, channels, 0, along_x, combine, between.data(), expected.data());
          std::vector<TypeParam> in_place = in;
          convolve_axis<3, TypeParam>(lattice, channels, 0, along_x, combine, between.data(), in_place.data());
          for (int threads : {1, 2, 3}) {
            SCOPED_TRACE(threads);
            omp_set_num_threads(threads);
            std::vector<TypeParam> out = before;
            convolve_planes<TypeParam>(lattice, channels, along_y, along_x, combine, in.data(), out.data());
            EXPECT_TRUE(out == expected) << "height " << size[1] << ", " << channels << " channels";
            out = in;
            convolve_planes<TypeParam>(lattice, channels, along_y, along_x, combine, out.data(), out.data());
            EXPECT_TRUE(out == in_place) << "in place, height " << size[1] << ", " << channels << " channels";
          }
        }
}

// Far from everything that is not zero nothing is left, not even a rounding error; and what an ill number does stays
// where taps reach.
TYPED_TEST(SeparableConvolution, CarriesNothingAlongTheLine) {
  const Lattice<2> lattice{{300, 4}, {1, 1}, {}};
  for (const auto& [shape, radius] : {std::pair(Shape::OddAfter, 9), {Shape::Even, 6}}) {
    const AxisTaps<TypeParam> taps(random_row(radius, shape));
    std::vector<TypeParam> in(2 * lattice.sites(), TypeParam(0)), out(in.size(), TypeParam(1));
    in[2 * (300 + 50)] = std::numeric_limits<TypeParam>::quiet_NaN();
    convolve_axis<2, TypeParam>(lattice, 2, 0, taps, Combine::Replace, in.data(), out.data());
    EXPECT_TRUE(std::isnan(out[2 * (300 + 55)]));
    for (int i = 0; i < 300; ++i) {
      if (std::abs(i - 50) > radius) {
        ASSERT_EQ(out[static_cast<std::size_t>(2 * (300 + i))], TypeParam(0)) << i;
      }
    }
  }
}

}  // namespace
}  // namespace saltus
