#include "proto/crc32c.h"

#include <gtest/gtest.h>

#include <string>

namespace saltus {
namespace {

/// Whichever way crc32c takes on this processor, and the tables.
class Crc32c : public testing::TestWithParam<std::uint32_t (*)(std::string_view)> {};
INSTANTIATE_TEST_SUITE_P(Ways, Crc32c, testing::Values(&crc32c, &crc32c_by_tables));

// Oracle: RFC 3720, B.4, and the customary check value of "123456789".
TEST_P(Crc32c, KnowsTheStandardsExamples) {
  std::string ascending;
  for (char c = 0; c < 32; ++c) ascending += c;
  EXPECT_EQ(GetParam()(std::string(32, '\0')), 0x8a9136aau);
  EXPECT_EQ(GetParam()(std::string(32, '\xff')), 0x62a8ab43u);
  EXPECT_EQ(GetParam()(ascending), 0x46dd794eu);
  EXPECT_EQ(GetParam()("123456789"), 0xe3069283u);
  EXPECT_EQ(GetParam()(""), 0u);
}

// Oracle: the definition, bit by bit, for lengths around the eight bytes that are taken at once.
TEST_P(Crc32c, AgreesWithTheDefinitionForEveryLength) {
  std::string data;
  for (int length = 0; length < 40; ++length) {
    std::uint32_t expected = ~0u;
    for (unsigned char byte : data) {
      expected ^= byte;
      for (int bit = 0; bit < 8; ++bit) expected = (expected >> 1) ^ ((expected & 1) ? 0x82F63B78u : 0u);
    }
    EXPECT_EQ(GetParam()(data), ~expected) << "length " << length;
    // At an odd address too.
    const std::string shifted = "x" + data;
    EXPECT_EQ(GetParam()(std::string_view(shifted).substr(1)), ~expected) << "length " << length;
    data += static_cast<char>(37 * length + 200);
  }
}

}  // namespace
}  // namespace saltus
