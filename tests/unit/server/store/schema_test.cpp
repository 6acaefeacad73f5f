// Databases of released versions must open in this one with everything they held.
#include "server/store/schema.h"

#include "server/store/sqlite_job_table.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// What saltusd 0.1 made, as `sqlite3 saltusd.db .dump` shows it, with rows in every table. Never to be edited.
constexpr const char* kReleasedSchema1 = R"sql(
PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
) WITHOUT ROWID;
INSERT INTO blob VALUES('sha256:in',10,1000);
INSERT INTO blob VALUES('sha256:out',20,2000);
CREATE TABLE job (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  request_id TEXT UNIQUE,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT
);
INSERT INTO job VALUES(3,3,'done','request-1','hash-1',X'00ff73706563',2,3,1,0,0,'token','',1000,2000,3000,NULL,NULL);
INSERT INTO job VALUES(4,4,'failed',NULL,'hash-2',X'73706563',0,4,2,1,1,'token','',1001,2001,3001,'DIVERGED','it diverged');
INSERT INTO job VALUES(7,2,'running','request-2','hash-3',X'73706563',0,1,1,0,0,'token','42 1 boot',1002,2002,NULL,NULL,NULL);
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
INSERT INTO label VALUES(3,'case','7');
INSERT INTO label VALUES(3,'side','left');
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
INSERT INTO input VALUES(3,'sha256:in');
INSERT INTO input VALUES(7,'sha256:in');
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
INSERT INTO artifact VALUES(3,0,'field.nii.gz','sha256:out',20);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('job',12);
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX input_by_digest ON input (digest);
CREATE INDEX artifact_by_digest ON artifact (digest);
PRAGMA application_id=1936487541;
PRAGMA user_version=1;
COMMIT;
)sql";

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

TEST_F(SchemaTest, AMigratedDatabaseHasTheSchemaOfANewOne) {
  database.execute(kReleasedSchema1);
  prepare_schema(database);
  Database fresh(folder / "fresh", Database::Access::ReadWrite);
  prepare_schema(fresh);
  EXPECT_EQ(definitions(database), definitions(fresh));
}

TEST_F(SchemaTest, TheFirstMigrationMakesWhatWasReleased) {
  prepare_schema(database, 1);
  Database released(folder / "released", Database::Access::ReadWrite);
  released.execute(kReleasedSchema1);
  EXPECT_EQ(definitions(database), definitions(released));
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
