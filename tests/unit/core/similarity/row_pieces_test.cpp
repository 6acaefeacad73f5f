#include "core/similarity/row_pieces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/similarity/similarity.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

template <int Dim>
void expect_all_sites_once(const Index<Dim>& size) {
  Lattice<Dim> lattice;
  lattice.size = size;
  std::vector<int> visits(lattice.sites(), 0);
  const double sum = sum_of_pieces(lattice, [&](const RowPiece<Dim>& piece) {
    EXPECT_LE(piece.length, kLongestPiece);
    std::size_t site = 0;
    for (int axis = Dim - 1; axis >= 0; --axis)
      site = site * static_cast<std::size_t>(size[axis]) + static_cast<std::size_t>(piece.first[axis]);
    EXPECT_EQ(piece.site, site);
    EXPECT_LE(piece.first[0] + piece.length, size[0]);
    for (int i = 0; i < piece.length; ++i) ++visits[piece.site + static_cast<std::size_t>(i)];
    return static_cast<double>(piece.length);
  });
  EXPECT_EQ(sum, static_cast<double>(lattice.sites()));
  EXPECT_EQ(visits, std::vector<int>(lattice.sites(), 1));
}

TEST(RowPieces, HoldEverySiteOnce) {
  for (int columns : {1, 127, 128, 129, 300}) {
    expect_all_sites_once<2>({columns, 5});
    expect_all_sites_once<3>({columns, 3, 4});
  }
}

using Make = std::unique_ptr<Similarity<3, double>> (*)(const Lattice<3>&);
struct OfPieces {
  const char* name;
  Make make;
};
class SimilarityOfPieces : public ::testing::TestWithParam<OfPieces> {};

// Oracle: central differences along directions that change samples on both sides of where one piece ends and the next
// begins, and none else.
TEST_P(SimilarityOfPieces, HasTheGradientWherePiecesMeet) {
  const Lattice<3> lattice{{kLongestPiece + 9, 4, 5}, {1.0, 1.5, 2.0}, {}};
  const std::vector<double> fixed = testing::random_waves<3>(lattice, 1), warped = testing::random_waves<3>(lattice, 2);
  std::vector<double> weights = testing::random_values(lattice.sites(), 3, 0.5);
  for (double& weight : weights) weight = std::max(0.0, weight + 0.3);
  for (const double* shown : {static_cast<const double*>(nullptr), static_cast<const double*>(weights.data())}) {
    const auto similarity = GetParam().make(lattice);
    similarity->prepare(fixed.data(), warped.data(), shown);
    std::vector<double> direction = testing::random_values(lattice.sites(), 4), gradient(lattice.sites()),
                        unused(lattice.sites());
    for (std::size_t i = 0; i < direction.size(); ++i)
      if (std::abs(static_cast<int>(i % static_cast<std::size_t>(lattice.size[0])) - kLongestPiece) > 2)
        direction[i] = 0;
    const auto at = [&](double step) {
      std::vector<double> moved = warped;
      for (std::size_t i = 0; i < moved.size(); ++i) moved[i] += step * direction[i];
      return similarity->evaluate(fixed.data(), moved.data(), shown, unused.data(), nullptr);
    };
    similarity->evaluate(fixed.data(), warped.data(), shown, gradient.data(), nullptr);
    double along = 0;
    for (std::size_t i = 0; i < gradient.size(); ++i) along += gradient[i] * direction[i];
    const double step = 1e-5, difference = (at(step) - at(-step)) / (2 * step);
    EXPECT_GT(std::abs(difference), 1e-3);
    EXPECT_NEAR(along, difference, 1e-6 * std::abs(difference));
  }
}

INSTANTIATE_TEST_SUITE_P(
    , SimilarityOfPieces,
    ::testing::Values(
        OfPieces{"ngf", [](const Lattice<3>& lattice) { return make_gradient_fields<3, double>(lattice, 0); }},
        OfPieces{"mind", [](const Lattice<3>& lattice) { return make_self_similarity<3, double>(lattice, 1, 1); }},
        OfPieces{"mind_wide",
                 [](const Lattice<3>& lattice) { return make_self_similarity<3, double>(lattice, 3, 2); }}),
    [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace saltus
