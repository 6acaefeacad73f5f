#include "server/rpc/stream_gate.h"

#include "server/jobs/refusal.h"

#include <gtest/gtest.h>

#include <vector>

namespace saltus::server {
namespace {

bool is_refused(StreamGate& gate, const std::string& name) {
  try {
    gate.enter(name);
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.kind(), RefusalKind::Exhausted);
    EXPECT_EQ(refusal.reason(), "TOO_MANY_STREAMS");
    EXPECT_TRUE(refusal.retry_after().has_value());
    return true;
  }
  return false;
}

TEST(StreamGate, NobodyTakesAllPlaces) {
  StreamGate gate("upload", 5, 2);
  std::vector<StreamGate::Pass> passes = {gate.enter("ann"), gate.enter("ann")};
  EXPECT_TRUE(is_refused(gate, "ann"));
  passes.push_back(gate.enter("bob"));
  passes.front().reset();
  EXPECT_FALSE(is_refused(gate, "ann"));
}

TEST(StreamGate, WhoHasNoNameHasTheCommonLimitOnly) {
  StreamGate gate("upload", 3, 1);
  std::vector<StreamGate::Pass> passes = {gate.enter(), gate.enter(), gate.enter()};
  EXPECT_TRUE(is_refused(gate, ""));
  EXPECT_TRUE(is_refused(gate, "ann"));
  passes.pop_back();
  EXPECT_FALSE(is_refused(gate, "ann")) << "a refusal must not take a place";
}

}  // namespace
}  // namespace saltus::server
