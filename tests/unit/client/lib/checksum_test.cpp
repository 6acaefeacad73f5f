#include "client/lib/checksum.h"

#include "client/lib/client_error.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

namespace saltus::client {
namespace {

// Oracle: RFC 3720, appendix B.4, and the common check value of CRC-32C.
TEST(Crc32c, GivesThePublishedValues) {
  EXPECT_EQ(crc32c("123456789"), 0xE3069283u);
  EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8A9136AAu);
  EXPECT_EQ(crc32c(std::string(32, '\xff')), 0x62A8AB43u);
  std::string ascending;
  for (char c = 0; c < 32; ++c) ascending += c;
  EXPECT_EQ(crc32c(ascending), 0x46DD794Eu);
  EXPECT_EQ(crc32c(""), 0u);
}

// Oracle: the definition, bit by bit, for lengths around the eight bytes that are taken at once.
TEST(Crc32c, AgreesWithTheDefinitionForEveryLength) {
  std::string data;
  for (int length = 0; length < 40; ++length) {
    std::uint32_t expected = ~0u;
    for (unsigned char byte : data) {
      expected ^= byte;
      for (int bit = 0; bit < 8; ++bit) expected = (expected >> 1) ^ ((expected & 1) ? 0x82F63B78u : 0u);
    }
    EXPECT_EQ(crc32c(data), ~expected) << "length " << length;
    data += static_cast<char>(37 * length + 200);
  }
}

// Oracle: FIPS 180-4 example "abc".
TEST(Sha256, NamesBytesByTheirDigest) {
  Sha256 sha;
  sha.add("a");
  sha.add("bc");
  EXPECT_EQ(sha.digest(), "sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(DigestOfFile, CountsAndHashesTheWholeFile) {
  testing_support::TemporaryFolder folder;
  const FileDigest found = digest_of_file(folder.write("file", "abc"));
  EXPECT_EQ(found.size, 3);
  EXPECT_EQ(found.digest, "sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(DigestOfFile, NamesAFileThatIsNotThere) {
  try {
    digest_of_file("/nowhere/image.mha");
    FAIL() << "no error";
  } catch (const LocalFileError& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/image.mha"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace saltus::client
