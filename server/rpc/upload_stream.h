#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/rpc/stall_watch.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/registration.grpc.pb.h"

namespace saltus::server {

/// In whose name blobs are uploaded.
struct Uploader {
  std::string owner;       ///< as in UploadPlan
  std::string limited_as;  ///< at the gate; "": no limit of its own
  std::int64_t quota = 0;  ///< as in UploadPlan
};

/// Receives one blob. The next message is read when the one before is on disk; the answer comes when all is durable.
/// Where the upload has a name, what came of a stream that was cut is made durable and kept.
grpc::ServerReadReactor<v1::WriteBlobRequest>* receive_blob(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate,
                                                            StallWatch& stalls, grpc::CallbackServerContext& context,
                                                            v1::WriteBlobResponse& response, Uploader uploader);

}  // namespace saltus::server
