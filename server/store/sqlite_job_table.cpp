#include "server/store/sqlite_job_table.h"

namespace saltus::server {
namespace {

#define SALTUS_JOB_COLUMNS                                                                                          \
  "SELECT sequence, revision, id, submitter, request_id, request_hash, spec, threads, priority, memory_bytes, "     \
  "limit_wall_seconds, limit_cpu_seconds, limit_memory_bytes, state, attempt, lost_attempts, crashes, not_before, " \
  "loss_reason, loss_message, token_hash, process, created, started, ended, failure_reason, failure_message, "      \
  "batch_id, begun, batch_host FROM job "

std::int64_t milliseconds(WallTime time) { return time.time_since_epoch().count(); }
WallTime wall_time(std::int64_t value) { return WallTime(std::chrono::milliseconds(value)); }

std::optional<std::int64_t> milliseconds(const std::optional<WallTime>& time) {
  return time ? std::optional(milliseconds(*time)) : std::nullopt;
}

std::optional<WallTime> optional_time(Query& query) {
  const bool is_null = query.is_null();
  const std::int64_t value = query.integer();
  return is_null ? std::nullopt : std::optional(wall_time(value));
}

std::optional<JobFailure> optional_failure(Query& query) {
  const bool is_null = query.is_null();
  const std::string reason = query.text();
  const std::string message = query.text();
  return is_null ? std::nullopt : std::optional(JobFailure{reason, message});
}

void bind_failure(Query& query, const std::optional<JobFailure>& failure) {
  if (failure)
    query.bind(failure->reason).bind(failure->message);
  else
    query.bind_null().bind_null();
}

static_assert(static_cast<int>(JobState::Queued) == 0);  // in SQL and in the index of queued jobs

std::int64_t number(JobState state) { return static_cast<std::int64_t>(state); }

// Of a row of the table blob. Whatever refers to blobs stands here.
#define SALTUS_IS_UNREFERENCED                                          \
  "NOT EXISTS (SELECT 1 FROM input WHERE digest = blob.digest) "        \
  "AND NOT EXISTS (SELECT 1 FROM artifact WHERE digest = blob.digest) " \
  "AND NOT EXISTS (SELECT 1 FROM checkpoint WHERE digest = blob.digest)"

std::vector<BlobRow> blob_rows(Query& query) {
  std::vector<BlobRow> rows;
  while (query.step()) {
    BlobRow row;
    row.digest = query.text();
    row.size = query.integer();
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace

JobRecord SqliteJobTable::record(Query& query) {
  JobRecord job;
  job.sequence = query.integer();
  job.revision = query.integer();
  job.id = query.text();
  job.submitter = query.text();
  job.request_id = query.text();
  job.request_hash = query.text();
  job.spec = query.text();
  job.threads = static_cast<int>(query.integer());
  job.priority = static_cast<int>(query.integer());
  job.memory_bytes = query.integer();
  job.limits.wall_seconds = query.integer();
  job.limits.cpu_seconds = query.integer();
  job.limits.memory_bytes = query.integer();
  job.state = static_cast<JobState>(query.integer());
  job.attempt = static_cast<int>(query.integer());
  job.lost_attempts = static_cast<int>(query.integer());
  job.crashes = static_cast<int>(query.integer());
  job.not_before = optional_time(query);
  job.last_loss = optional_failure(query);
  job.token_hash = query.text();
  job.process = query.text();
  job.created = wall_time(query.integer());
  job.started = optional_time(query);
  job.ended = optional_time(query);
  job.failure = optional_failure(query);
  job.batch_id = query.text();
  job.begun = optional_time(query);
  job.batch_host = query.text();
  return job;
}

void SqliteJobTable::read_lists(JobRecord& job) {
  Query labels = database_.query("SELECT name, value FROM label WHERE job = ?");
  labels.bind(job.sequence);
  while (labels.step()) {
    const std::string name = labels.text();
    job.labels[name] = labels.text();
  }
  Query inputs = database_.query("SELECT digest FROM input WHERE job = ? ORDER BY digest");
  inputs.bind(job.sequence);
  while (inputs.step()) job.inputs.push_back(inputs.text());
  Query artifacts = database_.query("SELECT name, digest, size FROM artifact WHERE job = ? ORDER BY position");
  artifacts.bind(job.sequence);
  while (artifacts.step()) {
    Artifact artifact;
    artifact.name = artifacts.text();
    artifact.digest = artifacts.text();
    artifact.size = artifacts.integer();
    job.artifacts.push_back(std::move(artifact));
  }
  Query checkpoints = database_.query("SELECT digest, size, attempt, level, iteration FROM checkpoint WHERE job = ?");
  checkpoints.bind(job.sequence);
  if (checkpoints.step()) {
    Checkpoint checkpoint;
    checkpoint.digest = checkpoints.text();
    checkpoint.size = checkpoints.integer();
    checkpoint.attempt = static_cast<int>(checkpoints.integer());
    checkpoint.level = static_cast<int>(checkpoints.integer());
    checkpoint.iteration = static_cast<int>(checkpoints.integer());
    job.checkpoint = std::move(checkpoint);
  }
  Query losses =
      database_.query("SELECT attempt, reason, batch_id, host, ended FROM lost_attempt WHERE job = ? ORDER BY attempt");
  losses.bind(job.sequence);
  while (losses.step()) {
    LostAttempt lost;
    lost.attempt = static_cast<int>(losses.integer());
    lost.reason = losses.text();
    lost.batch_id = losses.text();
    lost.host = losses.text();
    lost.ended = wall_time(losses.integer());
    job.losses.push_back(std::move(lost));
  }
}

std::optional<JobRecord> SqliteJobTable::first(Query& query) {
  if (!query.step()) return std::nullopt;
  JobRecord job = record(query);
  read_lists(job);
  return job;
}

std::optional<JobRecord> SqliteJobTable::find(const std::string& id) {
  Query query = database_.query(SALTUS_JOB_COLUMNS "WHERE id = ?");
  query.bind(id);
  return first(query);
}

std::optional<JobRecord> SqliteJobTable::find_request(const std::string& submitter, const std::string& request_id) {
  Query query = database_.query(SALTUS_JOB_COLUMNS "WHERE submitter = ? AND request_id = ?");
  query.bind(submitter).bind(request_id);
  return first(query);
}

std::vector<JobRecord> SqliteJobTable::list(const JobFilter& filter, std::int64_t before, int limit) {
  // One text for each combination of conditions that has an index of its own; the other labels are looked up.
  std::string sql = SALTUS_JOB_COLUMNS "WHERE sequence < ?";
  if (filter.state) sql += " AND state = ?";
  if (!filter.submitter.empty()) sql += " AND submitter = ?";
  for (std::size_t i = 0; i < filter.labels.size(); ++i)
    sql += " AND sequence IN (SELECT job FROM label WHERE name = ? AND value = ?)";
  sql += " ORDER BY sequence DESC LIMIT ?";
  std::vector<JobRecord> jobs;
  {
    Query query = database_.query(sql.c_str());
    query.bind(before);
    if (filter.state) query.bind(number(*filter.state));
    if (!filter.submitter.empty()) query.bind(filter.submitter);
    for (const auto& [name, value] : filter.labels) query.bind(name).bind(value);
    query.bind(limit);
    while (query.step()) jobs.push_back(record(query));
  }
  for (JobRecord& job : jobs) read_lists(job);
  return jobs;
}

std::vector<JobRecord> SqliteJobTable::queued() {
  Query query = database_.query(
      "SELECT sequence, id, submitter, priority, threads, memory_bytes, created, not_before, attempt FROM job "
      "WHERE state = ? ORDER BY sequence");
  query.bind(number(JobState::Queued));
  std::vector<JobRecord> jobs;
  while (query.step()) {
    JobRecord job;
    job.sequence = query.integer();
    job.id = query.text();
    job.submitter = query.text();
    job.priority = static_cast<int>(query.integer());
    job.threads = static_cast<int>(query.integer());
    job.memory_bytes = query.integer();
    job.created = wall_time(query.integer());
    job.not_before = optional_time(query);
    job.attempt = static_cast<int>(query.integer());
    jobs.push_back(std::move(job));
  }
  return jobs;
}

std::vector<LastStart> SqliteJobTable::last_starts() {
  Query query = database_.query(
      "SELECT submitter, priority, max(started) AS last FROM job WHERE started IS NOT NULL GROUP BY submitter, "
      "priority "
      "ORDER BY last, submitter, priority");
  std::vector<LastStart> starts;
  while (query.step()) {
    LastStart start;
    start.submitter = query.text();
    start.priority = static_cast<int>(query.integer());
    start.started = wall_time(query.integer());
    starts.push_back(std::move(start));
  }
  return starts;
}

int SqliteJobTable::count_queued_of(const std::string& submitter) {
  Query query = database_.query("SELECT count(*) FROM job WHERE state = 0 AND submitter = ?");
  query.bind(submitter);
  query.step();
  return static_cast<int>(query.integer());
}

JobReader::Totals SqliteJobTable::blob_totals() {
  Query query = database_.query("SELECT count(*), ifnull(sum(size), 0) FROM blob");
  query.step();
  Totals totals;
  totals.count = query.integer();
  totals.bytes = query.integer();
  return totals;
}

std::int64_t SqliteJobTable::blob_bytes_of(const std::string& owner) {
  // The condition on the owner lets the partial index serve.
  Query query = database_.query("SELECT ifnull(sum(size), 0) FROM blob WHERE owner = ? AND owner <> ''");
  query.bind(owner);
  query.step();
  return query.integer();
}

int SqliteJobTable::count(JobState state) {
  Query query = database_.query("SELECT count(*) FROM job WHERE state = ?");
  query.bind(number(state));
  query.step();
  return static_cast<int>(query.integer());
}

std::optional<std::int64_t> SqliteJobTable::blob_size(const std::string& digest) {
  Query query = database_.query("SELECT size FROM blob WHERE digest = ?");
  query.bind(digest);
  if (!query.step()) return std::nullopt;
  return query.integer();
}

void SqliteJobTable::insert(JobRecord& job) {
  job.revision = 1;
  Query query = database_.query(
      "INSERT INTO job (revision, id, submitter, request_id, request_hash, spec, threads, priority, memory_bytes, "
      "limit_wall_seconds, limit_cpu_seconds, limit_memory_bytes, state, attempt, lost_attempts, crashes, token_hash, "
      "process, created) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING sequence");
  query.bind(job.revision).bind(job.id).bind(job.submitter);
  job.request_id.empty() ? query.bind_null() : query.bind(job.request_id);
  query.bind(job.request_hash).bind_blob(job.spec).bind(job.threads).bind(job.priority).bind(job.memory_bytes);
  query.bind(job.limits.wall_seconds).bind(job.limits.cpu_seconds).bind(job.limits.memory_bytes);
  query.bind(number(job.state)).bind(job.attempt).bind(job.lost_attempts).bind(job.crashes);
  query.bind(job.token_hash).bind(job.process).bind(milliseconds(job.created));
  query.step();
  job.sequence = query.integer();
  query.run();
  for (const auto& [name, value] : job.labels)
    database_.query("INSERT INTO label (job, name, value) VALUES (?, ?, ?)")
        .bind(job.sequence)
        .bind(name)
        .bind(value)
        .run();
  for (const std::string& digest : job.inputs)
    database_.query("INSERT OR IGNORE INTO input (job, digest) VALUES (?, ?)").bind(job.sequence).bind(digest).run();
}

void SqliteJobTable::update(JobRecord& job) {
  ++job.revision;
  Query query = database_.query(
      "UPDATE job SET revision = ?, state = ?, attempt = ?, lost_attempts = ?, crashes = ?, not_before = ?, "
      "loss_reason = ?, loss_message = ?, token_hash = ?, process = ?, started = ?, ended = ?, failure_reason = ?, "
      "failure_message = ?, batch_id = ?, begun = ?, batch_host = ? WHERE sequence = ?");
  query.bind(job.revision).bind(number(job.state)).bind(job.attempt).bind(job.lost_attempts).bind(job.crashes);
  query.bind_optional(milliseconds(job.not_before));
  bind_failure(query, job.last_loss);
  query.bind(job.token_hash).bind(job.process);
  query.bind_optional(milliseconds(job.started)).bind_optional(milliseconds(job.ended));
  bind_failure(query, job.failure);
  query.bind(job.batch_id).bind_optional(milliseconds(job.begun)).bind(job.batch_host);
  query.bind(job.sequence).run();
  database_.query("DELETE FROM artifact WHERE job = ?").bind(job.sequence).run();
  std::int64_t position = 0;
  for (const Artifact& artifact : job.artifacts)
    database_.query("INSERT INTO artifact (job, position, name, digest, size) VALUES (?, ?, ?, ?, ?)")
        .bind(job.sequence)
        .bind(position++)
        .bind(artifact.name)
        .bind(artifact.digest)
        .bind(artifact.size)
        .run();
  write_checkpoint(job);
  write_losses(job);
}

void SqliteJobTable::write_losses(const JobRecord& job) {
  // Most jobs have none, and none of them is taken back.
  if (job.losses.empty()) return;
  database_.query("DELETE FROM lost_attempt WHERE job = ?").bind(job.sequence).run();
  for (const LostAttempt& lost : job.losses)
    database_.query("INSERT INTO lost_attempt (job, attempt, reason, batch_id, host, ended) VALUES (?, ?, ?, ?, ?, ?)")
        .bind(job.sequence)
        .bind(lost.attempt)
        .bind(lost.reason)
        .bind(lost.batch_id)
        .bind(lost.host)
        .bind(milliseconds(lost.ended))
        .run();
}

void SqliteJobTable::write_checkpoint(const JobRecord& job) {
  if (!job.checkpoint) {
    database_.query("DELETE FROM checkpoint WHERE job = ?").bind(job.sequence).run();
    return;
  }
  database_
      .query(
          "INSERT OR REPLACE INTO checkpoint (job, digest, size, attempt, level, iteration) VALUES (?, ?, ?, ?, ?, ?)")
      .bind(job.sequence)
      .bind(job.checkpoint->digest)
      .bind(job.checkpoint->size)
      .bind(job.checkpoint->attempt)
      .bind(job.checkpoint->level)
      .bind(job.checkpoint->iteration)
      .run();
}

void SqliteJobTable::erase(const std::string& id) { database_.query("DELETE FROM job WHERE id = ?").bind(id).run(); }

void SqliteJobTable::insert_blob(const std::string& digest, std::int64_t size, WallTime now, const std::string& owner) {
  database_
      .query(
          "INSERT INTO blob (digest, size, created, owner) VALUES (?, ?, ?, ?) "
          "ON CONFLICT (digest) DO UPDATE SET unreferenced_since = NULL")
      .bind(digest)
      .bind(size)
      .bind(milliseconds(now))
      .bind(owner)
      .run();
}

int SqliteJobTable::mark_unreferenced(WallTime now) {
  database_
      .query(
          "UPDATE blob SET unreferenced_since = NULL WHERE unreferenced_since IS NOT NULL AND NOT "
          "(" SALTUS_IS_UNREFERENCED ")")
      .run();
  database_.query("UPDATE blob SET unreferenced_since = ? WHERE unreferenced_since IS NULL AND " SALTUS_IS_UNREFERENCED)
      .bind(milliseconds(now))
      .run();
  return database_.changes();
}

void SqliteJobTable::unmark_unreferenced(const std::string& digest) {
  database_.query("UPDATE blob SET unreferenced_since = NULL WHERE digest = ?").bind(digest).run();
}

bool SqliteJobTable::erase_blob_if_unreferenced(const std::string& digest) {
  database_.query("DELETE FROM blob WHERE digest = ? AND " SALTUS_IS_UNREFERENCED).bind(digest).run();
  return database_.changes() > 0;
}

std::vector<BlobRow> SqliteJobTable::blobs_after(const std::string& after, int limit) {
  Query query = database_.query("SELECT digest, size FROM blob WHERE digest > ? ORDER BY digest LIMIT ?");
  query.bind(after).bind(limit);
  return blob_rows(query);
}

std::vector<BlobRow> SqliteJobTable::unreferenced_since(WallTime before, int limit) {
  Query query = database_.query("SELECT digest, size FROM blob WHERE unreferenced_since < ? AND " SALTUS_IS_UNREFERENCED
                                " LIMIT ?");
  query.bind(milliseconds(before)).bind(limit);
  return blob_rows(query);
}

bool SqliteJobTable::is_marked_unreferenced(const std::string& digest) {
  Query query = database_.query("SELECT 1 FROM blob WHERE digest = ? AND unreferenced_since IS NOT NULL");
  query.bind(digest);
  return query.step();
}

std::vector<std::string> SqliteJobTable::ended_before(WallTime before, int limit) {
  Query query = database_.query("SELECT id FROM job WHERE ended < ? AND state IN (?, ?, ?) LIMIT ?");
  query.bind(milliseconds(before));
  for (const JobState state : {JobState::Succeeded, JobState::Failed, JobState::Cancelled}) query.bind(number(state));
  query.bind(limit);
  std::vector<std::string> ids;
  while (query.step()) ids.push_back(query.text());
  return ids;
}

std::vector<std::string> SqliteJobTable::blobs() {
  Query query = database_.query("SELECT digest FROM blob");
  std::vector<std::string> digests;
  while (query.step()) digests.push_back(query.text());
  return digests;
}

}  // namespace saltus::server
