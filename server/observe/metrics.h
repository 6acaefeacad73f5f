#pragma once

#include "server/observe/job_history.h"
#include "server/rpc/call_record.h"

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace saltus::server {

/// What the daemon does, in numbers for Prometheus; no job id and no person in any label. Thread-safe; only
/// asking for the numbers may block.
class Metrics {
 public:
  /// `data`: whose disk is watched.
  Metrics(const std::string& version, std::filesystem::path data);
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  /// Serves http://127.0.0.1:port/metrics from now on; port 0 takes a free one. Returns the port. Throws
  /// std::runtime_error when the port cannot be had.
  int serve(const std::string& host, int port);
  /// What is served, as text.
  std::string text() const;

  struct Gauge {
    const char* name;
    const char* help;
    double value;
  };
  /// What is measured anew whenever somebody asks for the numbers, on the asker's thread; `measure` may block. What it
  /// throws leaves its numbers out. With nothing it is taken back; returns when it is under way no more.
  void at_scrape(std::function<std::vector<Gauge>()> measure);

  void call_began(const std::string& method);
  void call_ended(const CallRecord& call);
  void call_denied(const CallRecord& call);
  void received_blob_bytes(std::size_t count);
  void sent_blob_bytes(std::size_t count);

  void job_stepped(const JobRecord& job, const JobStep& step);
  void jobs_are(int queued, int running, int cancelling);

  /// A group of writes became durable, or not, after `time`.
  void committed(std::chrono::steady_clock::duration time, std::size_t writes);
  /// A call of the daemon to itself took `time` from end to end.
  void pinged(std::chrono::steady_clock::duration time);

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace saltus::server
