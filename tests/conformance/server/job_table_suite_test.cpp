// What every table of jobs must do, whether it keeps them in memory or in SQLite.
#include "server/store/sqlite_job_store.h"
#include "tests/support/server_fakes.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <future>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

struct MemoryFactory {
  testing_support::MemoryStore store;
  JobStore& get() { return store; }
};

struct SqliteFactory {
  testing_support::TemporaryFolder folder;
  SqliteJobStore store{folder / "db", [](const std::string& reason) { ADD_FAILURE() << reason; }};
  JobStore& get() { return store; }
};

template <class Factory>
class JobTableSuite : public ::testing::Test {
 protected:
  void write(const JobStore::Operation& operation) {
    std::promise<void> done;
    factory.get().write(operation,
                        [&](std::exception_ptr error) { error ? done.set_exception(error) : done.set_value(); });
    done.get_future().get();
  }
  JobRecord insert(const std::string& id, JobState state = JobState::Queued) {
    JobRecord job;
    job.id = id;
    job.state = state;
    write([&](JobTable& table) { table.insert(job); });
    return job;
  }
  template <class Read>
  auto read(Read ask) {
    decltype(ask(std::declval<JobReader&>())) answer;
    factory.get().read([&](JobReader& reader) { answer = ask(reader); });
    return answer;
  }

  Factory factory;
};

using Factories = ::testing::Types<MemoryFactory, SqliteFactory>;
TYPED_TEST_SUITE(JobTableSuite, Factories);

TYPED_TEST(JobTableSuite, GivesBackEveryField) {
  JobRecord job;
  job.id = "a";
  job.submitter = "ann";
  job.request_id = "request";
  job.request_hash = "hash";
  job.spec = std::string("with \0 inside \xff", 15);
  job.inputs = {"sha256:1", "sha256:2"};
  job.labels = {{"case", "7"}, {"side", "left"}};
  job.threads = 3;
  job.priority = kHighestPriority;
  job.memory_bytes = std::int64_t{3} << 32;
  job.limits = {.wall_seconds = 60, .cpu_seconds = 50, .memory_bytes = std::int64_t{5} << 32};
  job.created = WallTime(std::chrono::milliseconds(1234567890123));
  this->write([&](JobTable& table) {
    for (const char* digest : {"sha256:1", "sha256:2", "sha256:3"}) table.insert_blob(digest, 5, job.created);
    table.insert(job);
  });
  job.state = JobState::Failed;
  job.attempt = 2;
  job.lost_attempts = 1;
  job.crashes = 1;
  job.not_before = WallTime(std::chrono::milliseconds(4));
  job.last_loss = JobFailure{"STALLED", "it stood still"};
  job.checkpoint = Checkpoint{.digest = "sha256:3", .size = 5, .attempt = 1, .level = 2, .iteration = 17};
  job.token_hash = "#token";
  job.process = "42 1 boot";
  job.batch_id = "17";
  job.batch_host = "node3";
  job.losses = {{1, "NODE_FAILED", "16", "node2", WallTime(std::chrono::milliseconds(3))},
                {2, "PREEMPTED", "", "", WallTime(std::chrono::milliseconds(4))}};
  job.begun = WallTime(std::chrono::milliseconds(7));
  job.started = WallTime(std::chrono::milliseconds(5));
  job.ended = WallTime(std::chrono::milliseconds(6));
  job.failure = JobFailure{"DIVERGED", "it diverged"};
  job.artifacts = {{"z", "sha256:3", 5}, {"a", "sha256:3", 5}};
  this->write([&](JobTable& table) { table.update(job); });

  const auto found = *this->read([](JobReader& reader) { return reader.find("a"); });
  EXPECT_EQ(found.sequence, job.sequence);
  EXPECT_EQ(found.revision, 2);
  EXPECT_EQ(found.submitter, job.submitter);
  EXPECT_EQ(found.request_id, job.request_id);
  EXPECT_EQ(found.request_hash, job.request_hash);
  EXPECT_EQ(found.spec, job.spec);
  EXPECT_EQ(found.inputs, job.inputs);
  EXPECT_EQ(found.labels, job.labels);
  EXPECT_EQ(found.threads, 3);
  EXPECT_EQ(found.priority, kHighestPriority);
  EXPECT_EQ(found.memory_bytes, job.memory_bytes);
  EXPECT_EQ(found.limits, job.limits);
  EXPECT_EQ(found.state, JobState::Failed);
  EXPECT_EQ(found.attempt, 2);
  EXPECT_EQ(found.lost_attempts, 1);
  EXPECT_EQ(found.crashes, 1);
  EXPECT_EQ(found.not_before, job.not_before);
  EXPECT_EQ(found.last_loss, job.last_loss);
  EXPECT_EQ(found.checkpoint, job.checkpoint);
  EXPECT_EQ(found.token_hash, job.token_hash);
  EXPECT_EQ(found.process, job.process);
  EXPECT_EQ(found.batch_id, job.batch_id);
  EXPECT_EQ(found.batch_host, job.batch_host);
  EXPECT_EQ(found.losses, job.losses);
  EXPECT_EQ(found.begun, job.begun);
  EXPECT_EQ(found.created, job.created);
  EXPECT_EQ(found.started, job.started);
  EXPECT_EQ(found.ended, job.ended);
  EXPECT_EQ(found.failure, job.failure);
  EXPECT_EQ(found.artifacts, job.artifacts);

  job.losses.erase(job.losses.begin());
  job.losses.push_back({3, "STALLED", "18", "node1", WallTime(std::chrono::milliseconds(9))});
  this->write([&](JobTable& table) { table.update(job); });
  EXPECT_EQ(this->read([](JobReader& reader) { return reader.find("a"); })->losses, job.losses);
}

TYPED_TEST(JobTableSuite, ListsNewestFirstByStateAndFromAnyPlace) {
  this->insert("a");
  const auto b = this->insert("b", JobState::Running);
  this->insert("c");
  this->insert("d");
  const auto ids = [&](std::optional<JobState> state, std::int64_t before, int limit) {
    std::vector<std::string> found;
    for (const auto& job : this->read([&](JobReader& reader) { return reader.list({.state = state}, before, limit); }))
      found.push_back(job.id);
    return found;
  };
  EXPECT_THAT(ids(std::nullopt, 1000, 10), ElementsAre("d", "c", "b", "a"));
  EXPECT_THAT(ids(std::nullopt, 1000, 2), ElementsAre("d", "c"));
  EXPECT_THAT(ids(std::nullopt, b.sequence, 10), ElementsAre("a"));
  EXPECT_THAT(ids(JobState::Queued, 1000, 10), ElementsAre("d", "c", "a"));
  EXPECT_THAT(ids(JobState::Failed, 1000, 10), IsEmpty());
}

TYPED_TEST(JobTableSuite, KnowsTheQueue) {
  const auto a = this->insert("a", JobState::Succeeded);
  const auto b = this->insert("b");
  const auto c = this->insert("c");
  EXPECT_EQ(this->read([](JobReader& reader) { return reader.count(JobState::Queued); }), 2);
  const auto queued = this->read([](JobReader& reader) { return reader.queued(); });
  ASSERT_EQ(queued.size(), 2u);
  EXPECT_EQ(queued[0].sequence, b.sequence);
  EXPECT_EQ(queued[1].sequence, c.sequence);
}

TYPED_TEST(JobTableSuite, TheQueueTellsWhatChoosingTakes) {
  JobRecord job;
  job.id = "a";
  job.submitter = "ann";
  job.priority = kHighestPriority;
  job.threads = 3;
  job.memory_bytes = 5;
  job.created = WallTime(std::chrono::milliseconds(7));
  this->write([&](JobTable& table) {
    table.insert(job);
    job.attempt = 2;
    job.not_before = WallTime(std::chrono::milliseconds(9));
    table.update(job);
  });
  const auto queued = this->read([](JobReader& reader) { return reader.queued(); }).at(0);
  EXPECT_EQ(queued.id, "a");
  EXPECT_EQ(queued.submitter, "ann");
  EXPECT_EQ(queued.priority, kHighestPriority);
  EXPECT_EQ(queued.threads, 3);
  EXPECT_EQ(queued.memory_bytes, 5);
  EXPECT_EQ(queued.created, job.created);
  EXPECT_EQ(queued.not_before, job.not_before);
  EXPECT_EQ(queued.attempt, 2);
  EXPECT_EQ(this->read([](JobReader& reader) { return reader.count_queued_of("ann"); }), 1);
  EXPECT_EQ(this->read([](JobReader& reader) { return reader.count_queued_of("bob"); }), 0);
}

TYPED_TEST(JobTableSuite, AListFulfilsEveryCondition) {
  const auto add = [&](const std::string& id, const std::string& submitter, std::map<std::string, std::string> labels,
                       JobState state = JobState::Queued) {
    JobRecord job;
    job.id = id;
    job.submitter = submitter;
    job.labels = std::move(labels);
    job.state = state;
    this->write([&](JobTable& table) { table.insert(job); });
  };
  add("a", "ann", {{"case", "7"}, {"side", "left"}});
  add("b", "bob", {{"case", "7"}, {"side", "right"}});
  add("c", "ann", {{"case", "8"}, {"side", "left"}});
  add("d", "ann", {{"case", "7"}, {"side", "left"}}, JobState::Failed);
  const auto ids = [&](const JobFilter& filter, std::int64_t before = 1000, int limit = 10) {
    std::vector<std::string> found;
    for (const auto& job : this->read([&](JobReader& reader) { return reader.list(filter, before, limit); }))
      found.push_back(job.id);
    return found;
  };
  EXPECT_THAT(ids({.labels = {{"case", "7"}}}), ElementsAre("d", "b", "a"));
  EXPECT_THAT(ids({.labels = {{"case", "7"}, {"side", "left"}}}), ElementsAre("d", "a"));
  EXPECT_THAT(ids({.labels = {{"case", "7"}, {"side", "left"}}}, 4), ElementsAre("a"));
  EXPECT_THAT(ids({.labels = {{"case", "7"}}}, 1000, 2), ElementsAre("d", "b"));
  EXPECT_THAT(ids({.submitter = "ann"}), ElementsAre("d", "c", "a"));
  EXPECT_THAT(ids({.state = JobState::Queued, .labels = {{"side", "left"}}, .submitter = "ann"}),
              ElementsAre("c", "a"));
  EXPECT_THAT(ids({.labels = {{"case", "9"}}}), IsEmpty());
  EXPECT_THAT(ids({.labels = {{"none", ""}}}), IsEmpty());
}

TYPED_TEST(JobTableSuite, JobsWithoutRequestIdDoNotCollide) {
  this->insert("a");
  this->insert("b");
  this->write([&](JobTable& table) { EXPECT_FALSE(table.find_request("local", "").has_value()); });
}

TYPED_TEST(JobTableSuite, ARequestIdBelongsToItsSubmitter) {
  for (const char* submitter : {"ann", "bob"}) {
    JobRecord job;
    job.id = std::string("job of ") + submitter;
    job.submitter = submitter;
    job.request_id = "request";
    this->write([&](JobTable& table) { table.insert(job); });
  }
  this->write([&](JobTable& table) {
    EXPECT_EQ(table.find_request("ann", "request")->id, "job of ann");
    EXPECT_EQ(table.find_request("bob", "request")->id, "job of bob");
    EXPECT_FALSE(table.find_request("eve", "request").has_value());
  });
}

TYPED_TEST(JobTableSuite, ACheckpointIsReplacedAndTakenBack) {
  JobRecord job = this->insert("a");
  this->write([&](JobTable& table) {
    for (const char* digest : {"sha256:1", "sha256:2"}) table.insert_blob(digest, 5, {});
    job.checkpoint = Checkpoint{.digest = "sha256:1", .size = 5, .attempt = 1, .level = 0, .iteration = 9};
    table.update(job);
    EXPECT_FALSE(table.erase_blob_if_unreferenced("sha256:1"));
    job.checkpoint = Checkpoint{.digest = "sha256:2", .size = 5, .attempt = 1, .level = 1, .iteration = 3};
    table.update(job);
    EXPECT_TRUE(table.erase_blob_if_unreferenced("sha256:1"));
    EXPECT_EQ(table.find("a")->checkpoint, job.checkpoint);
    job.checkpoint.reset();
    table.update(job);
    EXPECT_FALSE(table.find("a")->checkpoint.has_value());
    EXPECT_TRUE(table.erase_blob_if_unreferenced("sha256:2"));
  });
}

TYPED_TEST(JobTableSuite, ABlobCountsForWhoeverWasTheFirstToUploadIt) {
  this->write([](JobTable& table) {
    table.insert_blob("sha256:1", 5, {}, "ann");
    table.insert_blob("sha256:2", 7, {}, "ann");
    table.insert_blob("sha256:3", 11, {}, "bob");
    table.insert_blob("sha256:4", 13, {});
    table.insert_blob("sha256:1", 5, {}, "bob");
  });
  const auto totals = this->read([](JobReader& reader) { return reader.blob_totals(); });
  EXPECT_EQ(totals.count, 4);
  EXPECT_EQ(totals.bytes, 36);
  const auto bytes_of = [this](const std::string& owner) {
    return this->read([&](JobReader& reader) { return reader.blob_bytes_of(owner); });
  };
  EXPECT_EQ(bytes_of("ann"), 12);
  EXPECT_EQ(bytes_of("bob"), 11);
  EXPECT_EQ(bytes_of("eve"), 0);
  EXPECT_EQ(bytes_of(""), 0) << "nobody's bytes are counted for nobody";
  this->write([](JobTable& table) { EXPECT_TRUE(table.erase_blob_if_unreferenced("sha256:2")); });
  EXPECT_EQ(bytes_of("ann"), 5);
}

TYPED_TEST(JobTableSuite, AThrownExceptionUndoesTheOperation) {
  EXPECT_THROW(this->write([&](JobTable& table) {
    JobRecord job;
    job.id = "a";
    table.insert(job);
    throw std::invalid_argument("no");
  }),
               std::invalid_argument);
  EXPECT_FALSE(this->read([](JobReader& reader) { return reader.find("a"); }).has_value());
}

TYPED_TEST(JobTableSuite, KeepsABlobAsLongAsAJobRefersToIt) {
  JobRecord job;
  job.id = "a";
  job.inputs = {"sha256:in"};
  this->write([&](JobTable& table) {
    table.insert_blob("sha256:in", 1, {});
    table.insert_blob("sha256:out", 2, {});
    table.insert(job);
    job.artifacts = {{"out", "sha256:out", 2}};
    table.update(job);
    EXPECT_FALSE(table.erase_blob_if_unreferenced("sha256:in"));
    EXPECT_FALSE(table.erase_blob_if_unreferenced("sha256:out"));
    table.erase("a");
    EXPECT_TRUE(table.erase_blob_if_unreferenced("sha256:out"));
    EXPECT_FALSE(table.erase_blob_if_unreferenced("sha256:out"));
    EXPECT_EQ(table.blob_size("sha256:in"), 1);
    EXPECT_EQ(table.blob_size("sha256:out"), std::nullopt);
  });
}

WallTime at(int milliseconds) { return WallTime(std::chrono::milliseconds(milliseconds)); }

std::vector<std::string> digests_of(const std::vector<BlobRow>& rows) {
  std::vector<std::string> digests;
  for (const BlobRow& row : rows) digests.push_back(row.digest);
  return digests;
}

// What a check of the whole store goes by.
TYPED_TEST(JobTableSuite, BlobsAreGoneThroughInPieces) {
  this->write([](JobTable& table) {
    for (const char* digest : {"sha256:c", "sha256:a", "sha256:d", "sha256:b"}) table.insert_blob(digest, 7, {});
  });
  const auto after = [&](const std::string& digest, int limit) {
    return this->read([&](JobReader& reader) { return reader.blobs_after(digest, limit); });
  };
  EXPECT_THAT(digests_of(after("", 2)), ElementsAre("sha256:a", "sha256:b"));
  EXPECT_THAT(digests_of(after("sha256:b", 2)), ElementsAre("sha256:c", "sha256:d"));
  EXPECT_THAT(after("sha256:d", 2), IsEmpty());
  EXPECT_EQ(after("sha256:c", 2).at(0), (BlobRow{"sha256:d", 7}));
  // The place need not be that of a blob: what was there may be gone.
  EXPECT_THAT(digests_of(after("sha256:bb", 10)), ElementsAre("sha256:c", "sha256:d"));
}

TYPED_TEST(JobTableSuite, ABlobIsMarkedSinceTheFirstLookThatFoundItUnused) {
  JobRecord job;
  job.id = "a";
  job.inputs = {"sha256:in"};
  this->write([&](JobTable& table) {
    for (const char* digest : {"sha256:in", "sha256:out", "sha256:stand", "sha256:other"})
      table.insert_blob(digest, 3, at(1));
    table.insert(job);
    job.artifacts = {{"out", "sha256:out", 3}};
    job.checkpoint = Checkpoint{.digest = "sha256:stand", .size = 3};
    table.update(job);
    EXPECT_EQ(table.mark_unreferenced(at(10)), 1);
    EXPECT_EQ(table.mark_unreferenced(at(20)), 0) << "noted before";
  });
  const auto marked_before = [&](int time, int limit = 10) {
    return this->read([&](JobReader& reader) { return reader.unreferenced_since(at(time), limit); });
  };
  EXPECT_TRUE(this->read([](JobReader& reader) { return reader.is_marked_unreferenced("sha256:other"); }));
  EXPECT_FALSE(this->read([](JobReader& reader) { return reader.is_marked_unreferenced("sha256:out"); }));
  EXPECT_THAT(marked_before(10), IsEmpty());
  EXPECT_THAT(marked_before(11), ElementsAre(BlobRow{"sha256:other", 3}));

  this->write([&](JobTable& table) {
    table.erase("a");
    EXPECT_EQ(table.mark_unreferenced(at(30)), 3);
  });
  EXPECT_EQ(marked_before(31).size(), 4u);
  EXPECT_EQ(marked_before(31, 2).size(), 2u);
  EXPECT_THAT(marked_before(30), ElementsAre(BlobRow{"sha256:other", 3}));
}

TYPED_TEST(JobTableSuite, WhoeverAsksForABlobOrNeedsItTakesTheMarkAway) {
  this->write([](JobTable& table) {
    for (const char* digest : {"sha256:asked", "sha256:needed", "sha256:sent", "sha256:left"})
      table.insert_blob(digest, 3, at(1));
    EXPECT_EQ(table.mark_unreferenced(at(10)), 4);
    table.unmark_unreferenced("sha256:asked");
    table.insert_blob("sha256:sent", 3, at(20));
    JobRecord job;
    job.id = "a";
    job.inputs = {"sha256:needed"};
    table.insert(job);
  });
  const auto marked = this->read([](JobReader& reader) { return reader.unreferenced_since(at(100), 10); });
  EXPECT_THAT(digests_of(marked), ElementsAre("sha256:left")) << "one that a job needs is never told";
  this->write([](JobTable& table) {
    EXPECT_EQ(table.mark_unreferenced(at(30)), 2) << "asked and sent, from now on";
    EXPECT_FALSE(table.is_marked_unreferenced("sha256:needed"));
    EXPECT_TRUE(table.erase_blob_if_unreferenced("sha256:left"));
    EXPECT_FALSE(table.is_marked_unreferenced("sha256:left"));
  });
}

TYPED_TEST(JobTableSuite, JobsThatEndedBeforeATimeAreTerminalOnes) {
  const auto ended = [&](const std::string& id, JobState state, std::optional<int> time) {
    JobRecord job = this->insert(id);
    job.state = state;
    if (time) job.ended = at(*time);
    this->write([&](JobTable& table) { table.update(job); });
  };
  ended("succeeded", JobState::Succeeded, 10);
  ended("failed", JobState::Failed, 20);
  ended("cancelled", JobState::Cancelled, 30);
  ended("running", JobState::Running, std::nullopt);
  this->insert("queued");
  const auto before = [&](int time, int limit) {
    auto ids = this->read([&](JobReader& reader) { return reader.ended_before(at(time), limit); });
    std::sort(ids.begin(), ids.end());
    return ids;
  };
  EXPECT_THAT(before(10, 10), IsEmpty());
  EXPECT_THAT(before(11, 10), ElementsAre("succeeded"));
  EXPECT_THAT(before(1000, 10), ElementsAre("cancelled", "failed", "succeeded"));
  EXPECT_EQ(before(1000, 2).size(), 2u);
}

TYPED_TEST(JobTableSuite, KnowsWhoStartedLastWithWhichPriority) {
  int sequence = 0;
  const auto add = [&](const std::string& submitter, int priority, std::optional<int> started) {
    JobRecord job;
    job.id = "job " + std::to_string(++sequence);
    job.submitter = submitter;
    job.priority = priority;
    this->write([&](JobTable& table) {
      table.insert(job);
      if (started) job.started = at(*started);
      table.update(job);
    });
  };
  add("ann", 1, 50);
  add("bob", 1, 20);
  add("ann", 1, 10);
  add("ann", 2, 30);
  add("eve", 0, std::nullopt);
  EXPECT_THAT(this->read([](JobReader& reader) { return reader.last_starts(); }),
              ElementsAre(LastStart{"bob", 1, at(20)}, LastStart{"ann", 2, at(30)}, LastStart{"ann", 1, at(50)}));
}

}  // namespace
}  // namespace saltus::server
