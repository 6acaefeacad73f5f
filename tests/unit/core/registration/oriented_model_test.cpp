// Oriented momenta in a registration. Oracles: the optimality condition of group sparsity at every element that may
// join, the same run in one piece and in two, and the truth of a slip that no axis is along.
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "core/evaluation/field_error.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/interface_normals.h"
#include "core/registration/matching_objective.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/support/errors.h"
#include "tests/support/checkpoint_bytes.h"
#include "tests/support/many_threads.h"
#include "tests/support/phantom_pair.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// A slip of 6 mm along a line that is 25 degrees off an axis.
struct Slip {
  Phantom<2> phantom;
  RegistrationInput<2> input;

  explicit Slip(std::uint64_t seed = 1) {
    PhantomOptions options = default_phantom_options(PhantomKind::Slip);
    options.seed = seed;
    options.size = {64, 64, 1};
    options.angle_deg = 25;
    phantom = make_phantom<2>(options);
    input = testing::pair_of(phantom);
  }
  double error_near_interface(const RegistrationOptions& options) const {
    const RegistrationResult<2> result = register_images<2>(input, options);
    const std::vector<double> errors =
        endpoint_errors<2>(result.displacement, phantom.displacement, phantom.masks.near);
    double sum = 0;
    for (double error : errors) sum += error;
    return sum / static_cast<double>(errors.size());
  }
};

RegistrationOptions oriented_options(int orientations = 8) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
  options.threads = 1;
  options.momenta.orientations = orientations;
  return options;
}

TEST(OrientedModel, HalvesTheErrorBesideAnInterfaceThatIsOblique) {
  // What noise and texture make of one pair is chance.
  double without = 0, with = 0;
  for (std::uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8}) {
    const Slip slip(seed);
    without += slip.error_near_interface(oriented_options(0));
    with += slip.error_near_interface(oriented_options());
  }
  EXPECT_LT(with, 0.75 * without) << with << " and " << without;
}

/// A level on which order 0 has settled and elements may join at the next look.
struct SettledSlip {
  const Slip slip;
  std::vector<PlacedScale<2, double>> placed;
  std::vector<MomentumScale<2, double>*> scales;
  MatchingLevel<2, double> level;
  std::vector<double> x;

  explicit SettledSlip(std::uint64_t seed = 1) : slip(seed) {
    const Lattice<2> lattice = lattice_of(slip.input.fixed.grid);
    const RegistrationOptions options = resolved(oriented_options(), lattice);
    placed = make_scales<2, double>(lattice, options);
    for (auto& scale : placed) scales.push_back(scale.scale.get());
    const std::vector<float>& samples = slip.input.fixed.samples;
    const double range =
        *std::max_element(samples.begin(), samples.end()) - *std::min_element(samples.begin(), samples.end());
    level.lattice = level.moving.lattice = lattice;
    for (float sample : samples) level.fixed.push_back(sample / range);
    for (float sample : slip.input.moving.samples) level.moving.samples.push_back(sample / range);
    level.moving.linear = Matrix<2>::Identity();
    level.moving.offset = Vector<2>::Zero();
    level.time_steps = 2;
    level.divergence_weight = 1e-2;
    level.evolution = Evolution::Carried;
    auto objective = make();
    objective.working_set().set_active_blocks({});
    MinimiseOptions how;
    how.max_iterations = 15;
    x.assign(objective.size(), 0.0);
    objective.weigh({SparsityRound::Weights::Even, 1, false}, x);
    minimise<double>(objective, how, x, [](const MinimiseStep&) { return true; });
    for (const auto& list : objective.working_set().active_elements()) EXPECT_TRUE(list.empty());
  }

  MatchingObjective<2, double> make(double sparsity = 4e-4) const {
    return MatchingObjective<2, double>(
        scales, level, make_similarity<2, double>(SimilarityType::Ssd, level.lattice, {}, 1.0), sparsity, {}, 0.5);
  }

  /// Has neither block nor element, and the normals of x.
  void begin(MatchingObjective<2, double>& objective) const {
    objective.working_set().set_active_blocks({});
    objective.weigh({}, x);
  }

  /// Looks at `at` and lets in what wants to take part.
  MinimiserState<double> look(MatchingObjective<2, double>& objective, const std::vector<double>& at,
                              Revision* revision = nullptr) const {
    objective.look_everywhere(true);
    MinimiserState<double> state(at);
    state.gradient.resize(at.size());
    state.preconditioned.resize(at.size());
    EXPECT_TRUE(objective.evaluate(at, state.gradient, state.preconditioned).is_valid);
    const Revision found = objective.revise(state);
    if (revision) *revision = found;
    return state;
  }

  /// Beside an element's site, along the axis that its normal is nearest to.
  std::vector<std::size_t> beside(std::size_t scale, std::uint32_t element) const {
    const OrientedMomenta<2, double>& oriented = *scales[scale]->oriented();
    const Lattice<2>& sites = scales[scale]->lattice();
    const long own = static_cast<long>(oriented.site_of(element));
    const Eigen::Vector2d n = oriented.options().normals[oriented.normal_of(element)];
    const bool is_x = std::abs(n[0]) > std::abs(n[1]) - 1e-6;
    const long step = is_x ? 1 : sites.size[0];
    std::vector<std::size_t> found;
    for (long other : {own - step, own + step})
      if (other >= 0 && other < static_cast<long>(sites.sites()) &&
          (!is_x || other / sites.size[0] == own / sites.size[0]))
        found.push_back(static_cast<std::size_t>(other));
    return found;
  }
};

// Those that join are those that pull harder than their weight, of all that were turned, and no less than what lies
// beside them across the interface; with the gradient that they have when they are there from the start.
TEST(OrientedModel, LetsJoinWhatPullsHarderThanItsWeight) {
  omp_set_num_threads(1);
  const SettledSlip settled;
  const auto& scales = settled.scales;
  const std::vector<double>& x = settled.x;
  auto objective = settled.make();
  settled.begin(objective);
  const MinimiserState<double> state = settled.look(objective, x);
  const auto joined = objective.working_set().active_elements();

  auto all = settled.make();
  std::vector<std::vector<std::uint32_t>> turned(scales.size());
  for (std::size_t s = 0; s < scales.size(); ++s)
    if (scales[s]->oriented()) turned[s] = scales[s]->oriented()->turned();
  all.working_set().set_active_blocks({});
  all.working_set().set_active_elements(turned);
  std::vector<double> spread(all.size(), 0.0), gradient(all.size()), preconditioned(all.size());
  std::size_t from = 0, to = 0, fields = 0;
  for (std::size_t s = 0; s < scales.size(); ++s) {
    if (has_zeroth(scales[s]->options().orders)) {
      std::copy_n(x.begin() + from, scales[s]->field_size(), spread.begin() + to);
      from += scales[s]->field_size();
      to += scales[s]->field_size();
    }
    to += turned[s].size();
    if (scales[s]->has_first_order()) fields += 2;
  }
  ASSERT_EQ(from, x.size());
  ASSERT_EQ(to, spread.size());
  ASSERT_TRUE(all.evaluate(spread, gradient, preconditioned).is_valid);
  std::size_t range_of = fields, pulling = 0, content = 0;
  for (std::size_t s = 0; s < scales.size(); ++s) {
    if (!scales[s]->oriented()) continue;
    const GroupSparsity& wide = all.sparsity()[range_of];
    const GroupSparsity& own = objective.sparsity()[range_of++];
    std::map<std::size_t, double> pull_at;
    for (std::size_t e = 0; e < turned[s].size(); ++e)
      pull_at[scales[s]->oriented()->site_of(turned[s][e])] = std::abs(gradient[wide.begin + e]);
    const auto is_most_across = [&](std::uint32_t element) {
      const double own_pull = pull_at[scales[s]->oriented()->site_of(element)];
      for (std::size_t site : settled.beside(s, element))
        if (const auto at = pull_at.find(site); at != pull_at.end() && at->second > own_pull) return false;
      return true;
    };
    std::size_t k = 0;
    for (std::size_t e = 0; e < turned[s].size(); ++e) {
      const double g = gradient[wide.begin + e];
      const bool is_there = std::binary_search(joined[s].begin(), joined[s].end(), turned[s][e]);
      EXPECT_EQ(is_there, std::abs(g) > wide.weight && is_most_across(turned[s][e])) << s << " " << turned[s][e];
      (is_there ? pulling : content) += 1;
      if (is_there) {
        EXPECT_NEAR(state.gradient[own.begin + k++], g, 1e-12 * (1 + std::abs(g)));
      }
    }
    EXPECT_EQ(k, joined[s].size());
  }
  EXPECT_GT(pulling, 10u);
  EXPECT_GT(content, 10u);
}

// Where elements have begun and no block is active, none joins, however hard it pulls, and normals along the axes have
// elements as well. Where blocks are active, all is as it is without being said.
TEST(OrientedModel, StandsAloneWhereNoBlockIsActive) {
  constexpr double kFewJoin = 4e-3;
  const SettledSlip settled;
  struct Found {
    std::size_t blocks = 0, along_axes = 0;
  };
  const auto look = [&](bool is_alone, bool begins_with_blocks) {
    auto objective = settled.make(kFewJoin);
    std::vector<double> x(settled.x);
    settled.begin(objective);
    // Leaves gradients that pull, of which a look that makes none must not read.
    settled.look(objective, x);
    if (is_alone) objective.working_set().let_elements_stand_alone();
    objective.working_set().set_active_elements({});
    settled.begin(objective);
    if (begins_with_blocks) {  // those that join before it is said
      auto before = settled.make(kFewJoin);
      settled.begin(before);
      x = settled.look(before, x).x;
      objective.working_set().set_active_blocks(before.working_set().active_blocks());
      objective.working_set().set_active_elements(before.working_set().active_elements());
      objective.weigh({}, x);
    }
    settled.look(objective, x);
    Found found;
    for (const auto& list : objective.working_set().active_blocks()) found.blocks += list.size();
    for (const std::vector<float>& normals : objective.working_set().turned_normals())
      for (float component : normals) found.along_axes += std::abs(component) > 0.999f;
    return found;
  };
  const Found beside = look(false, false), alone = look(true, false), with_blocks = look(true, true);
  EXPECT_GT(beside.blocks, 10u);
  EXPECT_LT(beside.blocks, 600u);  // of 640
  EXPECT_EQ(beside.along_axes, 0u);
  EXPECT_EQ(alone.blocks, 0u);
  EXPECT_GT(alone.along_axes, 0u);
  EXPECT_GE(with_blocks.blocks, beside.blocks);
  EXPECT_EQ(with_blocks.along_axes, 0u);
}

// Where one is active, what lies beside it across the interface joins only if it pulls 2.5 times its weight.
struct JoinedBeside {
  std::size_t kept_out = 0, let_in = 0;
};
JoinedBeside join_beside_what_is_active(std::uint64_t seed) {
  const SettledSlip settled(seed);
  auto first = settled.make();
  settled.begin(first);
  const MinimiserState<double> state = settled.look(first, settled.x);
  const auto joined = first.working_set().active_elements();

  // The same from where the elements beside every second of those are active.
  auto crowded = settled.make();
  settled.begin(crowded);
  std::vector<std::vector<std::uint32_t>> active(settled.scales.size());
  std::vector<std::set<std::size_t>> taken(settled.scales.size());
  for (std::size_t s = 0; s < settled.scales.size(); ++s) {
    if (!settled.scales[s]->oriented()) continue;
    for (std::size_t e = 0; e < joined[s].size(); e += 2)
      for (std::size_t site : settled.beside(s, joined[s][e])) taken[s].insert(site);
    for (std::uint32_t element : settled.scales[s]->oriented()->turned())
      if (taken[s].count(settled.scales[s]->oriented()->site_of(element)) &&
          !std::binary_search(joined[s].begin(), joined[s].end(), element))
        active[s].push_back(element);
    taken[s].clear();
    for (std::uint32_t element : active[s]) taken[s].insert(settled.scales[s]->oriented()->site_of(element));
  }
  crowded.working_set().set_active_elements(active);
  std::vector<double> x;  // order 0 of each scale, and its elements, which are 0
  for (std::size_t s = 0, from = 0; s < settled.scales.size(); ++s) {
    if (has_zeroth(settled.scales[s]->options().orders)) {
      x.insert(x.end(), settled.x.begin() + from, settled.x.begin() + from + settled.scales[s]->field_size());
      from += settled.scales[s]->field_size();
    }
    x.resize(x.size() + active[s].size(), 0.0);
  }
  EXPECT_EQ(x.size(), crowded.size());
  Revision revision;
  const MinimiserState<double> after = settled.look(crowded, x, &revision);
  const auto now = crowded.working_set().active_elements();
  EXPECT_TRUE(revision.has_changed);
  EXPECT_EQ(revision.joined, 1) << "all blocks are new";
  JoinedBeside found;
  std::size_t range_of = 0;
  while (first.sparsity()[range_of].group != 1) ++range_of;
  // Active elements that pull less than their weight are about to leave, and count for nothing.
  for (std::size_t s = 0, r = range_of; s < settled.scales.size(); ++s) {
    if (!settled.scales[s]->oriented()) continue;
    const GroupSparsity& range = crowded.sparsity()[r++];
    taken[s].clear();
    for (std::size_t e = 0; e < now[s].size(); ++e)
      if (std::binary_search(active[s].begin(), active[s].end(), now[s][e]) &&
          std::abs(after.gradient[range.begin + e]) > range.weight)
        taken[s].insert(settled.scales[s]->oriented()->site_of(now[s][e]));
  }
  for (std::size_t s = 0; s < settled.scales.size(); ++s) {
    if (!settled.scales[s]->oriented()) continue;
    const GroupSparsity& range = first.sparsity()[range_of++];
    for (std::size_t e = 0; e < joined[s].size(); ++e) {
      bool is_beside = false;
      for (std::size_t site : settled.beside(s, joined[s][e])) is_beside = is_beside || taken[s].count(site) > 0;
      const bool pulls = std::abs(state.gradient[range.begin + e]) > 2.5 * range.weight;
      EXPECT_EQ(std::binary_search(now[s].begin(), now[s].end(), joined[s][e]), pulls || !is_beside);
      found.kept_out += is_beside && !pulls;
      found.let_in += is_beside && pulls;
    }
  }
  return found;
}

TEST(OrientedModel, LetsLittleJoinBesideWhatIsActive) {
  omp_set_num_threads(1);
  JoinedBeside all;
  for (std::uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8, 9, 10}) {  // each has few that are kept out
    SCOPED_TRACE(seed);
    const JoinedBeside found = join_beside_what_is_active(seed);
    all.kept_out += found.kept_out;
    all.let_in += found.let_in;
  }
  EXPECT_GT(all.kept_out, 3u);
  EXPECT_GT(all.let_in, 3u);
}

// In 3-D an element stands for nine sites of its plane, and has to go as far in a step as all of them would.
TEST(OrientedModel, HasOneElementForNineSitesIn3d) {
  Lattice<3> lattice;
  lattice.size = {24, 24, 24};
  lattice.spacing = {1, 1, 1};
  RegistrationOptions asked = oriented_options(9);
  asked.pyramid.levels = 1;
  const RegistrationOptions options = resolved(asked, lattice);
  const auto placed = make_scales<3, double>(lattice, options);
  std::vector<MomentumScale<3, double>*> scales;
  for (const auto& one : placed) scales.push_back(one.scale.get());
  const auto with = std::find_if(scales.begin(), scales.end(), [](const auto* scale) { return scale->oriented(); });
  ASSERT_NE(with, scales.end());
  const OrientedMomenta<3, double>& oriented = *(*with)->oriented();
  EXPECT_EQ(oriented.sites_of_each(0), 9);
  const WorkingSet<3, double> set(scales, 1e-3, 0.5);
  double stiffness = 0;  // of one at every site
  for (std::size_t normal = 0; normal < 9; ++normal) stiffness += oriented.stiffness(normal) / 9;
  EXPECT_NEAR(set.sparsity().back().inverse_stiffness * stiffness, 9, 1e-9);
}

// Of the range with the largest share, be it of elements or of blocks.
TEST(OrientedModel, TellsWhatShareHasJoined) {
  omp_set_num_threads(1);
  const SettledSlip settled;
  auto first = settled.make();
  settled.begin(first);
  settled.look(first, settled.x);
  const auto thinned = [](std::vector<std::vector<std::uint32_t>> lists, std::size_t step) {
    for (std::vector<std::uint32_t>& list : lists) {
      std::size_t i = 0;
      std::erase_if(list, [&](std::uint32_t) { return i++ % step == step - 1; });
    }
    return lists;
  };
  const auto share_of = [](const auto& before, const auto& now) {
    double most = 0;
    for (std::size_t k = 0; k < now.size(); ++k) {
      std::size_t joined = 0;
      for (std::uint32_t number : now[k]) joined += !std::binary_search(before[k].begin(), before[k].end(), number);
      if (!now[k].empty()) most = std::max(most, static_cast<double>(joined) / static_cast<double>(now[k].size()));
    }
    return most;
  };
  for (const auto& [of_elements, of_blocks] : {std::pair{5, 1000}, std::pair{1000, 4}}) {
    auto objective = settled.make();
    const auto elements = thinned(first.working_set().active_elements(), of_elements),
               blocks = thinned(first.working_set().active_blocks(), of_blocks);
    settled.begin(objective);
    objective.working_set().set_active_blocks(blocks);
    objective.working_set().set_active_elements(elements);
    std::vector<double> x(objective.size(), 0.0);  // order 0, and all else 0
    auto value = settled.x.begin();
    for (std::size_t i = 0; i < x.size(); ++i)
      if (std::none_of(objective.sparsity().begin(), objective.sparsity().end(),
                       [&](const GroupSparsity& range) { return i >= range.begin && i < range.end; }))
        x[i] = *value++;
    ASSERT_EQ(value, settled.x.end());
    Revision revision;
    settled.look(objective, x, &revision);
    const double joined_elements = share_of(elements, objective.working_set().active_elements()),
                 joined_blocks = share_of(blocks, objective.working_set().active_blocks());
    SCOPED_TRACE(of_elements);
    EXPECT_EQ(revision.joined, std::max(joined_elements, joined_blocks));
    EXPECT_GT(revision.joined, 0.1);
    EXPECT_LT(std::min(joined_elements, joined_blocks), 0.1);
  }
}

// They lie in the image's plane along the interface, as the motion does, and are told with the others.
TEST(OrientedModel, TellsItsMomenta) {
  const Slip slip;
  const RegistrationResult<2> found = register_images<2>(slip.input, oriented_options());
  double along = 0, across = 0;
  const Vector<2> t(std::cos(25 * std::numbers::pi / 180), std::sin(25 * std::numbers::pi / 180));
  for (const MomentumField<2>& field : found.momenta) {
    if (field.axis != MomentumField<2>::kOriented) continue;
    EXPECT_EQ(field.kernel, "wendland");
    for (std::size_t site = 0; site < field.vectors.grid.voxels(); ++site) {
      const Vector<2> m(field.vectors.component(0)[site], field.vectors.component(1)[site]);
      along += std::abs(m.dot(t));
      across += std::abs(m[0] * t[1] - m[1] * t[0]);
    }
  }
  EXPECT_GT(along, 0);
  EXPECT_LT(across, 0.3 * along);
  EXPECT_FALSE(found.slip.points.empty());
}

TEST(OrientedModel, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const Slip slip;
  RegistrationOptions options = oriented_options();
  options.optimisation.max_iterations = 12;
  std::vector<std::vector<float>> fields;
  for (int threads : {1, 2}) {
    options.threads = threads;
    fields.push_back(register_images<2>(slip.input, options).displacement.samples);
  }
  EXPECT_EQ(fields[0], fields[1]);
}

// Normals come from where a round began, which is gone when it is taken up again.
void expect_to_resume_with_the_same_end(RegistrationOptions options, RegistrationSummary* found = nullptr) {
  const Slip slip;
  options.optimisation.max_iterations = 9;
  options.optimisation.tolerance = 0;
  const RegistrationResult<2> whole = register_images<2>(slip.input, options);
  const int steps = static_cast<int>(whole.summary.history.size());
  for (int stop : {steps / 3, steps / 2, steps - 13, steps - 4}) {
    std::string blob;
    int taken = 0;
    register_images<2>(slip.input, options,
                       [&](const Progress&) { return blob.empty() ? ProgressAnswer::Continue : ProgressAnswer::Stop; },
                       {.resume = {}, .offer = [&](const Progress&, const MakeCheckpoint& make) {
                          if (++taken == stop) blob = bytes_of(make);
                        }});
    ASSERT_FALSE(blob.empty());
    const RegistrationResult<2> resumed =
        register_images<2>(slip.input, options, {}, {.resume = from(blob), .offer = {}});
    EXPECT_EQ(resumed.displacement.samples, whole.displacement.samples) << stop;
    ASSERT_EQ(resumed.summary.levels.size(), whole.summary.levels.size());
    for (std::size_t l = 0; l < whole.summary.levels.size(); ++l) {
      EXPECT_EQ(resumed.summary.levels[l].oblique_share, whole.summary.levels[l].oblique_share) << stop;
      EXPECT_EQ(resumed.summary.levels[l].oriented_elements, whole.summary.levels[l].oriented_elements) << stop;
    }
  }
  EXPECT_GT(whole.summary.levels.back().oriented_elements, 0);
  if (found) *found = whole.summary;
}

TEST(OrientedModel, ResumesWithTheSameEnd) { expect_to_resume_with_the_same_end(oriented_options()); }

TEST(OrientedModel, ResumesWithTheSameEndWhereItStandsAlone) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.momenta.first_order_shear = 1e-9;
  ASSERT_EQ(resolved(options, Lattice<2>{{64, 64}, {1, 1}, {}}).momenta.oriented_alone, 1);
  expect_to_resume_with_the_same_end(options);
}

// Rounds begin with the pairs of the one before, and none waits.
TEST(OrientedModel, ResumesWithTheSameEndWithPairsOfTheRoundBefore) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.threads = 1;
  options.momenta.first_order_shear = 1e-9;
  ASSERT_TRUE(options.optimisation.keep_pairs);
  ASSERT_FALSE(options.momenta.first_order_waits);
  expect_to_resume_with_the_same_end(options);
}

// Of a scale that has nothing beside its elements.
TEST(OrientedModel, ResumesWithTheSameEndWithoutFields) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
  options.threads = 1;
  options.momenta.first_order_shear = 1e-9;
  options.momenta.oriented_alone = 2;
  options.momenta.oblique_share = 0;
  expect_to_resume_with_the_same_end(options);
}

// Weights that were made of a velocity which is no more.
TEST(OrientedModel, ResumesWithTheSameEndWithWeightsFromTheVelocity) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
  options.threads = 1;
  options.momenta.first_order_shear = 1e-9;
  options.momenta.oriented_alone = 2;
  options.momenta.oblique_share = 0;
  std::array<RegistrationSummary, 3> with;
  for (int shear_weights : {0, 1, 2}) {
    options.momenta.shear_weights = shear_weights;
    expect_to_resume_with_the_same_end(options, &with[static_cast<std::size_t>(shear_weights)]);
  }
  EXPECT_EQ(with[1].levels.back().rounds, 3);
  EXPECT_NE(with[1].levels.back().energy_after, with[0].levels.back().energy_after);
  EXPECT_EQ(with[2].levels.back().rounds, 2);
}

// One element is turned from another normal than a new choice would take, as one with a momentum may be.
TEST(OrientedModel, PutsBackWhatWasTurnedAndNothingElse) {
  const SettledSlip settled;
  auto objective = settled.make();
  settled.begin(objective);
  auto& set = objective.working_set();
  const auto normals = set.turned_normals();
  auto elements = set.turned_elements();
  std::size_t s = 0;
  while (s < elements.size() && elements[s].empty()) ++s;
  ASSERT_LT(s, elements.size());
  OrientedMomenta<2, double>& momenta = *settled.scales[s]->oriented();
  const auto sites = static_cast<std::uint32_t>(settled.scales[s]->lattice().sites());
  const std::uint32_t site = static_cast<std::uint32_t>(momenta.site_of(elements[s].front()));
  const Eigen::Vector2d n(normals[s][2 * site], normals[s][2 * site + 1]);
  std::uint32_t other = 0;
  while (other == momenta.normal_of(elements[s].front()) || momenta.options().normals[other].dot(n) < 0) ++other;
  elements[s].front() = other * sites + site;
  std::sort(elements[s].begin(), elements[s].end());
  set.restore_turned(normals, elements);
  EXPECT_EQ(momenta.turned(), elements[s]);
  EXPECT_EQ(set.turned_normals(), normals);

  const auto is_refused = [&](const std::vector<std::uint32_t>& list) {
    auto changed = elements;
    changed[s] = list;
    EXPECT_THROW(set.restore_turned(normals, changed), InvalidInput);
  };
  is_refused({elements[s][0], elements[s][0]});
  is_refused({elements[s][1], elements[s][0]});
  std::vector<std::uint32_t> both = {site, other * sites + site};
  for (std::uint32_t k = 0; k * sites + site == both[1] || momenta.options().normals[k].dot(n) < 0; ++k)
    both[0] = (k + 1) * sites + site;
  std::sort(both.begin(), both.end());
  is_refused(both);  // of one site
  std::uint32_t none = 0;
  while (normals[s][2 * none] != 0 || normals[s][2 * none + 1] != 0) ++none;
  is_refused({none});  // that has no normal
  is_refused({static_cast<std::uint32_t>(momenta.elements())});
  EXPECT_THROW(set.restore_turned({}, {}), InvalidInput);
  EXPECT_EQ(momenta.turned(), elements[s]);
}

TEST(OrientedModel, IsRefusedWhereItMeansNothing) {
  const auto is_refused = [](RegistrationOptions options) { return !problems(options).empty(); };
  EXPECT_FALSE(is_refused(oriented_options()));
  RegistrationOptions options = oriented_options();
  options.momenta.sparsity = 0;
  EXPECT_TRUE(is_refused(options));
  options = oriented_options();
  options.momenta.first_order_scales = 0;
  EXPECT_TRUE(is_refused(options));
  const Slip slip;
  EXPECT_THROW(register_images<2>(slip.input, oriented_options(13)), InvalidInput);
}

}  // namespace
}  // namespace saltus
