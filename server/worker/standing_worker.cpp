#include "server/worker/standing_worker.h"

#include "client/lib/channel.h"
#include "client/lib/client_error.h"
#include "server/worker/attempt_process.h"
#include "server/worker/worker_session.h"

#include "saltus/v1/worker.grpc.pb.h"

#include <algorithm>
#include <iostream>
#include <optional>

namespace saltus::worker {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kLongestPoll{20};  // less than proxies let a call wait
constexpr std::chrono::seconds kAnswerTime{10};   // beyond what it may wait
constexpr std::chrono::seconds kBetweenTries{60};
constexpr int kMostSpoiled = 3;
constexpr std::chrono::seconds kAfterSpoiled{5};

/// The job had its outcome, or the daemon or somebody else wanted the end: nothing is wrong with this machine.
bool is_sound(const ProcessEnd& end) {
  if (end.is_signalled) return false;
  return end.number == OutcomeReported || end.number == LeaseLostExit || end.number == DaemonUnreachable ||
         end.number == TerminatedExit || end.number == NoRoomExit;
}

class StandingWorker {
 public:
  StandingWorker(const StandingOptions& options, const std::stop_token& stop)
      : options_(options), stop_(stop), last_use_(Clock::now()) {
    connect();
  }

  int run() {
    int spoiled = 0;
    while (!stop_.stop_requested()) {
      const auto job = take();
      if (!job && is_idle_for_too_long()) return OutcomeReported;
      if (!job) continue;
      const ProcessEnd end = work(*job);
      report(*job, end);
      last_use_ = Clock::now();
      spoiled = is_sound(end) ? 0 : spoiled + 1;
      if (spoiled == kMostSpoiled) {
        std::cerr << "saltus-worker: " << spoiled << " attempts in a row have ended without an outcome; this machine "
                  << "takes no more jobs until the worker is started again" << std::endl;
        return InternalError;
      }
      if (spoiled > 0) client::wait_for(stop_, spoiled * kAfterSpoiled);
    }
    return OutcomeReported;
  }

 private:
  void connect() {
    stub_ =
        v1::WorkerService::NewStub(client::make_channel(options_.connection.server, options_.connection.identity()));
  }

  bool is_idle_for_too_long() const { return options_.idle.count() > 0 && Clock::now() - last_use_ >= options_.idle; }

  client::CallSettings settings() const {
    client::CallSettings settings{.address = options_.connection.server, .retry = {}, .stop = stop_};
    settings.retry.patience = kBetweenTries;
    settings.retry.longest_delay = std::chrono::seconds(5);
    if (options_.idle.count() > 0) settings.retry.patience = std::min(settings.retry.patience, options_.idle);
    return settings;
  }

  /// Nothing when there is no job, or no daemon, for now. Throws ClientError when there is no sense in asking again.
  std::optional<v1::TakeJobResponse> take() {
    v1::TakeJobRequest request;
    request.set_threads(options_.threads);
    request.set_memory_bytes(options_.memory_bytes);
    request.set_worker(options_.name);
    auto poll = std::chrono::duration_cast<std::chrono::milliseconds>(kLongestPoll);
    if (options_.idle.count() > 0) poll = std::min(poll, options_.idle);
    request.set_wait_seconds(static_cast<double>(poll.count()) / 1000);
    client::CallSettings patient = settings();
    patient.unary_deadline = poll + kAnswerTime;
    v1::TakeJobResponse response;
    try {
      client::call(patient, client::CallKind::Unary,
                   [&](grpc::ClientContext& context, bool&) { return stub_->TakeJob(&context, request, &response); });
    } catch (const client::ClientError& error) {
      if (stop_.stop_requested()) return std::nullopt;
      const auto code = error.code();
      if (code != grpc::StatusCode::UNAVAILABLE && code != grpc::StatusCode::DEADLINE_EXCEEDED &&
          code != grpc::StatusCode::RESOURCE_EXHAUSTED && code != grpc::StatusCode::CANCELLED)
        throw;
      std::cerr << "saltus-worker: " << error.what() << std::endl;
      // With certificates that may be new, and a name that may lead elsewhere.
      connect();
      return std::nullopt;
    }
    if (response.job_id().empty()) return std::nullopt;
    return response;
  }

  ProcessEnd work(const v1::TakeJobResponse& job) const {
    AttemptOrder order{job.job_id(), job.attempt(), job.token(), "", options_.connection.options(), options_.threads};
    if (!options_.blobs.empty()) order.options.insert(order.options.end(), {"--blobs", options_.blobs});
    try {
      return run_attempt_process(order, stop_);
    } catch (const std::exception& error) {
      std::cerr << "saltus-worker: " << error.what() << std::endl;
      return {false, InternalError};
    }
  }

  /// So that the daemon does not have to wait for the end of the lease. One that cannot be told finds out.
  void report(const v1::TakeJobResponse& job, const ProcessEnd& end) {
    v1::ReportExitRequest request;
    request.set_job_id(job.job_id());
    request.set_attempt(job.attempt());
    request.set_token(job.token());
    end.is_signalled ? request.set_signal(end.number) : request.set_exit_code(end.number);
    client::CallSettings brief = settings();
    brief.stop = {};
    brief.retry.patience = std::chrono::seconds(2);
    brief.unary_deadline = std::chrono::seconds(5);
    try {
      client::call(brief, client::CallKind::Unary, [&](grpc::ClientContext& context, bool&) {
        v1::ReportExitResponse response;
        return stub_->ReportExit(&context, request, &response);
      });
    } catch (const client::ClientError& error) {
      std::cerr << "saltus-worker: the end of an attempt could not be told: " << error.what() << std::endl;
    }
  }

  const StandingOptions& options_;
  const std::stop_token stop_;
  Clock::time_point last_use_;
  std::unique_ptr<v1::WorkerService::Stub> stub_;
};

}  // namespace

int stand_by(const StandingOptions& options, const std::stop_token& stop) {
  try {
    return StandingWorker(options, stop).run();
  } catch (const client::ClientError& error) {
    std::cerr << "saltus-worker: " << error.what() << std::endl;
    return InternalError;
  }
}

}  // namespace saltus::worker
