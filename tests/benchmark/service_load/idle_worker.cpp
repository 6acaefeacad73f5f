#include "tests/benchmark/service_load/idle_worker.h"

#include "saltus/v1/worker.grpc.pb.h"

#include <grpcpp/create_channel.h>

#include <chrono>
#include <fstream>
#include <thread>

namespace saltus::benchmark {
namespace {

constexpr std::chrono::milliseconds kBetweenHeartbeats{250};

}  // namespace

void work_idly(const WorkerOptions& options) {
  std::string token;
  std::ifstream(options.token_file) >> token;
  const auto stub = v1::WorkerService::NewStub(grpc::CreateChannel(options.server, grpc::InsecureChannelCredentials()));
  const auto identify = [&](auto& request) {
    request.set_job_id(options.job);
    request.set_attempt(options.attempt);
    request.set_token(token);
  };
  grpc::ClientContext acquiring;
  v1::AcquireLeaseRequest request;
  identify(request);
  v1::AcquireLeaseResponse terms;
  if (!stub->AcquireLease(&acquiring, request, &terms).ok()) return;

  v1::HeartbeatRequest heartbeat;
  identify(heartbeat);
  heartbeat.mutable_progress()->set_stage(v1::JOB_STAGE_OPTIMISING);
  for (int iteration = 1;; ++iteration) {
    heartbeat.mutable_progress()->set_iteration(iteration);
    grpc::ClientContext context;
    v1::HeartbeatResponse response;
    if (!stub->Heartbeat(&context, heartbeat, &response).ok() ||
        response.command() != v1::HeartbeatResponse::COMMAND_CONTINUE)
      return;
    std::this_thread::sleep_for(kBetweenHeartbeats);
  }
}

}  // namespace saltus::benchmark
