#include "server/rpc/upload_stream.h"

#include "core/support/errors.h"
#include "server/rpc/limits.h"
#include "server/rpc/status_map.h"
#include "server/rpc/validate_request.h"

#include <memory>

namespace saltus::server {
namespace {

/// At any moment either a read, or a task, or a commit is under way, or the stream is finished; whoever has the turn
/// may touch the members. gRPC calls OnDone after Finish only, so a task never outlives the stream.
class UploadStream final : public grpc::ServerReadReactor<v1::WriteBlobRequest> {
 public:
  UploadStream(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate, grpc::CallbackServerContext& context,
               v1::WriteBlobResponse& response)
      : blobs_(blobs), pool_(pool), context_(context), response_(response) {
    try {
      pass_ = gate.enter();
    } catch (...) {
      finish(std::current_exception());
      return;
    }
    StartRead(&request_);
  }

  void OnReadDone(bool is_ok) override {
    pool_.post([this, is_ok] {
      try {
        is_ok ? receive() : complete();
      } catch (...) {
        finish(std::current_exception());
      }
    });
  }

  void OnDone() override { delete this; }

 private:
  void receive() {
    if (!is_begun_) {
      is_begun_ = true;
      validate_upload(request_.digest(), request_.size());
      response_.set_digest(request_.digest());
      response_.set_size(request_.size());
      if (blobs_.has(request_.digest(), request_.size())) return finish(nullptr);
      upload_ = blobs_.begin(request_.digest(), request_.size());
    } else if ((!request_.digest().empty() && request_.digest() != upload_->digest()) ||
               (request_.size() != 0 && request_.size() != upload_->size())) {
      throw InvalidInput("digest or size differs from the first message; send them there only");
    }
    if (request_.data().size() > limits::kUploadChunkBytes)
      throw InvalidInput("data has " + std::to_string(request_.data().size()) + " bytes; send at most " +
                         std::to_string(limits::kUploadChunkBytes) + " in one message");
    upload_->append(request_.data());
    StartRead(&request_);
  }

  void complete() {
    if (!is_begun_)
      throw InvalidInput("digest is not set; the first message must name the digest and size of the blob");
    upload_->seal();
    blobs_.commit(upload_, [this](std::exception_ptr error) { finish(error); });
  }

  /// The client must find nothing left and its place free when it has the answer.
  void finish(std::exception_ptr error) {
    upload_.reset();
    pass_.reset();
    Finish(status_of(error, context_));
  }

  BlobCatalog& blobs_;
  TaskPool& pool_;
  grpc::CallbackServerContext& context_;
  v1::WriteBlobResponse& response_;
  StreamGate::Pass pass_;
  v1::WriteBlobRequest request_;
  std::shared_ptr<BlobUpload> upload_;
  bool is_begun_ = false;
};

}  // namespace

grpc::ServerReadReactor<v1::WriteBlobRequest>* receive_blob(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate,
                                                            grpc::CallbackServerContext& context,
                                                            v1::WriteBlobResponse& response) {
  return new UploadStream(blobs, pool, gate, context, response);
}

}  // namespace saltus::server
