#pragma once

#include "server/jobs/job_manager.h"
#include "server/jobs/maintenance.h"
#include "server/rpc/stall_watch.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/admin.grpc.pb.h"

#include <functional>

namespace saltus::server {

/// What administrators ask for. Who may call is in the table of method rules. Never blocks a callback thread.
class AdminServiceImpl final : public v1::AdminService::CallbackService {
 public:
  /// `on_drain` is told when the daemon begins or ceases to refuse jobs.
  AdminServiceImpl(JobManager& jobs, Maintenance& maintenance, TaskPool& pool, StallWatch& stalls,
                   std::function<void(bool is_draining)> on_drain);

  grpc::ServerUnaryReactor* Drain(grpc::CallbackServerContext*, const v1::DrainRequest*, v1::DrainResponse*) override;
  grpc::ServerUnaryReactor* CollectGarbage(grpc::CallbackServerContext*, const v1::CollectGarbageRequest*,
                                           v1::CollectGarbageResponse*) override;
  grpc::ServerWriteReactor<v1::FsckResponse>* Fsck(grpc::CallbackServerContext*, const v1::FsckRequest*) override;

 private:
  JobManager& jobs_;
  Maintenance& maintenance_;
  TaskPool& pool_;
  StallWatch& stalls_;
  const std::function<void(bool)> on_drain_;
  StreamGate checks_;
};

}  // namespace saltus::server
