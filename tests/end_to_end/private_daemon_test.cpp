#include "client/cli/private_daemon.h"

#include "client/cli/job_options.h"
#include "client/cli/registrar.h"
#include "client/lib/registration_client.h"
#include "core/image_io/write_image.h"
#include "tests/support/blob_pair.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

/// Temporary files beside the results, as a user often has them.
class PrivateDaemonTest : public testing::Test {
 protected:
  PrivateDaemonTest() {
    setenv("SALTUS_BIN", SALTUS_PROGRAMS, 1);
    setenv("TMPDIR", folder.path().c_str(), 1);
  }
  ~PrivateDaemonTest() override { unsetenv("TMPDIR"); }

  const testing_support::TemporaryFolder folder;
};

TEST_F(PrivateDaemonTest, KeepsBlobsWhereItSaysSoThatResultsNeedNotComeOverTheConnection) {
  fs::path blobs;
  {
    const PrivateDaemon daemon({.jobs = 1, .threads = 1});
    blobs = daemon.blobs();
    client::RegistrationClient client({.address = daemon.address(),
                                       .tls = {},
                                       .retry = {},
                                       .stop = {},
                                       .blobs = {.folder = blobs, .are_ours = true}});
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

TEST_F(PrivateDaemonTest, MakesABlobOfAFileThatLiesAmongItsUploads) {
  const PrivateDaemon daemon({.jobs = 1, .threads = 1});
  const client::CallSettings settings{.address = daemon.address(),
                                      .tls = {},
                                      .retry = {},
                                      .stop = {},
                                      .blobs = {.folder = daemon.blobs(),
                                                .uploads = daemon.blobs().parent_path().parent_path() / "uploads",
                                                .given_as = "given-job-1-"}};
  const fs::path file = folder.write("result", "bytes"), kept = folder / "kept";
  fs::create_hard_link(file, kept);
  client::BlobTransfer transfer(client::make_channel(settings.address), settings);
  const client::FileDigest given = transfer.give(file, "0");
  EXPECT_FALSE(fs::exists(file));
  EXPECT_TRUE(fs::is_empty(settings.blobs.uploads));
  const std::string hex = given.digest.substr(std::string("sha256:").size());
  EXPECT_TRUE(fs::equivalent(kept, daemon.blobs() / hex.substr(0, 2) / hex.substr(2))) << "it was sent";
  transfer.download(given.digest, folder / "fetched");
  EXPECT_EQ(testing_support::content_of(folder / "fetched"), "bytes");
}

// A list goes on with its daemon, whose files would be those of results that somebody may be working with.
TEST_F(PrivateDaemonTest, ResultsAreTheDaemonsOwnFilesOnlyWhereThereIsOnePair) {
  write_volume(folder / "fixed.mha", testing_support::blob_scene(48, 0));
  write_volume(folder / "moving.mha", testing_support::blob_scene(48, 3));
  JobOptions options;
  options.fixed = folder / "fixed.mha";
  options.moving = folder / "moving.mha";
  options.similarity = "ssd";
  options.preset = "fast";
  options.format = "mha";
  options.threads = 1;
  for (const bool is_one_pair : {true, false}) {
    Registrar registrar({}, {.jobs = 1, .threads = 1, .is_one_pair = is_one_pair});
    const fs::path out = folder / (is_one_pair ? "one" : "several");
    const auto job = registrar.run(options, make_spec(options), out, [](const v1::RegistrationJob&) {});
    ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED);
    EXPECT_EQ(fs::hard_link_count(out / "displacement.mha"), is_one_pair ? 2u : 1u);
  }
}

}  // namespace
}  // namespace saltus::cli
