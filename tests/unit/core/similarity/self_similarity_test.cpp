#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "core/grid/noise.h"
#include "core/similarity/similarity.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

template <int Dim>
double energy(const Lattice<Dim>& lattice, const std::vector<double>& fixed, const std::vector<double>& warped,
              double radius, double step, const double* weights = nullptr) {
  std::vector<double> gradient(fixed.size());
  const auto similarity = make_self_similarity<Dim, double>(lattice, radius, step);
  similarity->prepare(fixed.data(), warped.data(), weights);
  return similarity->evaluate(fixed.data(), warped.data(), weights, gradient.data(), nullptr);
}

/// The definition for a 3-D lattice, term by term: every sample, every pair of its six neighbours that lie on different
/// axes, every sample of both patches.
class BruteForce {
 public:
  BruteForce(const Lattice<3>& lattice, const Index<3>& radius, const Index<3>& step,
             const std::vector<double>& weights)
      : lattice_(lattice), radius_(radius), step_(step), weights_(weights) {}

  double energy(const std::vector<double>& fixed, const std::vector<double>& warped) const {
    const auto f = descriptors(fixed), w = descriptors(warped);
    double sum = 0;
    for (std::size_t i = 0; i < f.size(); ++i) {
      double squares = 0;
      for (std::size_t k = 0; k < f[i].size(); ++k) squares += std::pow(f[i][k] - w[i][k], 2);
      sum += weights_[i] * squares / static_cast<double>(f[i].size());
    }
    return lattice_.cell_volume() * sum;
  }

 private:
  static Index<3> sum(Index<3> a, const Index<3>& b) {
    for (int axis = 0; axis < 3; ++axis) a[axis] += b[axis];
    return a;
  }
  bool holds(const Index<3>& at) const {
    for (int axis = 0; axis < 3; ++axis)
      if (at[axis] < 0 || at[axis] >= lattice_.size[axis]) return false;
    return true;
  }
  std::size_t site(const Index<3>& at) const {
    return static_cast<std::size_t>(at[0] + lattice_.size[0] * (at[1] + lattice_.size[1] * at[2]));
  }

  double distance(const std::vector<double>& image, const Index<3>& a, const Index<3>& b) const {
    if (!holds(a) || !holds(b)) return 0;
    double squares = 0, count = 0;
    Index<3> by;
    for (by[2] = -radius_[2]; by[2] <= radius_[2]; ++by[2])
      for (by[1] = -radius_[1]; by[1] <= radius_[1]; ++by[1])
        for (by[0] = -radius_[0]; by[0] <= radius_[0]; ++by[0]) {
          ++count;
          const Index<3> one = sum(a, by), other = sum(b, by);
          if (!holds(one) || !holds(other)) continue;
          squares += weights_[site(one)] * weights_[site(other)] * std::pow(image[site(one)] - image[site(other)], 2);
        }
    return squares / count;
  }

  std::vector<std::vector<double>> descriptors(const std::vector<double>& image) const {
    std::vector<Index<3>> neighbours;
    for (int axis = 0; axis < 3; ++axis)
      for (int sign : {-1, 1}) {
        if (lattice_.size[axis] <= step_[axis]) continue;
        Index<3> by{};
        by[axis] = sign * step_[axis];
        neighbours.push_back(by);
      }
    std::vector<std::vector<double>> all(lattice_.sites());
    double mean = 0, whole = 0;
    Index<3> at;
    for (at[2] = 0; at[2] < lattice_.size[2]; ++at[2])
      for (at[1] = 0; at[1] < lattice_.size[1]; ++at[1])
        for (at[0] = 0; at[0] < lattice_.size[0]; ++at[0]) {
          std::vector<double>& d = all[site(at)];
          for (std::size_t a = 0; a < neighbours.size(); ++a)
            for (std::size_t b = a + 1; b < neighbours.size(); ++b)
              if (a / 2 != b / 2) d.push_back(distance(image, sum(at, neighbours[a]), sum(at, neighbours[b])));
          mean += weights_[site(at)] * average(d);
          whole += weights_[site(at)];
        }
    const double noise = noise_sd<3>(lattice_, image.data(), weights_.data());
    const double floor = 2 * noise * noise + 1e-3 * mean / whole;
    for (std::vector<double>& d : all) {
      const double scale = average(d) + floor;
      for (double& entry : d) entry = std::exp(-entry / scale);
    }
    return all;
  }
  static double average(const std::vector<double>& d) {
    double sum = 0;
    for (double entry : d) sum += entry;
    return sum / static_cast<double>(d.size());
  }

  const Lattice<3>& lattice_;
  Index<3> radius_, step_;
  const std::vector<double>& weights_;
};

TEST(SelfSimilarity, EqualsTheDefinitionTermByTerm) {
  for (const Lattice<3>& lattice : {Lattice<3>{{7, 6, 5}, {1, 1, 2}, {}}, Lattice<3>{{9, 8, 1}, {1, 1, 1}, {}},
                                    Lattice<3>{{261, 3, 4}, {1, 1, 2}, {}}}) {
    const std::vector<double> fixed = testing::random_waves<3>(lattice, 1),
                              warped = testing::random_waves<3>(lattice, 2);
    std::vector<double> weights = testing::random_values(lattice.sites(), 3, 0.5);
    for (double& weight : weights) weight = std::max(0.0, weight + 0.3);
    const std::vector<double> ones(weights.size(), 1.0);
    const bool flat = lattice.size[2] == 1;
    // 2 mm: two samples, one along z; 1 mm: one sample, half a one along z rounds up.
    const Index<3> radius = {2, 2, flat ? 0 : 1}, step = {1, 1, 1};
    for (const auto& mask : {weights, ones}) {
      const double expected = BruteForce(lattice, radius, step, mask).energy(fixed, warped);
      EXPECT_GT(expected, 0.001 * lattice.cell_volume() * lattice.sites());
      EXPECT_NEAR(energy<3>(lattice, fixed, warped, 2, 1, mask.data()), expected, 1e-10 * expected);
    }
    EXPECT_NEAR(energy<3>(lattice, fixed, warped, 2, 1), BruteForce(lattice, radius, step, ones).energy(fixed, warped),
                1e-10 * lattice.sites());
  }
}

// A second evaluation uses what is kept of the fixed image; a mask and a new preparation forget it.
TEST(SelfSimilarity, KeepsTheContextOfTheFixedImageUntilItIsPreparedAgainOrMasked) {
  const Lattice<2> lattice{{14, 11}, {1.0, 2.0}, {}};
  const std::vector<double> one = testing::random_waves<2>(lattice, 1), other = testing::random_waves<2>(lattice, 2);
  std::vector<double> gradient(one.size()), again(one.size());
  const auto similarity = make_self_similarity<2, double>(lattice, 1, 1);
  similarity->prepare(one.data(), other.data(), nullptr);
  const double first = similarity->evaluate(one.data(), other.data(), nullptr, gradient.data(), nullptr);
  EXPECT_EQ(similarity->evaluate(one.data(), other.data(), nullptr, again.data(), nullptr), first);
  EXPECT_EQ(again, gradient);
  std::vector<double> weights(one.size(), 1.0);
  weights[40] = 0;
  EXPECT_NE(similarity->evaluate(one.data(), other.data(), weights.data(), again.data(), nullptr), first);
  EXPECT_EQ(similarity->evaluate(one.data(), other.data(), nullptr, again.data(), nullptr), first);
  EXPECT_EQ(again, gradient);
  similarity->prepare(other.data(), other.data(), nullptr);
  EXPECT_EQ(similarity->evaluate(other.data(), other.data(), nullptr, again.data(), nullptr), 0);
}

TEST(SelfSimilarity, DoesNotSeeAnAffineChangeOfIntensity) {
  const Lattice<2> lattice{{14, 11}, {1.0, 2.0}, {}};
  const std::vector<double> fixed = testing::random_waves<2>(lattice, 1), warped = testing::random_waves<2>(lattice, 2);
  std::vector<double> changed = warped;
  for (double& value : changed) value = 7000 - 300 * value;
  const double same = energy<2>(lattice, fixed, warped, 1, 1);
  EXPECT_NEAR(energy<2>(lattice, fixed, changed, 1, 1), same, 1e-8 * same);
}

TEST(SelfSimilarity, RefusesToBeEvaluatedUnprepared) {
  const Lattice<2> lattice{{14, 11}, {1.0, 2.0}, {}};
  std::vector<double> image(lattice.sites(), 0.5), gradient(image.size());
  EXPECT_THROW((make_self_similarity<2, double>(lattice, 1, 1)
                    ->evaluate(image.data(), image.data(), nullptr, gradient.data(), nullptr)),
               std::logic_error);
}

}  // namespace
}  // namespace saltus
