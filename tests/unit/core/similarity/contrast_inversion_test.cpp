// Similarities for images of different kinds: a scene whose contrast is turned, and bent, is where it was.
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "core/registration/options.h"
#include "core/similarity/similarity.h"

namespace saltus {
namespace {

const Lattice<2> kLattice{{48, 40}, {1.0, 1.5}, {}};

/// Discs of several sizes and brightnesses with soft edges, `shift` mm along x and y.
std::vector<double> scene(double shift_x, double shift_y) {
  std::vector<double> image(kLattice.sites());
  for (int slab = 0; slab < kLattice.size[1]; ++slab)
    visit_slab<2>(kLattice, slab, [&](const Index<2>& i, std::size_t site) {
      const double x = i[0] - shift_x, y = 1.5 * i[1] - shift_y;
      const auto disc = [&](double at_x, double at_y, double radius, double height) {
        return height / (1 + std::exp(2 * (std::hypot(x - at_x, y - at_y) - radius)));
      };
      image[site] = disc(14, 20, 7, 0.5) + disc(34, 22, 5, 0.9) + disc(22, 44, 9, 0.3) + disc(37, 45, 4, 0.7);
    });
  return image;
}

class Inversion : public ::testing::TestWithParam<SimilarityType> {};

TEST_P(Inversion, RanksTheAlignedPositionBest) {
  const std::vector<double> fixed = scene(0, 0);
  for (const auto& tone : {+[](double v) { return 1 - v; }, +[](double v) { return 1000 - 50 * v * v; }}) {
    std::map<std::pair<int, int>, double> energies;
    for (int dx = -3; dx <= 3; ++dx)
      for (int dy = -3; dy <= 3; ++dy) {
        std::vector<double> warped = scene(dx, dy), gradient(fixed.size());
        for (double& value : warped) value = tone(value);
        const auto similarity = make_similarity<2, double>(GetParam(), kLattice, {}, 1.0);
        similarity->prepare(fixed.data(), warped.data(), nullptr);
        energies[{dx, dy}] = similarity->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr);
      }
    for (const auto& [shift, energy] : energies)
      if (shift != std::pair{0, 0}) {
        EXPECT_LT((energies[{0, 0}]), energy) << shift.first << " " << shift.second;
      }
    // And uphill all the way along the axes.
    for (int d = 1; d < 3; ++d)
      for (int sign : {-1, 1}) {
        EXPECT_LT((energies[{sign * d, 0}]), (energies[{sign * (d + 1), 0}]));
        EXPECT_LT((energies[{0, sign * d}]), (energies[{0, sign * (d + 1)}]));
      }
  }
}

INSTANTIATE_TEST_SUITE_P(Similarities, Inversion,
                         ::testing::Values(SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind),
                         [](const auto& info) { return to_string(info.param); });

}  // namespace
}  // namespace saltus
