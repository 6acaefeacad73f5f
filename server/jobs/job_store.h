#pragma once

#include "server/jobs/job.h"

#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace saltus::server {

struct BlobRow {
  std::string digest;
  std::int64_t size = 0;
  bool operator==(const BlobRow&) const = default;
};

/// When a submitter last had a job of this priority started.
struct LastStart {
  std::string submitter;
  int priority = kDefaultPriority;
  WallTime started{};
  bool operator==(const LastStart&) const = default;
};

/// Which jobs a list is to have: those that fulfil every condition.
struct JobFilter {
  std::optional<JobState> state = {};
  std::map<std::string, std::string> labels = {};  ///< each with exactly this value
  std::string submitter = {};                      ///< "": anybody
};

/// For those that go through all blobs: what one transaction reads of them.
inline constexpr int kBlobRowsPerPage = 1000;

/// The committed rows, as of one moment.
class JobReader {
 public:
  virtual ~JobReader() = default;
  virtual std::optional<JobRecord> find(const std::string& id) = 0;
  /// Newest first: jobs with a sequence below `before`, at most `limit`.
  virtual std::vector<JobRecord> list(const JobFilter& filter, std::int64_t before, int limit) = 0;
  /// All queued jobs by sequence, without their specification, labels and files.
  virtual std::vector<JobRecord> queued() = 0;
  /// One for each submitter and priority of whose jobs any was ever started; the longest ago first.
  virtual std::vector<LastStart> last_starts() = 0;
  virtual int count(JobState state) = 0;
  virtual int count_queued_of(const std::string& submitter) = 0;
  /// Of all blobs that `owner` was the first to upload.
  virtual std::int64_t blob_bytes_of(const std::string& owner) = 0;
  virtual std::optional<std::int64_t> blob_size(const std::string& digest) = 0;
  struct Totals {
    std::int64_t count = 0;
    std::int64_t bytes = 0;
  };
  /// Of all blobs.
  virtual Totals blob_totals() = 0;
  /// In the order of their digests: those after `after`, at most `limit`.
  virtual std::vector<BlobRow> blobs_after(const std::string& after, int limit) = 0;
  /// Blobs that no job has referred to since before `before`, as mark_unreferenced has noted; at most `limit`.
  virtual std::vector<BlobRow> unreferenced_since(WallTime before, int limit) = 0;
  /// mark_unreferenced has found that no job refers to the blob.
  virtual bool is_marked_unreferenced(const std::string& digest) = 0;
  /// Jobs in a terminal state that ended before `before`, at most `limit`.
  virtual std::vector<std::string> ended_before(WallTime before, int limit) = 0;
};

/// The rows inside one write transaction. Only valid during the operation it was given to.
class JobTable : public JobReader {
 public:
  virtual std::optional<JobRecord> find_request(const std::string& submitter, const std::string& request_id) = 0;
  /// Gives `job` its sequence.
  virtual void insert(JobRecord& job) = 0;
  /// Replaces what may change: state, attempts, times, failure, artefacts, checkpoint. Raises the revision of `job`.
  virtual void update(JobRecord& job) = 0;
  virtual void erase(const std::string& id) = 0;
  /// One that is there stays, with its owner, and counts as used just now. `owner`: who has uploaded it; "": nobody
  /// whose bytes are counted.
  virtual void insert_blob(const std::string& digest, std::int64_t size, WallTime now,
                           const std::string& owner = "") = 0;
  /// Notes `now` for blobs that no job refers to, unless it was noted before; takes the note from those that are
  /// referred to. Returns how many were noted.
  virtual int mark_unreferenced(WallTime now) = 0;
  /// Takes the note away: somebody has just asked for the blob.
  virtual void unmark_unreferenced(const std::string& digest) = 0;
  /// True when the blob is gone from the table; false when a job still refers to it.
  virtual bool erase_blob_if_unreferenced(const std::string& digest) = 0;
};

/// Keeps jobs. Operations are run one after the other, each in a transaction of its own or not at all.
class JobStore {
 public:
  using Operation = std::function<void(JobTable&)>;
  using Done = std::function<void(std::exception_ptr)>;

  virtual ~JobStore() = default;
  /// Runs `operation` on the store's writing thread; an exception undoes it. `done` is called on the same thread, in
  /// order, after the result is durable: with nothing, with what the operation threw, or with a Refusal that says why
  /// the store could not keep it. Neither may block.
  virtual void write(Operation operation, Done done) = 0;
  /// Runs `operation` on the calling thread on a consistent view. Blocks.
  virtual void read(const std::function<void(JobReader&)>& operation) = 0;
};

}  // namespace saltus::server
