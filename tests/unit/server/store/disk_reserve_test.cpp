#include "server/store/disk_reserve.h"

#include "server/jobs/refusal.h"
#include "tests/support/fake_disk.h"

#include <gtest/gtest.h>

#include <optional>

namespace saltus::server {
namespace {

class DiskReserveTest : public ::testing::Test {
 protected:
  /// Whether `bytes` more are granted.
  static bool fits(DiskReserve& reserve, std::int64_t bytes) {
    try {
      DiskReserve::Claim claim(reserve, bytes);
      return true;
    } catch (const Refusal& refusal) {
      EXPECT_EQ(refusal.reason(), "STORAGE_FULL");
      EXPECT_TRUE(refusal.retry_after().has_value());
      return false;
    }
  }
  testing_support::FakeDisk disk;
};

TEST_F(DiskReserveTest, TheLargerOfShareAndBytesStaysFree) {
  disk.total = 1000;
  disk.available = 300;
  DiskReserve by_bytes(disk, "/", {0.05, 100});
  EXPECT_TRUE(fits(by_bytes, 200));
  EXPECT_FALSE(fits(by_bytes, 201));
  DiskReserve by_share(disk, "/", {0.25, 100});
  EXPECT_TRUE(fits(by_share, 50));
  EXPECT_FALSE(fits(by_share, 51));
}

TEST_F(DiskReserveTest, WhatWasPromisedToOneUploadIsNotThereForAnother) {
  disk.total = 1000;
  disk.available = 300;
  DiskReserve reserve(disk, "/", {0, 100});
  auto first = std::make_optional<DiskReserve::Claim>(reserve, 150);
  EXPECT_TRUE(fits(reserve, 50));
  EXPECT_FALSE(fits(reserve, 51));
  // Its bytes are on the disk now, so the disk itself counts them.
  first->use(150);
  disk.available = 150;
  EXPECT_TRUE(fits(reserve, 50));
  EXPECT_FALSE(fits(reserve, 51));
  first.reset();
  EXPECT_TRUE(fits(reserve, 50));
}

TEST_F(DiskReserveTest, ARefusedUploadHoldsNothing) {
  disk.total = 1000;
  disk.available = 300;
  DiskReserve reserve(disk, "/", {0, 100});
  EXPECT_FALSE(fits(reserve, 201));
  EXPECT_TRUE(fits(reserve, 200));
}

}  // namespace
}  // namespace saltus::server
