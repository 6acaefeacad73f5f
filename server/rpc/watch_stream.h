#pragma once

#include "server/jobs/job_manager.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/registration.grpc.pb.h"

#include <functional>
#include <optional>
#include <string>

namespace saltus::server {

/// Whose job it has to be; nothing: anybody's. May throw a Refusal.
using OwnerOf = std::function<std::optional<std::string>()>;

/// A stream of one job's states: the snapshot first, then every change of state and the latest progress; OK after the
/// terminal state. At most one message is on its way at a time, so a slow client costs one message of memory.
/// `limited_as`: whose place at the gate it takes.
grpc::ServerWriteReactor<v1::WatchRegistrationJobResponse>* watch_job(JobManager& jobs, TaskPool& pool,
                                                                      StreamGate& gate,
                                                                      grpc::CallbackServerContext& context,
                                                                      const std::string& id, OwnerOf owner,
                                                                      const std::string& limited_as);

}  // namespace saltus::server
