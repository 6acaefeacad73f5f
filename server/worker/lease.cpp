#include "server/worker/lease.h"

#include "client/lib/client_error.h"
#include "core/support/failpoint.h"
#include "server/worker/process_limits.h"

#include <algorithm>
#include <csignal>
#include <iomanip>
#include <random>
#include <sstream>

namespace saltus::worker {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds longest_heartbeat_interval{500};
/// Of a heartbeat; a third of the lease where that is shorter, so that one without an answer does not cost the lease.
constexpr std::chrono::milliseconds heartbeat_deadline{5000};
// Before the lease is held its length is not known; a daemon that has just started a worker is there.
constexpr std::chrono::milliseconds acquire_patience{10000};

std::atomic<bool> termination_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free, "set by a signal handler");

template <class Request>
Request identified(const AttemptIdentity& identity) {
  Request request;
  request.set_job_id(identity.job_id);
  request.set_attempt(identity.attempt);
  request.set_token(identity.token);
  return request;
}

std::string name_at_random() {
  std::random_device source;
  std::ostringstream name;
  for (int i = 0; i < 4; ++i) name << std::hex << std::setw(8) << std::setfill('0') << source();
  return name.str();
}

std::chrono::milliseconds milliseconds_of(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(1000 * seconds));
}

}  // namespace

void catch_termination_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { termination_requested = true; };
  action.sa_flags = SA_RESTART;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
}

Lease::Lease(AttemptIdentity identity, std::function<void(Lease&)> when_late)
    : identity_(std::move(identity)),
      when_late_(std::move(when_late)),
      stub_(v1::WorkerService::NewStub(client::make_channel(identity_.server, identity_.tls))) {
  client::CallSettings settings{.address = identity_.server, .retry = {}, .stop = {}};
  settings.retry.patience = acquire_patience;
  auto request = identified<v1::AcquireLeaseRequest>(identity_);
  // So that a second process which somebody starts with the same token is told apart.
  request.set_worker(name_at_random());
  client::call(settings, client::CallKind::Unary,
               [&](grpc::ClientContext& context, bool&) { return stub_->AcquireLease(&context, request, &terms_); });
  SALTUS_FAILPOINT("worker.acquired");
  last_contact_ = Clock::now();
  heartbeats_ = std::jthread([this](const std::stop_token& end) { heartbeat_loop(end); });
}

Lease::~Lease() {
  heartbeats_.request_stop();
  heartbeats_.join();
}

void Lease::set_progress(const v1::JobProgress& progress) {
  std::lock_guard lock(mutex_);
  progress_ = progress;
}

std::chrono::milliseconds Lease::duration() const { return milliseconds_of(terms_.lease_seconds()); }

client::CallSettings Lease::transfer_settings() const {
  client::CallSettings settings{
      .address = identity_.server,
      .retry = {},
      .stop = stop_.get_token(),
      .blobs = {identity_.blobs, identity_.uploads,
                "given-" + identity_.job_id + "-" + std::to_string(identity_.attempt) + "-", false}};
  settings.retry.longest_delay = std::chrono::milliseconds(1000);
  settings.retry.patience = duration();
  return settings;
}

void Lease::put_checkpoint(const v1::Checkpoint& checkpoint, const std::stop_token& stop) {
  auto request = identified<v1::PutCheckpointRequest>(identity_);
  *request.mutable_checkpoint() = checkpoint;
  client::CallSettings settings = transfer_settings();
  settings.stop = stop;
  v1::PutCheckpointResponse response;
  SALTUS_FAILPOINT("worker.checkpoint.before");
  client::call(settings, client::CallKind::Unary,
               [&](grpc::ClientContext& context, bool&) { return stub_->PutCheckpoint(&context, request, &response); });
  SALTUS_FAILPOINT("worker.checkpoint.after");
}

void Lease::stop_because(StopReason reason) {
  StopReason expected = StopReason::None;
  if (stop_reason_.compare_exchange_strong(expected, reason)) stop_.request_stop();
}

void Lease::beat() {
  auto request = identified<v1::HeartbeatRequest>(identity_);
  {
    std::lock_guard lock(mutex_);
    *request.mutable_progress() = progress_;
  }
  const ProcessUse use = process_use();
  request.mutable_progress()->set_memory_bytes(use.memory_bytes);
  request.mutable_progress()->set_cpu_seconds(use.cpu_seconds);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::min(heartbeat_deadline, duration() / 3));
  v1::HeartbeatResponse response;
  const grpc::Status status = stub_->Heartbeat(&context, request, &response);
  if (status.ok()) {
    last_contact_ = Clock::now();
    if (response.command() == v1::HeartbeatResponse::COMMAND_CANCEL) stop_because(StopReason::Cancelled);
  } else if (status.error_code() == grpc::StatusCode::ABORTED) {
    // A completed job has no lease: then this is the answer to a heartbeat that was overtaken.
    if (!is_complete_) stop_because(StopReason::LeaseLost);
  } else if (Clock::now() - last_contact_ > duration()) {
    stop_because(StopReason::Unreachable);
  }
}

void Lease::heartbeat_loop(const std::stop_token& end) {
  auto interval = longest_heartbeat_interval;
  if (terms_.heartbeat_interval_seconds() > 0)
    interval = std::min(interval, milliseconds_of(terms_.heartbeat_interval_seconds()));
  Clock::time_point stopped_at{};
  while (!end.stop_requested()) {
    if (termination_requested) stop_because(StopReason::Terminated);
    if (cpu_time_is_used_up()) stop_because(StopReason::CpuTime);
    if (stop_reason_ != StopReason::LeaseLost) beat();
    if (stop_reason_ != StopReason::None) {
      if (stopped_at == Clock::time_point{}) stopped_at = Clock::now();
      if (Clock::now() - stopped_at >= stop_grace) when_late_(*this);
    }
    client::wait_for(end, interval);
  }
}

void Lease::complete(v1::CompleteJobRequest request) {
  // Not cut off by a stop: once the outcome is on its way, the answer to it decides.
  client::CallSettings settings = transfer_settings();
  settings.stop = {};
  v1::CompleteJobResponse response;
  SALTUS_FAILPOINT("worker.complete.before");
  client::call(settings, client::CallKind::Unary, [&](grpc::ClientContext& context, bool&) {
    const grpc::Status status = stub_->CompleteJob(&context, request, &response);
    if (status.ok()) is_complete_ = true;
    return status;
  });
  SALTUS_FAILPOINT("worker.complete.after");
}

void Lease::complete_success(const std::vector<v1::Artifact>& artifacts) {
  auto request = identified<v1::CompleteJobRequest>(identity_);
  request.mutable_success()->mutable_artifacts()->Assign(artifacts.begin(), artifacts.end());
  complete(std::move(request));
}

void Lease::complete_failure(const std::string& reason, const std::string& message) {
  auto request = identified<v1::CompleteJobRequest>(identity_);
  request.mutable_failure()->set_reason(reason);
  request.mutable_failure()->set_message(message);
  complete(std::move(request));
}

void Lease::complete_cancelled() {
  auto request = identified<v1::CompleteJobRequest>(identity_);
  request.mutable_cancelled();
  complete(std::move(request));
}

}  // namespace saltus::worker
