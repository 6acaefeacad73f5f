// The daemon's blobs and uploads as files that this program sees.
#include "client/lib/client_error.h"
#include "tests/unit/client/lib/fake_blobs.h"

#include <algorithm>
#include <fstream>

#include <sys/stat.h>
#include <unistd.h>

namespace saltus::client {
namespace {

using testing_support::content_of;
using testing_support::digest_of;

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

}  // namespace
}  // namespace saltus::client
