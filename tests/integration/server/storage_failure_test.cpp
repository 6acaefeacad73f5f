// What becomes of the daemon when its disk is full, fails, or has lost something.
#include "server/offline_fsck.h"
#include "tests/integration/server/daemon_test.h"
#include "tests/support/fake_disk.h"

#include <gmock/gmock.h>

#include <fcntl.h>
#include <sys/mount.h>
#include <unistd.h>

#include <condition_variable>
#include <fstream>
#include <mutex>
#include <sstream>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class StorageFailure : public testing_support::DaemonTest {
 protected:
  StorageFailure() {
    on_broken = [this](const std::string& reason) {
      ++failures;
      failure = reason;
    };
  }
  std::string refused_start() {
    try {
      start();
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  }
  /// What creating a job answers, as "code reason".
  std::pair<grpc::StatusCode, std::string> try_to_create(const v1::CreateRegistrationJobRequest& request) {
    grpc::ClientContext context;
    v1::RegistrationJob job;
    const auto status = jobs->CreateRegistrationJob(&context, request, &job);
    return {status.error_code(), testing_support::reason_of(context)};
  }
  std::string downloaded(const std::string& digest) {
    grpc::ClientContext context;
    v1::ReadBlobRequest request;
    request.set_digest(digest);
    const auto reader = blobs->ReadBlob(&context, request);
    v1::ReadBlobResponse response;
    std::string read;
    while (reader->Read(&response)) read += response.data();
    EXPECT_TRUE(reader->Finish().ok());
    return read;
  }
  void expect_read_only(const v1::CreateRegistrationJobRequest& request, const std::string& job) {
    const std::pair<grpc::StatusCode, std::string> unavailable{grpc::StatusCode::UNAVAILABLE, "STORE_UNAVAILABLE"};
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(try_to_create(request), unavailable);
      std::string reason;
      EXPECT_EQ(upload_part("new", 0, 3, &reason).error_code(), grpc::StatusCode::UNAVAILABLE);
      EXPECT_EQ(reason, "STORE_UNAVAILABLE");
    }
    EXPECT_EQ(get(job).id(), job);
    EXPECT_EQ(downloaded(digest_of("fixed")), "fixed");
    EXPECT_EQ(failures, 1) << "said more than once";
  }
  std::atomic<int> failures{0};
  std::string failure;
};

TEST_F(StorageFailure, AfterAFailedSyncTheDaemonOnlyReads) {
  auto disk = std::make_shared<testing_support::FakeDisk>();
  DaemonParts parts;
  parts.disk = disk;
  start(std::move(parts));
  const auto request = valid_request();
  const auto job = created();
  disk->sync_error = EIO;
  std::string reason;
  EXPECT_EQ(upload_part("lost", 0, 4, &reason).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(reason, "STORE_UNAVAILABLE");
  disk->sync_error = 0;
  const int syncs = disk->syncs;
  expect_read_only(request, job.id());
  EXPECT_EQ(disk->syncs, syncs) << "was tried again";
  EXPECT_THAT(failure, HasSubstr("cannot sync"));
  crash();
  start();
  EXPECT_EQ(try_to_create(request).first, grpc::StatusCode::OK);
  EXPECT_EQ(get(job.id()).id(), job.id());
}

TEST_F(StorageFailure, AWorkerWhoseResultFindsNoRoomDeliversItWhenThereIsSome) {
  auto disk = std::make_shared<testing_support::FakeDisk>();
  reserve = {0.05, 0};
  DaemonParts parts;
  parts.disk = disk;
  disk->total = 1000;
  disk->available = 1000;
  start(std::move(parts));
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  disk->available = 54;
  std::string reason;
  EXPECT_EQ(upload_part("field", 0, 5, &reason).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(reason, "STORAGE_FULL");
  v1::HeartbeatResponse answer;
  EXPECT_TRUE(heartbeat(launch, 1, answer).ok()) << "the attempt goes on";
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_RUNNING);
  disk->available = 55;
  EXPECT_TRUE(succeed(launch).ok());
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(downloaded(digest_of("field")), "field");
  EXPECT_EQ(failures, 0);
}

TEST_F(StorageFailure, ABlobThatCannotBeReadAnyMoreIsDamagedAndAnUploadHealsIt) {
  auto disk = std::make_shared<testing_support::FakeDisk>();
  DaemonParts parts;
  parts.disk = disk;
  start(std::move(parts));
  const std::string digest = uploaded("fixed");
  disk->read_error = EIO;
  grpc::ClientContext context;
  v1::ReadBlobRequest request;
  request.set_digest(digest);
  v1::ReadBlobResponse response;
  const auto reader = blobs->ReadBlob(&context, request);
  EXPECT_FALSE(reader->Read(&response));
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_EQ(testing_support::reason_of(context), "BLOB_CORRUPT");
  disk->read_error = 0;
  EXPECT_TRUE(fs::exists(folder / "data/corrupt" / digest.substr(7)));
  uploaded("fixed");
  EXPECT_EQ(downloaded(digest), "fixed");
  EXPECT_EQ(failures, 0);
}

/// A file system of its own, which can be made read-only as the kernel does with one that is damaged.
class ReadOnlyFolder : public StorageFailure {
 protected:
  ~ReadOnlyFolder() override {
    crash();
    for (auto path = mounted.rbegin(); path != mounted.rend(); ++path) ::umount2(path->c_str(), MNT_DETACH);
  }
  bool mount(const fs::path& from, const fs::path& to, const char* type, unsigned long flags) {
    if (::mount(from.c_str(), to.c_str(), type, flags, nullptr) != 0) return false;
    mounted.push_back(to);
    return true;
  }
  std::vector<fs::path> mounted;
};

TEST_F(ReadOnlyFolder, AFolderThatCannotBeWrittenIsRefusedAtTheStart) {
  start();
  const auto job = created();
  crash();
  const fs::path data = folder / "data";
  if (!mount(data, data, nullptr, MS_BIND))
    GTEST_SKIP() << "a file system cannot be mounted here: " << std::strerror(errno);
  ASSERT_EQ(::mount(nullptr, data.c_str(), nullptr, MS_REMOUNT | MS_BIND | MS_RDONLY, nullptr), 0);
  EXPECT_THAT(refused_start(), AllOf(HasSubstr(fs::canonical(data).string()), HasSubstr("cannot be written")));
  ASSERT_EQ(::mount(nullptr, data.c_str(), nullptr, MS_REMOUNT | MS_BIND, nullptr), 0);
  start();
  EXPECT_EQ(get(job.id()).id(), job.id());
}

TEST_F(ReadOnlyFolder, AFolderThatBecomesReadOnlyIsOnlyRead) {
  start();
  const auto request = valid_request();
  const auto job = created();
  const fs::path uploads = folder / "data/uploads";
  if (!mount(uploads, uploads, nullptr, MS_BIND))
    GTEST_SKIP() << "a file system cannot be mounted here: " << std::strerror(errno);
  ASSERT_EQ(::mount(nullptr, uploads.c_str(), nullptr, MS_REMOUNT | MS_BIND | MS_RDONLY, nullptr), 0);
  std::string reason;
  EXPECT_EQ(upload_part("lost", 0, 4, &reason).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(reason, "STORE_UNAVAILABLE");
  EXPECT_THAT(failure, HasSubstr("Read-only file system"));
  expect_read_only(request, job.id());
}

/// Lets every write of the connection that writes fail: its log is opened first of all.
void break_database_log() {
  int first = -1;
  for (const auto& entry : fs::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    const std::string target = fs::read_symlink(entry.path(), gone).string();
    const int number = std::stoi(entry.path().filename());
    if (target.ends_with("saltusd.db-wal") && (first < 0 || number < first)) first = number;
  }
  ASSERT_GE(first, 0);
  const int unwritable = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  ASSERT_EQ(::dup2(unwritable, first), first);
  ::close(unwritable);
}

TEST_F(StorageFailure, AfterAFailureOfTheDatabaseTheDaemonOnlyReads) {
  start();
  const auto request = valid_request();
  const auto job = created();
  launcher->wait_for_start(1);
  break_database_log();
  EXPECT_EQ(try_to_create(request).first, grpc::StatusCode::UNAVAILABLE);
  expect_read_only(request, job.id());
  crash();
  start();
  EXPECT_EQ(try_to_create(request).first, grpc::StatusCode::OK);
  EXPECT_EQ(get(job.id()).id(), job.id());
}

TEST_F(StorageFailure, ADiskThatIsFullRefusesAndWorksAgainWhenThereIsRoom) {
  const fs::path small = folder / "small";
  fs::create_directory(small);
  if (::mount("none", small.c_str(), "tmpfs", 0, "size=3m") != 0)
    GTEST_SKIP() << "a file system cannot be mounted here: " << std::strerror(errno);
  struct Unmount {
    fs::path path;
    ~Unmount() { ::umount2(path.c_str(), MNT_DETACH); }
  } unmount{small};
  // No reserve and no promise: the disk itself has to refuse.
  reserve = {0, std::numeric_limits<std::int64_t>::min() / 2};
  tune = [&](DaemonSettings& settings) { settings.data = small / "data"; };
  start();
  const auto request = valid_request();
  const auto job = created();
  launcher->wait_for_start(1);
  std::string reason;
  const std::string large(4 << 20, 'x');
  EXPECT_EQ(upload_part(large, 0, large.size(), &reason).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(reason, "STORAGE_FULL");
  {
    std::ofstream filler(small / "filler", std::ios::binary);
    const std::string page(4096, 'x');
    while (filler.write(page.data(), static_cast<std::streamsize>(page.size())).flush()) {
    }
  }
  // The log of the database has room for some rows of its own at first.
  auto answer = try_to_create(request);
  for (int i = 0; i < 1000 && answer.first == grpc::StatusCode::OK; ++i) answer = try_to_create(request);
  EXPECT_EQ(answer.first, grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(answer.second, "STORAGE_FULL");
  EXPECT_EQ(get(job.id()).id(), job.id());
  fs::remove(small / "filler");
  EXPECT_EQ(try_to_create(request).first, grpc::StatusCode::OK);
  EXPECT_EQ(failures, 0);
  crash();
}

TEST_F(StorageFailure, ADamagedDatabaseIsRefusedWithAWayOut) {
  start();
  for (int i = 0; i < 30; ++i) created();
  crash();
  const fs::path file = folder / "data/saltusd.db";
  const fs::path copy = folder / "copy";
  fs::copy_file(file, copy);
  const auto refused = AllOf(HasSubstr(fs::canonical(file).string()), HasSubstr("backup"));
  for (const std::uintmax_t size : {fs::file_size(copy) / 2, fs::file_size(copy) - 4096, std::uintmax_t{4096},
                                    std::uintmax_t{1000}, std::uintmax_t{0}}) {
    fs::copy_file(copy, file, fs::copy_options::overwrite_existing);
    fs::resize_file(file, size);
    EXPECT_THAT(refused_start(), refused) << size;
  }
  std::ofstream(file) << "this is no database, but it is long enough to be looked at as if it were one, or is it?";
  EXPECT_THAT(refused_start(), refused);
  // Without the check, blobs that no row knows would be taken for leftovers.
  fs::remove(file);
  EXPECT_THAT(refused_start(), refused);
  EXPECT_TRUE(
      fs::exists(folder / "data/blobs/sha256" / digest_of("fixed").substr(7, 2) / digest_of("fixed").substr(9)));
  fs::copy_file(copy, file, fs::copy_options::overwrite_existing);
  EXPECT_EQ(refused_start(), "");
}

TEST_F(StorageFailure, AQueuedJobWhoseInputIsLostFails) {
  start();
  const auto first = created();
  launcher->wait_for_start(1);
  const auto queued = created();
  crash();
  fs::remove(folder / "data/blobs/sha256" / digest_of("fixed").substr(7, 2) / digest_of("fixed").substr(9));
  start();
  EXPECT_EQ(get(queued.id()).state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(get(queued.id()).failure().reason(), "DATA_LOSS");
}

TEST_F(StorageFailure, TheFolderIsCheckedWithoutADaemon) {
  start();
  created();
  EXPECT_THROW(check_data_folder(folder / "data", std::cout), std::runtime_error) << "it is in use";
  crash();
  std::ostringstream sound;
  EXPECT_TRUE(check_data_folder(folder / "data", sound));
  EXPECT_THAT(sound.str(), HasSubstr("2 blobs, 11 bytes checked: 0 damaged"));
  std::ofstream(folder / "data/blobs/sha256" / digest_of("fixed").substr(7, 2) / digest_of("fixed").substr(9))
      << "fixes";
  std::ostringstream damaged;
  EXPECT_FALSE(check_data_folder(folder / "data", damaged));
  EXPECT_THAT(damaged.str(), HasSubstr(digest_of("fixed") + ": damaged"));
  EXPECT_THROW(check_data_folder(folder / "nothing", std::cout), std::runtime_error);
}

// Whoever looks at the log at night is to see that the disk is full, and that it came back by itself.
TEST_F(StorageFailure, TheLogSaysWhenTheReserveIsTouchedAndWhenThereIsRoomAgain) {
  auto disk = std::make_shared<testing_support::FakeDisk>();
  reserve = {0, 1000};
  disk->total = 100000;
  disk->available = 1000;
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<std::string> said;
  tune = [&](DaemonSettings& settings) {
    settings.log = [&](const LogLine& line) {
      const std::lock_guard lock(mutex);
      if (line.message.find("new jobs") != std::string::npos) said.push_back(line.message);
      changed.notify_all();
    };
  };
  const auto wait_for_lines = [&](std::size_t count) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return said.size() >= count; });
  };
  DaemonParts parts;
  parts.disk = disk;
  start(std::move(parts));
  disk->available = 999;
  wait_for_lines(1);
  disk->available = 1000;
  wait_for_lines(2);
  disk->available = 0;
  wait_for_lines(3);
  crash();
  EXPECT_THAT(said[0], HasSubstr("refused for as long as the daemon's disk is full but for its reserve"));
  EXPECT_THAT(said[1], HasSubstr("there is room on the disk again"));
  EXPECT_EQ(said[2], said[0]);
}

// The last bytes are the database's: it has to end the jobs that it has.
TEST_F(StorageFailure, BelowTheReserveNoJobIsAccepted) {
  auto disk = std::make_shared<testing_support::FakeDisk>();
  DaemonParts parts;
  parts.disk = disk;
  reserve = {0, 1000};
  start(std::move(parts));
  auto request = valid_request();
  request.set_request_id("known");
  v1::RegistrationJob known;
  ASSERT_TRUE(create(request, known).ok());
  disk->total = 100000;
  disk->available = 999;
  {
    grpc::ClientContext context;
    v1::RegistrationJob job;
    auto other = request;
    other.set_request_id("new");
    const auto status = jobs->CreateRegistrationJob(&context, other, &job);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(testing_support::reason_of(context), "STORAGE_FULL");
    EXPECT_EQ(testing_support::trailer_of(context, "saltus-retry-after-ms"), "60000");
    EXPECT_THAT(status.error_details(), AllOf(HasSubstr("RetryInfo"), HasSubstr("QuotaFailure"), HasSubstr("disk")));
  }
  {
    grpc::ClientContext context;
    v1::BatchCreateRegistrationJobsRequest batch;
    *batch.add_requests() = request;
    batch.mutable_requests(0)->set_request_id("in a batch");
    v1::BatchCreateRegistrationJobsResponse response;
    EXPECT_EQ(jobs->BatchCreateRegistrationJobs(&context, batch, &response).error_code(),
              grpc::StatusCode::RESOURCE_EXHAUSTED);
  }
  v1::RegistrationJob again;
  EXPECT_TRUE(create(request, again).ok()) << "what was accepted before is told";
  EXPECT_EQ(again.id(), known.id());
  EXPECT_EQ(cancel(known.id()).id(), known.id()) << "what is there can still end";
  disk->available = 1000;
  request.set_request_id("new");
  EXPECT_TRUE(create(request, again).ok());
  EXPECT_EQ(failures, 0);
}

}  // namespace
}  // namespace saltus::server
