// Uploads that are cut, continued, made twice at once, or refused.
#include "tests/integration/server/daemon_test.h"
#include "tests/support/fake_disk.h"

#include <gmock/gmock.h>

#include <thread>

namespace saltus::server {
namespace {

class ResumableUpload : public testing_support::DaemonTest {
 protected:
  static std::string pattern(std::size_t bytes) {
    std::string content(bytes, '\0');
    for (std::size_t i = 0; i < bytes; ++i) content[i] = static_cast<char>(i * 131 + (i >> 8));
    return content;
  }
  std::string downloaded(const std::string& content) {
    grpc::ClientContext context;
    v1::ReadBlobRequest request;
    request.set_digest(digest_of(content));
    const auto reader = blobs->ReadBlob(&context, request);
    v1::ReadBlobResponse response;
    std::string read;
    while (reader->Read(&response)) read += response.data();
    EXPECT_TRUE(reader->Finish().ok());
    return read;
  }
  void expect_cut_and_continued(const std::string& content, std::size_t cut, std::size_t chunk) {
    std::string reason;
    EXPECT_EQ(upload_part(content, 0, cut, &reason, "id", chunk).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_EQ(reason, "SIZE_MISMATCH");
    const auto status = write_status(content);
    ASSERT_EQ(status.committed_size(), static_cast<std::int64_t>(cut));
    ASSERT_FALSE(status.complete());
    ASSERT_TRUE(upload_part(content, cut, content.size(), nullptr, "id", chunk).ok());
    EXPECT_TRUE(write_status(content).complete());
    EXPECT_TRUE(downloaded(content) == content);
    EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
  }
};

TEST_F(ResumableUpload, CutAtEveryByteOfASmallBlob) {
  start();
  for (std::size_t cut = 0; cut < 40; ++cut) {
    std::string content = pattern(40);
    content[39] = static_cast<char>(cut);  // another blob each time
    expect_cut_and_continued(content, cut, 16);
  }
}

TEST_F(ResumableUpload, CutAtTheBordersOfMessagesAndSyncs) {
  start();
  constexpr std::size_t kChunk = 1 << 20;
  for (const std::size_t cut : {kChunk - 1, kChunk, kChunk + 1, 8 * kChunk - 1, 8 * kChunk, 8 * kChunk + 1}) {
    std::string content = pattern(9 * kChunk);
    content[0] = static_cast<char>(cut >> 20);
    content[1] = static_cast<char>(cut);
    expect_cut_and_continued(content, cut, kChunk);
  }
}

TEST_F(ResumableUpload, AStreamThatIsCancelledLeavesWhatIsSafe) {
  start();
  const std::string content = pattern(20 << 20);
  {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    const auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest request = announcement(content);
    for (std::size_t at = 0; at < (9u << 20); at += 1 << 20) {
      request.set_data(content.substr(at, 1 << 20));
      ASSERT_TRUE(writer->Write(request));
      request.Clear();
    }
    // The stream is open, and the first 8 MiB are safe sooner or later.
    while (write_status(content).committed_size() < 8 << 20) {
    }
    context.TryCancel();
    EXPECT_FALSE(writer->Finish().ok());
  }
  const auto committed = static_cast<std::size_t>(write_status(content).committed_size());
  EXPECT_GE(committed, std::size_t{8} << 20);
  // Its own parking may come between the question and the new stream: then the question is asked again.
  std::string reason;
  grpc::Status status = upload_part(content, committed, content.size(), &reason);
  while (reason == "OFFSET_MISMATCH")
    status =
        upload_part(content, static_cast<std::size_t>(write_status(content).committed_size()), content.size(), &reason);
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(downloaded(content) == content);
}

TEST_F(ResumableUpload, GoesOnAfterACrashOfTheDaemon) {
  start();
  const std::string content = pattern(3000000);
  EXPECT_FALSE(upload_part(content, 0, 1234567).ok());
  crash();
  start();
  EXPECT_EQ(write_status(content).committed_size(), 1234567);
  EXPECT_TRUE(upload_part(content, 1234567, content.size()).ok());
  EXPECT_TRUE(downloaded(content) == content);
}

TEST_F(ResumableUpload, AnotherOffsetIsRefusedWithTheRightOne) {
  start();
  const std::string content = pattern(1000);
  EXPECT_FALSE(upload_part(content, 0, 400).ok());
  for (const std::size_t offset : {0, 399, 401, 1000}) {
    std::string reason;
    const auto status = upload_part(content, offset, content.size(), &reason);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED);
    EXPECT_EQ(reason, "OFFSET_MISMATCH");
    EXPECT_THAT(status.error_message(), ::testing::HasSubstr("400 bytes"));
  }
  EXPECT_EQ(upload_part(content, 1001, 0).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(upload_part(content, 400, 0, nullptr, "").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(upload_part(content, 0, 0, nullptr, "a/../b").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(upload_part(content, 400, content.size()).ok());
}

TEST_F(ResumableUpload, ManyUploadsOfTheSameBytesAtOnceAllSucceed) {
  start();
  const std::string content = pattern(3000000);
  std::vector<std::thread> clients;
  for (int i = 0; i < 8; ++i)
    clients.emplace_back([&, i] {
      const auto status = upload_part(content, 0, content.size(), nullptr, "client-" + std::to_string(i));
      EXPECT_TRUE(status.ok()) << status.error_message();
    });
  for (auto& client : clients) client.join();
  EXPECT_TRUE(downloaded(content) == content);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
}

TEST_F(ResumableUpload, AFullDiskIsToldWithATimeToWait) {
  auto disk = std::make_shared<testing_support::FakeDisk>();
  disk->total = 1000000;
  disk->available = 1000000;
  reserve = {0.05, 0};
  DaemonParts parts;
  parts.disk = disk;
  start(std::move(parts));
  const std::string content = pattern(950001);
  grpc::ClientContext context;
  v1::WriteBlobResponse response;
  const auto writer = blobs->WriteBlob(&context, &response);
  v1::WriteBlobRequest request;
  request.set_digest(digest_of(content));
  request.set_size(static_cast<std::int64_t>(content.size()));
  writer->Write(request);
  EXPECT_EQ(writer->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(testing_support::reason_of(context), "STORAGE_FULL");
  EXPECT_GT(std::stoi(testing_support::trailer_of(context, "saltus-retry-after-ms")), 0);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
  EXPECT_TRUE(upload_part(pattern(950000), 0, 950000).ok());
}

TEST_F(ResumableUpload, ASizeBeyondTheLimitIsRefusedBeforeAnythingIsWritten) {
  start();
  grpc::ClientContext context;
  v1::WriteBlobResponse response;
  const auto writer = blobs->WriteBlob(&context, &response);
  v1::WriteBlobRequest request;
  request.set_digest(digest_of("x"));
  request.set_size(std::int64_t{1} << 62);
  request.set_upload_id("id");
  writer->Write(request);
  EXPECT_EQ(writer->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
}

}  // namespace
}  // namespace saltus::server
