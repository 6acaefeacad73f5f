#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/id_source.h"
#include "server/jobs/job_store.h"
#include "server/jobs/launcher.h"
#include "server/jobs/refusal.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace saltus::testing_support {

/// A clock that stands still until it is moved.
class FakeClock final : public server::Clock {
 public:
  server::WallTime wall() const override {
    return server::WallTime(std::chrono::milliseconds(1000000 + elapsed_.load()));
  }
  server::SteadyTime steady() const override {
    return server::SteadyTime(std::chrono::hours(1) + std::chrono::milliseconds(elapsed_.load()));
  }
  void advance(std::chrono::milliseconds time) { elapsed_ += time.count(); }

 private:
  std::atomic<std::int64_t> elapsed_{0};
};

/// job-1, job-2, ...; token-1, ...; the fingerprint of x is "#x".
class FakeIds final : public server::IdSource {
 public:
  std::string new_job_id(server::WallTime) override { return "job-" + std::to_string(++jobs_); }
  std::string new_token() override { return "token-" + std::to_string(++tokens_); }
  std::string fingerprint(const std::string& text) const override { return "#" + text; }

 private:
  int jobs_ = 0;
  int tokens_ = 0;
};

/// Has every blob and remembers what was removed; whoever needs more of it is told that it is not here.
class RecordingBlobs final : public server::BlobStore {
 public:
  std::unique_ptr<server::BlobUpload> begin(const server::UploadPlan&) override { not_here(); }
  std::int64_t committed(const server::UploadPlan&) override { not_here(); }
  std::int64_t waiting_beside(const server::UploadPlan&) override { not_here(); }
  void require_room() override {
    if (is_full) throw server::Refusal(server::RefusalKind::Exhausted, "STORAGE_FULL", "full");
  }
  void publish(server::BlobUpload&) override { not_here(); }
  bool holds(const std::string&, std::int64_t) const override { return true; }
  std::unique_ptr<server::BlobReader> open(const std::string&, std::int64_t) override { not_here(); }
  void remove(const std::string& digest) override { removed.push_back(digest); }
  std::vector<std::string> named_before(server::WallTime) override { not_here(); }
  Leftovers expire_uploads(std::chrono::milliseconds) override { not_here(); }
  int uploads_left() override { not_here(); }
  int set_aside() override { not_here(); }

  std::vector<std::string> removed;
  bool is_full = false;

 private:
  [[noreturn]] static void not_here() { throw std::logic_error("this fake does not have it"); }
};

/// Rows in memory. Every method does what the header of JobTable says.
class MemoryTable final : public server::JobTable {
 public:
  using JobRecord = server::JobRecord;
  using JobState = server::JobState;

  std::optional<JobRecord> find(const std::string& id) override {
    for (const auto& [sequence, job] : jobs_)
      if (job.id == id) return job;
    return std::nullopt;
  }
  std::vector<JobRecord> list(const server::JobFilter& filter, std::int64_t before, int limit) override {
    const auto is_wanted = [&](const JobRecord& job) {
      if (filter.state && job.state != *filter.state) return false;
      if (!filter.submitter.empty() && job.submitter != filter.submitter) return false;
      return std::all_of(filter.labels.begin(), filter.labels.end(), [&](const auto& label) {
        const auto found = job.labels.find(label.first);
        return found != job.labels.end() && found->second == label.second;
      });
    };
    std::vector<JobRecord> found;
    for (auto it = jobs_.rbegin(); it != jobs_.rend() && static_cast<int>(found.size()) < limit; ++it)
      if (it->first < before && is_wanted(it->second)) found.push_back(it->second);
    return found;
  }
  std::vector<JobRecord> queued() override {
    std::vector<JobRecord> found;
    for (const auto& [sequence, job] : jobs_)
      if (job.state == JobState::Queued) found.push_back(job);
    return found;
  }
  std::vector<server::LastStart> last_starts() override {
    std::map<std::pair<std::string, int>, server::WallTime> last;
    for (const auto& [sequence, job] : jobs_) {
      if (!job.started) continue;
      auto& time = last.try_emplace({job.submitter, job.priority}, *job.started).first->second;
      time = std::max(time, *job.started);
    }
    std::vector<server::LastStart> starts;
    for (const auto& [who, time] : last) starts.push_back({who.first, who.second, time});
    std::stable_sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.started < b.started; });
    return starts;
  }
  int count_queued_of(const std::string& submitter) override {
    return static_cast<int>(std::count_if(jobs_.begin(), jobs_.end(), [&](const auto& entry) {
      return entry.second.state == JobState::Queued && entry.second.submitter == submitter;
    }));
  }
  Totals blob_totals() override {
    Totals totals;
    for (const auto& [digest, size] : blobs_) {
      ++totals.count;
      totals.bytes += size;
    }
    return totals;
  }
  std::int64_t blob_bytes_of(const std::string& owner) override {
    std::int64_t bytes = 0;
    for (const auto& [digest, of] : blob_owners_) bytes += of == owner ? blobs_.at(digest) : 0;
    return bytes;
  }
  int count(JobState state) override {
    return static_cast<int>(
        std::count_if(jobs_.begin(), jobs_.end(), [&](const auto& entry) { return entry.second.state == state; }));
  }
  std::optional<std::int64_t> blob_size(const std::string& digest) override {
    const auto found = blobs_.find(digest);
    return found == blobs_.end() ? std::nullopt : std::optional(found->second);
  }
  std::optional<JobRecord> find_request(const std::string& submitter, const std::string& request_id) override {
    for (const auto& [sequence, job] : jobs_)
      if (!request_id.empty() && job.submitter == submitter && job.request_id == request_id) return job;
    return std::nullopt;
  }
  void insert(JobRecord& job) override {
    job.sequence = ++last_sequence_;
    job.revision = 1;
    std::sort(job.inputs.begin(), job.inputs.end());
    jobs_[job.sequence] = job;
  }
  void update(JobRecord& job) override {
    ++job.revision;
    jobs_.at(job.sequence) = job;
  }
  void erase(const std::string& id) override {
    std::erase_if(jobs_, [&](const auto& entry) { return entry.second.id == id; });
  }
  void insert_blob(const std::string& digest, std::int64_t size, server::WallTime,
                   const std::string& owner = "") override {
    if (blobs_.emplace(digest, size).second && !owner.empty()) blob_owners_[digest] = owner;
    unreferenced_since_.erase(digest);
  }
  std::vector<server::BlobRow> blobs_after(const std::string& after, int limit) override {
    std::vector<server::BlobRow> rows;
    for (auto it = blobs_.upper_bound(after); it != blobs_.end() && static_cast<int>(rows.size()) < limit; ++it)
      rows.push_back({it->first, it->second});
    return rows;
  }
  std::vector<server::BlobRow> unreferenced_since(server::WallTime before, int limit) override {
    std::vector<server::BlobRow> rows;
    for (const auto& [digest, since] : unreferenced_since_)
      if (since < before && !is_referenced(digest) && static_cast<int>(rows.size()) < limit)
        rows.push_back({digest, blobs_.at(digest)});
    return rows;
  }
  bool is_marked_unreferenced(const std::string& digest) override { return unreferenced_since_.count(digest) > 0; }
  std::vector<std::string> ended_before(server::WallTime before, int limit) override {
    std::vector<std::string> ids;
    for (const auto& [sequence, job] : jobs_)
      if (server::is_terminal(job.state) && job.ended && *job.ended < before && static_cast<int>(ids.size()) < limit)
        ids.push_back(job.id);
    return ids;
  }
  int mark_unreferenced(server::WallTime now) override {
    int marked = 0;
    for (const auto& [digest, size] : blobs_)
      if (is_referenced(digest))
        unreferenced_since_.erase(digest);
      else
        marked += unreferenced_since_.emplace(digest, now).second ? 1 : 0;
    return marked;
  }
  void unmark_unreferenced(const std::string& digest) override { unreferenced_since_.erase(digest); }
  bool erase_blob_if_unreferenced(const std::string& digest) override {
    if (is_referenced(digest)) return false;
    unreferenced_since_.erase(digest);
    blob_owners_.erase(digest);
    return blobs_.erase(digest) > 0;
  }

 private:
  bool is_referenced(const std::string& digest) const {
    for (const auto& [sequence, job] : jobs_) {
      if (std::find(job.inputs.begin(), job.inputs.end(), digest) != job.inputs.end()) return true;
      for (const auto& artifact : job.artifacts)
        if (artifact.digest == digest) return true;
      if (job.checkpoint && job.checkpoint->digest == digest) return true;
    }
    return false;
  }
  std::map<std::int64_t, JobRecord> jobs_;
  std::map<std::string, std::int64_t> blobs_;
  std::map<std::string, std::string> blob_owners_;
  std::map<std::string, server::WallTime> unreferenced_since_;
  std::int64_t last_sequence_ = 0;
};

/// Runs every operation at once on the calling thread; an exception undoes it. With `refuse_writes`, nothing is kept;
/// with `holds_writes`, nothing happens before release().
class MemoryStore final : public server::JobStore {
 public:
  void write(Operation operation, Done done) override {
    if (holds_writes)
      held_.emplace_back(std::move(operation), std::move(done));
    else
      commit(operation, done);
  }
  void read(const std::function<void(server::JobReader&)>& operation) override { operation(table); }

  /// Does what was held, in order. Returns how much that was.
  std::size_t release() {
    const auto held = std::exchange(held_, {});
    holds_writes = false;
    for (const auto& [operation, done] : held) commit(operation, done);
    return held.size();
  }

  MemoryTable table;
  bool refuse_writes = false;
  bool holds_writes = false;

 private:
  void commit(const Operation& operation, const Done& done) {
    std::exception_ptr error;
    if (refuse_writes) {
      error = std::make_exception_ptr(server::Refusal(server::RefusalKind::Exhausted, "STORAGE_FULL", "full"));
    } else {
      MemoryTable copy = table;
      try {
        operation(copy);
        table = std::move(copy);
      } catch (...) {
        error = std::current_exception();
      }
    }
    done(error);
  }
  std::vector<std::pair<Operation, Done>> held_;
};

/// Starts nothing and remembers what it was asked for. Processes end when the test says so. Thread-safe.
class FakeLauncher final : public server::Launcher {
 public:
  using Key = server::AttemptKey;

  bool is_batch_system() const override {
    must_be_there();
    return is_batch;
  }
  std::string name_of(const Key& key) const override {
    must_be_there();
    return is_batch ? name(key) : "";
  }
  void on_news(NewsHandler handler) override { news_ = std::move(handler); }
  void on_exit(ExitHandler handler) override { handler_ = std::move(handler); }
  std::string start(const server::LaunchRequest& request) override {
    must_be_there();
    std::lock_guard lock(mutex_);
    if (refuse_starts) throw std::runtime_error("no such program");
    started_.push_back(request);
    alive_.insert(request.key);
    changed_.notify_all();
    return name(request.key);
  }
  bool adopt(const Key& key, const std::string&) override {
    must_be_there();
    std::lock_guard lock(mutex_);
    if (!adoptable.contains(key)) return false;
    alive_.insert(key);
    return true;
  }
  void terminate(const Key& key) override {
    must_be_there();
    std::lock_guard lock(mutex_);
    terminated_.push_back(key);
  }
  void kill(const Key& key) override {
    must_be_there();
    std::lock_guard lock(mutex_);
    killed_.push_back(key);
  }
  bool is_idle() const override {
    must_be_there();
    std::lock_guard lock(mutex_);
    return alive_.empty();
  }

  void tell(const Key& key, const server::QueueNews& news) { news_(key, news); }
  /// The process ends this way.
  void end(const Key& key, server::WorkerExit exit) {
    handler_(key, exit);
    std::lock_guard lock(mutex_);
    alive_.erase(key);
  }
  /// The start number `count`, from 1. Blocks until it has happened.
  server::LaunchRequest wait_for_start(std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return started_.size() >= count; });
    return started_[count - 1];
  }
  std::vector<server::LaunchRequest> started() const { return copy(started_); }
  std::vector<Key> terminated() const { return copy(terminated_); }
  std::vector<Key> killed() const { return copy(killed_); }

  std::atomic<bool> refuse_starts{false};
  bool is_batch = false;    ///< to be set before a manager has it
  std::set<Key> adoptable;  ///< to be set before the manager recovers
  /// As if it had been destroyed; what is asked of it from then on is counted, where one that is gone would be memory
  /// that is somebody else's.
  std::atomic<bool> is_gone{false};
  mutable std::atomic<int> asked_when_gone{0};

 private:
  void must_be_there() const { asked_when_gone += is_gone ? 1 : 0; }
  template <class T>
  std::vector<T> copy(const std::vector<T>& list) const {
    std::lock_guard lock(mutex_);
    return list;
  }
  static std::string name(const Key& key) { return "process of " + key.job_id + " " + std::to_string(key.attempt); }
  ExitHandler handler_;
  NewsHandler news_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<server::LaunchRequest> started_;
  std::vector<Key> terminated_;
  std::vector<Key> killed_;
  std::set<Key> alive_;
};

}  // namespace saltus::testing_support
