#include "server/jobs/job_transitions.h"

#include <gtest/gtest.h>

#include <map>

namespace saltus::server {
namespace {

using S = JobState;
using E = JobEvent;

constexpr S kStates[] = {S::Queued, S::Running, S::Cancelling, S::Succeeded, S::Failed, S::Cancelled};
constexpr E kEvents[] = {E::Start, E::Succeed, E::Fail,      E::Cancel, E::Stop,
                         E::Lose,  E::GiveUp,  E::LoseInput, E::Release};

// Oracle: the section "Jobs" of the architecture, written out by hand for every pair; a pair that is not here is
// refused.
const std::map<std::pair<S, E>, S> kAllowed = {
    {{S::Queued, E::Start}, S::Running},        {{S::Queued, E::Cancel}, S::Cancelled},
    {{S::Queued, E::LoseInput}, S::Failed},     {{S::Running, E::Succeed}, S::Succeeded},
    {{S::Running, E::Fail}, S::Failed},         {{S::Running, E::Cancel}, S::Cancelling},
    {{S::Running, E::Lose}, S::Queued},         {{S::Running, E::GiveUp}, S::Failed},
    {{S::Running, E::Release}, S::Queued},      {{S::Cancelling, E::Succeed}, S::Succeeded},
    {{S::Cancelling, E::Fail}, S::Cancelled},   {{S::Cancelling, E::Cancel}, S::Cancelling},
    {{S::Cancelling, E::Stop}, S::Cancelled},   {{S::Cancelling, E::Lose}, S::Cancelled},
    {{S::Cancelling, E::GiveUp}, S::Cancelled}, {{S::Cancelling, E::Release}, S::Cancelled},
    {{S::Succeeded, E::Cancel}, S::Succeeded},  {{S::Failed, E::Cancel}, S::Failed},
    {{S::Cancelled, E::Cancel}, S::Cancelled},
};

TEST(JobTransitions, EveryPairOfStateAndEventDoesWhatTheDiagramSays) {
  for (const S state : kStates)
    for (const E event : kEvents) {
      SCOPED_TRACE(to_string(state) + ", event " + std::to_string(static_cast<int>(event)));
      const auto allowed = kAllowed.find({state, event});
      const auto next = next_state(state, event);
      EXPECT_EQ(next.has_value(), allowed != kAllowed.end());
      if (next && allowed != kAllowed.end()) {
        EXPECT_EQ(*next, allowed->second);
      }
    }
}

TEST(JobTransitions, ATerminalStateIsNeverLeft) {
  for (const S state : kStates) {
    if (!is_terminal(state)) continue;
    for (const E event : kEvents) EXPECT_EQ(next_state(state, event).value_or(state), state);
  }
}

}  // namespace
}  // namespace saltus::server
