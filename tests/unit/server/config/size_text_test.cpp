#include "server/config/size_text.h"

#include "core/support/errors.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

TEST(DiskReserveText, ReadsBytesUnitsAndShares) {
  EXPECT_EQ(parse_reserve("0").bytes, 0);
  EXPECT_EQ(parse_reserve("1000").bytes, 1000);
  EXPECT_EQ(parse_reserve("512M").bytes, 512LL << 20);
  EXPECT_EQ(parse_reserve("4G").bytes, 4LL << 30);
  EXPECT_EQ(parse_reserve("4G").fraction, 0);
  EXPECT_EQ(parse_reserve("10%").fraction, 0.1);
  EXPECT_EQ(parse_reserve("10%").bytes, 0);
}

TEST(SizeText, ReadsBytesAndUnits) {
  EXPECT_EQ(parse_size("--upload-quota", "0"), 0);
  EXPECT_EQ(parse_size("--upload-quota", "512M"), 512LL << 20);
  EXPECT_EQ(parse_size("--upload-quota", "100G"), 100LL << 30);
  for (const char* text : {"", "-1", "10%", "1.5G", "4T", "99999999999G"})
    EXPECT_THROW(parse_size("", text), InvalidInput);
}

TEST(DiskReserveText, RefusesAnythingElse) {
  for (const char* text : {"", "-1", "1.5G", "101%", "4T", "G", "4 G", "99999999999G", "99999999999999999999"})
    EXPECT_THROW(parse_reserve(text), InvalidInput) << text;
}

}  // namespace
}  // namespace saltus::server
