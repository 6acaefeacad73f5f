// When the rounds of a level settle. Oracle: the energies of each round, the rule in core/measurements.md, "Stopping".
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "core/phantom/make_phantom.h"
#include "core/registration/checkpoint.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "tests/support/checkpoint_bytes.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

/// Of one round. Five iterations brought too little if that is at most `tolerance` of what the round has brought and of
/// what counts from before, so each look at them bounds what counted.
struct Round {
  double before = 0;                                           ///< what the rounds before it brought
  double at_least = 0;                                         ///< counted, by where it settled
  double less_than = std::numeric_limits<double>::infinity();  ///< counted, by where it went on
};

/// The last level's rounds.
std::vector<Round> rounds_of(const RegistrationInput<2>& input, const RegistrationOptions& options) {
  const std::uint64_t job = job_fingerprint(input, options);
  std::vector<Round> rounds;
  std::vector<double> energies;  // of the round at hand, from its start to its last step
  const auto bound = [&] {       // what would have to count for the last five iterations to be just too little
    const double now = energies.back();
    return (energies.at(energies.size() - 6) - now) / options.optimisation.tolerance - (energies.front() - now);
  };
  Checkpointing checkpointing;
  checkpointing.offer = [&](const Progress&, const MakeCheckpoint& make) {
    const Checkpoint reached = decoded(bytes_of(make), job);
    if (reached.step + 1 < options.pyramid.levels) return;
    if (static_cast<std::size_t>(reached.level.rounds) > rounds.size()) {
      if (!rounds.empty()) rounds.back().at_least = bound();
      rounds.push_back({.before = reached.level.energy_before - reached.level.energy_after});
    } else if (energies.size() > 5 && reached.minimiser.settled_at < 0) {
      rounds.back().less_than = std::min(rounds.back().less_than, bound());
    }
    energies = reached.minimiser.energies;
  };
  const RegistrationResult<2> result = register_images<2>(input, options, {}, checkpointing);
  rounds.back().at_least = bound();
  EXPECT_EQ(result.summary.levels.back().termination, Termination::Settled);
  EXPECT_EQ(result.summary.levels.back().rounds, static_cast<int>(rounds.size()));
  return rounds;
}

TEST(Settling, CountsTwoFifthsOfTheRoundsBeforeOneWithOtherWeights) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
  scene.size = {64, 64, 1};
  const Phantom<2> phantom = make_phantom<2>(scene);
  RegistrationInput<2> input = testing::pair_of(phantom);
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  options.optimisation.noise_tolerance = 0;
  options.pyramid.levels = 2;
  const std::vector<Round> rounds = rounds_of(input, options);
  // Order 0 alone, then with first orders and the same energy, then with other weights.
  ASSERT_EQ(rounds.size(), 3u);
  for (const auto& [round, share] : {std::pair{0, 0.0}, {1, 1.0}, {2, 0.4}}) {
    EXPECT_LE(rounds[round].at_least, share * rounds[round].before) << round;
    EXPECT_GT(rounds[round].less_than, share * rounds[round].before) << round;
  }
  // Were it nothing or all, the last round would have settled elsewhere.
  EXPECT_GT(rounds[2].at_least, 0.1 * rounds[2].before);
  EXPECT_LT(rounds[2].less_than, 0.9 * rounds[2].before);
}

}  // namespace
}  // namespace saltus
