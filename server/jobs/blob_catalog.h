#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/job_store.h"
#include "server/jobs/upload_quota.h"

#include <memory>
#include <string>
#include <vector>

namespace saltus::server {

/// Joins the bytes of blobs with their rows: bytes are durable before their row exists, and a row is gone before its
/// bytes are. Thread-safe; what blocks says so.
class BlobCatalog {
 public:
  BlobCatalog(JobStore& rows, BlobStore& bytes, const Clock& clock) : rows_(rows), bytes_(bytes), clock_(clock) {}

  /// Those of `digests` that are not here. Blocks.
  std::vector<std::string> missing(const std::vector<std::string>& digests);
  /// Blocks.
  bool has(const std::string& digest, std::int64_t size);
  /// As BlobStore::begin; throws Exhausted QUOTA when the blob is more than the plan's owner may have. Blocks.
  std::unique_ptr<BlobUpload> begin(const UploadPlan& plan);
  /// As BlobStore::committed: how many bytes of an upload that has not become a blob are safe. Blocks.
  std::int64_t committed(const UploadPlan& plan);
  /// As BlobStore::require_room. Does not wait for anything but the file system's own numbers.
  void require_room() { bytes_.require_room(); }
  /// Makes a sealed upload a blob; `done` as in JobStore::write.
  void commit(std::shared_ptr<BlobUpload> upload, JobStore::Done done);
  /// Blocks. Throws NotFound BLOB_NOT_FOUND.
  std::unique_ptr<BlobReader> open(const std::string& digest);
  /// Removes the bytes of those digests that have no row, after their rows' removal has become durable.
  void drop_bytes(std::vector<std::string> digests);

 private:
  std::vector<std::string> renew(const std::vector<std::string>& marked);

  JobStore& rows_;
  BlobStore& bytes_;
  const Clock& clock_;
  UploadQuota quota_;
};

}  // namespace saltus::server
