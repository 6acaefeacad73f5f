#include "server/jobs/maintenance.h"

#include "server/jobs/refusal.h"

namespace saltus::server {

Maintenance::Maintenance(JobStore& rows, BlobStore& bytes, const Clock& clock, Retention retention, Intervals intervals,
                         std::function<void(const std::string&)> log)
    : rows_(rows),
      bytes_(bytes),
      clock_(clock),
      intervals_(intervals),
      log_(std::move(log)),
      garbage_(rows, bytes, clock, retention),
      thread_([this] { run(); }) {}

Maintenance::~Maintenance() {
  {
    std::lock_guard lock(mutex_);
    is_closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
  for (const Done& done : asked_)
    done(std::make_exception_ptr(
             Refusal(RefusalKind::Unavailable, "DRAINING", "the daemon is shutting down; try again later", kRestart)),
         {});
}

void Maintenance::collect(Done done) {
  {
    std::lock_guard lock(mutex_);
    asked_.push_back(std::move(done));
  }
  changed_.notify_all();
}

std::unique_ptr<Fsck> Maintenance::fsck() {
  return std::make_unique<Fsck>([this](const auto& operation) { rows_.read(operation); }, bytes_, clock_);
}

void Maintenance::run() {
  auto wait = intervals_.first;
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait_for(lock, wait, [this] { return is_closing_ || !asked_.empty(); });
    if (is_closing_) return;
    const auto asked = std::exchange(asked_, {});
    wait = intervals_.next;
    lock.unlock();
    std::exception_ptr error;
    const GarbageReport report = collect_now(error);
    for (const Done& done : asked) done(error, report);
    lock.lock();
  }
}

GarbageReport Maintenance::collect_now(std::exception_ptr& error) {
  GarbageReport report;
  try {
    report = garbage_.collect();
    if (report.jobs + report.blobs + report.uploads + report.orphans > 0)
      log_("collected " + std::to_string(report.jobs) + " jobs, " + std::to_string(report.blobs) + " blobs of " +
           std::to_string(report.blob_bytes) + " bytes, " + std::to_string(report.uploads) + " uploads and " +
           std::to_string(report.orphans) + " files without a row");
  } catch (const std::exception& failure) {
    error = std::current_exception();
    log_(std::string("garbage could not be collected: ") + failure.what());
  }
  return report;
}

}  // namespace saltus::server
