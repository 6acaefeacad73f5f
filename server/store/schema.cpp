#include "server/store/schema.h"

#include <stdexcept>
#include <string>

namespace saltus::server {
namespace {

constexpr std::int64_t kApplicationId = 0x736c7475;  // "sltu"

// States are stored as the numbers of JobState.
constexpr const char* kCreate = R"sql(
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

std::int64_t pragma(Database& database, const char* sql) {
  Query query = database.query(sql);
  query.step();
  return query.integer();
}

}  // namespace

void prepare_schema(Database& database) {
  database.execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON;");
  const std::int64_t version = pragma(database, "PRAGMA user_version");
  const std::int64_t application = pragma(database, "PRAGMA application_id");
  if (version > 0 && application != kApplicationId)
    throw std::runtime_error("the database is not one of saltusd; use another --data directory");
  if (version > kSchemaVersion)
    throw std::runtime_error("the database has schema " + std::to_string(version) + ", this saltusd knows up to " +
                             std::to_string(kSchemaVersion) + "; use a newer saltusd or another --data directory");
  if (version == kSchemaVersion) return;
  database.execute("BEGIN IMMEDIATE;" + std::string(kCreate) +
                   "PRAGMA application_id=" + std::to_string(kApplicationId) +
                   ";PRAGMA user_version=" + std::to_string(kSchemaVersion) + ";COMMIT;");
}

}  // namespace saltus::server
