#include "proto/crc32c.h"
#include "server/rpc/limits.h"
#include "tests/integration/server/daemon_test.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

using ::testing::HasSubstr;

class BlobTransfer : public testing_support::DaemonTest {
 protected:
  void SetUp() override { start(); }

  /// Reads from `offset` on, checking what every message says about itself.
  grpc::Status download(const std::string& digest, std::int64_t offset, std::string& content) {
    grpc::ClientContext context;
    v1::ReadBlobRequest request;
    request.set_digest(digest);
    request.set_offset(offset);
    const auto reader = blobs->ReadBlob(&context, request);
    v1::ReadBlobResponse response;
    while (reader->Read(&response)) {
      EXPECT_EQ(response.offset(), offset + static_cast<std::int64_t>(content.size()));
      EXPECT_EQ(response.crc32c(), crc32c(response.data()));
      EXPECT_LE(response.data().size(), limits::kDownloadChunkBytes);
      content += response.data();
      size = response.size();
    }
    return reader->Finish();
  }
  std::filesystem::path file_of(const std::string& digest) const {
    return folder / "data/blobs/sha256" / digest.substr(7, 2) / digest.substr(9);
  }
  static std::string pattern(std::size_t bytes) {
    std::string content(bytes, '\0');
    for (std::size_t i = 0; i < bytes; ++i) content[i] = static_cast<char>(i * 131 + (i >> 8));
    return content;
  }

  std::int64_t size = -1;
};

TEST_F(BlobTransfer, WhatWasUploadedComesBack) {
  for (const std::size_t bytes : {std::size_t{0}, std::size_t{1}, limits::kDownloadChunkBytes, std::size_t{3000001}}) {
    const std::string content = pattern(bytes);
    const std::string digest = uploaded(content);
    std::string read;
    EXPECT_TRUE(download(digest, 0, read).ok());
    EXPECT_EQ(read, content);
    EXPECT_EQ(size, static_cast<std::int64_t>(bytes));
  }
}

TEST_F(BlobTransfer, ADownloadGoesOnFromAnyOffset) {
  const std::string content = pattern(1000000);
  const std::string digest = uploaded(content);
  for (const std::int64_t offset : {1, 262144, 999999, 1000000}) {
    std::string read;
    EXPECT_TRUE(download(digest, offset, read).ok());
    EXPECT_EQ(read, content.substr(static_cast<std::size_t>(offset)));
  }
  std::string read;
  const auto status = download(digest, 1000001, read);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::OUT_OF_RANGE);
  EXPECT_THAT(status.error_message(), HasSubstr("offset is 1000001"));
}

TEST_F(BlobTransfer, DamagedBytesAreNeverDeliveredWhole) {
  const std::string digest = uploaded(pattern(600000));
  {
    std::fstream file(file_of(digest), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(10);
    file.put('!');
  }
  for (const std::int64_t offset : {0, 300000}) {
    std::string read;
    EXPECT_EQ(download(digest, offset, read).error_code(), grpc::StatusCode::DATA_LOSS);
    EXPECT_LT(read.size() + static_cast<std::size_t>(offset), 600000u);
  }
}

TEST_F(BlobTransfer, ALostFileCountsAsMissingAndIsHealedByAnUpload) {
  const std::string digest = uploaded("content");
  std::filesystem::remove(file_of(digest));
  grpc::ClientContext context;
  v1::FindMissingBlobsRequest request;
  request.add_digests(digest);
  v1::FindMissingBlobsResponse response;
  ASSERT_TRUE(blobs->FindMissingBlobs(&context, request, &response).ok());
  ASSERT_EQ(response.missing_size(), 1);
  uploaded("content");
  std::string read;
  EXPECT_TRUE(download(digest, 0, read).ok());
  EXPECT_EQ(read, "content");
}

TEST_F(BlobTransfer, AWrongDigestLeavesNothing) {
  const auto status = upload("content", digest_of("other"));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr(digest_of("content")));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
  std::string read;
  EXPECT_EQ(download(digest_of("other"), 0, read).error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(BlobTransfer, AChunkThatIsTooLargeIsRefused) {
  const std::string content = pattern(limits::kUploadChunkBytes + 1);
  const auto status = upload(content, digest_of(content), content.size());
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("data has"));
}

TEST_F(BlobTransfer, ABlobThatIsThereIsAcceptedEarly) {
  const std::string content = pattern(5000000);
  uploaded(content);
  grpc::ClientContext context;
  v1::WriteBlobResponse response;
  const auto writer = blobs->WriteBlob(&context, &response);
  v1::WriteBlobRequest request;
  request.set_digest(digest_of(content));
  request.set_size(5000000);
  writer->Write(request);
  // Neither the bytes nor the end of the stream were sent.
  EXPECT_TRUE(writer->Finish().ok());
  EXPECT_EQ(response.size(), 5000000);
}

TEST_F(BlobTransfer, ACutUploadLeavesNothing) {
  {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    const auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest request;
    request.set_digest(digest_of("content"));
    request.set_size(7);
    request.set_data("cont");
    ASSERT_TRUE(writer->Write(request));
    context.TryCancel();
    EXPECT_FALSE(writer->Finish().ok());
  }
  // A stop waits for all streams to end.
  daemon->stop();
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
}

TEST_F(BlobTransfer, BlobsSurviveACrash) {
  const std::string digest = uploaded("content");
  crash();
  start();
  std::string read;
  EXPECT_TRUE(download(digest, 0, read).ok());
  EXPECT_EQ(read, "content");
}

}  // namespace
}  // namespace saltus::server
