// What the Gram matrices of momenta owe an optimiser, for every kernel and sum of kernels: symmetric and positive
// semi-definite, each order alone (the penalty) and all orders jointly with their cross terms (the total energy).
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "core/momenta/momentum_scale.h"
#include "tests/conformance/kernels/kernel_sums.h"

namespace saltus {
namespace {

using testing::NamedKernel;

/// Every second value is one component of the vectors: the kernel does not mix them, so one is enough.
constexpr int kComponent = 1;

class GramSuite : public ::testing::TestWithParam<NamedKernel> {
 protected:
  static constexpr int kSites = 7 * 6;
  MomentumScale<2, double> scale(double sigma) const {
    return MomentumScale<2, double>(
        {GetParam().make(sigma), {{7, 6}, {1.0, 1.4}, {}}, Orders::ZerothAndFirst, 1.3, 0.6});
  }

  /// A unit momentum: order -1 (zeroth), 0 or 1 (along that axis) is `block` - 1.
  struct Momenta {
    std::vector<double> zeroth = std::vector<double>(2 * kSites, 0.0), first = std::vector<double>(4 * kSites, 0.0);
    double& at(int unknown) {
      const int block = unknown / kSites, site = unknown % kSites;
      return block == 0 ? zeroth[static_cast<std::size_t>(2 * site + kComponent)]
                        : first[static_cast<std::size_t>(2 * (kSites * (block - 1) + site) + kComponent)];
    }
  };

  static void expect_positive_semi_definite(const Eigen::MatrixXd& gram, double cut) {
    ASSERT_GT(gram.diagonal().minCoeff(), 0);
    EXPECT_LT((gram - gram.transpose()).cwiseAbs().maxCoeff(), 1e-12 * gram.diagonal().maxCoeff());
    const Eigen::VectorXd values =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(gram, Eigen::EigenvaluesOnly).eigenvalues();
    EXPECT_GT(values.minCoeff(), -(1e-12 + 3 * cut) * values.maxCoeff());
  }
};

TEST_P(GramSuite, HasSymmetricPositiveSemiDefiniteBlocksInThePenalty) {
  for (double sigma : {1.3, 4.0}) {
    auto momenta = scale(sigma);
    Eigen::MatrixXd gram(3 * kSites, 3 * kSites);
    for (int j = 0; j < 3 * kSites; ++j) {
      Momenta unit, gradient;
      unit.at(j) = 1;
      momenta.penalty(unit.zeroth.data(), unit.first.data(), gradient.zeroth.data(), gradient.first.data());
      for (int i = 0; i < 3 * kSites; ++i) gram(i, j) = gradient.at(i);
    }
    expect_positive_semi_definite(gram, GetParam().cut);
    // The blocks know nothing of each other.
    for (int block = 0; block < 3; ++block)
      for (int other = 0; other < 3; ++other)
        if (block != other) {
          EXPECT_EQ(gram.block(block * kSites, other * kSites, kSites, kSites).norm(), 0);
        }
  }
}

// Entries by polarisation of the quadratic form.
TEST_P(GramSuite, HasAPositiveSemiDefiniteJointGramOfAllOrders) {
  for (double sigma : {1.3, 4.0}) {
    auto momenta = scale(sigma);
    const int count = 3 * kSites;
    const auto energy = [&](int i, int j) {
      Momenta pair;
      pair.at(i) += 1;
      if (j >= 0) pair.at(j) += 1;
      return momenta.total_energy(pair.zeroth.data(), pair.first.data());
    };
    std::vector<double> alone;
    for (int i = 0; i < count; ++i) alone.push_back(energy(i, -1));
    Eigen::MatrixXd gram(count, count);
    double largest_cross = 0;
    for (int i = 0; i < count; ++i)
      for (int j = i; j < count; ++j) {
        gram(i, j) = gram(j, i) = energy(i, j) - alone[i] - alone[j];
        if (i / kSites != j / kSites) largest_cross = std::max(largest_cross, std::abs(gram(i, j)));
      }
    expect_positive_semi_definite(gram, GetParam().cut);
    EXPECT_GT(largest_cross, 1e-3 * gram.diagonal().maxCoeff());  // there are cross terms to speak of
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels, GramSuite, ::testing::ValuesIn(testing::named_kernels()),
                         [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace saltus
