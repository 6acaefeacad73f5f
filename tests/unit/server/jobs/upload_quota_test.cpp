#include "server/jobs/upload_quota.h"

#include "server/jobs/refusal.h"

#include <gtest/gtest.h>

#include <limits>
#include <optional>

namespace saltus::server {
namespace {

class UploadQuotaTest : public ::testing::Test {
 protected:
  UploadQuota::Claim claim(const std::string& owner, std::int64_t bytes) {
    return quota.claim(owner, bytes, 100, [this] { return stored; });
  }
  /// Nothing when it was granted; else whether waiting may help.
  std::optional<bool> refused(const std::string& owner, std::int64_t bytes) {
    try {
      claim(owner, bytes);
    } catch (const Refusal& refusal) {
      EXPECT_EQ(refusal.kind(), RefusalKind::Exhausted);
      EXPECT_EQ(refusal.reason(), "QUOTA");
      return refusal.retry_after().has_value();
    }
    return std::nullopt;
  }

  UploadQuota quota;
  std::int64_t stored = 0;
};

TEST_F(UploadQuotaTest, CountsWhatIsThereAndWhatIsOnItsWay) {
  stored = 30;
  const auto first = claim("ann", 50);
  EXPECT_EQ(refused("ann", 20), std::nullopt);
  EXPECT_EQ(refused("ann", 21), true) << "it would fit without the first";
  EXPECT_EQ(refused("ann", 71), false) << "it never fits";
}

TEST_F(UploadQuotaTest, GivesRoomBackWhenTheUploadIsOver) {
  auto first = claim("ann", 100);
  EXPECT_EQ(refused("ann", 1), true);
  first.reset();
  EXPECT_EQ(refused("ann", 100), std::nullopt);
}

TEST_F(UploadQuotaTest, OwnersHaveNothingToDoWithEachOther) {
  const auto first = claim("ann", 100);
  EXPECT_EQ(refused("bob", 100), std::nullopt);
}

// A limit that was made smaller, and sizes that a client makes up.
TEST_F(UploadQuotaTest, NothingOverflows) {
  stored = 1000;
  EXPECT_EQ(refused("ann", 1), false);
  stored = 0;
  EXPECT_EQ(refused("ann", std::numeric_limits<std::int64_t>::max()), false);
}

}  // namespace
}  // namespace saltus::server
