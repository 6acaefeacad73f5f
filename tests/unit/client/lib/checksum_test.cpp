#include "client/lib/checksum.h"

#include "client/lib/client_error.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

namespace saltus::client {
namespace {

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
