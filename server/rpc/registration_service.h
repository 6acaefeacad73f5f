#pragma once

#include "server/jobs/id_source.h"
#include "server/jobs/job_manager.h"
#include "server/rpc/authorisation.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/registration.grpc.pb.h"

#include <optional>
#include <string>

namespace saltus::server {

/// Translates between clients and the job manager. Never blocks a callback thread.
class RegistrationServiceImpl final : public v1::RegistrationService::CallbackService {
 public:
  RegistrationServiceImpl(JobManager& jobs, const IdSource& ids, const Authorisation& authorisation, TaskPool& pool);

  grpc::ServerUnaryReactor* CreateRegistrationJob(grpc::CallbackServerContext*, const v1::CreateRegistrationJobRequest*,
                                                  v1::RegistrationJob*) override;
  grpc::ServerUnaryReactor* BatchCreateRegistrationJobs(grpc::CallbackServerContext*,
                                                        const v1::BatchCreateRegistrationJobsRequest*,
                                                        v1::BatchCreateRegistrationJobsResponse*) override;
  grpc::ServerUnaryReactor* GetRegistrationJob(grpc::CallbackServerContext*, const v1::GetRegistrationJobRequest*,
                                               v1::RegistrationJob*) override;
  grpc::ServerUnaryReactor* ListRegistrationJobs(grpc::CallbackServerContext*, const v1::ListRegistrationJobsRequest*,
                                                 v1::ListRegistrationJobsResponse*) override;
  grpc::ServerUnaryReactor* CancelRegistrationJob(grpc::CallbackServerContext*, const v1::CancelRegistrationJobRequest*,
                                                  v1::RegistrationJob*) override;
  grpc::ServerUnaryReactor* DeleteRegistrationJob(grpc::CallbackServerContext*, const v1::DeleteRegistrationJobRequest*,
                                                  v1::DeleteRegistrationJobResponse*) override;
  grpc::ServerWriteReactor<v1::WatchRegistrationJobResponse>* WatchRegistrationJob(
      grpc::CallbackServerContext*, const v1::WatchRegistrationJobRequest*) override;

 private:
  /// Whose jobs the call may touch; nothing: everybody's.
  std::optional<std::string> owner(const grpc::CallbackServerContext& context, const char* method) const;
  /// Answers as if the job did not exist when it is not `owner`'s. Blocks.
  void require_own(const std::string& id, const std::optional<std::string>& owner);
  NewJob new_job(const grpc::CallbackServerContext& context, const v1::CreateRegistrationJobRequest& request) const;

  JobManager& jobs_;
  const IdSource& ids_;
  const Authorisation& authorisation_;
  TaskPool& pool_;
  StreamGate watchers_;
};

}  // namespace saltus::server
