#include "client/lib/blob_transfer.h"

#include "client/lib/client_error.h"
#include "proto/crc32c.h"
#include "tests/support/fake_daemon.h"

#include <algorithm>
#include <fstream>
#include <map>

#include <sys/stat.h>
#include <unistd.h>

namespace saltus::client {
namespace {

using testing_support::content_of;
using testing_support::digest_of;
using testing_support::FakeDaemon;
using testing_support::TemporaryFolder;

/// Keeps blobs in memory; can cut a transfer or spoil a byte, once.
class FakeBlobs : public v1::BlobService::Service {
 public:
  std::map<std::string, std::string> blobs;
  std::vector<std::int64_t> read_offsets;
  int cut_reads_after = -1;   ///< messages of the first read; -1: never
  int cut_writes_after = -1;  ///< the same for writes
  bool spoil_data = false;
  bool spoil_writes = false;
  int writes = 0;
  int refusals = 0;         ///< questions that are answered RESOURCE_EXHAUSTED first
  std::string retry_after;  ///< in milliseconds, what these say about waiting; "" nothing
  std::size_t longest_message = 0;
  std::map<std::string, std::string> parts;  ///< what is safe of uploads, by upload_id
  std::filesystem::path uploads;             ///< where it looks for files that it is given; empty: nowhere
  bool spoil_given = false;                  ///< the first of them
  std::vector<std::int64_t> write_offsets;
  std::vector<std::string> upload_ids;
  int take_overs = 0;  ///< uploads that are answered UPLOAD_TAKEN_OVER first
  int late_parts = 0;  ///< uploads of which another byte becomes safe after the question

  grpc::Status FindMissingBlobs(grpc::ServerContext* context, const v1::FindMissingBlobsRequest* request,
                                v1::FindMissingBlobsResponse* response) override {
    if (refusals > 0) {
      --refusals;
      context->AddTrailingMetadata("saltus-reason", "TOO_MANY");
      if (!retry_after.empty()) context->AddTrailingMetadata("saltus-retry-after-ms", retry_after);
      return {grpc::StatusCode::RESOURCE_EXHAUSTED, "too many"};
    }
    for (const std::string& digest : request->digests())
      if (!blobs.count(digest)) response->add_missing(digest);
    return grpc::Status::OK;
  }

  grpc::Status WriteBlob(grpc::ServerContext* context, grpc::ServerReader<v1::WriteBlobRequest>* reader,
                         v1::WriteBlobResponse* response) override {
    ++writes;
    v1::WriteBlobRequest request;
    std::string digest, id;
    std::int64_t size = -1;
    for (int message = 0; reader->Read(&request); ++message) {
      if (message == 0) {
        digest = request.digest();
        size = request.size();
        id = request.upload_id();
        write_offsets.push_back(request.write_offset());
        upload_ids.push_back(id);
        if (request.write_offset() != static_cast<std::int64_t>(parts[id].size())) {
          context->AddTrailingMetadata("saltus-reason", "OFFSET_MISMATCH");
          return {grpc::StatusCode::ABORTED, "another offset"};
        }
        if (take_overs > 0) {
          --take_overs;
          context->AddTrailingMetadata("saltus-reason", "UPLOAD_TAKEN_OVER");
          return {grpc::StatusCode::ABORTED, "taken over"};
        }
      } else if (!request.digest().empty() || request.size() != 0 || request.write_offset() != 0) {
        return {grpc::StatusCode::INVALID_ARGUMENT, "digest, size and offset belong to the first message"};
      }
      if (message == cut_writes_after) {
        cut_writes_after = -1;
        return {grpc::StatusCode::UNAVAILABLE, "cut"};
      }
      longest_message = std::max(longest_message, request.data().size());
      parts[id] += request.data();
      if (spoil_writes) parts[id].back() ^= 1;
    }
    const std::string data = std::move(parts[id]);
    parts.erase(id);
    if (digest_of(data) != digest || static_cast<std::int64_t>(data.size()) != size) {
      context->AddTrailingMetadata("saltus-reason", "DIGEST_MISMATCH");
      return {grpc::StatusCode::INVALID_ARGUMENT, "digest or size differ"};
    }
    blobs[digest] = data;
    response->set_digest(digest);
    return grpc::Status::OK;
  }

  grpc::Status QueryWriteStatus(grpc::ServerContext*, const v1::QueryWriteStatusRequest* request,
                                v1::QueryWriteStatusResponse* response) override {
    const bool is_complete = blobs.count(request->digest()) > 0;
    const auto given = uploads / (request->upload_id() + "." + std::to_string(request->size()) + "." +
                                  request->digest().substr(std::string("sha256:").size()) + ".part");
    if (!uploads.empty() && std::filesystem::exists(given)) {
      parts[request->upload_id()] = content_of(given);
      if (spoil_given) parts[request->upload_id()].back() ^= 1;
      spoil_given = false;
    }
    response->set_complete(is_complete);
    std::string& part = parts[request->upload_id()];
    response->set_committed_size(is_complete ? request->size() : static_cast<std::int64_t>(part.size()));
    if (late_parts > 0) {
      --late_parts;
      part += late_byte;
    }
    return grpc::Status::OK;
  }
  char late_byte = '?';

  grpc::Status ReadBlob(grpc::ServerContext*, const v1::ReadBlobRequest* request,
                        grpc::ServerWriter<v1::ReadBlobResponse>* writer) override {
    read_offsets.push_back(request->offset());
    const auto found = blobs.find(request->digest());
    if (found == blobs.end()) return {grpc::StatusCode::NOT_FOUND, "no blob " + request->digest()};
    const std::string& data = found->second;
    constexpr std::size_t chunk = 1000;
    int message = 0;
    for (auto at = static_cast<std::size_t>(request->offset()); at < data.size(); at += chunk, ++message) {
      if (message == cut_reads_after) {
        cut_reads_after = -1;
        return {grpc::StatusCode::UNAVAILABLE, "cut"};
      }
      v1::ReadBlobResponse response;
      response.set_offset(static_cast<std::int64_t>(at));
      response.set_size(static_cast<std::int64_t>(data.size()));
      response.set_data(data.substr(at, chunk));
      response.set_crc32c(crc32c(response.data()));
      if (spoil_data) (*response.mutable_data())[0] ^= 1;
      writer->Write(response);
    }
    return grpc::Status::OK;
  }
};

std::string many_bytes(std::size_t count) {
  std::string data(count, '\0');
  std::uint32_t state = 12345;
  for (char& byte : data) byte = static_cast<char>((state = state * 1664525u + 1013904223u) >> 24);
  return data;
}

class BlobTransferTest : public testing::Test {
 protected:
  FakeBlobs service;
  FakeDaemon daemon{&service};
  TemporaryFolder folder;
  BlobTransfer transfer{make_channel(daemon.settings().address), daemon.settings()};
};

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

class GivenFileTest : public BlobTransferTest {
 protected:
  GivenFileTest() {
    std::filesystem::create_directory(folder / "uploads");
    settings.blobs.uploads = folder / "uploads";
    settings.blobs.given_as = "given-job-1-";
  }
  void give() {
    BlobTransfer(make_channel(settings.address), settings).give(file, "0");
    EXPECT_TRUE(service.blobs.at(digest_of(data)) == data);
    EXPECT_FALSE(std::filesystem::exists(file));
    EXPECT_TRUE(std::filesystem::is_empty(folder / "uploads"));
  }

  const std::string data = many_bytes(2'500'000);
  const std::filesystem::path file = folder.write("result", data);
  CallSettings settings = daemon.settings();
};

TEST_F(GivenFileTest, IsNotSent) {
  service.uploads = folder / "uploads";
  give();
  EXPECT_EQ(service.longest_message, 0u);
  EXPECT_EQ(service.write_offsets, std::vector<std::int64_t>{2'500'000});
  EXPECT_EQ(service.upload_ids, std::vector<std::string>{"given-job-1-0"});
}

TEST_F(GivenFileTest, IsSentToADaemonThatDoesNotSeeIt) {
  give();
  EXPECT_EQ(service.write_offsets, std::vector<std::int64_t>{0});
}

TEST_F(GivenFileTest, IsSentWhereItCannotBePut) {
  settings.blobs.uploads = folder / "absent";
  give();
  EXPECT_EQ(service.write_offsets, std::vector<std::int64_t>{0});
}

TEST_F(GivenFileTest, IsSentWhenItWasSpoiltOnTheDisk) {
  service.uploads = folder / "uploads";
  service.spoil_given = true;
  give();
  EXPECT_EQ(service.write_offsets, (std::vector<std::int64_t>{2'500'000, 0}));
}

TEST_F(GivenFileTest, IsGivenAgainToADaemonThatWasAway) {
  service.uploads = folder / "uploads";
  service.cut_writes_after = 0;
  give();
  EXPECT_EQ(service.longest_message, 0u);
}

TEST_F(GivenFileTest, StaysWhereItWasWhenItIsRefused) {
  service.uploads = folder / "uploads";
  service.refusals = 1;
  EXPECT_THROW(give(), ClientError);
  EXPECT_TRUE(content_of(file) == data);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "uploads"));
}

TEST_F(GivenFileTest, StaysWhenItIsUploadedOnly) {
  service.uploads = folder / "uploads";
  BlobTransfer(make_channel(settings.address), settings).upload(file);
  EXPECT_EQ(service.write_offsets, std::vector<std::int64_t>{0});
  EXPECT_TRUE(content_of(file) == data);
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

/// With a folder of blobs as the daemon's own, in which the blob of "seen" lies.
class SharedBlobsTest : public BlobTransferTest {
 protected:
  SharedBlobsTest() { put(data, data); }
  /// `bytes` under the name of the blob of `content`.
  void put(const std::string& content, const std::string& bytes) {
    std::filesystem::create_directories(place(content).parent_path());
    std::ofstream(place(content), std::ios::binary) << bytes;
    std::filesystem::permissions(place(content), std::filesystem::perms::owner_read);
  }
  std::filesystem::path place(const std::string& content) const {
    const std::string hex = digest_of(content).substr(std::string("sha256:").size());
    return folder.path() / "blobs" / hex.substr(0, 2) / hex.substr(2);
  }
  void download(const std::string& content, const std::filesystem::path& file, bool are_ours = false,
                const std::stop_token& stop = {}) {
    CallSettings settings = daemon.settings();
    settings.blobs = {.folder = folder / "blobs", .are_ours = are_ours};
    settings.stop = stop;
    BlobTransfer(make_channel(settings.address), settings).download(digest_of(content), file);
  }
  static struct stat status_of(const std::filesystem::path& file) {
    struct stat status {};
    EXPECT_EQ(stat(file.c_str(), &status), 0) << file;
    return status;
  }

  const std::string data = many_bytes(2'500'000);
};

TEST_F(SharedBlobsTest, AreReadWithoutAskingTheDaemon) {
  download(data, folder / "file");
  EXPECT_TRUE(content_of(folder / "file") == data);
  EXPECT_TRUE(service.read_offsets.empty());
  EXPECT_NE(status_of(folder / "file").st_ino, status_of(place(data)).st_ino) << "somebody else's file";
}

TEST_F(SharedBlobsTest, ComeOverTheConnectionWhenTheyAreNotThereOrNotWhatTheyShouldBe) {
  for (const std::string& bytes : {std::string("other bytes"), std::string()}) {
    const std::string content = "content" + bytes;
    service.blobs[digest_of(content)] = content;
    put(content, bytes);
    download(content, folder / "file");
    EXPECT_EQ(content_of(folder / "file"), content);
  }
  service.blobs[digest_of("absent")] = "absent";
  download("absent", folder / "file");
  EXPECT_EQ(content_of(folder / "file"), "absent");
  EXPECT_EQ(service.read_offsets.size(), 3u);
}

TEST_F(SharedBlobsTest, GoOnUnderAnotherNameWhenTheyAreOurs) {
  const mode_t mask = umask(0027);
  download(data, folder / "file", true);
  download(data, folder / "another", true);
  umask(mask);
  EXPECT_TRUE(content_of(folder / "file") == data);
  EXPECT_TRUE(content_of(folder / "another") == data);
  EXPECT_TRUE(service.read_offsets.empty());
  EXPECT_EQ(status_of(folder / "file").st_ino, status_of(place(data)).st_ino);
  EXPECT_EQ(status_of(folder / "file").st_mode & 0777, 0640u);
  EXPECT_NE(status_of(folder / "another").st_ino, status_of(place(data)).st_ino) << "one change would change both";
  EXPECT_EQ(status_of(folder / "file").st_nlink, 2u);
}

// As in a folder that a group shares.
TEST_F(SharedBlobsTest, AreCopiedWhereANewFileWouldBelongToOthers) {
  std::vector<gid_t> groups(static_cast<std::size_t>(std::max(0, getgroups(0, nullptr))));
  getgroups(static_cast<int>(groups.size()), groups.data());
  if (geteuid() == 0) groups.push_back(getegid() + 1);
  const auto other = std::find_if(groups.begin(), groups.end(), [](gid_t group) { return group != getegid(); });
  if (other == groups.end()) GTEST_SKIP() << "this user is in one group only";
  const std::filesystem::path out = folder / "out";
  std::filesystem::create_directory(out);
  ASSERT_EQ(chown(out.c_str(), static_cast<uid_t>(-1), *other), 0);
  ASSERT_EQ(chmod(out.c_str(), 02775), 0);
  download(data, out / "file", true);
  EXPECT_EQ(status_of(out / "file").st_gid, *other);
  EXPECT_TRUE(content_of(out / "file") == data);
}

TEST_F(SharedBlobsTest, TakeThePlaceOfAnOldFile) {
  for (const bool are_ours : {false, true}) {
    const auto file = folder.write("file", "old");
    download(data, file, are_ours);
    EXPECT_TRUE(content_of(file) == data);
  }
  for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
    EXPECT_TRUE(entry.path().filename() == "file" || entry.path().filename() == "blobs") << entry.path();
}

TEST_F(SharedBlobsTest, AreNotLookedForUnderWhatIsNoDigest) {
  CallSettings settings = daemon.settings();
  settings.blobs = {.folder = folder / "blobs", .are_ours = true};
  folder.write("secret", "secret");
  std::filesystem::create_directories(folder / "blobs/..");
  BlobTransfer transfer(make_channel(settings.address), settings);
  for (const char* digest : {"sha256:../secret", "sha256:", "", "../../secret"})
    EXPECT_THROW(transfer.download(digest, folder / "file"), ClientError) << digest;
  EXPECT_FALSE(std::filesystem::exists(folder / "file"));
}

TEST_F(SharedBlobsTest, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  try {
    download(data, folder / "file", false, stop.get_token());
    FAIL();
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::CANCELLED);
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "file"));
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
