#pragma once

#include "server/jobs/maintenance.h"
#include "server/rpc/stall_watch.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/admin.grpc.pb.h"

namespace saltus::server {

/// Checks the store bit by bit on the pool, which others share, and tells how far it is after each GiB and with each
/// finding. Ends when its caller does.
grpc::ServerWriteReactor<v1::FsckResponse>* check_store(Maintenance& maintenance, TaskPool& pool, StreamGate& gate,
                                                        StallWatch& stalls, grpc::CallbackServerContext& context);

}  // namespace saltus::server
