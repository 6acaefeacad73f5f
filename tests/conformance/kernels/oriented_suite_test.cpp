// What the Gram matrices of oriented momenta owe an optimiser: symmetric and positive semi-definite, one block for each
// normal, and the energy of the velocity itself as the lattice is refined.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <numeric>

#include "core/momenta/oriented_momenta.h"
#include "core/momenta/spread_normals.h"

namespace saltus {
namespace {

template <int Dim>
void expect_positive_semi_definite_blocks(const Lattice<Dim>& lattice, int count, double sigma) {
  OrientedMomenta<Dim, double> momenta({lattice, spread_normals<Dim>(count), sigma, 0.6});
  constexpr int components = Dim - 1;
  std::vector<std::uint32_t> elements(momenta.elements());
  std::iota(elements.begin(), elements.end(), 0u);
  const int sites = static_cast<int>(lattice.sites()), all = static_cast<int>(elements.size());
  // One component is enough: the kernel does not mix them.
  Eigen::MatrixXd gram(all, all);
  for (int j = 0; j < all; ++j) {
    std::vector<double> unit(components * elements.size(), 0.0), gradient(unit.size(), 0.0);
    unit[static_cast<std::size_t>(components * j)] = 1;
    const double energy = momenta.penalty(elements, unit.data(), gradient.data());
    for (int i = 0; i < all; ++i) gram(i, j) = gradient[static_cast<std::size_t>(components * i)];
    EXPECT_DOUBLE_EQ(energy, gram(j, j) / 2);
  }
  for (int normal = 0; normal < count; ++normal) {
    const Eigen::MatrixXd block = gram.block(normal * sites, normal * sites, sites, sites);
    ASSERT_GT(block.diagonal().minCoeff(), 0);
    EXPECT_LT((block - block.transpose()).cwiseAbs().maxCoeff(), 1e-12 * block.diagonal().maxCoeff());
    const Eigen::VectorXd values =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(block, Eigen::EigenvaluesOnly).eigenvalues();
    EXPECT_GT(values.minCoeff(), -1e-12 * values.maxCoeff()) << normal;
    for (int other = 0; other < normal; ++other) {
      EXPECT_EQ(gram.block(normal * sites, other * sites, sites, sites).norm(), 0);
    }
  }
}

TEST(OrientedSuite, HasPositiveSemiDefiniteBlocks) {
  for (double sigma : {1.3, 4.0}) {
    expect_positive_semi_definite_blocks<2>({{7, 6}, {1.0, 1.4}, {}}, 8, sigma);
    expect_positive_semi_definite_blocks<3>({{4, 3, 3}, {1.0, 1.4, 1.2}, {}}, 13, sigma);
  }
}

// Only some elements: the same as all of them with the others 0.
TEST(OrientedSuite, KnowsListedElementsOnly) {
  const Lattice<2> lattice{{9, 8}, {1.0, 1.0}, {}};
  OrientedMomenta<2, double> momenta({lattice, spread_normals<2>(4), 3.0, 1.0});
  std::vector<std::uint32_t> all(momenta.elements()), some;
  std::iota(all.begin(), all.end(), 0u);
  std::vector<double> full(all.size(), 0.0), few;
  for (std::uint32_t e = 1; e < all.size(); e += 5) {
    some.push_back(e);
    few.push_back(0.1 * (e % 7) - 0.3);
    full[e] = few.back();
  }
  std::vector<double> full_gradient(full.size(), 0.0), few_gradient(few.size(), 0.0);
  EXPECT_DOUBLE_EQ(momenta.penalty(some, few.data(), few_gradient.data()),
                   momenta.penalty(all, full.data(), full_gradient.data()));
  for (std::size_t k = 0; k < some.size(); ++k) EXPECT_DOUBLE_EQ(few_gradient[k], full_gradient[some[k]]);
}

}  // namespace
}  // namespace saltus
