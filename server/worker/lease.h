#pragma once

#include "client/lib/channel.h"

#include "saltus/v1/worker.grpc.pb.h"

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

namespace saltus::worker {

/// Which attempt of which job this process is, and the secret that proves it.
struct AttemptIdentity {
  std::string server;       ///< unix:/path or host:port
  client::TlsIdentity tls;  ///< for a server beyond this machine
  std::string job_id;
  int attempt = 0;
  std::string token;
  std::string blobs;  ///< the daemon's folder of blobs, when this machine sees it; "": they come over the connection
  std::string uploads{};  ///< that of uploads, when results can be put there; "": they go over the connection
};

/// Why a worker must not go on.
enum class StopReason {
  None,
  Cancelled,    ///< the daemon asks for the job's end
  LeaseLost,    ///< the attempt belongs to nobody any more; nothing may be written
  Unreachable,  ///< no answer from the daemon for as long as the lease lasts
  Terminated,   ///< SIGTERM: this process has to end, the job may run again elsewhere
  CpuTime       ///< more of it is used than the lease allows
};

/// The right to work on one job: acquires it, keeps it alive with heartbeats from a thread of its own, learns from the
/// answers when to stop, and hands in the outcome.
///
/// Life cycle: construct (acquires), work, complete, destroy (ends the thread). set_progress and stop_reason may be
/// called from any thread. A daemon that is away is waited for as long as the lease lasts, so a quick restart at the
/// same address goes unnoticed.
class Lease {
 public:
  /// `when_late` is called on the heartbeat thread when stop was requested and the lease still exists `stop_grace`
  /// later: the work has not polled stop_reason for so long that the process has to be ended from here.
  /// Throws client::ClientError; code ABORTED when the attempt is no longer wanted.
  Lease(AttemptIdentity identity, std::function<void(Lease&)> when_late);
  ~Lease();
  Lease(const Lease&) = delete;
  Lease& operator=(const Lease&) = delete;

  const v1::AcquireLeaseResponse& terms() const { return terms_; }

  void set_progress(const v1::JobProgress& progress);
  StopReason stop_reason() const { return stop_reason_; }

  /// For transfers of this attempt: they wait as long as the lease lasts and are cut off when work must stop.
  client::CallSettings transfer_settings() const;
  std::stop_token stop_token() const { return stop_.get_token(); }

  /// The next attempt goes on from this blob, which the daemon must hold. Cut off by `stop`. Throws
  /// client::ClientError.
  void put_checkpoint(const v1::Checkpoint& checkpoint, const std::stop_token& stop);

  /// Hand in the outcome. Idempotent. Throw client::ClientError; code ABORTED when the lease is lost.
  void complete_success(const std::vector<v1::Artifact>& artifacts);
  void complete_failure(const std::string& reason, const std::string& message);
  void complete_cancelled();

  static constexpr std::chrono::milliseconds stop_grace{1000};

 private:
  void beat();
  void heartbeat_loop(const std::stop_token& end);
  void stop_because(StopReason reason);
  void complete(v1::CompleteJobRequest request);
  std::chrono::milliseconds duration() const;

  AttemptIdentity identity_;
  std::function<void(Lease&)> when_late_;
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  v1::AcquireLeaseResponse terms_;

  std::mutex mutex_;
  v1::JobProgress progress_;
  std::atomic<StopReason> stop_reason_ = StopReason::None;
  std::atomic<bool> is_complete_ = false;
  std::stop_source stop_;
  std::chrono::steady_clock::time_point last_contact_;
  std::jthread heartbeats_;
};

/// From now on SIGTERM and SIGINT no longer end the process but stop the lease, at its next heartbeat, as Terminated.
void catch_termination_signals();

}  // namespace saltus::worker
