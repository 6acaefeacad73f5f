// Oracle: the definition, site by site.
#include "core/momenta/block_set.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/support/errors.h"
#include "tests/support/lattices.h"

namespace saltus {
namespace {

using testing::unit_lattice;

/// Number of the block of each site.
template <int Dim>
std::vector<std::uint32_t> block_of_sites(const Lattice<Dim>& lattice) {
  std::vector<std::uint32_t> blocks;
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t) {
      std::uint32_t block = 0;
      for (int axis = Dim - 1; axis >= 0; --axis) block = block * ((lattice.size[axis] + 3) / 4) + index[axis] / 4;
      blocks.push_back(block);
    });
  return blocks;
}

/// Every `step`-th block from the first, and the last.
std::vector<std::uint32_t> some_of(std::size_t blocks, std::size_t step) {
  std::vector<std::uint32_t> active;
  for (std::size_t block = 0; block < blocks; ++block)
    if (block % step == 0 || block + 1 == blocks) active.push_back(static_cast<std::uint32_t>(block));
  return active;
}

std::vector<float> numbers(std::size_t count) {
  std::vector<float> values(count);
  std::iota(values.begin(), values.end(), 1.0f);
  return values;
}

template <int Dim>
void expect_round_trips(const Index<Dim>& size) {
  const Lattice<Dim> lattice = unit_lattice<Dim>(size);
  const std::vector<std::uint32_t> block_of = block_of_sites(lattice);
  const std::size_t blocks = BlockSet<Dim>::none(lattice).blocks();
  ASSERT_EQ(blocks, *std::max_element(block_of.begin(), block_of.end()) + 1u);
  std::vector<std::vector<std::uint32_t>> sets = {{}, BlockSet<Dim>::all(lattice).active()};
  for (std::size_t step : {2, 3, 5}) sets.push_back(some_of(blocks, step));
  // As many as in another set, but not the same: each block's mirror image.
  sets.push_back(some_of(blocks, 3));
  for (std::uint32_t& block : sets.back()) block = static_cast<std::uint32_t>(blocks) - 1 - block;
  std::reverse(sets.back().begin(), sets.back().end());
  for (int channels : {1, 3}) {
    const std::vector<float> dense = numbers(channels * lattice.sites());
    for (const auto& active : sets) {
      const BlockSet<Dim> set(lattice, active);
      std::vector<float> wanted, spread(dense.size(), 0);
      for (std::size_t i = 0; i < dense.size(); ++i)
        if (std::binary_search(active.begin(), active.end(), block_of[i / channels]))
          wanted.push_back(spread[i] = dense[i]);
      ASSERT_EQ(set.sites() * channels, wanted.size());
      EXPECT_EQ(set.is_complete(), wanted.size() == dense.size());
      EXPECT_EQ(set.all_sites(), lattice.sites());
      std::vector<float> compact(wanted.size(), -1), back(dense.size(), -1);
      set.gather(channels, dense.data(), compact.data());
      EXPECT_EQ(compact, wanted);
      set.scatter(channels, compact.data(), back.data());
      EXPECT_EQ(back, spread);

      for (const auto& other : sets) {
        const BlockSet<Dim> to(lattice, other);
        std::vector<float> moved(channels * to.sites(), -1), expected(moved.size());
        to.gather(channels, spread.data(), expected.data());
        to.gather_from(set, channels, compact.data(), moved.data());
        EXPECT_EQ(moved, expected);
      }
    }
  }
}

TEST(BlockSet, CarriesFieldsToActiveBlocksAndBack) {
  for (const Index<2>& size : {Index<2>{8, 8}, {1, 1}, {17, 9}, {32, 7}, {3, 40}}) expect_round_trips<2>(size);
  for (const Index<3>& size : {Index<3>{8, 8, 8}, {1, 2, 3}, {17, 9, 10}, {9, 24, 16}, {20, 3, 25}})
    expect_round_trips<3>(size);
}

TEST(BlockSet, VisitsTheSitesOfABlock) {
  const Lattice<3> lattice = unit_lattice<3>({18, 9, 11});
  const BlockSet<3> set = BlockSet<3>::none(lattice);
  const std::vector<std::uint32_t> block_of = block_of_sites(lattice);
  std::vector<int> visits(lattice.sites(), 0);
  for (std::size_t block = 0; block < set.blocks(); ++block) {
    EXPECT_FALSE(set.any_site(block, [&](std::size_t site) {
      EXPECT_EQ(block_of[site], block);
      ++visits[site];
      return false;
    }));
    const auto last =
        static_cast<std::size_t>(block_of.rend() - std::find(block_of.rbegin(), block_of.rend(), block)) - 1;
    EXPECT_TRUE(set.any_site(block, [&](std::size_t site) { return site == last; }));
  }
  EXPECT_EQ(visits, std::vector<int>(lattice.sites(), 1));
}

TEST(BlockSet, MarksBlocksThatHoldSomething) {
  const Lattice<2> lattice = unit_lattice<2>({14, 11});  // 4 x 3 blocks
  const BlockSet<2> set(lattice, {1, 2, 3, 6, 11});
  std::vector<float> dense(2 * lattice.sites(), 0), compact(2 * set.sites());
  dense[2 * (3 * 14 + 11) + 1] = 1e-30f;  // the last site of block 2
  dense[2 * (10 * 14 + 13)] = -1;         // of block 11
  dense[2 * (5 * 14)] = 1;                // of block 4, which is not active
  set.gather(2, dense.data(), compact.data());
  std::vector<char> found(set.blocks(), 0);
  found[0] = 1;
  set.mark_nonzero(compact.data(), found);
  EXPECT_EQ(found, (std::vector<char>{1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1}));
}

TEST(BlockSet, RefusesNumbersThatAreNoSet) {
  const Lattice<2> lattice = unit_lattice<2>({8, 8});
  for (const std::vector<std::uint32_t>& wrong : {std::vector<std::uint32_t>{4}, {1, 1}, {2, 1}, {0, 4294967295u}})
    EXPECT_THROW(BlockSet<2>(lattice, wrong), InvalidInput);
}

}  // namespace
}  // namespace saltus
