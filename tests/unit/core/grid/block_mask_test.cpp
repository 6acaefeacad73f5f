// Oracle: the definition, site by site.
#include "core/grid/block_mask.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <set>

#include "core/grid/interpolation.h"
#include "tests/support/random_blocks.h"

namespace saltus {
namespace {

template <int Dim>
Lattice<Dim> lattice() {
  if constexpr (Dim == 2)
    return {{18, 9}, {1, 1}, {}};
  else
    return {{13, 6, 22}, {1, 1, 1}, {}};
}

template <int Dim>
BlockMask<Dim> some(std::uint64_t seed, double share) {
  return testing::random_blocks<Dim>(lattice<Dim>(), seed, share);
}

template <int Dim>
std::size_t block_of(const Index<Dim>& index, const BlockMask<Dim>& mask) {
  std::size_t block = 0, stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    block += stride * static_cast<std::size_t>(index[axis] / kBlockEdge);
    stride *= static_cast<std::size_t>(mask.blocks()[axis]);
  }
  return block;
}

/// Calls visit(index, site, is in the mask) for all sites.
template <int Dim, class Visit>
void each_site(const BlockMask<Dim>& mask, Visit&& visit) {
  for (int slab = 0; slab < lattice<Dim>().size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice<Dim>(), slab, [&](const Index<Dim>& index, std::size_t site) {
      visit(index, site, mask[block_of<Dim>(index, mask)]);
    });
}

template <int Dim>
std::set<std::size_t> sites_of(const BlockMask<Dim>& mask) {
  std::set<std::size_t> sites;
  each_site<Dim>(mask, [&](const Index<Dim>&, std::size_t site, bool in) {
    if (in) sites.insert(site);
  });
  return sites;
}

template <int Dim>
void expect_visits_its_sites() {
  for (const BlockMask<Dim>& mask : {some<Dim>(1, 0.3), some<Dim>(2, 0.9), BlockMask<Dim>::none(lattice<Dim>()),
                                     BlockMask<Dim>::all(lattice<Dim>())}) {
    const std::set<std::size_t> expected = sites_of<Dim>(mask);
    EXPECT_EQ(mask.is_empty(), expected.empty());
    std::vector<std::size_t> visited;
    for (int slab = 0; slab < lattice<Dim>().size[Dim - 1]; ++slab)
      mask.visit_sites(lattice<Dim>(), slab, [&](const Index<Dim>& index, std::size_t site) {
        std::size_t number = 0, stride = 1;
        for (int axis = 0; axis < Dim; ++axis) {
          number += stride * static_cast<std::size_t>(index[axis]);
          stride *= static_cast<std::size_t>(lattice<Dim>().size[axis]);
        }
        EXPECT_EQ(number, site);
        EXPECT_EQ(index[Dim - 1], slab);
        visited.push_back(site);
      });
    EXPECT_EQ(visited, std::vector<std::size_t>(expected.begin(), expected.end()));
    std::vector<double> values(2 * lattice<Dim>().sites(), 3.0);
    mask.clear(lattice<Dim>(), 2, values.data());
    for (std::size_t i = 0; i < values.size(); ++i) ASSERT_EQ(values[i], expected.count(i / 2) ? 0 : 3);
    double sum = 0;
    for (std::size_t site : expected) sum += static_cast<double>(site);
    EXPECT_EQ(mask.sum_runs(lattice<Dim>(),
                            [](std::size_t begin, std::size_t count) {
                              return 0.5 * static_cast<double>(count) * static_cast<double>(2 * begin + count - 1);
                            }),
              sum);
  }
}
TEST(BlockMask, VisitsItsSites) {
  expect_visits_its_sites<2>();
  expect_visits_its_sites<3>();
}

template <int Dim>
void expect_dilation() {
  for (int reach : {0, 1, 4, 5, 9, 100})
    for (int axis = 0; axis < Dim; ++axis) {
      const BlockMask<Dim> mask = some<Dim>(3, 0.1), wide = mask.dilated(axis, reach);
      // A block is in when one of its sites lies within reach of the nearest site of a block that was in; blocks at the
      // border are as far away as whole ones.
      each_site<Dim>(wide, [&](const Index<Dim>& index, std::size_t, bool in) {
        bool expected = false;
        for (int b = 0; b < mask.blocks()[axis]; ++b) {
          Index<Dim> other = index;
          other[axis] = b * kBlockEdge;
          const int apart = std::abs(b - index[axis] / kBlockEdge);
          const int nearest = apart == 0 ? 0 : (apart - 1) * kBlockEdge + 1;
          expected = expected || (mask[block_of<Dim>(other, mask)] && nearest <= reach);
        }
        ASSERT_EQ(in, expected) << "reach " << reach << " axis " << axis;
      });
    }
  EXPECT_TRUE(BlockMask<Dim>::all(lattice<Dim>()).dilated(0, 3).is_all());
  EXPECT_TRUE(BlockMask<Dim>::none(lattice<Dim>()).with_neighbours().is_empty());
  auto one = BlockMask<Dim>::none(lattice<Dim>());
  Index<Dim> centre;
  centre.fill(kBlockEdge);
  one.mark(block_of<Dim>(centre, one));
  each_site<Dim>(one.with_neighbours(), [&](const Index<Dim>& index, std::size_t, bool in) {
    bool near = true;
    for (int axis = 0; axis < Dim; ++axis) near = near && index[axis] < 3 * kBlockEdge;
    ASSERT_EQ(in, near);
  });
}
TEST(BlockMask, GrowsByBlocks) {
  expect_dilation<2>();
  expect_dilation<3>();
}

template <int Dim>
void expect_set_operations() {
  const auto all = BlockMask<Dim>::all(lattice<Dim>()), none = BlockMask<Dim>::none(lattice<Dim>());
  const BlockMask<Dim> masks[] = {some<Dim>(5, 0.4), some<Dim>(6, 0.4), all, none};
  for (const BlockMask<Dim>& a : masks)
    for (const BlockMask<Dim>& b : masks) {
      BlockMask<Dim> either = a, both = a;
      either |= b;
      both &= b;
      const std::set<std::size_t> in_a = sites_of<Dim>(a), in_b = sites_of<Dim>(b), in_either = sites_of<Dim>(either),
                                  in_both = sites_of<Dim>(both);
      for (std::size_t site = 0; site < lattice<Dim>().sites(); ++site) {
        ASSERT_EQ(in_either.count(site), in_a.count(site) || in_b.count(site));
        ASSERT_EQ(in_both.count(site), in_a.count(site) && in_b.count(site));
      }
      EXPECT_EQ(either.is_empty(), in_either.empty());
      EXPECT_EQ(both.is_empty(), in_both.empty());
    }
  BlockMask<Dim> dense = some<Dim>(7, 0.95), sparse = some<Dim>(8, 0.2);
  const std::set<std::size_t> before = sites_of<Dim>(sparse);
  dense.complete_if_dense();
  sparse.complete_if_dense();
  EXPECT_TRUE(dense.is_all());
  EXPECT_EQ(sites_of<Dim>(sparse), before);
}
TEST(BlockMask, JoinsAndMeets) {
  expect_set_operations<2>();
  expect_set_operations<3>();
}

TEST(BlockMask, MarksTheBlocksOfAllCornersOfCells) {
  const Lattice<3> where = lattice<3>();
  for (double y : {0.5, 3.5, 5.0, 7.2})
    for (double z : {3.5, 8.0, 19.5, 21.0}) {
      std::array<std::array<double, 12>, 3> points;
      points[0] = {-1.0, 0.0, 2.9, 2.95, 3.0, 3.2, 7.5, 11.0, 11.5, 40.0, 6.5, 4.5};
      points[1].fill(y);
      points[2].fill(z);
      points[2][7] = 4.5;  // one that lies elsewhere
      for (int begin : {0, 3, 9})
        for (int count : {1, 4, 10}) {
          std::array<std::array<double, 12>, 3> some = points;
          for (auto& along : some) std::rotate(along.begin(), along.begin() + begin, along.end());
          auto mask = BlockMask<3>::none(where);
          mask.mark_cells(where, some, count);
          std::set<std::size_t> blocks;
          for (std::size_t k = 0; k < static_cast<std::size_t>(count); ++k) {
            const LinearCell<3, double> cell(where, {some[0][k], some[1][k], some[2][k]});
            for (int bits = 0; bits < 8; ++bits) {
              const std::size_t site = cell.corner(bits);
              const Index<3> index = {static_cast<int>(site % 13), static_cast<int>(site / 13 % 6),
                                      static_cast<int>(site / 78)};
              blocks.insert(block_of<3>(index, mask));
            }
          }
          each_site<3>(mask, [&](const Index<3>& index, std::size_t, bool in) {
            ASSERT_EQ(in, blocks.count(block_of<3>(index, mask)) > 0);
          });
        }
    }
}

}  // namespace
}  // namespace saltus
