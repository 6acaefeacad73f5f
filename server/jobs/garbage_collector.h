#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/job_store.h"

#include <chrono>
#include <vector>

namespace saltus::server {

/// How long what nobody needs any more is kept.
struct Retention {
  std::chrono::hours inputs{7 * 24};    ///< blobs that no job refers to
  std::chrono::hours results{30 * 24};  ///< jobs with their results, after their end
  std::chrono::hours uploads{24};       ///< uploads that were begun, after their last byte

  bool operator==(const Retention&) const = default;
};

/// What one run has removed.
struct GarbageReport {
  int jobs = 0;
  int blobs = 0;
  std::int64_t blob_bytes = 0;
  int uploads = 0;
  std::int64_t upload_bytes = 0;
  int orphans = 0;  ///< files without a row: what a crash has left between two steps
};

/// Removes jobs, blobs and uploads whose time is over. Rows go before bytes, each batch in a transaction of its own, so
/// a crash leaves files without rows at most, which the next run or start removes. One thread at a time.
class GarbageCollector {
 public:
  GarbageCollector(JobStore& rows, BlobStore& bytes, const Clock& clock, Retention retention)
      : rows_(rows), bytes_(bytes), clock_(clock), retention_(retention) {}

  /// Blocks. Throws Refusal when the store cannot be written; what was removed before stays removed.
  GarbageReport collect();

 private:
  void write(const JobStore::Operation& operation);
  void remove_jobs(GarbageReport& report);
  void remove_blobs(GarbageReport& report);
  void remove_orphans(GarbageReport& report);
  void remove_bytes(const std::vector<BlobRow>& gone, GarbageReport& report);

  JobStore& rows_;
  BlobStore& bytes_;
  const Clock& clock_;
  const Retention retention_;
};

}  // namespace saltus::server
