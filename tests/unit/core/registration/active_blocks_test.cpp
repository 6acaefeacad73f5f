// First-order momenta in blocks. Oracles: the same minimisation with all blocks in use, and the optimality condition of
// group sparsity checked at every site.
#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <limits>

#include "core/optimisation/lbfgs.h"
#include "core/registration/matching_objective.h"
#include "core/registration/scales.h"
#include "core/support/errors.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// Plane waves of which two halves slide along each other.
template <int Dim, class T>
struct Scene {
  MatchingLevel<Dim, T> level;
  std::vector<PlacedScale<Dim, T>> placed;
  std::vector<MomentumScale<Dim, T>*> scales;

  explicit Scene(Model model) {
    Lattice<Dim>& lattice = level.lattice;
    const int size[3] = {Dim == 2 ? 35 : 19, Dim == 2 ? 33 : 17, 10};
    lattice.spacing.fill(1);
    for (int axis = 0; axis < Dim; ++axis) lattice.size[axis] = size[axis];
    RegistrationOptions options = default_options(model, SimilarityType::Ssd, Preset::Balanced);
    options.momenta.width_voxels = 4;
    options.momenta.scales = options.momenta.first_order_scales = 2;
    options.momenta.finest_scale = options.momenta.first_order_finest_scale = 0;
    options.momenta.regularisation = options.momenta.first_order_regularisation = 1e-3;
    Field<double> directions;
    if (model == Model::Directional) {
      directions.assign(Dim * lattice.sites(), 0);
      for (std::size_t site = 0; site < lattice.sites(); ++site) directions[Dim * site] = 1;
    }
    placed = make_scales<Dim, T>(lattice, options, directions);
    for (auto& scale : placed) scales.push_back(scale.scale.get());

    const std::vector<double> waves = testing::random_waves<Dim>(lattice, 3);
    level.moving.lattice = lattice;
    level.moving.linear = Matrix<Dim>::Identity();
    level.moving.offset = Vector<Dim>::Zero();
    level.moving.samples.assign(waves.begin(), waves.end());
    level.fixed = level.moving.samples;
    for (std::size_t site = 0; site < lattice.sites(); ++site) {
      const int x = static_cast<int>(site % size[0]), y = static_cast<int>(site / size[0] % size[1]);
      const int from = x > size[0] / 2 ? std::min(y + 1, size[1] - 1) : std::max(y - 1, 0);
      level.fixed[site] = level.moving.samples[site + (from - y) * size[0]];
    }
    level.time_steps = 2;
    level.divergence_weight = 1e-2;
    level.evolution = Evolution::Carried;
  }

  MatchingObjective<Dim, T> objective(double sparsity) {
    return MatchingObjective<Dim, T>(scales, level,
                                     make_similarity<Dim, T>(SimilarityType::Ssd, level.lattice, {}, 1.0), sparsity);
  }
};

/// The same objective, which keeps all its blocks.
template <int Dim, class T>
class AllBlocks final : public Objective<T> {
 public:
  explicit AllBlocks(MatchingObjective<Dim, T>& objective) : objective_(objective) {}
  std::size_t size() const override { return objective_.size(); }
  Evaluation evaluate(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) override {
    return objective_.evaluate(x, gradient, preconditioned);
  }
  double first_step(const std::vector<T>& direction) override { return objective_.first_step(direction); }
  const std::vector<GroupSparsity>& sparsity() const override { return objective_.sparsity(); }

 private:
  MatchingObjective<Dim, T>& objective_;
};

MinimiseOptions iterations(int most) {
  MinimiseOptions how;
  how.max_iterations = most;
  how.tolerance = 0;
  return how;
}

const auto go_on = [](const MinimiseStep&) { return true; };

/// Momenta of all scales and orders at all sites.
template <int Dim, class T>
std::vector<T> at_all_sites(const Scene<Dim, T>& scene, const MatchingObjective<Dim, T>& objective,
                            const std::vector<T>& x) {
  std::vector<T> all;
  const auto pointers = objective.working_set().pointers(x);
  for (std::size_t s = 0; s < pointers.size(); ++s) {
    const std::size_t count = scene.scales[s]->field_size();
    if (pointers[s].zeroth) all.insert(all.end(), pointers[s].zeroth, pointers[s].zeroth + count);
    if (pointers[s].first) all.insert(all.end(), pointers[s].first, pointers[s].first + Dim * count);
  }
  return all;
}

double sparsity_term(const std::vector<GroupSparsity>& ranges, const std::vector<double>& x) {
  double sum = 0;
  for (const GroupSparsity& range : ranges)
    for (std::size_t at = range.begin; at < range.end; at += range.group) {
      double square = 0;
      for (int k = 0; k < range.group; ++k) square += x[at + k] * x[at + k];
      sum += range.weight_of((at - range.begin) / range.group) * std::sqrt(square);
    }
  return sum;
}

class ActiveBlocks : public ::testing::TestWithParam<Model> {
 protected:
  void SetUp() override { omp_set_num_threads(1); }
};

/// A factor for the weight of each group: 1/2, 1 or 2, so that neighbours differ.
template <int Dim, class T>
std::vector<std::vector<float>> mixed_factors(const Scene<Dim, T>& scene) {
  std::vector<std::vector<float>> factors;
  for (const MomentumScale<Dim, T>* scale : scene.scales) {
    const int fields = !scale->has_first_order() ? 0 : scale->options().direction.empty() ? Dim : 1;
    for (int field = 0; field < fields; ++field) {
      std::vector<float>& own = factors.emplace_back(scale->lattice().sites());
      for (std::size_t site = 0; site < own.size(); ++site)
        own[site] = std::ldexp(1.0f, static_cast<int>((site * 7 + field) % 3) - 1);
    }
  }
  return factors;
}

/// Minimises with blocks that come and go; then looks at every group of every site.
template <int Dim>
void expect_a_minimum_over_all_groups(Model model, double sparsity, bool even = true) {
  Scene<Dim, double> scene(model);
  auto dense = scene.objective(sparsity), sparse = scene.objective(sparsity);
  sparse.working_set().set_active_blocks({});
  if (!even)
    for (auto* objective : {&dense, &sparse}) objective->working_set().restore_weights({}, mixed_factors(scene));
  std::vector<double> all(dense.size(), 0.0), x(sparse.size(), 0.0);
  ASSERT_LT(x.size(), all.size());
  AllBlocks<Dim, double> keeping(dense);
  // Groups take turns at zero for long; a run that is cut short does not look at what is outside before it ends.
  MinimiseOptions how = iterations(2000);
  how.tolerance = 1e-6;
  const MinimiseSummary wanted = minimise<double>(keeping, how, all, go_on);
  std::vector<std::size_t> sizes;
  const MinimiseSummary found = minimise<double>(sparse, how, x, [&](const MinimiseStep&) {
    sizes.push_back(sparse.size());
    return true;
  });
  ASSERT_NE(found.termination, MinimiseTermination::IterationLimit);
  EXPECT_EQ(x.size(), sparse.size());
  EXPECT_LT(x.size(), all.size());
  EXPECT_GT(sparse.working_set().active_block_share(), 0);
  EXPECT_LT(sparse.working_set().active_block_share(), 0.8);
  EXPECT_NE(*std::min_element(sizes.begin(), sizes.end()), *std::max_element(sizes.begin(), sizes.end()))
      << "no block came or went";
  // The flow is not convex: it may end lower.
  EXPECT_LE(found.energy_after, (1 + 1e-3) * wanted.energy_after);
  EXPECT_GE(found.energy_after, (1 - 1e-2) * wanted.energy_after);

  // The same momenta with all blocks active: the same energy, and no group that is 0 wants to be another.
  const auto blocks = sparse.working_set().active_blocks();
  std::vector<double> spread(dense.size(), 0.0);
  {
    std::size_t from = 0, to = 0, range = 0;
    for (MomentumScale<Dim, double>* scale : scene.scales) {
      if (has_zeroth(scale->options().orders)) {
        std::copy_n(x.begin() + from, scale->field_size(), spread.begin() + to);
        from += scale->field_size();
        to += scale->field_size();
      }
      if (!scale->has_first_order()) continue;
      for (std::size_t field = 0; field < (scale->options().direction.empty() ? Dim : 1); ++field, ++range) {
        const BlockSet<Dim> set(scale->lattice(), blocks[range]);
        set.scatter(Dim, x.data() + from, spread.data() + to);
        from += Dim * set.sites();
        to += scale->field_size();
      }
    }
    ASSERT_EQ(from, x.size());
    ASSERT_EQ(to, spread.size());
  }
  EXPECT_EQ(at_all_sites(scene, sparse, x), at_all_sites(scene, dense, spread));
  std::vector<double> gradient(dense.size()), ignored(dense.size()), own(x.size()), own_ignored(x.size());
  // The same sums in another order.
  EXPECT_DOUBLE_EQ(dense.evaluate(spread, gradient, ignored).value, sparse.evaluate(x, own, own_ignored).value);
  EXPECT_NEAR(sparsity_term(sparse.sparsity(), x), sparsity_term(dense.sparsity(), spread), 1e-12);
  std::size_t range = 0, outside = 0;
  for (MomentumScale<Dim, double>* scale : scene.scales) {
    if (!scale->has_first_order()) continue;
    for (std::size_t field = 0; field < (scale->options().direction.empty() ? Dim : 1); ++field, ++range) {
      const GroupSparsity& groups = dense.sparsity()[range];
      const BlockSet<Dim> set(scale->lattice(), blocks[range]);
      std::vector<double> is_inside(scale->lattice().sites()), compact(set.sites(), 1.0);
      set.scatter(1, compact.data(), is_inside.data());
      for (std::size_t site = 0; site < is_inside.size(); ++site) {
        if (is_inside[site] == 1) continue;
        ++outside;
        double pull = 0, size = 0;
        for (int k = 0; k < Dim; ++k) {
          pull += std::pow(gradient[groups.begin + Dim * site + k], 2);
          size += std::abs(spread[groups.begin + Dim * site + k]);
        }
        EXPECT_EQ(size, 0);
        EXPECT_LE(std::sqrt(pull), groups.weight_of(site)) << "a group outside the active blocks wants to move";
      }
    }
  }
  EXPECT_GT(outside, 0u);
}

TEST_P(ActiveBlocks, EndAtAMinimumOverAllGroups2d) { expect_a_minimum_over_all_groups<2>(GetParam(), 3e-3); }
TEST_P(ActiveBlocks, EndAtAMinimumOverAllGroups3d) { expect_a_minimum_over_all_groups<3>(GetParam(), 3e-3); }

TEST_P(ActiveBlocks, EndAtAMinimumOverGroupsOfDifferentWeights) {
  expect_a_minimum_over_all_groups<2>(GetParam(), 3e-3, false);
}

INSTANTIATE_TEST_SUITE_P(Models, ActiveBlocks, ::testing::Values(Model::Wendland1, Model::Directional, Model::Sliding),
                         [](const auto& info) { return to_string(info.param); });

TEST(ActiveBlockLists, AreAllBlocksWithoutSparsity) {
  Scene<2, float> scene(Model::Sliding);
  auto objective = scene.objective(0);
  const std::size_t size = objective.size();
  EXPECT_EQ(objective.working_set().active_block_share(), 1);
  objective.working_set().set_active_blocks({});
  EXPECT_EQ(objective.size(), size);
  std::vector<float> x(size, 0.0f);
  minimise<float>(objective, iterations(3), x, go_on);
  EXPECT_EQ(x.size(), size);
}

TEST(ActiveBlockLists, StayAsTheyAreWhileFirstOrdersWait) {
  Scene<2, float> scene(Model::Sliding);
  auto objective = scene.objective(3e-3);
  objective.working_set().set_active_blocks({});
  std::vector<float> x(objective.size(), 0.0f);
  for (const SparsityRound& round : {SparsityRound{SparsityRound::Weights::Even, 1, false}, SparsityRound{}}) {
    objective.weigh(round, x);
    EXPECT_EQ(objective.has_more(), round.lets_blocks_join);
    minimise<float>(objective, iterations(12), x, go_on);
    EXPECT_EQ(objective.working_set().active_block_share() > 0, round.lets_blocks_join);
  }
}

/// The largest pull in each block of an order-1 field, as a multiple of the weight.
template <int Dim>
std::vector<double> pulls_of(const Lattice<Dim>& lattice, const GroupSparsity& range, const double* gradient) {
  const auto all = BlockSet<Dim>::all(lattice);
  std::vector<double> pulls(all.blocks());
  for (std::size_t block = 0; block < pulls.size(); ++block)
    all.any_site(block, [&](std::size_t site) {
      double square = 0;
      for (int k = 0; k < Dim; ++k) square += std::pow(gradient[Dim * site + k], 2);
      pulls[block] = std::max(pulls[block], std::sqrt(square) / range.weight_of(site));
      return false;
    });
  return pulls;
}

// Oracle: the gradient at 0 with all blocks in use. With `factors` weights differ from site to site.
void expect_the_strongest_to_join(bool factors) {
  constexpr std::size_t most = 12;
  Scene<2, double> scene(Model::Sliding);
  auto dense = scene.objective(1e-3), bound = scene.objective(1e-3);
  for (auto* objective : {&dense, &bound})
    if (factors) objective->working_set().restore_weights({}, mixed_factors(scene));
  std::vector<double> zero(dense.size(), 0.0), gradient(dense.size()), ignored(dense.size());
  dense.evaluate(zero, gradient, ignored);
  bound.working_set().set_active_blocks({});
  bound.working_set().bound_active(most);
  if (factors) bound.working_set().restore_weights({}, mixed_factors(scene));
  std::vector<double> x(bound.size(), 0.0);
  minimise<double>(bound, iterations(0), x, go_on);

  const auto active = bound.working_set().active_blocks();
  std::size_t range = 0, kept_out = 0, all = 0;
  for (MomentumScale<2, double>* scale : scene.scales) {
    if (!scale->has_first_order()) continue;
    double least_in = std::numeric_limits<double>::infinity(), most_out = 0;
    std::size_t in = 0, blocks = 0;
    for (int field = 0; field < 2; ++field, ++range) {
      const GroupSparsity& groups = dense.sparsity()[range];
      const std::vector<double> pulls = pulls_of<2>(scale->lattice(), groups, gradient.data() + groups.begin);
      std::vector<char> is_in(pulls.size(), 0);
      for (std::uint32_t block : active[range]) is_in[block] = 1;
      for (std::size_t block = 0; block < pulls.size(); ++block) {
        kept_out += !is_in[block] && pulls[block] > 1;
        if (is_in[block])
          least_in = std::min(least_in, pulls[block]);
        else
          most_out = std::max(most_out, pulls[block]);
      }
      in += active[range].size();
      blocks += pulls.size();
    }
    EXPECT_EQ(in, most);
    EXPECT_GT(least_in, 1);
    EXPECT_GT(most_out, 1);
    EXPECT_GE(least_in, most_out);
    all += blocks;
  }
  EXPECT_GT(kept_out, 0u);
  EXPECT_DOUBLE_EQ(bound.working_set().kept_out_share(), static_cast<double>(kept_out) / static_cast<double>(all));
}

TEST(BoundBlocks, AreThoseThatPullHardest) { expect_the_strongest_to_join(false); }
TEST(BoundBlocks, AreThoseThatPullHardestForTheirWeight) { expect_the_strongest_to_join(true); }

TEST(BoundBlocks, StayWithinTheirBoundWhileOthersTakeTheirPlace) {
  Scene<2, double> scene(Model::Sliding);
  auto objective = scene.objective(3e-3);
  objective.working_set().set_active_blocks({});
  objective.working_set().bound_active(12);
  std::vector<double> x(objective.size(), 0.0);
  const auto active_within_bound = [&] {
    const auto active = objective.working_set().active_blocks();
    for (std::size_t range = 0, s = 0; s < scene.scales.size(); ++s) {
      if (!scene.scales[s]->has_first_order()) continue;
      EXPECT_LE(active[range].size() + active[range + 1].size(), 12u);
      range += 2;
    }
    return active;
  };
  double energy = std::numeric_limits<double>::infinity();
  std::vector<std::vector<std::vector<std::uint32_t>>> seen;
  minimise<double>(objective, iterations(120), x, [&](const MinimiseStep& step) {
    EXPECT_LT(step.energy, energy);
    energy = step.energy;
    seen.push_back(active_within_bound());
    return true;
  });
  active_within_bound();
  EXPECT_NE(seen.front(), seen.back());
  EXPECT_GT(objective.working_set().kept_out_share(), 0);
}

// 35 x 33 sites are 9 x 9 blocks.
TEST(BoundBlocks, AreCountedAtFullResolution) {
  const Scene<2, float> scene(Model::Sliding);
  EXPECT_EQ(most_active_blocks(scene.level.lattice, 1), 162u);
  EXPECT_EQ(most_active_blocks(scene.level.lattice, 0.1), 16u);
  EXPECT_EQ(most_active_blocks(scene.level.lattice, 1e-3), 1u);
}

TEST(BoundBlocks, AreAllWithoutSparsity) {
  Scene<2, float> scene(Model::Sliding);
  auto objective = scene.objective(0);
  objective.working_set().bound_active(12);
  objective.working_set().set_active_blocks({});
  std::vector<float> x(objective.size(), 0.0f);
  minimise<float>(objective, iterations(3), x, go_on);
  EXPECT_EQ(objective.working_set().active_block_share(), 1);
  EXPECT_EQ(objective.working_set().kept_out_share(), 0);
}

TEST(ActiveBlockLists, AreRefusedWhereTheyDoNotFit) {
  Scene<2, float> scene(Model::Sliding);
  auto objective = scene.objective(1);
  EXPECT_THROW(objective.working_set().set_active_blocks({{}, {}, {}, {}, {}}), InvalidInput);
  EXPECT_THROW(objective.working_set().set_active_blocks({{0, 4000}}), InvalidInput);
  objective.working_set().set_active_blocks({{0}, {}, {}, {1}});
  EXPECT_EQ(objective.working_set().active_blocks(), (std::vector<std::vector<std::uint32_t>>{{0}, {}, {}, {1}}));
}

TEST(ActiveBlockLists, DoNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  std::vector<std::vector<float>> ends;
  std::vector<std::vector<std::vector<std::uint32_t>>> lists;
  for (int threads : {1, 2}) {
    omp_set_num_threads(threads);
    Scene<3, float> scene(Model::Sliding);
    auto objective = scene.objective(3e-3);
    objective.working_set().set_active_blocks({});
    ends.emplace_back(objective.size(), 0.0f);
    minimise<float>(objective, iterations(12), ends.back(), go_on);
    lists.push_back(objective.working_set().active_blocks());
  }
  EXPECT_EQ(ends[0], ends[1]);
  EXPECT_EQ(lists[0], lists[1]);
}

}  // namespace
}  // namespace saltus
