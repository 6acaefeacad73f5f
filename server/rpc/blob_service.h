#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/rpc/authorisation.h"
#include "server/rpc/stall_watch.h"
#include "server/rpc/stream_gate.h"
#include "server/rpc/task_pool.h"

#include "saltus/v1/registration.grpc.pb.h"

namespace saltus::server {

/// Uploads and downloads. Never blocks a callback thread; each stream has one message in memory.
class BlobServiceImpl final : public v1::BlobService::CallbackService {
 public:
  /// `transfers` does what takes long, `pool` the rest. `upload_quota`: bytes that one submitter may have; 0: no limit.
  BlobServiceImpl(BlobCatalog& blobs, const Authorisation& authorisation, std::int64_t upload_quota, TaskPool& pool,
                  TaskPool& transfers, StallWatch& stalls);

  grpc::ServerUnaryReactor* FindMissingBlobs(grpc::CallbackServerContext*, const v1::FindMissingBlobsRequest*,
                                             v1::FindMissingBlobsResponse*) override;
  grpc::ServerReadReactor<v1::WriteBlobRequest>* WriteBlob(grpc::CallbackServerContext*,
                                                           v1::WriteBlobResponse*) override;
  grpc::ServerWriteReactor<v1::ReadBlobResponse>* ReadBlob(grpc::CallbackServerContext*,
                                                           const v1::ReadBlobRequest*) override;
  grpc::ServerUnaryReactor* QueryWriteStatus(grpc::CallbackServerContext*, const v1::QueryWriteStatusRequest*,
                                             v1::QueryWriteStatusResponse*) override;

 private:
  BlobCatalog& blobs_;
  const Authorisation& authorisation_;
  const std::int64_t upload_quota_;
  TaskPool& pool_;
  TaskPool& transfers_;
  StallWatch& stalls_;
  StreamGate uploads_;
  StreamGate downloads_;
};

}  // namespace saltus::server
