#include "client/cli/private_daemon.h"

#include "client/lib/registration_client.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

TEST(PrivateDaemon, KeepsBlobsWhereItSaysSoThatResultsNeedNotComeOverTheConnection) {
  const testing_support::TemporaryFolder folder;
  ASSERT_EQ(setenv("SALTUS_BIN", SALTUS_PROGRAMS, 1), 0);
  // Beside the result, as a user's temporary files and results often are.
  ASSERT_EQ(setenv("TMPDIR", folder.path().c_str(), 1), 0);
  fs::path blobs;
  {
    const PrivateDaemon daemon({.jobs = 1, .threads = 1});
    blobs = daemon.blobs();
    client::RegistrationClient client(
        {.address = daemon.address(), .tls = {}, .retry = {}, .stop = {}, .blobs = {blobs, true}});
    const v1::InputFile sent = client.upload_file(folder.write("image", "bytes"), "mha");
    v1::Artifact wanted;
    wanted.set_digest(sent.digest());
    client.download(wanted, folder / "result");
    // One file with two names: it has not been sent.
    EXPECT_EQ(fs::hard_link_count(folder / "result"), 2u);
  }
  EXPECT_FALSE(fs::exists(blobs));
  EXPECT_EQ(testing_support::content_of(folder / "result"), "bytes");
  EXPECT_EQ(fs::hard_link_count(folder / "result"), 1u);
}

}  // namespace
}  // namespace saltus::cli
