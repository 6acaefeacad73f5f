#include "server/store/blob_directory.h"

#include "server/jobs/refusal.h"
#include "server/store/data_directory.h"
#include "server/store/random_ids.h"
#include "server/store/sha256.h"
#include "tests/support/server_fakes.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <sys/stat.h>
#include <unistd.h>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;

std::string digest_of(const std::string& content) {
  Sha256 hash;
  hash.add(content);
  return "sha256:" + hash.hex();
}

constexpr ReserveSettings kNoReserve{0, 0};

class BlobDirectoryTest : public ::testing::Test {
 protected:
  void put(const std::string& content) {
    const auto upload = blobs.begin({digest_of(content), static_cast<std::int64_t>(content.size()), "", 0});
    while (!upload->prepare(1)) {
    }
    upload->append(content);
    upload->seal();
    blobs.publish(*upload);
  }
  fs::path file_of(const std::string& content) const {
    const std::string hex = digest_of(content).substr(7);
    return data.blobs() / hex.substr(0, 2) / hex.substr(2);
  }
  template <class Call>
  std::string reason_of(Call call) {
    try {
      call();
    } catch (const Refusal& refusal) {
      return refusal.reason();
    }
    return "";
  }

  testing_support::TemporaryFolder folder;
  DataDirectory data{folder / "data"};
  StorageState state;
  testing_support::FakeClock clock;
  BlobDirectory blobs{{data.blobs(), data.uploads(), data.corrupt()}, state, clock, kNoReserve};
};

// Oracle: FIPS 180-2, appendix B.1.
TEST(Sha256Test, KnowsTheStandardsExample) {
  EXPECT_EQ(digest_of("abc"), "sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST_F(BlobDirectoryTest, GivesBackWhatWasPut) {
  const std::string content(3000000, 'x');
  put(content);
  const auto reader = blobs.open(digest_of(content), 3000000);
  std::string read;
  while (reader->position() < reader->size()) read += reader->read(1 << 20);
  EXPECT_EQ(read, content);
}

TEST_F(BlobDirectoryTest, TheEmptyBlobIsABlob) {
  put("");
  const auto reader = blobs.open(digest_of(""), 0);
  EXPECT_EQ(reader->read(100), "");
}

TEST_F(BlobDirectoryTest, AnotherDigestIsRefusedAndLeavesNothing) {
  {
    const auto upload = blobs.begin({digest_of("abc"), 3, "", 0});
    upload->append("abd");
    EXPECT_EQ(reason_of([&] { upload->seal(); }), "DIGEST_MISMATCH");
    EXPECT_THROW(blobs.publish(*upload), std::logic_error);
  }
  EXPECT_FALSE(blobs.holds(digest_of("abc"), 3));
  EXPECT_TRUE(fs::is_empty(data.uploads()));
}

TEST_F(BlobDirectoryTest, AnotherSizeIsRefused) {
  const auto upload = blobs.begin({digest_of("abc"), 3, "", 0});
  upload->append("ab");
  EXPECT_EQ(reason_of([&] { upload->seal(); }), "SIZE_MISMATCH");
  EXPECT_EQ(reason_of([&] { upload->append("cd"); }), "SIZE_MISMATCH");
}

TEST_F(BlobDirectoryTest, AnUploadThatIsDroppedLeavesNothing) {
  blobs.begin({digest_of("abc"), 3, "", 0})->append("ab");
  EXPECT_TRUE(fs::is_empty(data.uploads()));
}

TEST_F(BlobDirectoryTest, ReadingFromTheMiddleStillChecksTheWhole) {
  const std::string content(2000000, 'x');
  put(content);
  const auto reader = blobs.open(digest_of(content), 2000000);
  while (!reader->advance(1500000, 400000)) {
  }
  EXPECT_EQ(reader->position(), 1500000);
  EXPECT_EQ(reader->read(1000000).size(), 500000u);
}

TEST_F(BlobDirectoryTest, ADamagedByteIsFoundBeforeTheLastPieceIsGivenAway) {
  std::string content(1000, 'x');
  put(content);
  content[3] = 'y';
  std::ofstream(file_of(std::string(1000, 'x')), std::ios::binary) << content;
  const auto reader = blobs.open(digest_of(std::string(1000, 'x')), 1000);
  EXPECT_EQ(reader->read(999).size(), 999u);
  EXPECT_EQ(reason_of([&] { reader->read(1); }), "BLOB_CORRUPT");
}

TEST_F(BlobDirectoryTest, DamagedBytesAreSetAsideSoThatAnUploadHealsThem) {
  put("good");
  std::ofstream(file_of("good"), std::ios::binary) << "bad!";
  const auto damaged = blobs.open(digest_of("good"), 4);
  const auto also_damaged = blobs.open(digest_of("good"), 4);
  EXPECT_EQ(reason_of([&] { damaged->read(4); }), "BLOB_CORRUPT");
  EXPECT_FALSE(blobs.holds(digest_of("good"), 4));
  EXPECT_EQ(testing_support::content_of(data.corrupt() / digest_of("good").substr(7)), "bad!");
  put("good");
  // A reader of the old bytes must not take the new ones away.
  EXPECT_EQ(reason_of([&] { also_damaged->read(4); }), "BLOB_CORRUPT");
  EXPECT_EQ(blobs.open(digest_of("good"), 4)->read(4), "good");
}

TEST_F(BlobDirectoryTest, ALostOrShortenedFileIsDataLoss) {
  put("abc");
  fs::resize_file(file_of("abc"), 2);
  EXPECT_FALSE(blobs.holds(digest_of("abc"), 3));
  EXPECT_EQ(reason_of([&] { blobs.open(digest_of("abc"), 3); }), "BLOB_CORRUPT");
  fs::remove(file_of("abc"));
  EXPECT_EQ(reason_of([&] { blobs.open(digest_of("abc"), 3); }), "BLOB_CORRUPT");
}

TEST_F(BlobDirectoryTest, ADigestThatIsAPathIsRefused) {
  for (const std::string digest : {"../../etc/passwd", "sha256:../../../../etc/passwd", "", "sha256:ABC"})
    EXPECT_EQ(reason_of([&] { blobs.holds(digest, 1); }), "INVALID_FIELD") << digest;
}

TEST_F(BlobDirectoryTest, FilesWithoutARowBecomeUploadsAgain) {
  put("known");
  put("unknown");
  EXPECT_EQ(blobs.take_back_unknown([](const std::string& digest) { return digest == digest_of("known"); }), 1);
  EXPECT_TRUE(blobs.holds(digest_of("known"), 5));
  EXPECT_FALSE(blobs.holds(digest_of("unknown"), 7));
  // The upload that was to make it has all of its bytes, and no other has.
  UploadPlan plan;
  plan.digest = digest_of("unknown");
  plan.size = 7;
  plan.id = "mine";
  UploadPlan longer = plan;
  longer.size = 8;
  EXPECT_EQ(blobs.committed(longer), 0);
  EXPECT_EQ(blobs.committed(plan), 7);
  plan.offset = 7;
  auto upload = blobs.begin(plan);
  while (!upload->prepare(100)) {
  }
  upload->seal();
  blobs.publish(*upload);
  EXPECT_TRUE(blobs.holds(digest_of("unknown"), 7));
}

TEST(DataDirectoryTest, ASecondDaemonIsRefused) {
  testing_support::TemporaryFolder folder;
  const DataDirectory first(folder / "data");
  try {
    DataDirectory second(folder / "data");
    FAIL() << "was opened twice";
  } catch (const std::runtime_error& error) {
    const std::string holder = "another saltusd, process " + std::to_string(getpid()) + ", is using";
    EXPECT_NE(std::string(error.what()).find(holder), std::string::npos) << error.what();
  }
}

TEST(DataDirectoryTest, TheLockEndsWithTheDaemon) {
  testing_support::TemporaryFolder folder;
  { const DataDirectory first(folder / "data"); }
  const DataDirectory second(folder / "data");
}

TEST(DataDirectoryTest, OthersCannotLookIn) {
  testing_support::TemporaryFolder folder;
  const DataDirectory data(folder / "data");
  struct stat status {};
  ASSERT_EQ(stat((folder / "data").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0710u);
}

TEST(RandomIdsTest, IdsSortByTimeAndTokensDiffer) {
  RandomIds ids;
  const WallTime now(std::chrono::milliseconds(1800000000000));
  EXPECT_LT(ids.new_job_id(now), ids.new_job_id(now + std::chrono::milliseconds(1)));
  EXPECT_NE(ids.new_job_id(now), ids.new_job_id(now));
  EXPECT_NE(ids.new_token(), ids.new_token());
  EXPECT_EQ(ids.new_token().size(), 64u);
}

}  // namespace
}  // namespace saltus::server
