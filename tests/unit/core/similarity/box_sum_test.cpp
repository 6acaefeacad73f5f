#include "core/similarity/box_sum.h"

#include <gtest/gtest.h>

#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

// Oracle: the sum over the box, term by term.
template <int Dim, class T>
void expect_brute_force(const Index<Dim>& size, const Index<Dim>& radius, double tolerance) {
  Lattice<Dim> lattice;
  lattice.size = size;
  lattice.spacing.fill(1);
  const auto values = testing::random_values(lattice.sites(), 1);
  std::vector<T> field(values.begin(), values.end());
  const std::vector<T> before = field;
  BoxSum<Dim, T>(lattice, radius).apply(field.data());
  const auto last = [](const auto& of) { return Dim == 3 ? of[Dim - 1] : 0; };  // an axis more with a single plane
  const int planes = Dim == 3 ? size[Dim - 1] : 1;
  const auto site_of = [&](int x, int y, int z) { return static_cast<std::size_t>(x + size[0] * (y + size[1] * z)); };
  for (int z = 0; z < planes; ++z)
    for (int y = 0; y < size[1]; ++y)
      for (int x = 0; x < size[0]; ++x) {
        double expected = 0;
        for (int k = std::max(0, z - last(radius)); k <= std::min(planes - 1, z + last(radius)); ++k)
          for (int j = std::max(0, y - radius[1]); j <= std::min(size[1] - 1, y + radius[1]); ++j)
            for (int i = std::max(0, x - radius[0]); i <= std::min(size[0] - 1, x + radius[0]); ++i)
              expected += before[site_of(i, j, k)];
        ASSERT_NEAR(field[site_of(x, y, z)], expected, tolerance) << x << " " << y << " " << z;
      }
}

TEST(BoxSum, EqualsTheSumOverTheBox) {
  for (const Index<3>& radius : {Index<3>{0, 0, 0}, {1, 1, 1}, {3, 0, 2}, {2, 9, 40}}) {
    expect_brute_force<3, double>({7, 5, 6}, radius, 1e-12);
    expect_brute_force<3, double>({390, 3, 4}, radius, 1e-12);  // rows of more than one strip
    expect_brute_force<3, double>({5, 1, 4}, radius, 1e-12);
    expect_brute_force<3, double>({1, 2, 9}, radius, 1e-12);
    expect_brute_force<3, double>({2, 4, 1}, radius, 1e-12);
    expect_brute_force<3, float>({7, 5, 6}, radius, 3e-5);
  }
  // Running sums that rows enter and leave, along all axes; rows of more than one strip.
  expect_brute_force<3, double>({11, 12, 13}, {4, 3, 5}, 1e-12);
  expect_brute_force<3, double>({300, 9, 8}, {3, 3, 3}, 1e-12);
}

TEST(BoxSum, EqualsTheSumOverTheBoxInThePlane) {
  for (const Index<2>& radius : {Index<2>{0, 2}, {1, 4}, {5, 1}, {3, 20}}) {
    expect_brute_force<2, double>({300, 9}, radius, 1e-12);
    expect_brute_force<2, double>({130, 400}, radius, 1e-11);  // running sums: strips of 81 lines
    expect_brute_force<2, double>({20, 5000}, radius, 1e-10);  // of 8, the fewest
    expect_brute_force<2, double>({9, 300}, radius, 1e-12);
    expect_brute_force<2, double>({1, 7}, radius, 1e-12);
    expect_brute_force<2, double>({7, 2}, radius, 1e-12);
  }
}

// Threads share slabs or, where these are few, their rows and strips, and then strips across them, each in place: the
// same sums, bit by bit, however many there are.
TEST(BoxSum, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const Lattice<3> space{{300, 9, 11}, {1, 1, 1}, {}};
  const Lattice<2> plane{{300, 23}, {1, 1}, {}};
  for (int radius : {1, 4}) {  // summed anew, and running
    const auto sums = [&](int threads) {
      omp_set_num_threads(threads);
      const auto values = testing::random_values(space.sites(), 2);
      std::vector<float> in_space(values.begin(), values.end());
      std::vector<float> in_plane(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(plane.sites()));
      BoxSum<3, float>(space, {radius, radius, radius}).apply(in_space.data());
      BoxSum<2, float>(plane, {radius, radius}).apply(in_plane.data());
      in_space.insert(in_space.end(), in_plane.begin(), in_plane.end());
      return in_space;
    };
    const std::vector<float> expected = sums(1);
    for (int threads : {2, 3, 8}) EXPECT_EQ(sums(threads), expected) << radius << ", " << threads << " threads";
  }
}

// Running sums must not drift: all full boxes of a flat field hold exactly the same.
TEST(BoxSum, KeepsFlatFieldsFlat) {
  const Lattice<2> lattice{{500, 60}, {1, 1}, {}};
  std::vector<float> field(lattice.sites(), 0.1f);
  BoxSum<2, float>(lattice, {3, 3}).apply(field.data());
  for (int y = 3; y < 57; ++y)
    for (int x = 3; x < 497; ++x)
      ASSERT_EQ(field[static_cast<std::size_t>(500 * y + x)], field[500 * 30 + 250]) << x << " " << y;
  EXPECT_NEAR(field[500 * 30 + 250], 4.9f, 1e-6f);
}

}  // namespace
}  // namespace saltus
