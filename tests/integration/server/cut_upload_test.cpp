// Uploads whose client hangs up after any byte: what was received is safe, no byte of it is asked for again, and the
// blob is right in the end.
#include "tests/integration/server/daemon_test.h"

#include <condition_variable>
#include <mutex>
#include <sstream>

namespace saltus::server {
namespace {

/// Tells what is written where, and syncs nothing: nobody cuts the power here. Only uploads are written through it.
class WatchedDisk final : public Disk {
 public:
  ssize_t write(int descriptor, const char* bytes, std::size_t count, off_t offset) override {
    const ssize_t done = Disk::write(descriptor, bytes, count, offset);
    const std::lock_guard lock(mutex_);
    for (ssize_t i = 0; i < done; ++i) ++times_[static_cast<std::size_t>(offset + i)];
    written_ += done;
    changed_.notify_all();
    return done;
  }
  int sync_data(int) override {
    const std::lock_guard lock(mutex_);
    ++syncs_;
    changed_.notify_all();
    return 0;
  }
  int sync(int) override { return 0; }

  void begin() {
    const std::lock_guard lock(mutex_);
    times_.clear();
    written_ = syncs_ = 0;
  }
  void wait_for_bytes(std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return written_ >= static_cast<std::int64_t>(count); });
  }
  void wait_for_syncs(int count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return syncs_ >= count; });
  }
  /// How often each byte was written since begin().
  std::map<std::size_t, int> times() {
    const std::lock_guard lock(mutex_);
    return times_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::size_t, int> times_;
  std::int64_t written_ = 0;
  int syncs_ = 0;
};

class CutUpload : public testing_support::DaemonTest {
 protected:
  CutUpload() : disk(std::make_shared<WatchedDisk>()) {
    DaemonParts parts;
    parts.disk = disk;
    start(std::move(parts));
  }

  /// Bytes that no other upload of the test has.
  std::string new_content(std::size_t size) {
    std::string content = std::to_string(++made) + ",";
    for (std::size_t i = content.size(); i < size; ++i) content.push_back(static_cast<char>(i * 131 + (i >> 8)));
    content.resize(size);
    return content;
  }

  /// Sends the bytes from `begin` to `end` in messages of `chunk` bytes and hangs up when the daemon has them.
  void send_and_hang_up(const std::string& content, std::size_t begin, std::size_t end, std::size_t chunk) {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    const auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest request = announcement(content, begin);
    ASSERT_TRUE(writer->Write(request));
    request.Clear();
    for (std::size_t at = begin; at < end; at += chunk) {
      request.set_data(content.substr(at, std::min(chunk, end - at)));
      ASSERT_TRUE(writer->Write(request));
    }
    disk->wait_for_bytes(end);
    context.TryCancel();
    EXPECT_FALSE(writer->Finish().ok());
  }

  /// Cuts an upload of `size` bytes at each of `cuts`, in ascending order, and brings it to its end. None is at 0: of a
  /// stream that has brought nothing, nobody can tell when the daemon is done with it.
  void expect_continued(std::size_t size, const std::vector<std::size_t>& cuts, std::size_t chunk) {
    std::ostringstream what;
    what << size << " bytes in messages of " << chunk << ", cut at";
    for (const std::size_t cut : cuts) what << ' ' << cut;
    SCOPED_TRACE(what.str());
    const std::string content = new_content(size);
    disk->begin();
    std::size_t begin = 0;
    int syncs = 0;
    for (const std::size_t cut : cuts) {
      send_and_hang_up(content, begin, cut, chunk);
      // What came is made safe once the daemon has noticed.
      disk->wait_for_syncs(++syncs);
      const auto status = write_status(content);
      ASSERT_EQ(status.committed_size(), static_cast<std::int64_t>(cut));
      ASSERT_FALSE(status.complete());
      begin = cut;
    }
    const auto last = upload_part(content, begin, size, nullptr, "id", chunk);
    ASSERT_TRUE(last.ok()) << last.error_message();
    EXPECT_TRUE(write_status(content).complete());
    const auto times = disk->times();
    EXPECT_EQ(times.size(), size);
    for (const auto& [at, count] : times) EXPECT_EQ(count, 1) << "byte " << at << " was sent again";
    expect_stored(content);
  }
  void expect_stored(const std::string& content) {
    grpc::ClientContext context;
    v1::ReadBlobRequest request;
    request.set_digest(digest_of(content));
    const auto reader = blobs->ReadBlob(&context, request);
    std::string read;
    for (v1::ReadBlobResponse response; reader->Read(&response);) read += response.data();
    EXPECT_TRUE(reader->Finish().ok());
    EXPECT_TRUE(read == content);
    EXPECT_TRUE(std::filesystem::is_empty(folder / "data/uploads"));
  }

  std::shared_ptr<WatchedDisk> disk;
  int made = 0;
};

TEST_F(CutUpload, AtEveryByteInMessagesOfOneByte) {
  for (std::size_t cut = 1; cut < 60; ++cut) expect_continued(60, {cut}, 1);
}

// Between the messages and within them: the last message before a cut is a part of one.
TEST_F(CutUpload, AtEveryByteInMessagesOfSeveral) {
  for (std::size_t cut = 1; cut < 300; ++cut) expect_continued(300, {cut}, 64);
}

TEST_F(CutUpload, AfterEveryRange) {
  constexpr std::size_t size = 20;
  for (std::size_t begin = 1; begin < size; ++begin)
    for (std::size_t end = begin + 1; end < size; ++end) expect_continued(size, {begin, end}, 3);
}

TEST_F(CutUpload, AfterEachOfItsBytes) {
  std::vector<std::size_t> cuts;
  for (std::size_t cut = 1; cut < 300; ++cut) cuts.push_back(cut);
  expect_continued(300, cuts, 1);
}

}  // namespace
}  // namespace saltus::server
