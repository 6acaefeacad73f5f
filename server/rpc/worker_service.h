#pragma once

#include "server/jobs/job_manager.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/worker.grpc.pb.h"

namespace saltus::server {

/// Translates between workers and the job manager. Never blocks a callback thread.
class WorkerServiceImpl final : public v1::WorkerService::CallbackService {
 public:
  WorkerServiceImpl(JobManager& jobs, TaskPool& pool) : jobs_(jobs), pool_(pool) {}

  grpc::ServerUnaryReactor* AcquireLease(grpc::CallbackServerContext*, const v1::AcquireLeaseRequest*,
                                         v1::AcquireLeaseResponse*) override;
  grpc::ServerUnaryReactor* Heartbeat(grpc::CallbackServerContext*, const v1::HeartbeatRequest*,
                                      v1::HeartbeatResponse*) override;
  grpc::ServerUnaryReactor* PutCheckpoint(grpc::CallbackServerContext*, const v1::PutCheckpointRequest*,
                                          v1::PutCheckpointResponse*) override;
  grpc::ServerUnaryReactor* CompleteJob(grpc::CallbackServerContext*, const v1::CompleteJobRequest*,
                                        v1::CompleteJobResponse*) override;
  grpc::ServerUnaryReactor* TakeJob(grpc::CallbackServerContext*, const v1::TakeJobRequest*,
                                    v1::TakeJobResponse*) override;
  grpc::ServerUnaryReactor* ReportExit(grpc::CallbackServerContext*, const v1::ReportExitRequest*,
                                       v1::ReportExitResponse*) override;

 private:
  JobManager& jobs_;
  TaskPool& pool_;
};

}  // namespace saltus::server
