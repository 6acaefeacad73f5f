#pragma once

#include "server/jobs/job_manager.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/registration.grpc.pb.h"

#include <string>

namespace saltus::server {

/// A stream of one job's states: the snapshot first, then every change of state and the latest progress; OK after the
/// terminal state. At most one message is on its way at a time, so a slow client costs one message of memory.
grpc::ServerWriteReactor<v1::WatchRegistrationJobResponse>* watch_job(JobManager& jobs, TaskPool& pool,
                                                                      StreamGate& gate,
                                                                      grpc::CallbackServerContext& context,
                                                                      const std::string& id);

}  // namespace saltus::server
