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

/// Whether a site is beside where one piece ends and the next begins.
bool is_where_pieces_meet(const Lattice<3>& lattice, std::size_t site) {
  return std::abs(static_cast<int>(site % static_cast<std::size_t>(lattice.size[0])) - kLongestPiece) <= 2;
}

// Oracle: central differences along directions that change samples, and weights, where pieces meet and nowhere else.
// Two samples there are hidden and no numbers.
TEST_P(SimilarityOfPieces, HasTheGradientsWherePiecesMeet) {
  const Lattice<3> lattice{{kLongestPiece + 9, 4, 5}, {1.0, 1.5, 2.0}, {}};
  const std::size_t sites = lattice.sites(), row = static_cast<std::size_t>(lattice.size[0]);
  const std::vector<double> fixed = testing::random_waves<3>(lattice, 1);
  const std::vector<double> none;
  std::vector<double> masked = testing::random_values(sites, 3, 0.5);
  for (double& weight : masked) weight = std::max(0.01, weight + 0.4);
  const std::size_t hidden[] = {6 * row + kLongestPiece - 1, 9 * row + kLongestPiece};
  for (std::size_t site : hidden) masked[site] = 0;
  for (const std::vector<double>& weights : {none, masked}) {
    const bool has_mask = !weights.empty();
    std::vector<double> warped = testing::random_waves<3>(lattice, 2);
    if (has_mask)
      for (std::size_t site : hidden) warped[site] = std::nan("");
    std::vector<double> direction = testing::random_values(sites, 4), gradient(sites), of_weights(sites);
    for (std::size_t i = 0; i < sites; ++i)
      if (!is_where_pieces_meet(lattice, i) || (has_mask && weights[i] == 0)) direction[i] = 0;
    const auto similarity = GetParam().make(lattice);
    similarity->prepare(fixed.data(), warped.data(), has_mask ? weights.data() : nullptr);
    const auto at = [&](double of_image, double of_weight) {
      std::vector<double> moved = warped, shown = weights, unused(sites);
      for (std::size_t i = 0; i < sites; ++i) moved[i] += of_image * direction[i];
      for (std::size_t i = 0; i < shown.size(); ++i) shown[i] += of_weight * direction[i];
      return similarity->evaluate(fixed.data(), moved.data(), has_mask ? shown.data() : nullptr, unused.data(),
                                  nullptr);
    };
    const auto expect_along = [&](const std::vector<double>& found, double difference) {
      double along = 0;
      for (std::size_t i = 0; i < sites; ++i)
        if (direction[i] != 0) along += found[i] * direction[i];
      EXPECT_GT(std::abs(difference), 1e-3);
      EXPECT_NEAR(along, difference, 2e-6 * std::abs(difference));
    };
    similarity->evaluate(fixed.data(), warped.data(), has_mask ? weights.data() : nullptr, gradient.data(),
                         has_mask ? of_weights.data() : nullptr);
    const double step = 1e-5;
    expect_along(gradient, (at(step, 0) - at(-step, 0)) / (2 * step));
    if (!has_mask) continue;
    expect_along(of_weights, (at(0, step) - at(0, -step)) / (2 * step));
    for (std::size_t site : hidden) EXPECT_EQ(gradient[site], 0);
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
