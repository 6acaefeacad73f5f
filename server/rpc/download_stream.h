#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/rpc/stall_watch.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/registration.grpc.pb.h"

namespace saltus::server {

/// Sends one blob from an offset on. The next message is made when the one before has left, so a slow reader costs one
/// message of memory. `limited_as`: whose place at the gate it takes. The bytes before the offset are read too, for the
/// check of the digest at the end.
grpc::ServerWriteReactor<v1::ReadBlobResponse>* send_blob(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate,
                                                          StallWatch& stalls, grpc::CallbackServerContext& context,
                                                          const v1::ReadBlobRequest& request,
                                                          const std::string& limited_as);

}  // namespace saltus::server
