#include "server/rpc/crc32c.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

// Oracle: RFC 3720, B.4, and the customary check value of "123456789".
TEST(Crc32c, KnowsTheStandardsExamples) {
  std::string ascending(32, '\0');
  for (int i = 0; i < 32; ++i) ascending[static_cast<std::size_t>(i)] = static_cast<char>(i);
  EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8a9136aau);
  EXPECT_EQ(crc32c(std::string(32, '\xff')), 0x62a8ab43u);
  EXPECT_EQ(crc32c(ascending), 0x46dd794eu);
  EXPECT_EQ(crc32c("123456789"), 0xe3069283u);
  EXPECT_EQ(crc32c(""), 0u);
}

}  // namespace
}  // namespace saltus::server
