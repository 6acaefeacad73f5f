#include "server/rpc/worker_service.h"

#include "server/rpc/convert.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/validate_request.h"

namespace saltus::server {

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

}  // namespace saltus::server
