#pragma once

#include "server/jobs/job_store.h"
#include "server/store/database.h"

namespace saltus::server {

/// The rows of one connection, inside a transaction that the owner of the connection has begun.
class SqliteJobTable final : public JobTable {
 public:
  explicit SqliteJobTable(Database& database) : database_(database) {}

  std::optional<JobRecord> find(const std::string& id) override;
  std::vector<JobRecord> list(const JobFilter& filter, std::int64_t before, int limit) override;
  std::vector<JobRecord> queued() override;
  std::vector<LastStart> last_starts() override;
  int count(JobState state) override;
  int count_queued_of(const std::string& submitter) override;
  Totals blob_totals() override;
  std::int64_t blob_bytes_of(const std::string& owner) override;
  std::optional<std::int64_t> blob_size(const std::string& digest) override;
  std::vector<BlobRow> blobs_after(const std::string& after, int limit) override;
  std::vector<BlobRow> unreferenced_since(WallTime before, int limit) override;
  bool is_marked_unreferenced(const std::string& digest) override;
  std::vector<std::string> ended_before(WallTime before, int limit) override;

  std::optional<JobRecord> find_request(const std::string& submitter, const std::string& request_id) override;
  void insert(JobRecord& job) override;
  void update(JobRecord& job) override;
  void erase(const std::string& id) override;
  void insert_blob(const std::string& digest, std::int64_t size, WallTime now, const std::string& owner = "") override;
  int mark_unreferenced(WallTime now) override;
  void unmark_unreferenced(const std::string& digest) override;
  bool erase_blob_if_unreferenced(const std::string& digest) override;

  /// Digests of all blobs.
  std::vector<std::string> blobs();

 private:
  std::optional<JobRecord> first(Query& query);
  JobRecord record(Query& query);
  void read_lists(JobRecord& job);
  void write_checkpoint(const JobRecord& job);
  void write_losses(const JobRecord& job);
  Database& database_;
};

}  // namespace saltus::server
