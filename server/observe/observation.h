#pragma once

#include "server/observe/audit_log.h"
#include "server/observe/job_history.h"
#include "server/observe/log_line.h"
#include "server/observe/metrics.h"
#include "server/rpc/call_record.h"

#include <functional>
#include <mutex>
#include <string>

namespace saltus::server {

/// Turns what happens to calls and jobs into numbers, log lines and entries of the audit log. Thread-safe, never blocks
/// for long.
class Observation final : public CallObserver {
 public:
  Observation(Metrics& metrics, AuditLog& audit, std::function<void(const LogLine&)> log)
      : metrics_(metrics), audit_(audit), log_(std::move(log)) {}

  void began(const std::string& method) override { metrics_.call_began(method); }
  void received_blob_bytes(std::size_t count) override { metrics_.received_blob_bytes(count); }
  void sent_blob_bytes(std::size_t count) override { metrics_.sent_blob_bytes(count); }
  void ended(const CallRecord& call) override;
  void denied(const CallRecord& call) override;

  /// A job that has not ended, when the daemon starts.
  void found(const JobRecord& job);
  void job_changed(const JobRecord& job);
  void job_deleted(const std::string& id);

 private:
  void count_jobs();

  Metrics& metrics_;
  AuditLog& audit_;
  const std::function<void(const LogLine&)> log_;
  std::mutex mutex_;
  JobHistory history_;
};

}  // namespace saltus::server
