#include "server/rpc/blob_service.h"

#include "server/rpc/download_stream.h"
#include "server/rpc/limits.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/upload_stream.h"
#include "server/rpc/validate_request.h"

namespace saltus::server {

BlobServiceImpl::BlobServiceImpl(BlobCatalog& blobs, TaskPool& pool, TaskPool& transfers, StallWatch& stalls)
    : blobs_(blobs),
      pool_(pool),
      transfers_(transfers),
      stalls_(stalls),
      uploads_("upload", limits::kUploadStreams),
      downloads_("download", limits::kDownloadStreams) {}

grpc::ServerUnaryReactor* BlobServiceImpl::FindMissingBlobs(grpc::CallbackServerContext* context,
                                                            const v1::FindMissingBlobsRequest* request,
                                                            v1::FindMissingBlobsResponse* response) {
  return answer_from_pool(pool_, context, [this, request, response] {
    validate(*request);
    for (std::string& digest : blobs_.missing({request->digests().begin(), request->digests().end()}))
      response->add_missing(std::move(digest));
  });
}

grpc::ServerReadReactor<v1::WriteBlobRequest>* BlobServiceImpl::WriteBlob(grpc::CallbackServerContext* context,
                                                                          v1::WriteBlobResponse* response) {
  return receive_blob(blobs_, transfers_, uploads_, stalls_, *context, *response);
}

grpc::ServerWriteReactor<v1::ReadBlobResponse>* BlobServiceImpl::ReadBlob(grpc::CallbackServerContext* context,
                                                                          const v1::ReadBlobRequest* request) {
  return send_blob(blobs_, transfers_, downloads_, stalls_, *context, *request);
}

grpc::ServerUnaryReactor* BlobServiceImpl::QueryWriteStatus(grpc::CallbackServerContext* context,
                                                            const v1::QueryWriteStatusRequest* request,
                                                            v1::QueryWriteStatusResponse* response) {
  return answer_from_pool(pool_, context, [this, request, response] {
    validate(*request);
    const bool is_complete = blobs_.has(request->digest(), request->size());
    response->set_complete(is_complete);
    response->set_committed_size(is_complete
                                     ? request->size()
                                     : blobs_.committed({request->digest(), request->size(), request->upload_id(), 0}));
  });
}

}  // namespace saltus::server
