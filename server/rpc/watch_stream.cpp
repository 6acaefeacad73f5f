#include "server/rpc/watch_stream.h"

#include "server/jobs/refusal.h"
#include "server/rpc/convert.h"
#include "server/rpc/status_map.h"
#include "server/rpc/validate_request.h"

#include <memory>
#include <mutex>
#include <optional>

namespace saltus::server {
namespace {

using Response = v1::WatchRegistrationJobResponse;

/// Lives by `self_` until gRPC is done with it; whoever calls pump() late holds it by a reference of their own.
class WatchStream final : public grpc::ServerWriteReactor<Response>, public std::enable_shared_from_this<WatchStream> {
 public:
  WatchStream(JobManager& jobs, TaskPool& pool, grpc::CallbackServerContext& context)
      : jobs_(jobs), pool_(pool), context_(context) {}

  void start(StreamGate& gate, const std::string& id, const OwnerOf& owner, const std::string& limited_as) {
    self_ = shared_from_this();
    try {
      validate_job_id(id);
      owner_ = owner();
      pass_ = gate.enter(limited_as);
    } catch (...) {
      return finish(std::current_exception());
    }
    // Subscribed before the snapshot is read, so that no change falls between the two.
    subscription_ = jobs_.watchers().subscribe(id, [weak = weak_from_this()] {
      if (const auto stream = weak.lock()) stream->pump();
    });
    pool_.post([stream = shared_from_this(), id] { stream->send_snapshot(id); });
  }

  void OnWriteDone(bool is_ok) override {
    {
      std::lock_guard lock(mutex_);
      is_busy_ = false;
      is_gone_ = is_gone_ || !is_ok;
    }
    pump();
  }

  void OnCancel() override {
    {
      std::lock_guard lock(mutex_);
      is_gone_ = true;
    }
    pump();
  }

  void OnDone() override {
    if (subscription_) jobs_.watchers().end(subscription_);
    pass_.reset();
    self_.reset();
  }

 private:
  void send_snapshot(const std::string& id) {
    try {
      view_ = jobs_.get(id);
      if (owner_) require_owner(view_.job, *owner_);
    } catch (...) {
      return finish(std::current_exception());
    }
    write();
  }

  /// Sends the next event unless a message is on its way. May be called from any thread.
  void pump() {
    {
      std::lock_guard lock(mutex_);
      if (is_busy_) return;
      is_busy_ = true;
    }
    if (step()) return;
    std::unique_lock lock(mutex_);
    is_busy_ = false;
    // An event that came between the two had found the stream busy.
    while (subscription_->has_next() || is_gone_) {
      is_busy_ = true;
      lock.unlock();
      if (step()) return;
      lock.lock();
      is_busy_ = false;
    }
  }

  /// Called by the one who holds is_busy_. True when a message is on its way or the stream has ended.
  bool step() {
    {
      std::lock_guard lock(mutex_);
      if (is_gone_)
        return finish(
                   std::make_exception_ptr(Refusal(RefusalKind::Unavailable, "WATCHER_GONE", "the watcher has gone"))),
               true;
    }
    if (is_terminal(view_.job.state)) return finish(nullptr), true;
    while (auto event = subscription_->next()) {
      switch (event->kind) {
        case Subscription::Event::Kind::Changed:
          if (event->job.revision <= view_.job.revision) continue;  // the snapshot had it already
          view_ = jobs_.view(event->job);
          break;
        case Subscription::Event::Kind::Progressed:
          if (!is_held(view_.job.state)) continue;
          view_.progress = event->progress;
          break;
        case Subscription::Event::Kind::Deleted:
          finish(std::make_exception_ptr(
              Refusal(RefusalKind::NotFound, "JOB_NOT_FOUND", "job '" + view_.job.id + "' has been deleted")));
          return true;
      }
      write();
      return true;
    }
    return false;
  }

  void write() {
    try {
      *response_.mutable_job() = to_message(view_);
    } catch (...) {
      return finish(std::current_exception());
    }
    StartWrite(&response_);
  }

  /// Leaves the stream busy for ever, so that nothing is sent after the end.
  void finish(std::exception_ptr error) { Finish(status_of(error, context_)); }

  JobManager& jobs_;
  TaskPool& pool_;
  grpc::CallbackServerContext& context_;
  std::optional<std::string> owner_;
  StreamGate::Pass pass_;
  std::shared_ptr<Subscription> subscription_;
  std::shared_ptr<WatchStream> self_;
  Response response_;
  JobView view_;  // of whoever holds is_busy_

  std::mutex mutex_;
  bool is_busy_ = true;  // a message is on its way, or one is being made, or the stream has ended
  bool is_gone_ = false;
};

}  // namespace

grpc::ServerWriteReactor<Response>* watch_job(JobManager& jobs, TaskPool& pool, StreamGate& gate,
                                              grpc::CallbackServerContext& context, const std::string& id,
                                              OwnerOf owner, const std::string& limited_as) {
  const auto stream = std::make_shared<WatchStream>(jobs, pool, context);
  stream->start(gate, id, owner, limited_as);
  return stream.get();
}

}  // namespace saltus::server
