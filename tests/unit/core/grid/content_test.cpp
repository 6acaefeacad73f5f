#include "core/grid/content.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

constexpr double kNoise = 0.05;

/// Background -3 with noise, and a box that is brighter.
template <int Dim>
std::vector<float> image_of(const Lattice<Dim>& lattice, const IndexBox<Dim>& bright) {
  const std::vector<double> noise = testing::random_values(lattice.sites(), 1, kNoise);
  std::vector<float> samples(noise.begin(), noise.end());
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      bool is_inside = true;
      for (int axis = 0; axis < Dim; ++axis)
        is_inside = is_inside && index[axis] >= bright.begin[axis] && index[axis] < bright.end[axis];
      samples[site] += is_inside ? 1.0f : -3.0f;
    });
  return samples;
}

TEST(ContentBox, HoldsWhatStandsOutFromTheBackground) {
  const Lattice<3> block{{30, 26, 20}, {1, 2, 3}, {}};
  for (const IndexBox<3>& bright : {IndexBox<3>{{4, 3, 2}, {21, 25, 11}}, {{0, 7, 5}, {30, 12, 20}}}) {
    const std::vector<float> samples = image_of(block, bright);
    EXPECT_EQ(content_box(block, samples.data(), nullptr, 8 * kNoise), bright);
  }
  const Lattice<2> plane{{40, 33}, {1, 1}, {}};
  const IndexBox<2> bright{{9, 0}, {31, 20}};
  EXPECT_EQ(content_box(plane, image_of(plane, bright).data(), nullptr, 8 * kNoise), bright);
}

TEST(ContentBox, OverlooksSamplesOnTheirOwn) {
  const Lattice<3> block{{60, 50, 40}, {1, 1, 1}, {}};
  const IndexBox<3> bright{{9, 9, 9}, {40, 30, 25}};
  std::vector<float> samples = image_of(block, bright);
  // One of 3000 in its plane across z, of 2400 and of 2000 across the others.
  samples[2 * 60 + 1] = samples[35 * 60 * 50 + 45 * 60 + 55] = 50;
  EXPECT_EQ(content_box(block, samples.data(), nullptr, 8 * kNoise), bright);
  for (std::size_t x = 0; x < 8; ++x) samples[35 * 60 * 50 + 4 * 60 + x] = 50;  // two more are enough across x
  EXPECT_EQ(content_box(block, samples.data(), nullptr, 8 * kNoise), (IndexBox<3>{{9, 4, 9}, {40, 30, 36}}));
}

// Oracle: one thread. What stands out is at the limit: a plane that were counted twice would hold the other answer.
TEST(ContentBox, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const Lattice<3> block{{64, 64, 48}, {1, 1, 1}, {}};
  std::vector<float> samples = image_of(block, IndexBox<3>{{20, 20, 20}, {40, 40, 30}});
  for (int y = 0; y < 64; ++y)
    for (int i = 0; i < 3; ++i) samples[static_cast<std::size_t>((i * 16 * 64 + y) * 64 + (y + i) % 64)] = 50;
  const auto box = [&](int threads) {
    omp_set_num_threads(threads);
    return content_box(block, samples.data(), nullptr, 8 * kNoise);
  };
  const IndexBox<3> alone = box(1);
  for (int run = 0; run < 40; ++run)
    for (int threads : {2, 3, 7}) ASSERT_EQ(box(threads), alone) << threads;
}

TEST(ContentBox, HoldsNothingThatAMaskHides) {
  const Lattice<2> plane{{40, 30}, {1, 1}, {}};
  std::vector<float> samples = image_of(plane, IndexBox<2>{{5, 5}, {38, 28}}), weights(plane.sites(), 1.0f);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      if (x < 12 || y >= 20) {
        weights[static_cast<std::size_t>(40 * y + x)] = 0;
        samples[static_cast<std::size_t>(40 * y + x)] = std::numeric_limits<float>::quiet_NaN();
      }
  EXPECT_EQ(content_box(plane, samples.data(), weights.data(), 8 * kNoise), (IndexBox<2>{{12, 5}, {38, 20}}));
}

// Planes are judged by what is seen of them, and nothing is background that no border shows.
TEST(ContentBox, IsAllThatAMaskWithinTheImageShows) {
  const Lattice<2> plane{{400, 300}, {1, 1}, {}};
  const std::vector<float> samples = image_of(plane, IndexBox<2>{{0, 0}, {200, 300}});
  std::vector<float> weights(plane.sites(), 0.0f);
  for (int y = 0; y < 300; ++y)
    for (int x = 0; x < 400; ++x)
      if (std::hypot(x - 210.0, y - 100.0) <= 30) weights[static_cast<std::size_t>(400 * y + x)] = 1;
  EXPECT_EQ(content_box(plane, samples.data(), weights.data(), 8 * kNoise), (IndexBox<2>{{180, 70}, {241, 131}}));
}

TEST(ContentBox, IsAllOfAnImageThatShowsNothing) {
  const Lattice<2> plane{{40, 30}, {1, 1}, {}};
  const IndexBox<2> all{{0, 0}, {40, 30}};
  const std::vector<float> flat(plane.sites(), 7.0f), hidden(plane.sites(), 0.0f);
  EXPECT_EQ(content_box(plane, flat.data(), nullptr, 0.1), all);
  EXPECT_EQ(content_box(plane, flat.data(), hidden.data(), 0.1), all);
}

// Oracle: each sample of the part is the one at its place.
TEST(PartAround, HoldsTheBoxAndItsMargin) {
  const Lattice<3> block{{10, 12, 9}, {1, 2, 3}, {0.5, -1, 2}};
  // x: 2.5 to 6 mm is index 2 to 5.5; y: -20 mm lies before the lattice; z: 8 mm is index 2, the end lies beyond it.
  const Lattice<3> part = part_around<3>(block, {2.5, -20, 8}, {6, 3, 100}, 1.5);
  EXPECT_EQ(part.size, (Index<3>{8, 5, 9}));
  EXPECT_EQ(part.spacing, block.spacing);
  EXPECT_EQ(part.offset, (std::array<double, 3>{0.5, -1, 2}));
  const Lattice<3> inner = part_around<3>(block, {4.5, 5, 11}, {5.5, 9, 14}, 0);
  EXPECT_EQ(inner.size, (Index<3>{2, 3, 2}));
  EXPECT_EQ(inner.offset, (std::array<double, 3>{4.5, 5, 11}));
  std::vector<float> samples(block.sites());
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<float>(i);
  const std::vector<float> taken = samples_of_part(block, samples, inner);
  ASSERT_EQ(taken.size(), 12u);
  for (int z = 0; z < 2; ++z)
    for (int y = 0; y < 3; ++y)
      for (int x = 0; x < 2; ++x)
        EXPECT_EQ(taken[static_cast<std::size_t>(x + 2 * (y + 3 * z))], (x + 4) + 10 * ((y + 3) + 12 * (z + 3)));
}

}  // namespace
}  // namespace saltus
