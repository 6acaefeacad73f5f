// Databases of released versions must open in this one with everything they held.
#include "server/store/schema.h"

#include "server/store/sqlite_job_table.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/server/store/released_schemas.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::kReleasedSchema1;
using testing_support::kReleasedSchema2;
using testing_support::kReleasedSchema3;
using testing_support::kReleasedSchema4;
using testing_support::kReleasedSchema5;
using testing_support::kReleasedSchema6;

constexpr const char* kReleased[] = {kReleasedSchema1, kReleasedSchema2, kReleasedSchema3,
                                     kReleasedSchema4, kReleasedSchema5, kReleasedSchema6};
static_assert(std::size(kReleased) == kSchemaVersion, "a new schema needs a fixture of its own");

class SchemaTest : public ::testing::Test {
 protected:
  std::int64_t number(const char* sql) {
    Query query = database.query(sql);
    EXPECT_TRUE(query.step());
    return query.integer();
  }
  /// All that makes up the schema, in a fixed order.
  static std::vector<std::string> definitions(Database& of) {
    Query query = of.query("SELECT type || ' ' || name || ' ' || ifnull(sql, '') FROM sqlite_schema ORDER BY 1");
    std::vector<std::string> found;
    while (query.step()) found.push_back(query.text());
    return found;
  }
  static WallTime at(int milliseconds) { return WallTime(std::chrono::milliseconds(milliseconds)); }
  /// What schemas 2 and 3 held of jobs.
  void expect_jobs_since_schema_2() {
    SqliteJobTable table(database);
    const auto retry = *table.find("retry");
    EXPECT_EQ(retry.sequence, 8);
    EXPECT_EQ(retry.revision, 5);
    EXPECT_EQ(retry.submitter, "ann");
    EXPECT_EQ(retry.request_hash, "hash-4");
    EXPECT_EQ(retry.spec, "spec");
    EXPECT_EQ(retry.threads, 3);
    EXPECT_EQ(retry.priority, kHighestPriority);
    EXPECT_EQ(retry.memory_bytes, std::int64_t{1} << 30);
    EXPECT_EQ(retry.limits, (JobLimits{60, 50, std::int64_t{2} << 30}));
    EXPECT_EQ(retry.state, JobState::Queued);
    EXPECT_EQ(retry.attempt, 2);
    EXPECT_EQ(retry.lost_attempts, 1);
    EXPECT_EQ(retry.crashes, 1);
    EXPECT_EQ(retry.not_before, at(9000));
    EXPECT_EQ(retry.last_loss, (JobFailure{"STALLED", "it stood still"}));
    EXPECT_EQ(retry.checkpoint, (Checkpoint{"sha256:stand", 30, 1, 2, 17}));
    EXPECT_EQ(retry.labels, (std::map<std::string, std::string>{{"case", "8"}}));
    EXPECT_THAT(retry.inputs, ElementsAre("sha256:in"));
    EXPECT_EQ(retry.created, at(1003));
    EXPECT_EQ(retry.started, at(2003));
    EXPECT_EQ(table.find_request("ann", "request-1")->id, "retry");
    EXPECT_EQ(table.find_request(kLocalSubmitter, "request-1")->id, "done");
    EXPECT_EQ(table.find("held")->state, JobState::Cancelling);
    EXPECT_EQ(table.find("held")->process, "43 1 boot");
    EXPECT_EQ(table.find("failed")->failure, (JobFailure{"DIVERGED", "it diverged"}));
    EXPECT_THAT(table.find("done")->artifacts, ElementsAre(Artifact{"field.nii.gz", "sha256:out", 20}));
    EXPECT_EQ(table.count_queued_of("ann"), 1);
    for (const auto& [digest, size] : {std::pair{"sha256:in", 10}, {"sha256:out", 20}, {"sha256:stand", 30}}) {
      EXPECT_EQ(table.blob_size(digest), size);
      EXPECT_FALSE(table.is_marked_unreferenced(digest));
      EXPECT_FALSE(table.erase_blob_if_unreferenced(digest)) << digest;
    }
  }

  testing_support::TemporaryFolder folder;
  Database database{folder / "db", Database::Access::ReadWrite};
};

TEST_F(SchemaTest, AReleasedDatabaseKeepsEverythingItHeld) {
  database.execute(kReleasedSchema1);
  prepare_schema(database);
  EXPECT_EQ(number("PRAGMA user_version"), kSchemaVersion);
  EXPECT_EQ(number("PRAGMA foreign_keys"), 1);

  SqliteJobTable table(database);
  const auto done = *table.find("done");
  EXPECT_EQ(done.sequence, 3);
  EXPECT_EQ(done.revision, 3);
  EXPECT_EQ(done.submitter, kLocalSubmitter);
  EXPECT_EQ(done.request_id, "request-1");
  EXPECT_EQ(done.request_hash, "hash-1");
  EXPECT_EQ(done.spec, std::string("\0\xffspec", 6));
  EXPECT_EQ(done.threads, 2);
  EXPECT_EQ(done.priority, kDefaultPriority);
  EXPECT_EQ(done.memory_bytes, 0);
  EXPECT_EQ(done.limits, JobLimits{});
  EXPECT_EQ(done.state, JobState::Succeeded);
  EXPECT_EQ(done.attempt, 1);
  EXPECT_EQ(done.token_hash, "token");
  EXPECT_EQ(done.created, WallTime(std::chrono::milliseconds(1000)));
  EXPECT_EQ(done.started, WallTime(std::chrono::milliseconds(2000)));
  EXPECT_EQ(done.ended, WallTime(std::chrono::milliseconds(3000)));
  EXPECT_EQ(done.labels, (std::map<std::string, std::string>{{"case", "7"}, {"side", "left"}}));
  EXPECT_THAT(done.inputs, ElementsAre("sha256:in"));
  EXPECT_THAT(done.artifacts, ElementsAre(Artifact{"field.nii.gz", "sha256:out", 20}));
  EXPECT_FALSE(done.checkpoint || done.last_loss || done.not_before || done.failure);

  const auto failed = *table.find("failed");
  EXPECT_EQ(failed.request_id, "");
  EXPECT_EQ(failed.lost_attempts, 1);
  EXPECT_EQ(failed.crashes, 1);
  EXPECT_EQ(failed.failure, (JobFailure{"DIVERGED", "it diverged"}));
  EXPECT_EQ(table.find("running")->process, "42 1 boot");
  EXPECT_EQ(table.find_request(kLocalSubmitter, "request-2")->id, "running");
}

// Each step on its own: what the daemon of that version made is what its migration makes now.
TEST_F(SchemaTest, EachMigrationMakesOfTheSchemaBeforeWhatWasReleased) {
  for (int version = 1; version <= kSchemaVersion; ++version) {
    SCOPED_TRACE("schema " + std::to_string(version));
    Database migrated(folder / ("migrated " + std::to_string(version)), Database::Access::ReadWrite);
    if (version > 1) migrated.execute(kReleased[version - 2]);
    prepare_schema(migrated, version);
    Database released(folder / ("released " + std::to_string(version)), Database::Access::ReadWrite);
    released.execute(kReleased[version - 1]);
    EXPECT_EQ(definitions(migrated), definitions(released));
    Query query = migrated.query("PRAGMA user_version");
    EXPECT_TRUE(query.step());
    EXPECT_EQ(query.integer(), version);
  }
}

TEST_F(SchemaTest, EveryReleasedDatabaseComesToTheSchemaOfANewOne) {
  Database fresh(folder / "fresh", Database::Access::ReadWrite);
  prepare_schema(fresh);
  for (int version = 1; version <= kSchemaVersion; ++version) {
    Database released(folder / ("released " + std::to_string(version)), Database::Access::ReadWrite);
    released.execute(kReleased[version - 1]);
    prepare_schema(released);
    EXPECT_EQ(definitions(released), definitions(fresh)) << "from schema " << version;
  }
}

TEST_F(SchemaTest, TheSecondSchemaKeepsEverythingItHeldAndLearnsOfRetention) {
  database.execute(kReleasedSchema2);
  prepare_schema(database);
  EXPECT_EQ(number("PRAGMA user_version"), kSchemaVersion);
  expect_jobs_since_schema_2();
  // Nobody has looked yet: the time of a blob that is not used begins with the next look.
  SqliteJobTable table(database);
  table.insert_blob("sha256:new", 5, at(1));
  EXPECT_EQ(table.mark_unreferenced(at(5000)), 1);
  EXPECT_THAT(table.unreferenced_since(at(5001), 10), ElementsAre(BlobRow{"sha256:new", 5}));
  EXPECT_THAT(table.ended_before(at(3001), 10), ElementsAre("done"));
}

TEST_F(SchemaTest, TheThirdSchemaKeepsEverythingItHeld) {
  database.execute(kReleasedSchema3);
  prepare_schema(database);
  expect_jobs_since_schema_2();
  SqliteJobTable table(database);
  EXPECT_TRUE(table.is_marked_unreferenced("sha256:old"));
  EXPECT_THAT(table.unreferenced_since(at(7001), 10), ElementsAre(BlobRow{"sha256:old", 40}));
  EXPECT_TRUE(table.unreferenced_since(at(7000), 10).empty());
}

TEST_F(SchemaTest, TheFourthSchemaKeepsEverythingItHeld) {
  database.execute(kReleasedSchema4);
  prepare_schema(database);
  expect_jobs_since_schema_2();
  SqliteJobTable table(database);
  EXPECT_TRUE(table.is_marked_unreferenced("sha256:old"));
  EXPECT_EQ(table.blob_bytes_of("ann"), 50);
  EXPECT_EQ(table.blob_bytes_of("bob"), 0);
}

TEST_F(SchemaTest, TheFifthSchemaKeepsEverythingItHeldAndOlderAttemptsWereInNoBatchSystem) {
  database.execute(kReleasedSchema5);
  prepare_schema(database);
  expect_jobs_since_schema_2();
  SqliteJobTable table(database);
  EXPECT_EQ(table.find("held")->batch_id, "77");
  EXPECT_EQ(table.find("held")->begun, at(2504));
  EXPECT_EQ(table.find("retry")->batch_id, "");
  EXPECT_FALSE(table.find("retry")->begun);

  Database older(folder / "older", Database::Access::ReadWrite);
  older.execute(kReleasedSchema4);
  prepare_schema(older);
  EXPECT_EQ(SqliteJobTable(older).find("held")->batch_id, "");
}

TEST_F(SchemaTest, TheSixthSchemaKeepsLostAttemptsAndNobodyKnowsOlderOnes) {
  database.execute(kReleasedSchema6);
  prepare_schema(database);
  expect_jobs_since_schema_2();
  SqliteJobTable table(database);
  EXPECT_EQ(table.find("held")->batch_host, "node3");
  EXPECT_TRUE(table.find("held")->losses.empty());
  EXPECT_THAT(table.find("retry")->losses, ElementsAre(LostAttempt{1, "STALLED", "76", "node2", at(2400)}));
  table.erase("retry");
  EXPECT_EQ(number("SELECT count(*) FROM lost_attempt"), 0);

  Database older(folder / "older", Database::Access::ReadWrite);
  older.execute(kReleasedSchema5);
  prepare_schema(older);
  EXPECT_EQ(SqliteJobTable(older).find("held")->batch_host, "");
  EXPECT_TRUE(SqliteJobTable(older).find("retry")->losses.empty());
}

TEST_F(SchemaTest, SequencesOfDeletedJobsAreNotGivenAgain) {
  database.execute(kReleasedSchema1);
  prepare_schema(database);
  JobRecord job;
  job.id = "new";
  SqliteJobTable(database).insert(job);
  EXPECT_EQ(job.sequence, 13);
}

TEST_F(SchemaTest, TheRowsOfAJobStillGoWithIt) {
  database.execute(kReleasedSchema1);
  prepare_schema(database);
  SqliteJobTable table(database);
  table.erase("done");
  EXPECT_EQ(number("SELECT count(*) FROM label"), 0);
  EXPECT_EQ(number("SELECT count(*) FROM artifact"), 0);
  EXPECT_TRUE(table.erase_blob_if_unreferenced("sha256:out"));
}

TEST_F(SchemaTest, AMigrationThatCannotBeFinishedChangesNothing) {
  database.execute(kReleasedSchema1);
  database.execute("PRAGMA foreign_keys=OFF; INSERT INTO input VALUES (4, 'sha256:nowhere')");
  const auto before = definitions(database);
  try {
    prepare_schema(database);
    FAIL() << "was migrated";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("its table input refers to rows that are not there"));
  }
  EXPECT_EQ(number("PRAGMA user_version"), 1);
  EXPECT_EQ(definitions(database), before);
  EXPECT_EQ(number("SELECT count(*) FROM job"), 3);
}

TEST_F(SchemaTest, OpeningAgainChangesNothing) {
  prepare_schema(database);
  const auto before = definitions(database);
  prepare_schema(database);
  EXPECT_EQ(definitions(database), before);
}

TEST_F(SchemaTest, ANewerSchemaIsRefusedAndLeftAsItIs) {
  database.execute(kReleasedSchema1);
  database.execute("PRAGMA user_version=" + std::to_string(kSchemaVersion + 1));
  const auto before = definitions(database);
  try {
    prepare_schema(database);
    FAIL() << "was opened";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("use a newer saltusd"));
    EXPECT_THAT(error.what(), HasSubstr("schema " + std::to_string(kSchemaVersion + 1)));
  }
  EXPECT_EQ(definitions(database), before);
}

}  // namespace
}  // namespace saltus::server
