#include "server/rpc/blob_service.h"

#include "server/rpc/download_stream.h"
#include "server/rpc/limits.h"
#include "server/rpc/unary_call.h"
#include "server/rpc/upload_stream.h"
#include "server/rpc/validate_request.h"

namespace saltus::server {

BlobServiceImpl::BlobServiceImpl(BlobCatalog& blobs, const Authorisation& authorisation, std::int64_t upload_quota,
                                 TaskPool& pool, TaskPool& transfers, StallWatch& stalls)
    : blobs_(blobs),
      authorisation_(authorisation),
      upload_quota_(upload_quota),
      pool_(pool),
      transfers_(transfers),
      stalls_(stalls),
      uploads_("upload", limits::kUploadStreams, limits::kUploadStreamsOfOne),
      downloads_("download", limits::kDownloadStreams, limits::kDownloadStreamsOfOne) {}

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
  const Caller caller = authorisation_.caller_of(*context);
  Uploader uploader{caller.owner(), caller.limited_as(), 0};
  if (!uploader.limited_as.empty()) uploader.quota = upload_quota_;
  return receive_blob(blobs_, transfers_, uploads_, stalls_, *context, *response, std::move(uploader));
}

grpc::ServerWriteReactor<v1::ReadBlobResponse>* BlobServiceImpl::ReadBlob(grpc::CallbackServerContext* context,
                                                                          const v1::ReadBlobRequest* request) {
  return send_blob(blobs_, transfers_, downloads_, stalls_, *context, *request,
                   authorisation_.caller_of(*context).limited_as());
}

grpc::ServerUnaryReactor* BlobServiceImpl::QueryWriteStatus(grpc::CallbackServerContext* context,
                                                            const v1::QueryWriteStatusRequest* request,
                                                            v1::QueryWriteStatusResponse* response) {
  return answer_from_pool(pool_, context, [this, context, request, response] {
    validate(*request);
    const bool is_complete = blobs_.has(request->digest(), request->size());
    response->set_complete(is_complete);
    response->set_committed_size(is_complete
                                     ? request->size()
                                     : blobs_.committed({request->digest(), request->size(), request->upload_id(), 0,
                                                         authorisation_.caller_of(*context).owner()}));
  });
}

}  // namespace saltus::server
