#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/job_store.h"

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace saltus::server {

struct FsckFinding {
  enum class Kind {
    Corrupt,  ///< the bytes are others than the digest says; they are set aside, and an upload heals them
    Missing,  ///< there is a row and no file of its size
    Orphan,   ///< there is a file and no row: harmless, garbage collection removes it
  };
  Kind kind = Kind::Corrupt;
  std::string digest;
};

struct FsckReport {
  std::int64_t blobs = 0;  ///< rows looked at
  std::int64_t bytes = 0;  ///< read and checked
  int corrupt = 0;
  int missing = 0;
  int orphans = 0;
  int uploads = 0;    ///< that wait to be continued
  int set_aside = 0;  ///< damaged bytes that are kept for somebody to look at, from now and before
  bool is_healthy() const { return corrupt == 0 && missing == 0; }
};

/// Reads every blob and compares it with its digest, every row with its file, every file with its row. Works beside a
/// serving daemon: what changes meanwhile is not taken for damage. One thread at a time.
class Fsck {
 public:
  using Read = std::function<void(const std::function<void(JobReader&)>&)>;

  Fsck(Read read, BlobStore& bytes, const Clock& clock) : read_(std::move(read)), bytes_(bytes), clock_(clock) {}

  /// Goes on for about `budget` bytes. False when all is done.
  bool step(std::int64_t budget);
  /// So far.
  const FsckReport& report() const { return report_; }
  /// What was found since the last call.
  std::vector<FsckFinding> take_findings() { return std::exchange(findings_, {}); }

 private:
  bool next_blob();
  void check(std::int64_t& budget);
  void found(FsckFinding::Kind kind, const std::string& digest);
  bool is_still_missing(const BlobRow& row);
  void look_for_orphans();

  const Read read_;
  BlobStore& bytes_;
  const Clock& clock_;
  std::vector<BlobRow> page_;
  std::size_t next_ = 0;
  std::string last_digest_;
  BlobRow row_;
  std::unique_ptr<BlobReader> reader_;
  bool is_done_ = false;
  FsckReport report_;
  std::vector<FsckFinding> findings_;
};

}  // namespace saltus::server
