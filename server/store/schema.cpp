#include "server/store/schema.h"

#include <iterator>
#include <stdexcept>
#include <string>

namespace saltus::server {
namespace {

constexpr std::int64_t kApplicationId = 0x736c7475;  // "sltu"

// Migrations from nothing to kSchemaVersion, in order. What has been released is never edited: a change is a new
// migration at the end. While one runs, foreign keys are off (a table can be replaced); they are checked before it
// commits.

// States are stored as the numbers of JobState.
constexpr const char* kJobsAndBlobs = R"sql(
CREATE TABLE blob (
  digest TEXT PRIMARY KEY,
  size INTEGER NOT NULL,
  created INTEGER NOT NULL
) WITHOUT ROWID;
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
CREATE INDEX job_by_state ON job (state, sequence);
CREATE TABLE label (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  name TEXT NOT NULL,
  value TEXT NOT NULL,
  PRIMARY KEY (job, name)
) WITHOUT ROWID;
CREATE TABLE input (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  PRIMARY KEY (job, digest)
) WITHOUT ROWID;
CREATE INDEX input_by_digest ON input (digest);
CREATE TABLE artifact (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  PRIMARY KEY (job, position)
) WITHOUT ROWID;
CREATE INDEX artifact_by_digest ON artifact (digest);
)sql";

// Request ids become unique for each submitter, so the table is replaced; its AUTOINCREMENT goes on where it was.
// What an old job did not say gets the value that the daemon worked by: no submitter but this machine, the middle
// priority, no limit. Numbers of 0 mean "not said".
constexpr const char* kSchedulingAndCheckpoints = R"sql(
CREATE TABLE new_job (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  revision INTEGER NOT NULL,
  id TEXT NOT NULL UNIQUE,
  submitter TEXT NOT NULL DEFAULT 'local',
  request_id TEXT,
  request_hash TEXT NOT NULL,
  spec BLOB NOT NULL,
  threads INTEGER NOT NULL,
  priority INTEGER NOT NULL DEFAULT 1,
  memory_bytes INTEGER NOT NULL DEFAULT 0,
  limit_wall_seconds INTEGER NOT NULL DEFAULT 0,
  limit_cpu_seconds INTEGER NOT NULL DEFAULT 0,
  limit_memory_bytes INTEGER NOT NULL DEFAULT 0,
  state INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  lost_attempts INTEGER NOT NULL,
  crashes INTEGER NOT NULL,
  not_before INTEGER,
  loss_reason TEXT,
  loss_message TEXT,
  token_hash TEXT NOT NULL,
  process TEXT NOT NULL,
  created INTEGER NOT NULL,
  started INTEGER,
  ended INTEGER,
  failure_reason TEXT,
  failure_message TEXT,
  UNIQUE (submitter, request_id)
);
INSERT INTO new_job (sequence, revision, id, request_id, request_hash, spec, threads, state, attempt, lost_attempts,
                     crashes, token_hash, process, created, started, ended, failure_reason, failure_message)
  SELECT sequence, revision, id, request_id, request_hash, spec, threads, state, attempt, lost_attempts,
         crashes, token_hash, process, created, started, ended, failure_reason, failure_message FROM job;
DELETE FROM sqlite_sequence WHERE name = 'new_job';
INSERT INTO sqlite_sequence (name, seq) SELECT 'new_job', seq FROM sqlite_sequence WHERE name = 'job';
DROP TABLE job;
ALTER TABLE new_job RENAME TO job;
CREATE INDEX job_by_state ON job (state, sequence);
CREATE INDEX job_by_submitter ON job (submitter, sequence);
CREATE INDEX queued_by_submitter ON job (submitter) WHERE state = 0;
CREATE INDEX label_by_value ON label (name, value, job);
CREATE TABLE checkpoint (
  job INTEGER PRIMARY KEY REFERENCES job ON DELETE CASCADE,
  digest TEXT NOT NULL REFERENCES blob,
  size INTEGER NOT NULL,
  attempt INTEGER NOT NULL,
  level INTEGER NOT NULL,
  iteration INTEGER NOT NULL
);
CREATE INDEX checkpoint_by_digest ON checkpoint (digest);
)sql";

// Since when no job has referred to a blob, as the garbage collector has found; NULL while one does or nobody looked.
constexpr const char* kRetention = R"sql(
ALTER TABLE blob ADD COLUMN unreferenced_since INTEGER;
CREATE INDEX blob_by_unreferenced ON blob (unreferenced_since) WHERE unreferenced_since IS NOT NULL;
CREATE INDEX job_by_end ON job (ended) WHERE ended IS NOT NULL;
)sql";

// Whose quota a blob counts against: whoever was the first to upload it; nobody's for those that were there before.
constexpr const char* kOwners = R"sql(
ALTER TABLE blob ADD COLUMN owner TEXT NOT NULL DEFAULT '';
CREATE INDEX blob_by_owner ON blob (owner, size) WHERE owner <> '';
)sql";

// What a batch system calls the attempt, and when it let its worker begin. Attempts of before were in no such queue.
constexpr const char* kBatchSystem = R"sql(
ALTER TABLE job ADD COLUMN batch_id TEXT NOT NULL DEFAULT '';
ALTER TABLE job ADD COLUMN begun INTEGER;
)sql";

// Where the batch system runs the attempt, and what became of those before: nobody has written that down until now.
constexpr const char* kLostAttempts = R"sql(
ALTER TABLE job ADD COLUMN batch_host TEXT NOT NULL DEFAULT '';
CREATE TABLE lost_attempt (
  job INTEGER NOT NULL REFERENCES job ON DELETE CASCADE,
  attempt INTEGER NOT NULL,
  reason TEXT NOT NULL,
  batch_id TEXT NOT NULL,
  host TEXT NOT NULL,
  ended INTEGER NOT NULL,
  PRIMARY KEY (job, attempt)
) WITHOUT ROWID;
)sql";

constexpr const char* kMigrations[] = {kJobsAndBlobs, kSchedulingAndCheckpoints, kRetention, kOwners, kBatchSystem,
                                       kLostAttempts};
static_assert(std::size(kMigrations) == kSchemaVersion);

std::int64_t pragma(Database& database, const char* sql) {
  Query query = database.query(sql);
  query.step();
  return query.integer();
}

void require_foreign_keys(Database& database, int version) {
  Query query = database.query("PRAGMA foreign_key_check");
  if (query.step())
    throw std::runtime_error("the database cannot be brought to schema " + std::to_string(version) + ": its table " +
                             query.text() + " refers to rows that are not there; restore a backup");
}

void migrate(Database& database, int version) {
  try {
    database.execute("BEGIN IMMEDIATE");
    database.execute(kMigrations[version - 1]);
    require_foreign_keys(database, version);
    database.execute("PRAGMA application_id=" + std::to_string(kApplicationId) +
                     ";PRAGMA user_version=" + std::to_string(version) + ";COMMIT");
  } catch (...) {
    if (database.is_in_transaction()) database.execute("ROLLBACK");
    throw;
  }
}

}  // namespace

void prepare_schema(Database& database, int version) {
  database.execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL;");
  const std::int64_t found = pragma(database, "PRAGMA user_version");
  const std::int64_t application = pragma(database, "PRAGMA application_id");
  if (found > 0 && application != kApplicationId)
    throw std::runtime_error("the database is not one of saltusd; use another --data directory");
  if (found > version)
    throw std::runtime_error("the database has schema " + std::to_string(found) + ", this saltusd knows up to " +
                             std::to_string(version) + "; use a newer saltusd or another --data directory");
  database.execute("PRAGMA foreign_keys=OFF");
  for (int next = static_cast<int>(found) + 1; next <= version; ++next) migrate(database, next);
  database.execute("PRAGMA foreign_keys=ON");
}

}  // namespace saltus::server
