#include "server/jobs/watch_hub.h"

#include <vector>

namespace saltus::server {

std::optional<Subscription::Event> Subscription::next() {
  std::lock_guard lock(mutex_);
  if (!changes_.empty()) {
    Event event{Event::Kind::Changed, std::move(changes_.front()), {}};
    changes_.pop_front();
    return event;
  }
  if (is_deleted_) return Event{Event::Kind::Deleted, {}, {}};
  if (progress_) {
    Event event{Event::Kind::Progressed, {}, *progress_};
    progress_.reset();
    return event;
  }
  return std::nullopt;
}

bool Subscription::has_next() {
  std::lock_guard lock(mutex_);
  return !changes_.empty() || is_deleted_ || progress_.has_value();
}

void Subscription::push_change(const JobRecord& job) {
  std::lock_guard lock(mutex_);
  changes_.push_back(job);
  progress_.reset();  // it belongs to the state before
}

void Subscription::push_progress(const JobProgress& progress) {
  std::lock_guard lock(mutex_);
  progress_ = progress;
}

void Subscription::push_deleted() {
  std::lock_guard lock(mutex_);
  is_deleted_ = true;
}

std::shared_ptr<Subscription> WatchHub::subscribe(const std::string& job_id, std::function<void()> wake) {
  std::shared_ptr<Subscription> subscription(new Subscription(job_id, std::move(wake)));
  std::lock_guard lock(mutex_);
  subscriptions_[job_id].insert(subscription);
  return subscription;
}

void WatchHub::end(const std::shared_ptr<Subscription>& subscription) {
  std::lock_guard lock(mutex_);
  const auto found = subscriptions_.find(subscription->job_id_);
  if (found == subscriptions_.end()) return;
  found->second.erase(subscription);
  if (found->second.empty()) subscriptions_.erase(found);
}

void WatchHub::observe(std::function<void(const JobRecord&)> changed, std::function<void(const std::string&)> deleted) {
  on_changed_ = std::move(changed);
  on_deleted_ = std::move(deleted);
}

template <class Push>
void WatchHub::tell(const std::string& job_id, Push push) {
  std::vector<std::shared_ptr<Subscription>> watchers;
  {
    std::lock_guard lock(mutex_);
    const auto found = subscriptions_.find(job_id);
    if (found == subscriptions_.end()) return;
    watchers.assign(found->second.begin(), found->second.end());
  }
  for (const auto& watcher : watchers) {
    push(*watcher);
    watcher->wake_();
  }
}

void WatchHub::changed(const JobRecord& job) {
  on_changed_(job);
  tell(job.id, [&](Subscription& watcher) { watcher.push_change(job); });
}

void WatchHub::progressed(const std::string& job_id, const JobProgress& progress) {
  tell(job_id, [&](Subscription& watcher) { watcher.push_progress(progress); });
}

void WatchHub::deleted(const std::string& job_id) {
  on_deleted_(job_id);
  tell(job_id, [&](Subscription& watcher) { watcher.push_deleted(); });
}

}  // namespace saltus::server
