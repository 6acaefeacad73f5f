#include "server/store/upload_parts.h"

#include "server/jobs/refusal.h"
#include "server/store/blob_directory.h"
#include "server/store/data_directory.h"
#include "server/store/sha256.h"
#include "tests/support/fake_disk.h"
#include "tests/support/server_fakes.h"
#include "tests/support/temporary_folder.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <cerrno>
#include <fstream>
#include <memory>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr std::int64_t kSyncBytes = 16;

std::string digest_of(const std::string& content) {
  Sha256 hash;
  hash.add(content);
  return "sha256:" + hash.hex();
}

std::string pattern(std::size_t bytes) {
  std::string content(bytes, '\0');
  for (std::size_t i = 0; i < bytes; ++i) content[i] = static_cast<char>(i * 131 + 7);
  return content;
}

class UploadPartsTest : public ::testing::Test {
 protected:
  UploadPartsTest() { restart(); }

  /// As a new daemon on the same folder, after the old one went without a word.
  void restart() {
    blobs.reset();
    blobs = std::make_unique<BlobDirectory>(BlobFolders{data.blobs(), data.uploads(), data.corrupt()}, state, clock,
                                            reserve, UploadParts::Limits{kSyncBytes, 4}, disk);
  }
  UploadPlan plan(std::int64_t offset = 0, const std::string& id = "id") const {
    return {digest_of(content), static_cast<std::int64_t>(content.size()), id, offset};
  }
  std::unique_ptr<BlobUpload> begin(std::int64_t offset = 0, const std::string& id = "id") {
    auto upload = blobs->begin(plan(offset, id));
    while (!upload->prepare(5)) {
    }
    return upload;
  }
  std::int64_t committed(const std::string& id = "id") { return blobs->committed(plan(0, id)); }
  void finish(BlobUpload& upload, std::int64_t offset) {
    upload.append(std::string_view(content).substr(static_cast<std::size_t>(offset)));
    upload.seal();
    blobs->publish(upload);
  }
  void expect_published() {
    ASSERT_TRUE(blobs->holds(digest_of(content), static_cast<std::int64_t>(content.size())));
    const auto reader = blobs->open(digest_of(content), static_cast<std::int64_t>(content.size()));
    EXPECT_EQ(reader->read(content.size() + 1), content);
    EXPECT_TRUE(fs::is_empty(data.uploads()));
  }
  template <class Call>
  static std::string reason_of(Call call) {
    try {
      call();
    } catch (const Refusal& refusal) {
      return refusal.reason();
    }
    return "";
  }

  testing_support::TemporaryFolder folder;
  DataDirectory data{folder / "data"};
  std::string failure;
  StorageState state{[this](const std::string& reason) { failure += reason; }};
  testing_support::FakeClock clock;
  testing_support::FakeDisk disk;
  ReserveSettings reserve{0, 0};
  std::unique_ptr<BlobDirectory> blobs;
  std::string content = pattern(50);
};

TEST_F(UploadPartsTest, AnUploadThatIsCutAnywhereIsCompletedFromThere) {
  for (std::size_t cut = 0; cut <= content.size(); ++cut) {
    {
      const auto upload = begin();
      upload->append(content.substr(0, cut));
      upload->park();
    }
    ASSERT_EQ(committed(), static_cast<std::int64_t>(cut));
    const auto upload = begin(static_cast<std::int64_t>(cut));
    finish(*upload, static_cast<std::int64_t>(cut));
    expect_published();
    blobs->remove(digest_of(content));
  }
}

TEST_F(UploadPartsTest, ManyCutsAreNoDifferentFromOne) {
  for (std::size_t at = 0; at < content.size(); at += 7) {
    const auto upload = begin(static_cast<std::int64_t>(at));
    upload->append(content.substr(at, 7));
    upload->park();
    if (at % 2 == 0) restart();
  }
  const auto upload = begin(50);
  finish(*upload, 50);
  expect_published();
}

TEST_F(UploadPartsTest, AfterACrashWhatTheFileHasIsSyncedAndCounts) {
  for (std::size_t cut = 0; cut <= content.size(); ++cut) {
    auto upload = begin();
    upload->append(content.substr(0, cut));
    // Goes without parking, as with a kill.
    upload.reset();
    restart();
    disk.syncs = 0;
    ASSERT_EQ(committed(), static_cast<std::int64_t>(cut));
    EXPECT_EQ(disk.syncs, 1);
    upload = begin(static_cast<std::int64_t>(cut));
    finish(*upload, static_cast<std::int64_t>(cut));
    expect_published();
    blobs->remove(digest_of(content));
  }
}

TEST_F(UploadPartsTest, OnlySyncedBytesAreCommitted) {
  const auto upload = begin();
  upload->append(content.substr(0, 15));
  EXPECT_EQ(disk.syncs, 0);
  EXPECT_EQ(committed(), 0);
  upload->append(content.substr(15, 1));
  EXPECT_EQ(disk.syncs, 1);
  EXPECT_EQ(committed(), 16);
  upload->append(content.substr(16, 15));
  EXPECT_EQ(disk.syncs, 1);
  EXPECT_EQ(committed(), 16);
}

TEST_F(UploadPartsTest, BytesThatWereNotSyncedAreCutOffWhenAnotherStreamGoesOn) {
  const auto cut = begin();
  cut->append(pattern(16));
  cut->append("never safe");
  const auto upload = begin(16);
  finish(*upload, 16);
  expect_published();
}

TEST_F(UploadPartsTest, AnotherOffsetIsRefused) {
  {
    const auto upload = begin();
    upload->append(content.substr(0, 20));
    upload->park();
  }
  for (const std::int64_t offset : {0, 19, 21, 50})
    EXPECT_EQ(reason_of([&] { begin(offset); }), "OFFSET_MISMATCH") << offset;
  EXPECT_EQ(reason_of([&] { begin(1, "another"); }), "OFFSET_MISMATCH");
  EXPECT_EQ(reason_of([&] { begin(1, ""); }), "OFFSET_MISMATCH");
  EXPECT_EQ(committed(), 20);
}

TEST_F(UploadPartsTest, TheLastStreamOfAnUploadWins) {
  const auto first = begin();
  first->append(content.substr(0, 16));
  const auto second = begin(16);
  EXPECT_EQ(reason_of([&] { first->append("x"); }), "UPLOAD_TAKEN_OVER");
  EXPECT_EQ(reason_of([&] { first->seal(); }), "UPLOAD_TAKEN_OVER");
  first->park();
  finish(*second, 16);
  expect_published();
}

TEST_F(UploadPartsTest, AStreamThatWasTakenOverCannotPublish) {
  const auto first = begin();
  first->append(content);
  first->seal();
  const auto second = begin(50);
  EXPECT_EQ(reason_of([&] { blobs->publish(*first); }), "UPLOAD_TAKEN_OVER");
  finish(*second, 50);
  expect_published();
}

TEST_F(UploadPartsTest, UploadsOfTheSameBytesByDifferentNamesDoNotMeet) {
  const auto first = begin(0, "first");
  const auto second = begin(0, "second");
  const auto third = begin(0, "");
  first->append(content.substr(0, 25));
  finish(*second, 0);
  finish(*third, 0);
  finish(*first, 25);
  expect_published();
}

TEST_F(UploadPartsTest, WrongBytesLeaveNothingToGoOnWith) {
  const auto upload = begin();
  upload->append(std::string(50, '!'));
  EXPECT_EQ(reason_of([&] { upload->seal(); }), "DIGEST_MISMATCH");
  EXPECT_TRUE(fs::is_empty(data.uploads()));
  EXPECT_EQ(committed(), 0);
  const auto again = begin();
  finish(*again, 0);
  expect_published();
}

TEST_F(UploadPartsTest, BytesThatWereSpoiltOnTheDiskAreFoundAtTheEnd) {
  {
    const auto upload = begin();
    upload->append(content.substr(0, 20));
    upload->park();
  }
  {
    std::fstream file(fs::directory_iterator(data.uploads())->path(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(3);
    file.put('!');
  }
  const auto upload = begin(20);
  EXPECT_EQ(reason_of([&] { finish(*upload, 20); }), "DIGEST_MISMATCH");
  EXPECT_TRUE(fs::is_empty(data.uploads()));
}

TEST_F(UploadPartsTest, AStartKeepsWhatCanBeContinuedAndRemovesTheRest) {
  {
    const auto upload = begin();
    upload->append(content.substr(0, 20));
    upload->park();
  }
  std::ofstream(data.uploads() / "abcdef.part") << "half";
  std::ofstream(data.uploads() / "notes.txt") << "?";
  fs::create_directory(data.uploads() / "folder");
  restart();
  EXPECT_EQ(std::distance(fs::directory_iterator(data.uploads()), {}), 1);
  EXPECT_EQ(committed(), 20);
}

TEST_F(UploadPartsTest, AbandonedPartsExpireAndThoseInUseDoNot) {
  const auto held = begin(0, "held");
  {
    const auto left = begin(0, "left");
    left->append(content.substr(0, 20));
    left->park();
  }
  clock.advance(24h - 1ms);
  EXPECT_EQ(blobs->expire_uploads(24h).count, 0);
  clock.advance(1ms);
  const auto removed = blobs->expire_uploads(24h);
  EXPECT_EQ(removed.count, 1);
  EXPECT_EQ(removed.bytes, 20);
  EXPECT_EQ(committed("left"), 0);
  finish(*held, 0);
  expect_published();
}

TEST_F(UploadPartsTest, WhoAsksHowFarAnUploadCameFindsThatMuchForAnotherDay) {
  {
    const auto upload = begin();
    upload->append(content.substr(0, 20));
    upload->park();
  }
  clock.advance(24h);
  EXPECT_EQ(committed(), 20);
  EXPECT_EQ(blobs->expire_uploads(24h).count, 0);
  clock.advance(24h);
  EXPECT_EQ(reason_of([&] { begin(7); }), "OFFSET_MISMATCH");  // which says the same
  EXPECT_EQ(blobs->expire_uploads(24h).count, 0);
  clock.advance(24h);
  EXPECT_EQ(blobs->expire_uploads(24h).count, 1);
  EXPECT_EQ(committed(), 0);
}

TEST_F(UploadPartsTest, TheOldestPartMakesRoomWhenThereAreTooMany) {
  for (const std::string id : {"1", "2", "3", "4"}) {
    const auto upload = begin(0, id);
    upload->append(content.substr(0, 20));
    upload->park();
    clock.advance(1ms);
  }
  begin(0, "5");
  EXPECT_EQ(committed("1"), 0);
  for (const std::string id : {"2", "3", "4"}) EXPECT_EQ(committed(id), 20) << id;
}

TEST_F(UploadPartsTest, ASyncThatFailsEndsAllWritingAndIsNeverRepeated) {
  const auto other = begin(0, "other");
  const auto upload = begin();
  disk.sync_error = EIO;
  EXPECT_EQ(reason_of([&] { upload->append(content.substr(0, 16)); }), "STORE_UNAVAILABLE");
  EXPECT_EQ(disk.syncs, 1);
  EXPECT_TRUE(state.has_failed());
  EXPECT_NE(failure.find("cannot sync"), std::string::npos) << failure;
  disk.sync_error = 0;
  EXPECT_EQ(reason_of([&] { other->append("x"); }), "STORE_UNAVAILABLE");
  EXPECT_EQ(reason_of([&] { begin(0, "new"); }), "STORE_UNAVAILABLE");
  upload->park();
  EXPECT_EQ(disk.syncs, 1);
}

TEST_F(UploadPartsTest, EveryStepOfPublishingMayFailAndNothingIsAcknowledged) {
  const auto upload = begin();
  upload->append(content);
  upload->seal();
  disk.rename_error = EIO;
  EXPECT_EQ(reason_of([&] { blobs->publish(*upload); }), "STORE_UNAVAILABLE");
  EXPECT_TRUE(state.has_failed());
  EXPECT_FALSE(blobs->holds(digest_of(content), 50));
}

TEST_F(UploadPartsTest, AFullDiskRefusesAndIsNoFailure) {
  const auto upload = begin();
  upload->append(content.substr(0, 16));
  disk.write_error = ENOSPC;
  EXPECT_EQ(reason_of([&] { upload->append(content.substr(16)); }), "STORAGE_FULL");
  EXPECT_FALSE(state.has_failed());
  disk.write_error = 0;
  const auto again = begin(16);
  finish(*again, 16);
  expect_published();
}

TEST_F(UploadPartsTest, AFileThatMayNotGrowRefusesAndIsNoFailure) {
  const auto upload = begin();
  upload->append(content.substr(0, 16));
  disk.write_error = EFBIG;
  EXPECT_EQ(reason_of([&] { upload->append(content.substr(16)); }), "FILE_TOO_LARGE");
  EXPECT_FALSE(state.has_failed());
  disk.write_error = 0;
  const auto again = begin(16);
  finish(*again, 16);
  expect_published();
}

// Not even the part of it that fits: nobody could go on with that.
TEST_F(UploadPartsTest, NothingIsWrittenOfWhatMayNotBecomeAFile) {
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto limit_to = [&](rlim_t bytes) {
    const rlimit limit{bytes, before.rlim_max};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  };
  limit_to(content.size() - 1);
  for (const std::string id : {"id", ""}) EXPECT_EQ(reason_of([&] { begin(0, id); }), "FILE_TOO_LARGE");
  limit_to(content.size());
  EXPECT_TRUE(fs::is_empty(data.uploads()));
  finish(*begin(0, "id"), 0);
  limit_to(before.rlim_cur);
  expect_published();
}

TEST_F(UploadPartsTest, ADiskThatOthersHaveFilledIsNoticedAtTheNextSync) {
  reserve = {0, 100};
  disk.total = 1000;
  disk.available = 1000;
  restart();
  const auto upload = begin();
  upload->append(content.substr(0, 15));
  disk.available = 99;
  EXPECT_EQ(reason_of([&] { upload->append(content.substr(15)); }), "STORAGE_FULL");
  EXPECT_FALSE(state.has_failed());
  disk.available = 1000;
  upload->park();
  EXPECT_EQ(committed(), 50);
}

TEST_F(UploadPartsTest, AnUploadThatWouldTouchTheReserveWritesNothing) {
  reserve = {0, 100};
  disk.total = 1000;
  disk.available = 149;
  restart();
  for (const std::string id : {"id", ""}) EXPECT_EQ(reason_of([&] { begin(0, id); }), "STORAGE_FULL");
  EXPECT_TRUE(fs::is_empty(data.uploads()));
  disk.available = 150;
  finish(*begin(), 0);
  expect_published();
}

/// Files that a worker on this machine puts among the uploads, under a second name.
class GivenFileTest : public UploadPartsTest {
 protected:
  static constexpr const char* kId = "given-job-1-0";

  std::int64_t size() const { return static_cast<std::int64_t>(content.size()); }
  fs::path place(const std::string& id = kId) const {
    return data.uploads() / (id + "." + std::to_string(content.size()) + "." +
                             digest_of(content).substr(std::string("sha256:").size()) + ".part");
  }
  void put(const std::string& bytes, const std::string& id = kId) {
    fs::create_hard_link(folder.write("result-" + id, bytes), place(id));
  }
  std::string kept(const std::string& id = kId) { return testing_support::content_of(folder / ("result-" + id)); }
  void publish() {
    auto upload = begin(size(), kId);
    upload->seal();
    blobs->publish(*upload);
  }
};

TEST_F(GivenFileTest, IsAnUploadOfWhichAllIsThere) {
  put(content);
  EXPECT_EQ(committed(kId), size());
  publish();
  expect_published();
  EXPECT_EQ(kept(), content);
}

TEST_F(GivenFileTest, MayComeAgainUnderTheSameName) {
  for (int time = 0; time < 2; ++time) {
    put(content);
    publish();
    expect_published();
    blobs->remove(digest_of(content));
  }
}

// It may be large, and whoever asks does not wait for the disk.
TEST_F(GivenFileTest, IsSyncedWhenItIsSealedAndNotWhenSomebodyAsks) {
  put(content);
  const int before = disk.syncs;
  EXPECT_EQ(committed(kId), size());
  auto upload = begin(size(), kId);
  EXPECT_EQ(disk.syncs, before);
  disk.sync_error = EIO;
  EXPECT_EQ(reason_of([&] { upload->seal(); }), "STORE_UNAVAILABLE");
  EXPECT_FALSE(blobs->holds(digest_of(content), size()));
  EXPECT_EQ(kept(), content);
}

TEST_F(GivenFileTest, WithOtherBytesIsRefusedAndStaysWhatItIs) {
  std::string other = content;
  other.back() ^= 1;
  put(other);
  EXPECT_EQ(reason_of([&] { publish(); }), "DIGEST_MISMATCH");
  EXPECT_EQ(kept(), other);
  EXPECT_TRUE(fs::is_empty(data.uploads()));
  put(content);
  publish();
  expect_published();
}

TEST_F(GivenFileTest, ThatIsTakenAwayAgainIsNoFailureOfTheDisk) {
  for (const bool was_asked_for : {false, true}) {
    put(content);
    if (was_asked_for) {
      EXPECT_EQ(committed(kId), size());
    }
    fs::remove(place());
    EXPECT_EQ(reason_of([&] { begin(size(), kId); }), "OFFSET_MISMATCH");
    EXPECT_EQ(committed(kId), 0);
    finish(*begin(0, kId), 0);
    expect_published();
    blobs->remove(digest_of(content));
  }
}

TEST_F(GivenFileTest, IsNeverCutOff) {
  put(content + "more");
  EXPECT_EQ(reason_of([&] { begin(size(), kId); }), "OFFSET_MISMATCH");
  EXPECT_EQ(kept(), content + "more");
  EXPECT_EQ(reason_of([&] { begin(0, kId); }), "OFFSET_MISMATCH") << "all of it is there";

  // What becomes longer after it was looked at.
  std::ofstream(folder / (std::string("result-") + kId), std::ios::app) << "and more";
  EXPECT_EQ(reason_of([&] { begin(size() + 4, kId); }), "OFFSET_MISMATCH");
  EXPECT_EQ(kept(), content + "moreand more");
  EXPECT_FALSE(fs::exists(place()));
}

TEST_F(GivenFileTest, IsNotLookedForUnderOtherIdsOrOfOthers) {
  put(content, "id");
  EXPECT_EQ(committed("id"), 0);
  put(content);
  UploadPlan foreign = plan(0, kId);
  foreign.owner = "somebody";
  EXPECT_EQ(blobs->committed(foreign), 0);
}

TEST_F(GivenFileTest, OfAWorkerThatHasDiedExpires) {
  put(content);
  const timespec since{std::chrono::duration_cast<std::chrono::seconds>(clock.wall().time_since_epoch() - 2h).count(),
                       0};
  const timespec times[] = {since, since};
  ASSERT_EQ(utimensat(AT_FDCWD, place().c_str(), times, 0), 0);
  EXPECT_EQ(blobs->expire_uploads(1h).count, 1);
  EXPECT_TRUE(fs::is_empty(data.uploads()));
}

TEST_F(GivenFileTest, MayComeAgainAfterItWasAskedForInVain) {
  EXPECT_EQ(reason_of([&] { begin(size(), kId); }), "OFFSET_MISMATCH");
  put(content);
  EXPECT_EQ(committed(kId), size());
  publish();
  expect_published();
}

TEST_F(GivenFileTest, ThatAreGoneAreNotCounted) {
  put(content);
  put(content, "given-job-2-0");
  restart();
  fs::remove(place());
  EXPECT_EQ(blobs->uploads_left(), 1);
  fs::remove(place("given-job-2-0"));
  EXPECT_EQ(blobs->uploads_left(), 0);
}

// There is room for four that wait.
TEST_F(GivenFileTest, ThatWereTakenAwayTakeNoRoomFromOthers) {
  begin(0, "old")->append(std::string_view(content).substr(0, kSyncBytes));
  clock.advance(1ms);  // so that it is the oldest
  for (int i = 0; i < 4; ++i) {
    const std::string id = kId + std::to_string(i);
    put(content, id);
    EXPECT_EQ(committed(id), size());
    fs::remove(place(id));
  }
  begin(0, "new");
  EXPECT_EQ(committed("old"), kSyncBytes);
}

TEST_F(UploadPartsTest, ANameThatIsAPathIsRefused) {
  for (const std::string id : {"../x", "a/b", ".", "a.b", "a b"})
    EXPECT_EQ(reason_of([&] { begin(0, id); }), "INVALID_FIELD") << id;
  EXPECT_TRUE(fs::is_empty(data.uploads()));
}

// Ids are chosen by clients: two who choose the same must not meet, nor learn of each other.
TEST_F(UploadPartsTest, UploadsOfTwoOwnersHaveNothingToDoWithEachOther) {
  const auto plan_of = [&](const std::string& owner, std::int64_t offset = 0) {
    UploadPlan of = plan(offset);
    of.owner = owner;
    return of;
  };
  const std::string ann = "ann@hospital.example", bob = "bob / ../etc";
  for (const auto& [owner, count] : {std::pair(ann, 20), std::pair(bob, 7), std::pair(std::string(), 3)}) {
    const auto upload = blobs->begin(plan_of(owner));
    upload->append(std::string_view(content).substr(0, static_cast<std::size_t>(count)));
    upload->park();
  }
  for (int daemon = 0; daemon < 2; ++daemon) {
    EXPECT_EQ(blobs->committed(plan_of(ann)), 20);
    EXPECT_EQ(blobs->committed(plan_of(bob)), 7);
    EXPECT_EQ(blobs->committed(plan_of("")), 3);
    EXPECT_EQ(blobs->committed(plan_of("eve")), 0);
    EXPECT_EQ(reason_of([&] { blobs->begin(plan_of("eve", 20)); }), "OFFSET_MISMATCH");
    restart();
  }
  for (const auto& entry : fs::directory_iterator(data.uploads()))
    EXPECT_EQ(entry.path().filename().string().find("hospital"), std::string::npos) << "a name on the disk";
  // Taken over by its owner alone.
  const auto of_ann = blobs->begin(plan_of(ann, 20));
  blobs->begin(plan_of(bob, 7));
  while (!of_ann->prepare(5)) {
  }
  finish(*of_ann, 20);
  EXPECT_TRUE(blobs->holds(digest_of(content), static_cast<std::int64_t>(content.size())));
}

TEST_F(UploadPartsTest, WhatWaitsCountsForItsOwner) {
  const auto park = [&](const std::string& owner, const std::string& id, std::size_t count) {
    UploadPlan of = plan(0, id);
    of.owner = owner;
    const auto upload = blobs->begin(of);
    upload->append(std::string_view(content).substr(0, count));
    upload->park();
    return of;
  };
  const UploadPlan first = park("ann", "1", 20), second = park("ann", "2", 5), other = park("bob", "1", 9);
  UploadPlan unnamed = plan(0, "");
  unnamed.owner = "ann";
  for (int daemon = 0; daemon < 2; ++daemon) {
    EXPECT_EQ(blobs->waiting_beside(first), 5);
    EXPECT_EQ(blobs->waiting_beside(second), 20);
    EXPECT_EQ(blobs->waiting_beside(unnamed), 25);
    EXPECT_EQ(blobs->waiting_beside(other), 0);
    restart();
  }
  UploadPlan next = second;
  next.offset = 5;
  const auto upload = blobs->begin(next);
  EXPECT_EQ(blobs->waiting_beside(unnamed), 20) << "what is under way has a claim of its own";
}

}  // namespace
}  // namespace saltus::server
