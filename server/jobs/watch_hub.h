#pragma once

#include "server/jobs/job.h"

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>

namespace saltus::server {

/// What one watcher has not seen yet. State changes are never dropped (a job has a handful); of the progress only the
/// latest is kept, so a slow watcher costs no memory and delays nobody. Thread-safe.
class Subscription {
 public:
  struct Event {
    enum class Kind { Changed, Progressed, Deleted };
    Kind kind = Kind::Progressed;
    JobRecord job;         ///< Changed only
    JobProgress progress;  ///< Progressed only
  };

  /// The oldest state change, or else the latest progress; nothing when all has been seen.
  std::optional<Event> next();
  bool has_next();

 private:
  friend class WatchHub;
  Subscription(std::string job_id, std::function<void()> wake) : job_id_(std::move(job_id)), wake_(std::move(wake)) {}
  void push_change(const JobRecord& job);
  void push_progress(const JobProgress& progress);
  void push_deleted();

  const std::string job_id_;
  const std::function<void()> wake_;
  std::mutex mutex_;
  std::deque<JobRecord> changes_;
  std::optional<JobProgress> progress_;
  bool is_deleted_ = false;
};

/// Tells watchers what becomes of jobs. Thread-safe. `wake` is called without any lock held, from the thread that
/// published, and may come late: after the subscription was ended.
class WatchHub {
 public:
  std::shared_ptr<Subscription> subscribe(const std::string& job_id, std::function<void()> wake);
  void end(const std::shared_ptr<Subscription>& subscription);

  /// Is told of all jobs, before their watchers. To be called before anything is published; must not block.
  void observe(std::function<void(const JobRecord&)> changed, std::function<void(const std::string&)> deleted);

  /// To be called in the order of the changes, after they are durable.
  void changed(const JobRecord& job);
  void progressed(const std::string& job_id, const JobProgress& progress);
  void deleted(const std::string& job_id);

 private:
  template <class Push>
  void tell(const std::string& job_id, Push push);

  std::function<void(const JobRecord&)> on_changed_ = [](const JobRecord&) {};
  std::function<void(const std::string&)> on_deleted_ = [](const std::string&) {};
  std::mutex mutex_;
  std::map<std::string, std::set<std::shared_ptr<Subscription>>> subscriptions_;
};

}  // namespace saltus::server
