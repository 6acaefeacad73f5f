#include "client/lib/client_error.h"
#include "tests/unit/client/lib/fake_blobs.h"

namespace saltus::client {
namespace {

using testing_support::content_of;
using testing_support::digest_of;
using testing_support::TemporaryFolder;

TEST_F(BlobTransferTest, SendsAFileInMessagesOfOneMebibyte) {
  const std::string data = many_bytes(2'500'000);
  const FileDigest sent = transfer.upload(folder.write("image", data));
  EXPECT_EQ(sent.digest, digest_of(data));
  EXPECT_EQ(sent.size, 2'500'000);
  EXPECT_TRUE(service.blobs.at(sent.digest) == data);
  EXPECT_EQ(service.longest_message, std::size_t{1} << 20);
}

TEST_F(BlobTransferTest, SendsAnEmptyFile) {
  const FileDigest sent = transfer.upload(folder.write("empty", ""));
  EXPECT_EQ(service.blobs.at(sent.digest), "");
}

TEST_F(BlobTransferTest, SendsNothingThatTheDaemonHas) {
  const auto file = folder.write("image", "abc");
  transfer.upload(file);
  transfer.upload(file);
  EXPECT_EQ(service.writes, 1);
}

TEST_F(BlobTransferTest, GoesOnWithACutUploadWhereItsBytesAreSafe) {
  service.cut_writes_after = 1;
  const std::string data = many_bytes(2'500'000);
  const FileDigest sent = transfer.upload(folder.write("image", data));
  EXPECT_EQ(service.write_offsets, (std::vector<std::int64_t>{0, 1 << 20}));
  EXPECT_TRUE(service.blobs.at(sent.digest) == data);
}

TEST_F(BlobTransferTest, GoesOnWithWhatAnEarlierProcessHasSent) {
  const std::string data = many_bytes(2'500'000);
  const auto file = folder.write("image", data);
  service.cut_writes_after = 2;
  CallSettings impatient = daemon.settings();
  impatient.retry.patience = std::chrono::milliseconds(0);
  EXPECT_THROW(BlobTransfer(make_channel(impatient.address), impatient).upload(file), ClientError);
  transfer.upload(file);
  EXPECT_EQ(service.write_offsets, (std::vector<std::int64_t>{0, 2 << 20}));
  EXPECT_EQ(service.upload_ids[0], service.upload_ids[1]);
  EXPECT_TRUE(service.blobs.at(digest_of(data)) == data);
}

TEST_F(BlobTransferTest, AsksAgainWhenMoreHasBecomeSafeThanItWasTold) {
  service.late_parts = 1;
  const std::string data = many_bytes(1000);
  service.late_byte = data.front();
  transfer.upload(folder.write("image", data));
  EXPECT_EQ(service.write_offsets, (std::vector<std::int64_t>{0, 1}));
  EXPECT_TRUE(service.blobs.at(digest_of(data)) == data);
}

TEST_F(BlobTransferTest, LeavesAnUploadToTheProcessThatTookIt) {
  service.take_overs = 1;
  transfer.upload(folder.write("image", "abc"));
  ASSERT_EQ(service.upload_ids.size(), 2u);
  EXPECT_NE(service.upload_ids[0], service.upload_ids[1]);
  EXPECT_EQ(service.blobs.at(digest_of("abc")), "abc");
}

TEST_F(BlobTransferTest, BeginsAgainWhenWhatWasLeftIsSpoilt) {
  service.late_parts = 1;  // a byte that is none of the file's
  transfer.upload(folder.write("image", "abc"));
  EXPECT_EQ(service.write_offsets, (std::vector<std::int64_t>{0, 1, 0}));
  EXPECT_EQ(service.blobs.at(digest_of("abc")), "abc");
}

TEST_F(BlobTransferTest, SaysWhenTheFileHasChangedOnTheWay) {
  // The daemon finds other bytes from the start on: to send them again would not help.
  const auto file = folder.write("image", "abc");
  service.spoil_writes = true;
  try {
    transfer.upload(file);
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.reason(), "DIGEST_MISMATCH");
  }
  EXPECT_EQ(service.writes, 1);
}

TEST_F(BlobTransferTest, TriesAgainAtALimitThatTimeLifts) {
  service.refusals = 2;
  service.retry_after = "1";
  transfer.upload(folder.write("image", "abc"));
  EXPECT_EQ(service.writes, 1);
}

TEST_F(BlobTransferTest, DoesNotTryAgainAtALimitThatTimeDoesNotLift) {
  for (const std::string wait : {"", "soon", "-1", "3600000"}) {
    service.refusals = 1;
    service.retry_after = wait;
    try {
      transfer.upload(folder.write("image", "abc"));
      FAIL() << "no error with " << wait;
    } catch (const ClientError& error) {
      EXPECT_EQ(error.code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
      EXPECT_EQ(error.reason(), "TOO_MANY");
    }
  }
  EXPECT_EQ(service.writes, 0);
}

TEST_F(BlobTransferTest, GoesOnWithACutDownloadWhereItStopped) {
  const std::string data = many_bytes(10'500);
  service.blobs[digest_of(data)] = data;
  service.cut_reads_after = 4;
  transfer.download(digest_of(data), folder / "copy");
  EXPECT_TRUE(content_of(folder / "copy") == data);
  EXPECT_EQ(service.read_offsets, (std::vector<std::int64_t>{0, 4000}));
  EXPECT_EQ(folder.count(), 1u) << "temporary files are left";
}

TEST_F(BlobTransferTest, RefusesSpoiledBytesAndLeavesNoFile) {
  const std::string data = many_bytes(5'000);
  service.blobs[digest_of(data)] = data;
  service.spoil_data = true;
  try {
    transfer.download(digest_of(data), folder / "copy");
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::DATA_LOSS);
    EXPECT_EQ(error.reason(), "BYTES_CHANGED");
  }
  EXPECT_EQ(folder.count(), 0u);
}

TEST_F(BlobTransferTest, RefusesBytesOfAnotherDigest) {
  const std::string wanted = digest_of("wanted");
  service.blobs[wanted] = "something else";
  try {
    transfer.download(wanted, folder / "copy");
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.reason(), "DIGEST_MISMATCH");
  }
  EXPECT_EQ(folder.count(), 0u);
}

TEST_F(BlobTransferTest, SaysWhenThereIsNoSuchBlob) {
  try {
    transfer.download(digest_of("unknown"), folder / "copy");
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::NOT_FOUND);
  }
}

TEST(BlobTransfer, StopsWaitingForADaemonThatIsAwayWhenAsked) {
  TemporaryFolder folder;
  std::stop_source stop;
  CallSettings settings{.address = "unix:" + (folder / "nobody").string(), .retry = {}, .stop = stop.get_token()};
  settings.retry.first_delay = settings.retry.longest_delay = std::chrono::hours(1);
  settings.retry.patience = std::chrono::hours(2);
  BlobTransfer transfer(make_channel(settings.address), settings);
  stop.request_stop();
  try {
    transfer.upload(folder.write("image", "abc"));
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::CANCELLED);
  }
}

}  // namespace
}  // namespace saltus::client
