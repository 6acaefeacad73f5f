#include "server/jobs/garbage_collector.h"

#include "server/jobs/blob_catalog.h"
#include "server/jobs/fsck.h"
#include "server/jobs/missing_inputs.h"
#include "server/store/blob_directory.h"
#include "server/store/data_directory.h"
#include "server/store/sha256.h"
#include "server/store/sqlite_job_store.h"
#include "tests/support/server_fakes.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <future>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

std::string digest_of(const std::string& content) {
  Sha256 hash;
  hash.add(content);
  return "sha256:" + hash.hex();
}

class GarbageCollectorTest : public ::testing::Test {
 protected:
  void write(const JobStore::Operation& operation) {
    std::promise<void> done;
    store.write(operation, [&](std::exception_ptr error) { error ? done.set_exception(error) : done.set_value(); });
    done.get_future().get();
  }
  std::string put(const std::string& content) {
    const auto upload = blobs.begin({digest_of(content), static_cast<std::int64_t>(content.size()), "", 0});
    upload->append(content);
    upload->seal();
    write([&](JobTable& table) {
      blobs.publish(*upload);
      table.insert_blob(upload->digest(), upload->size(), clock.wall());
    });
    return digest_of(content);
  }
  void insert(const std::string& id, const std::string& input, JobState state, const std::string& artifact = "") {
    write([&](JobTable& table) {
      JobRecord job;
      job.id = id;
      job.inputs = {input};
      job.created = clock.wall();
      table.insert(job);
      job.state = state;
      if (is_terminal(state)) job.ended = clock.wall();
      if (!artifact.empty()) job.artifacts = {{"field", artifact, 1}};
      table.update(job);
    });
  }
  bool has(const std::string& digest) {
    bool has = false;
    store.read([&](JobReader& reader) { has = reader.blob_size(digest).has_value(); });
    EXPECT_EQ(fs::exists(file_of(digest)), has) << "row and file differ";
    return has;
  }
  std::optional<JobRecord> find(const std::string& id) {
    std::optional<JobRecord> job;
    store.read([&](JobReader& reader) { job = reader.find(id); });
    return job;
  }
  fs::path file_of(const std::string& digest) const { return data.blobs() / digest.substr(7, 2) / digest.substr(9); }
  GarbageReport collect() { return GarbageCollector(store, blobs, clock, Retention{}).collect(); }
  FsckReport check(std::vector<FsckFinding>* findings = nullptr) {
    Fsck fsck([this](const auto& operation) { store.read(operation); }, blobs, clock);
    while (fsck.step(1000)) {
    }
    if (findings) *findings = fsck.take_findings();
    return fsck.report();
  }

  testing_support::TemporaryFolder folder;
  DataDirectory data{folder / "data"};
  StorageState state;
  testing_support::FakeClock clock;
  BlobDirectory blobs{{data.blobs(), data.uploads(), data.corrupt()}, state, clock, {0, 0}};
  SqliteJobStore store{data.database(), [](const std::string& reason) { ADD_FAILURE() << reason; }};
};

TEST_F(GarbageCollectorTest, InputsGoAWeekAfterNobodyNeedsThem) {
  const std::string unused = put("unused"), used = put("used");
  insert("job", used, JobState::Queued);
  EXPECT_EQ(collect().blobs, 0);
  clock.advance(7 * 24h);
  EXPECT_EQ(collect().blobs, 0);
  clock.advance(1ms);
  const GarbageReport report = collect();
  EXPECT_EQ(report.blobs, 1);
  EXPECT_EQ(report.blob_bytes, 6);
  EXPECT_FALSE(has(unused));
  EXPECT_TRUE(has(used));
}

TEST_F(GarbageCollectorTest, ANewUploadOrQuestionBeginsTheWeekAnew) {
  const std::string digest = put("again"), asked = put("asked");
  collect();
  clock.advance(6 * 24h);
  put("again");
  write([&](JobTable& table) { table.unmark_unreferenced(asked); });
  collect();
  clock.advance(6 * 24h);
  EXPECT_EQ(collect().blobs, 0);
  EXPECT_TRUE(has(digest));
  EXPECT_TRUE(has(asked));
  clock.advance(1 * 24h + 1ms);
  EXPECT_EQ(collect().blobs, 2);
}

// "It is here" is a promise: it holds for another week, whichever call has said so, and as soon as it is said.
TEST_F(GarbageCollectorTest, WhoeverIsToldThatABlobIsHereHasAWeekToUseIt) {
  BlobCatalog catalog(store, blobs, clock);
  const std::string asked = put("asked"), sent = put("sent"), left = put("left");
  collect();
  clock.advance(7 * 24h + 1ms);
  EXPECT_TRUE(catalog.missing({asked}).empty());
  EXPECT_TRUE(catalog.has(sent, 4));
  EXPECT_FALSE(catalog.has(left, 5)) << "another size";
  EXPECT_EQ(collect().blobs, 1);
  EXPECT_TRUE(has(asked));
  EXPECT_TRUE(has(sent));
  EXPECT_FALSE(has(left));
  EXPECT_EQ(catalog.missing({left}), std::vector<std::string>{left});
}

TEST_F(GarbageCollectorTest, ResultsGoAMonthAfterTheEndAndTheirInputsAWeekLater) {
  const std::string input = put("input"), field = put("field");
  insert("done", input, JobState::Succeeded, field);
  insert("running", put("other"), JobState::Running);
  clock.advance(30 * 24h);
  EXPECT_EQ(collect().jobs, 0);
  clock.advance(1ms);
  const GarbageReport report = collect();
  EXPECT_EQ(report.jobs, 1);
  EXPECT_EQ(report.blobs, 1);
  EXPECT_FALSE(find("done"));
  EXPECT_FALSE(has(field));
  EXPECT_TRUE(has(input));
  EXPECT_TRUE(find("running"));
  clock.advance(7 * 24h + 1ms);
  EXPECT_EQ(collect().blobs, 1);
  EXPECT_FALSE(has(input));
}

TEST_F(GarbageCollectorTest, AResultThatAnotherJobSharesStays) {
  const std::string input = put("input"), field = put("field");
  insert("old", input, JobState::Succeeded, field);
  clock.advance(20 * 24h);
  insert("young", input, JobState::Succeeded, field);
  clock.advance(10 * 24h + 1ms);
  const GarbageReport report = collect();
  EXPECT_EQ(report.jobs, 1);
  EXPECT_EQ(report.blobs, 0);
  EXPECT_TRUE(has(field));
}

TEST_F(GarbageCollectorTest, FilesWithoutARowGoWhenTheyAreNotYoung) {
  put("known");
  const fs::path orphan = file_of(digest_of("orphan"));
  fs::create_directories(orphan.parent_path());
  std::ofstream(orphan) << "orphan";
  // The files' times are the machine's; the clock here is set beside them.
  const auto now = std::chrono::duration_cast<std::chrono::milliseconds>(
      std::chrono::system_clock::now().time_since_epoch() - clock.wall().time_since_epoch());
  clock.advance(now);
  EXPECT_EQ(collect().orphans, 0);
  clock.advance(2h);
  EXPECT_EQ(check().orphans, 1);
  EXPECT_EQ(collect().orphans, 1);
  EXPECT_FALSE(fs::exists(orphan));
  EXPECT_TRUE(has(digest_of("known")));
}

TEST_F(GarbageCollectorTest, ManyBlobsGoInBatches) {
  for (int i = 0; i < 130; ++i) put("blob " + std::to_string(i));
  collect();
  clock.advance(7 * 24h + 1ms);
  EXPECT_EQ(collect().blobs, 130);
  std::vector<BlobRow> left;
  store.read([&](JobReader& reader) { left = reader.blobs_after("", 10); });
  EXPECT_TRUE(left.empty());
}

TEST_F(GarbageCollectorTest, FsckFindsNothingInASoundStore) {
  put("");
  put(std::string(100000, 'x'));
  const FsckReport report = check();
  EXPECT_TRUE(report.is_healthy());
  EXPECT_EQ(report.blobs, 2);
  EXPECT_EQ(report.bytes, 100000);
}

TEST_F(GarbageCollectorTest, FsckFindsEveryKindOfDamage) {
  const std::string damaged = put(std::string(5000, 'x'));
  const std::string empty = put("");
  const std::string shortened = put("shortened"), lost = put("lost"), sound = put("sound");
  {
    std::fstream file(file_of(damaged), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(4999);
    file.put('!');
  }
  fs::resize_file(file_of(shortened), 3);
  fs::remove(file_of(lost));
  std::vector<FsckFinding> findings;
  const FsckReport report = check(&findings);
  EXPECT_EQ(report.blobs, 5);
  EXPECT_EQ(report.corrupt, 1);
  EXPECT_EQ(report.missing, 2);
  EXPECT_EQ(report.set_aside, 1);
  EXPECT_FALSE(report.is_healthy());
  std::map<std::string, FsckFinding::Kind> kinds;
  for (const FsckFinding& finding : findings) kinds[finding.digest] = finding.kind;
  const std::map<std::string, FsckFinding::Kind> expected = {{damaged, FsckFinding::Kind::Corrupt},
                                                             {shortened, FsckFinding::Kind::Missing},
                                                             {lost, FsckFinding::Kind::Missing}};
  EXPECT_EQ(kinds, expected);
  // An upload of the same bytes heals each of them.
  put(std::string(5000, 'x'));
  put("shortened");
  put("lost");
  EXPECT_TRUE(check().is_healthy());
}

TEST_F(GarbageCollectorTest, QueuedJobsWhoseInputIsLostFailAndOthersDoNot) {
  const std::string lost = put("lost"), sound = put("sound");
  insert("a", lost, JobState::Queued);
  insert("b", sound, JobState::Queued);
  insert("c", lost, JobState::Succeeded);
  EXPECT_EQ(fail_jobs_without_inputs(store, blobs, clock), 0);
  fs::remove(file_of(lost));
  EXPECT_EQ(fail_jobs_without_inputs(store, blobs, clock), 1);
  ASSERT_EQ(find("a")->state, JobState::Failed);
  EXPECT_EQ(find("a")->failure->reason, "DATA_LOSS");
  EXPECT_TRUE(find("a")->ended.has_value());
  EXPECT_EQ(find("b")->state, JobState::Queued);
  EXPECT_EQ(find("c")->state, JobState::Succeeded);
}

}  // namespace
}  // namespace saltus::server
