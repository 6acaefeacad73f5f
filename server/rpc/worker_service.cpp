#include "server/rpc/worker_service.h"

#include "server/rpc/convert.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/validate_request.h"

#include <atomic>
#include <mutex>
#include <optional>

namespace saltus::server {
namespace {

/// A call that is answered when there is a job, and that frees its place when the caller goes. Owns itself.
class TakeCall final : public grpc::ServerUnaryReactor {
 public:
  TakeCall(JobManager& jobs, v1::TakeJobResponse& response) : jobs_(jobs), response_(response) {}

  void begin(const Offer& offer, std::chrono::milliseconds wait) {
    const std::uint64_t taker = jobs_.take(offer, wait, [this](const std::optional<TakenJob>& job) { answer(job); });
    std::unique_lock lock(mutex_);
    taker_ = taker;
    const bool is_gone = is_cancelled_;
    lock.unlock();
    if (is_gone) jobs_.withdraw(taker);
    leave();
  }
  void refuse(const grpc::Status& status) {
    Finish(status);
    leave();
  }

  void OnCancel() override {
    std::unique_lock lock(mutex_);
    is_cancelled_ = true;
    const auto taker = taker_;
    lock.unlock();
    if (taker) jobs_.withdraw(*taker);
  }
  void OnDone() override { leave(); }

 private:
  void answer(const std::optional<TakenJob>& job) {
    if (job) {
      response_.set_job_id(job->key.job_id);
      response_.set_attempt(job->key.attempt);
      response_.set_token(job->token);
      response_.set_threads(job->threads);
    }
    Finish(grpc::Status::OK);
  }
  /// gRPC and begin() both have to be through with it.
  void leave() {
    if (--users_ == 0) delete this;
  }

  JobManager& jobs_;
  v1::TakeJobResponse& response_;
  std::mutex mutex_;
  std::optional<std::uint64_t> taker_;
  bool is_cancelled_ = false;
  std::atomic<int> users_{2};
};

}  // namespace

grpc::ServerUnaryReactor* WorkerServiceImpl::AcquireLease(grpc::CallbackServerContext* context,
                                                          const v1::AcquireLeaseRequest* request,
                                                          v1::AcquireLeaseResponse* response) {
  return answer_from_pool(pool_, context, [this, request, response] {
    validate_job_id(request->job_id());
    validate(*request);
    *response = to_message(jobs_.acquire({request->job_id(), request->attempt()}, request->token(), request->worker()));
  });
}

grpc::ServerUnaryReactor* WorkerServiceImpl::Heartbeat(grpc::CallbackServerContext* context,
                                                       const v1::HeartbeatRequest* request,
                                                       v1::HeartbeatResponse* response) {
  return answer_now(context, [&] {
    validate_job_id(request->job_id());
    const auto wanted =
        jobs_.heartbeat({request->job_id(), request->attempt()}, request->token(), from_message(request->progress()));
    response->set_command(wanted == LeaseTable::Wanted::Cancel ? v1::HeartbeatResponse::COMMAND_CANCEL
                                                               : v1::HeartbeatResponse::COMMAND_CONTINUE);
  });
}

grpc::ServerUnaryReactor* WorkerServiceImpl::PutCheckpoint(grpc::CallbackServerContext* context,
                                                           const v1::PutCheckpointRequest* request,
                                                           v1::PutCheckpointResponse*) {
  return answer_by_reply<JobRecord>(
      pool_, context,
      [this, request](const Reply<JobRecord>& reply) {
        validate_job_id(request->job_id());
        validate(*request);
        jobs_.put_checkpoint({request->job_id(), request->attempt()}, request->token(),
                             from_message(request->checkpoint()), reply);
      },
      [](const JobRecord&) {});
}

grpc::ServerUnaryReactor* WorkerServiceImpl::CompleteJob(grpc::CallbackServerContext* context,
                                                         const v1::CompleteJobRequest* request,
                                                         v1::CompleteJobResponse*) {
  return answer_by_reply<JobRecord>(
      pool_, context,
      [this, request](const Reply<JobRecord>& reply) {
        validate_job_id(request->job_id());
        validate(*request);
        jobs_.complete({request->job_id(), request->attempt()}, request->token(), from_message(*request), reply);
      },
      [](const JobRecord&) {});
}

grpc::ServerUnaryReactor* WorkerServiceImpl::TakeJob(grpc::CallbackServerContext* context,
                                                     const v1::TakeJobRequest* request, v1::TakeJobResponse* response) {
  auto* call = new TakeCall(jobs_, *response);
  try {
    validate(*request);
    const auto wait = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * request->wait_seconds()));
    call->begin({request->threads(), request->memory_bytes()}, wait);
  } catch (...) {
    call->refuse(status_of(std::current_exception(), *context));
  }
  return call;
}

grpc::ServerUnaryReactor* WorkerServiceImpl::ReportExit(grpc::CallbackServerContext* context,
                                                        const v1::ReportExitRequest* request, v1::ReportExitResponse*) {
  return answer_now(context, [&] {
    validate_job_id(request->job_id());
    const WorkerExit exit = request->signal() > 0 ? WorkerExit{WorkerExit::Kind::Signalled, request->signal()}
                                                  : WorkerExit{WorkerExit::Kind::Exited, request->exit_code()};
    jobs_.report_exit({request->job_id(), request->attempt()}, request->token(), exit);
  });
}

}  // namespace saltus::server
