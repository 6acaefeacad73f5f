#pragma once

#include "server/jobs/job_manager.h"
#include "server/rpc/limits.h"

#include "saltus/v1/registration.grpc.pb.h"

#include <string>

namespace saltus::server {

/// Answers from memory, so it answers however busy the disk is.
class ServerInfoServiceImpl final : public v1::ServerInfoService::CallbackService {
 public:
  ServerInfoServiceImpl(const JobManager& jobs, std::string version, SubmitterLimits limits)
      : jobs_(jobs), version_(std::move(version)), limits_(limits) {}

  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext*, const v1::GetServerInfoRequest*,
                                          v1::ServerInfo*) override;

 private:
  const JobManager& jobs_;
  const std::string version_;
  const SubmitterLimits limits_;
};

}  // namespace saltus::server
