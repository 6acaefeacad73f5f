#include "core/grid/resampling.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/grid/interpolation.h"
#include "core/grid/pyramid.h"
#include "tests/support/finite_differences.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

template <int Dim>
struct Pair {
  Lattice<Dim> source, target;
};

std::vector<Pair<2>> flat_pairs() {
  const Lattice<2> fine{{13, 9}, {1, 1.5}, {}};
  return {{fine, fine},
          {coarsened(fine, 4.0), fine},
          {fine, coarsened(fine, 4.0)},
          {{{4, 1}, {2, 2}, {-1, 0}}, {{11, 5}, {1, 1}, {-3, -2}}},
          {{{1, 1}, {2, 2}, {}}, {{3, 2}, {1, 1}, {}}}};
}

std::vector<Pair<3>> deep_pairs() {
  const Lattice<3> fine{{9, 8, 5}, {1, 1.5, 3}, {}};
  return {{fine, fine},
          {coarsened(fine, 2.0), fine},
          {fine, {{4, 5, 3}, {2.5, 2, 5}, {0.3, -4, 1}}},
          {{{1, 3, 2}, {2, 2, 2}, {}}, {{5, 4, 3}, {1, 1, 1}, {}}}};
}

// Oracle: LinearCell at every site of the target.
template <int Channels, int Dim>
void expect_linear_interpolation(const Pair<Dim>& pair) {
  const std::vector<double> field = random_values(Channels * pair.source.sites(), 1);
  std::vector<double> out(Channels * pair.target.sites(), 5.0);
  LatticeInterpolation<Dim, double>(pair.source, pair.target, Channels).add_to(field.data(), out.data());
  const double none[Dim] = {};
  for (int slab = 0; slab < pair.target.size[Dim - 1]; ++slab)
    visit_slab<Dim>(pair.target, slab, [&](const Index<Dim>& index, std::size_t site) {
      const LinearCell<Dim, double> cell(pair.source,
                                         SitePlacement<Dim, double>(pair.target, pair.source)(index, none));
      const auto value = cell.template value<Channels>(field.data());
      for (int c = 0; c < Channels; ++c) ASSERT_NEAR(out[Channels * site + c], 5 + value[c], 1e-12);
    });
}

TEST(LatticeInterpolation, AddsLinearInterpolation) {
  for (const auto& pair : flat_pairs()) {
    expect_linear_interpolation<2>(pair);
    expect_linear_interpolation<3>(pair);
  }
  for (const auto& pair : deep_pairs()) {
    expect_linear_interpolation<2>(pair);
    expect_linear_interpolation<3>(pair);
  }
}

// Oracle: <P a, b> = <a, P^T b>.
template <int Dim>
void expect_transpose(const Pair<Dim>& pair) {
  LatticeInterpolation<Dim, double> interpolation(pair.source, pair.target, Dim);
  const std::vector<double> a = random_values(Dim * pair.source.sites(), 2),
                            b = random_values(Dim * pair.target.sites(), 3);
  std::vector<double> pa(b.size(), 0.0), ptb(a.size(), 1e300);
  interpolation.add_to(a.data(), pa.data());
  interpolation.transpose(b.data(), ptb.data());
  EXPECT_NEAR(dot(pa, b), dot(a, ptb), 1e-12 * std::sqrt(dot(pa, pa) * dot(b, b)));
  EXPECT_EQ(interpolation.is_identity(), pair.source == pair.target);
}

TEST(LatticeInterpolation, HasAnExactTranspose) {
  const testing::ManyThreads many;  // planes beside each other at once: none writes to another
  omp_set_num_threads(3);
  for (const auto& pair : flat_pairs()) expect_transpose(pair);
  for (const auto& pair : deep_pairs()) expect_transpose(pair);
}

template <int Dim>
void expect_same_middle(const Lattice<Dim>& image, double target) {
  const Lattice<Dim> coarse = coarsened(image, target);
  for (int axis = 0; axis < Dim; ++axis) {
    const double before = image.offset[axis] + 0.5 * (image.size[axis] - 1) * image.spacing[axis];
    const double after = coarse.offset[axis] + 0.5 * (coarse.size[axis] - 1) * coarse.spacing[axis];
    EXPECT_NEAR(before, after, 1e-12);
    const bool coarser = image.size[axis] >= 4 && target >= 1.5 * image.spacing[axis];
    EXPECT_EQ(coarse.spacing[axis], coarser ? target : image.spacing[axis]);
    // Cells of the coarse lattice cover the image, with less than one cell to spare.
    EXPECT_GE(coarse.size[axis] * coarse.spacing[axis], image.size[axis] * image.spacing[axis] - 1e-9);
    if (coarser && coarse.size[axis] > 2) {
      EXPECT_LT((coarse.size[axis] - 1) * coarse.spacing[axis], image.size[axis] * image.spacing[axis]);
    }
  }
}

TEST(Coarsened, StaysCentredAndCoversTheImage) {
  for (double target : {1.0, 1.49, 1.5, 2.0, 3.0, 7.7, 100.0}) {
    expect_same_middle<2>({{17, 8}, {1, 2.5}, {0.5, -3}}, target);
    expect_same_middle<3>({{33, 3, 10}, {0.9, 1, 4}, {}}, target);
    expect_same_middle<2>({{2, 1}, {1, 1}, {}}, target);
  }
}

TEST(Downsampled, KeepsConstants) {
  const Lattice<3> fine{{11, 9, 6}, {1, 1.2, 2.5}, {}};
  for (double target : {1.0, 2.0, 4.0, 40.0}) {
    const auto coarse = downsampled<3, double>(fine, std::vector<double>(fine.sites(), 3.25), coarsened(fine, target));
    for (double value : coarse) ASSERT_NEAR(value, 3.25, 1e-12);
    const auto single = downsampled<3, float>(fine, std::vector<float>(fine.sites(), 3.25f), coarsened(fine, target));
    for (float value : single) ASSERT_NEAR(value, 3.25f, 1e-5f);
  }
}

// Oracle: a symmetric window leaves linear functions as they are, away from the border.
TEST(Downsampled, KeepsLinearFunctionsInPlaceAwayFromTheBorder) {
  const Lattice<2> fine{{41, 31}, {1, 1.25}, {2, -1}}, coarse = coarsened(fine, 4.0);
  std::vector<double> ramp(fine.sites());
  for (int slab = 0; slab < fine.size[1]; ++slab)
    visit_slab<2>(fine, slab, [&](const Index<2>& i, std::size_t site) {
      ramp[site] = 0.3 * (i[0] * fine.spacing[0] + fine.offset[0]) - 0.8 * (i[1] * fine.spacing[1] + fine.offset[1]);
    });
  const auto result = downsampled<2, double>(fine, ramp, coarse);
  int inner = 0;
  for (int slab = 2; slab < coarse.size[1] - 2; ++slab)
    visit_slab<2>(coarse, slab, [&](const Index<2>& i, std::size_t site) {
      if (i[0] < 2 || i[0] >= coarse.size[0] - 2) return;
      ++inner;
      ASSERT_NEAR(result[site],
                  0.3 * (i[0] * 4.0 + coarse.offset[0]) - 0.8 * (i[1] * coarse.spacing[1] + coarse.offset[1]), 1e-10);
    });
  EXPECT_GT(inner, 20);
}

// Oracle: the fastest wave of the fine lattice cannot be seen on the coarse one.
TEST(Downsampled, RemovesWhatTheTargetCannotShow) {
  const Lattice<2> fine{{40, 40}, {1, 1}, {}};
  std::vector<double> checkers(fine.sites());
  for (std::size_t i = 0; i < checkers.size(); ++i) checkers[i] = (i % 40 + i / 40) % 2 ? 1.0 : -1.0;
  for (double value : downsampled<2, double>(fine, checkers, coarsened(fine, 2.0))) EXPECT_LT(std::abs(value), 0.1);
}

}  // namespace
}  // namespace saltus
