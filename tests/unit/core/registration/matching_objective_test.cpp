// Oracle: the energy's definition, put together from its parts by hand.
#include "core/registration/matching_objective.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/flow/divergence_penalty.h"
#include "core/grid/interpolation.h"
#include "core/kernels/kernel_profile.h"
#include "core/momenta/spread_normals.h"
#include "core/registration/scales.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// Two images of plane waves.
MatchingLevel<2, double> waves() {
  MatchingLevel<2, double> level;
  level.lattice.size = {19, 17};
  level.lattice.spacing = {1, 1.25};
  level.fixed = testing::random_waves<2>(level.lattice, 1);
  level.moving.lattice = level.lattice;
  level.moving.samples = testing::random_waves<2>(level.lattice, 2);
  level.moving.linear = Vector<2>(1, 0.8).asDiagonal();
  level.moving.offset = Vector<2>::Zero();
  return level;
}

/// Order 0 alone, on the level's lattice unless it is coarsened.
RegistrationOptions one_scale(double width_voxels) {
  RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.regularisation = 3e-6;
  options.momenta.width_voxels = width_voxels;
  options.momenta.scales = 1;
  options.momenta.finest_scale = 0;
  return options;
}

// A constant in time counts once, whatever the number of steps: the trapezoidal rule halves both ends.
TEST(MatchingObjective, TakesTheDivergencePenaltyOverTimeByTheTrapezoidalRule) {
  omp_set_num_threads(1);
  MatchingLevel<2, double> level = waves();
  level.evolution = Evolution::Exact;
  const RegistrationOptions options = one_scale(4);
  auto placed = make_scales<2, double>(level.lattice, options, {});
  const std::vector<double> x = testing::random_values(placed[0].scale->field_size(), 5, 0.5);
  for (int steps : {1, 2, 4}) {
    SCOPED_TRACE(steps);
    level.time_steps = steps;
    double regularisation[2];
    for (int with : {0, 1}) {
      level.divergence_weight = 0.3 * with;
      MatchingObjective<2, double> objective(
          {placed[0].scale.get()}, level,
          make_similarity<2, double>(SimilarityType::Ssd, level.lattice, options.similarity_parameters, 1.0), 0.0);
      ASSERT_EQ(objective.size(), x.size());
      std::vector<double> gradient(x.size()), preconditioned(x.size());
      ASSERT_TRUE(objective.evaluate(x, gradient, preconditioned).is_valid);
      regularisation[with] = objective.parts().regularisation;
      if (!with) continue;
      const std::vector<Field<double>>& velocities = objective.velocities(x);
      std::vector<double> at;
      for (const Field<double>& velocity : velocities) {
        Field<double> ignored(velocity.size());
        at.push_back(add_divergence_penalty<2, double>(level.lattice, velocity.data(), 0.3, ignored.data()));
      }
      ASSERT_EQ(at.size(), steps + 1u);
      double expected = 0;
      for (int k = 0; k < steps; ++k) expected += (at[k] + at[k + 1]) / (2 * steps);
      EXPECT_GT(expected, 0.01 * regularisation[0]);
      EXPECT_NEAR(regularisation[1] - regularisation[0], expected, 1e-9 * expected);
    }
  }
}

/// Scales with order 0, order 1 and both, alone on a lattice and beside others.
std::vector<std::unique_ptr<MomentumScale<2, double>>> mixed_scales(const Lattice<2>& lattice) {
  std::vector<std::unique_ptr<MomentumScale<2, double>>> scales;
  const auto add = [&](Orders orders, double width, const Lattice<2>& on, double weight) {
    MomentumScaleOptions<2> made;
    made.kernel = KernelSum(has_first(orders) ? make_wendland_profile(width) : make_gaussian_profile(width));
    made.lattice = on;
    made.orders = orders;
    made.zeroth_weight = weight;
    made.first_weight = 0.7;
    if (orders == Orders::First) made.normals = spread_normals<2>(8);
    scales.push_back(std::make_unique<MomentumScale<2, double>>(made));
  };
  add(Orders::Zeroth, 6, coarsened(lattice, 2), 1.5);
  add(Orders::First, 4, coarsened(lattice, 2), 1);
  add(Orders::First, 5, lattice, 1);  // before the first order 0 of its lattice
  add(Orders::Zeroth, 3, lattice, 2);
  add(Orders::Zeroth, 5, lattice, 0.4);
  add(Orders::ZerothAndFirst, 4, lattice, 1.1);
  return scales;
}

std::vector<MomentumScale<2, double>*> pointers_to(
    const std::vector<std::unique_ptr<MomentumScale<2, double>>>& scales) {
  std::vector<MomentumScale<2, double>*> all;
  for (const auto& scale : scales) all.push_back(scale.get());
  return all;
}

MatchingObjective<2, double> ssd_of(const std::vector<MomentumScale<2, double>*>& scales,
                                    const MatchingLevel<2, double>& level) {
  return {scales, level, make_similarity<2, double>(SimilarityType::Ssd, level.lattice, {}, 1.0), 0.0};
}

// Oracle: each scale's own penalty. Without images there is nothing else in the energy. Nothing of what was in the
// gradient before is left.
TEST(MatchingObjective, PenalisesEveryScale) {
  omp_set_num_threads(1);
  MatchingLevel<2, double> level = waves();
  level.similarity_weight = 0;
  const auto scales = mixed_scales(level.lattice);
  const std::vector<MomentumScale<2, double>*> all = pointers_to(scales);
  MatchingObjective<2, double> objective = ssd_of(all, level);
  const std::vector<double> x = testing::random_values(objective.size(), 5, 0.01);
  std::vector<double> gradient(x.size(), std::numeric_limits<double>::quiet_NaN());
  std::vector<double> preconditioned(objective.working_set().dense_size(), std::numeric_limits<double>::quiet_NaN());
  for (int again : {0, 1}) {
    SCOPED_TRACE(again);
    ASSERT_TRUE(objective.evaluate(x, gradient, preconditioned).is_valid);
    double penalty = 0;
    std::size_t at = 0, dense_at = 0;  // no blocks are left out, and there are no elements
    for (MomentumScale<2, double>* scale : all) {
      const std::size_t field = scale->field_size(), zeroth = has_zeroth(scale->options().orders) ? field : 0,
                        first = scale->has_first_order() ? 2 * field : 0;
      std::vector<double> expected(zeroth + first);
      penalty += scale->penalty(zeroth ? x.data() + at : nullptr, first ? x.data() + at + zeroth : nullptr,
                                expected.data(), expected.data() + zeroth);
      double largest = 0;
      for (double value : expected) largest = std::max(largest, std::abs(value));
      EXPECT_GT(largest, 0);
      for (std::size_t i = 0; i < expected.size(); ++i)
        ASSERT_NEAR(gradient[at + i], expected[i], 1e-13 * largest) << i;
      for (std::size_t i = 0; i < zeroth; ++i) ASSERT_EQ(preconditioned[dense_at + i], x[at + i]) << i;
      at += expected.size();
      dense_at += zeroth;
    }
    EXPECT_EQ(at, x.size());
    EXPECT_NEAR(objective.parts().regularisation, penalty, 1e-13 * penalty);
  }
}

// Oracle: each scale's own synthesis, brought to one lattice. Nothing of an earlier shot is left.
TEST(MatchingObjective, BeginsWithTheVelocityOfEveryScale) {
  omp_set_num_threads(1);
  const Lattice<2> lattice = waves().lattice;
  const auto scales = mixed_scales(lattice);
  const std::vector<MomentumScale<2, double>*> all = pointers_to(scales);
  GeodesicShooting<2, double> shooting(all, lattice, 2, Evolution::Carried);
  for (std::uint64_t seed : {3, 4}) {
    Field<double> expected(2 * lattice.sites());
    std::vector<std::vector<double>> made;
    std::vector<MomentumPointers<double>> momenta;
    std::vector<Field<double>> own;
    for (MomentumScale<2, double>* scale : all) {
      const std::size_t field = scale->field_size();
      made.push_back(testing::random_values(3 * field, seed + made.size(), 0.1));
      MomentumPointers<double> pointers;
      if (has_zeroth(scale->options().orders)) pointers.zeroth = made.back().data();
      if (scale->has_first_order()) pointers.first = made.back().data() + field;
      momenta.push_back(pointers);
      own.emplace_back(field);
      scale->synthesise(pointers.zeroth, pointers.first, own.back().data());
    }
    // An element of each scale that has oriented momenta: not of a scale's own velocity.
    const std::vector<std::uint32_t> elements = {static_cast<std::uint32_t>(lattice.size[0] + 3)};
    const double strength = 0.5;
    for (std::size_t s = 0; s < all.size(); ++s)
      if (OrientedMomenta<2, double>* oriented = all[s]->oriented()) {
        momenta[s].elements = &elements;
        momenta[s].oriented = &strength;
        std::vector<double> corners;
        oriented->place(elements, corners);
        oriented->add_velocity(elements, corners.data(), &strength, own[s].data());
      }
    for (std::size_t s = 0; s < all.size(); ++s)
      LatticeInterpolation<2, double>(all[s]->lattice(), lattice, 2).add_to(own[s].data(), expected.data());
    std::vector<std::size_t> told;
    shooting.shoot(momenta, {}, [&](std::size_t s, const double* velocity) {
      told.push_back(s);
      for (std::size_t i = 0; i < own[s].size(); ++i) ASSERT_EQ(velocity[i], own[s][i]) << "scale " << s << " at " << i;
    });
    EXPECT_EQ(told, (std::vector<std::size_t>{0, 3, 4}));
    for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(shooting.velocities()[0][i], expected[i], 1e-12) << i;
  }
}

// Oracle: the mean under each scale's kernel, of which every value is asked for by a unit momentum of its own. First
// orders stay as they are.
TEST(MatchingObjective, SmoothsOrderZeroUnderEachKernel) {
  omp_set_num_threads(1);
  const MatchingLevel<2, double> level = waves();
  const auto scales = mixed_scales(level.lattice);
  const std::vector<MomentumScale<2, double>*> all = pointers_to(scales);
  MatchingObjective<2, double> objective = ssd_of(all, level);
  const std::vector<double> before = testing::random_values(objective.size(), 5, 0.1);
  std::vector<double> x = before;
  objective.smooth_zeroth(x);
  std::size_t at = 0;
  for (std::size_t s = 0; s < all.size(); ++s) {
    SCOPED_TRACE(s);
    const std::size_t field = all[s]->field_size(), zeroth = has_zeroth(all[s]->options().orders) ? field : 0,
                      first = all[s]->has_first_order() ? 2 * field : 0;
    std::vector<double> sum(zeroth), mass(zeroth), unit(field), row(field);
    for (std::size_t j = 0; j < zeroth; ++j) {
      unit[j] = 1;
      all[s]->synthesise(unit.data(), nullptr, row.data());
      unit[j] = 0;
      for (std::size_t i = j % 2; i < zeroth; i += 2) {  // the same component
        sum[i] += row[i] * before[at + j];
        mass[i] += row[i];
      }
    }
    for (std::size_t i = 0; i < zeroth; ++i) ASSERT_NEAR(x[at + i], sum[i] / mass[i], 1e-12) << i;
    for (std::size_t i = zeroth; i < zeroth + first; ++i) ASSERT_EQ(x[at + i], before[at + i]) << i;
    at += zeroth + first;
  }
  EXPECT_EQ(at, x.size());
}

// The images are warped with the map of the flow's lattice, taken linearly between its samples.
TEST(MatchingObjective, WarpsWithTheMapOfACoarserFlow) {
  omp_set_num_threads(1);
  const MatchingLevel<2, double> level = waves();
  RegistrationOptions options = one_scale(6);
  options.flow.coarsening = 1;
  auto placed = make_scales<2, double>(level.lattice, options, {});
  const Lattice<2> flow = level_lattice(level.lattice, 1);
  ASSERT_EQ(placed[0].scale->lattice(), flow);
  ASSERT_LT(flow.sites(), level.lattice.sites() / 2);
  EXPECT_EQ(placed[0].scale->options().kernel.width(), 6);  // of the level's voxels
  const auto similarity = [&] {
    return make_similarity<2, double>(SimilarityType::Ssd, level.lattice, options.similarity_parameters, 1.0);
  };
  MatchingObjective<2, double> objective({placed[0].scale.get()}, level, similarity(), 0.0, flow);
  const std::vector<double> x = testing::random_values(objective.size(), 5, 0.5);
  std::vector<double> gradient(x.size()), preconditioned(x.size());
  ASSERT_TRUE(objective.evaluate(x, gradient, preconditioned).is_valid);
  const double found = objective.parts().similarity;

  const std::vector<Field<double>>& velocities = objective.velocities(x);
  BackwardMap<2, double> map(flow, flow, static_cast<int>(velocities.size()) - 1);
  const Field<double> coarse = map.follow(velocities);
  Field<double> displacement(2 * level.lattice.sites());
  double largest = 0;
  const SitePlacement<2, double> place(level.lattice, flow);
  for (int y = 0; y < level.lattice.size[1]; ++y)
    for (int x_index = 0; x_index < level.lattice.size[0]; ++x_index) {
      constexpr double none[2] = {};
      const auto u = LinearCell<2, double>(flow, place({x_index, y}, none)).value<2>(coarse.data());
      for (int c = 0; c < 2; ++c) {
        displacement[2 * (static_cast<std::size_t>(y) * level.lattice.size[0] + x_index) + c] = u[c];
        largest = std::max(largest, std::abs(u[c]));
      }
    }
  EXPECT_GT(largest, 0.5);
  Field<double> warped, weights, image_dual(level.lattice.sites());
  warp_level<2, double>(level, {displacement.data()}, warped, weights);
  EXPECT_NEAR(similarity()->evaluate(level.fixed.data(), warped.data(), nullptr, image_dual.data(), nullptr), found,
              1e-10 * found);
  const std::vector<double> other = testing::random_values(objective.size(), 6, 0.5);
  ASSERT_TRUE(objective.evaluate(other, gradient, preconditioned).is_valid);
  EXPECT_EQ(objective.displacement(x), coarse) << "whatever was evaluated before";
}

// At rest all points of two images on one grid lie on samples, where the energy has a kink along each direction.
// Oracle: a central difference, which is the mean of what both sides have.
TEST(MatchingObjective, HasTheMeanSlopeOfBothSidesAtRest) {
  omp_set_num_threads(1);
  for (const bool has_moving_weights : {false, true}) {
    SCOPED_TRACE(has_moving_weights);
    MatchingLevel<2, double> level = waves();
    level.moving.samples = testing::random_values(level.lattice.sites(), 3);  // rough
    level.fixed_weights.assign(level.lattice.sites(), 1.0);
    for (std::size_t site = 0; site < level.lattice.sites(); ++site) {
      const int x = static_cast<int>(site) % level.lattice.size[0], y = static_cast<int>(site) / level.lattice.size[0];
      const bool is_border = x == 0 || y == 0 || x == level.lattice.size[0] - 1 || y == level.lattice.size[1] - 1;
      if (is_border) level.fixed_weights[site] = 0;  // slopes are 0 there
    }
    if (has_moving_weights) {
      level.moving_weights = level.moving;
      for (double& weight : level.moving_weights.samples) weight = 0.6 + 0.3 * weight * weight;
    }
    const RegistrationOptions options = one_scale(4);
    auto placed = make_scales<2, double>(level.lattice, options, {});
    MatchingObjective<2, double> objective(
        {placed[0].scale.get()}, level,
        make_similarity<2, double>(SimilarityType::Ssd, level.lattice, options.similarity_parameters, 1.0), 0.0);
    const std::vector<double> rest(objective.size(), 0.0), w = testing::random_values(rest.size(), 5);
    std::vector<double> gradient(rest.size()), preconditioned(rest.size());
    const double here = objective.evaluate_between_sides(rest, gradient, preconditioned).value;
    const double along = testing::dot(gradient, w);
    const auto energy = [&](double step) {
      std::vector<double> unused(rest.size()), scaled(rest.size());
      return objective.evaluate(testing::moved(rest, step, w), unused, scaled).value;
    };
    const double step = 1e-10, above = energy(step), below = energy(-step);  // moves by 1e-6 mm
    const double mean = (above - below) / (2 * step), kink = (above + below - 2 * here) / (2 * step);
    EXPECT_GT(std::abs(kink), 0.02 * std::abs(mean));
    EXPECT_NEAR(along, mean, 1e-4 * std::abs(mean));
  }
}

// Only component i of m_i opens or closes: it gets no gradient, and all others theirs.
TEST(MatchingObjective, GivesNoGradientToWhatIsNoShear) {
  omp_set_num_threads(1);
  MatchingLevel<2, double> level = waves();
  RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.regularisation = 3e-6;
  options.momenta.width_voxels = 4;
  options.momenta.scales = options.momenta.first_order_scales = 1;
  options.momenta.finest_scale = options.momenta.first_order_finest_scale = 0;
  auto placed = make_scales<2, double>(level.lattice, options, {});
  const std::size_t field = placed[0].scale->field_size();
  const std::vector<double> x = testing::random_values(3 * field, 5, 0.03);
  std::vector<double> gradients[2], preconditioned[2];
  for (int shear_only : {0, 1}) {
    MatchingObjective<2, double> objective(
        {placed[0].scale.get()}, level,
        make_similarity<2, double>(SimilarityType::Ssd, level.lattice, options.similarity_parameters, 1.0), 0.0);
    if (shear_only) objective.working_set().keep_shear_only();
    ASSERT_EQ(objective.size(), x.size());
    gradients[shear_only].resize(x.size());
    preconditioned[shear_only].resize(x.size());
    ASSERT_TRUE(objective.evaluate(x, gradients[shear_only], preconditioned[shear_only]).is_valid);
  }
  for (std::size_t i = 0; i < x.size(); ++i) {
    const bool is_normal = i >= field && i % 2 == (i - field) / field;
    EXPECT_NE(gradients[0][i], 0) << i;
    EXPECT_EQ(gradients[1][i], is_normal ? 0 : gradients[0][i]) << i;
    EXPECT_EQ(preconditioned[1][i], is_normal ? 0 : preconditioned[0][i]) << i;
  }
}

}  // namespace
}  // namespace saltus
