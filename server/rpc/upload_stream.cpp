#include "server/rpc/upload_stream.h"

#include "core/support/errors.h"
#include "server/jobs/refusal.h"
#include "server/rpc/limits.h"
#include "server/rpc/status_map.h"
#include "server/rpc/validate_request.h"

#include <memory>

namespace saltus::server {
namespace {

// How much of an earlier stream's bytes one task may read before the others get their turn.
constexpr std::int64_t kPrepareBytes = 8 << 20;

/// At any moment either a read, or a task, or a commit is under way, or the stream is finished; whoever has the turn
/// may touch the members. gRPC calls OnDone after Finish only, so a task never outlives the stream.
class UploadStream final : public grpc::ServerReadReactor<v1::WriteBlobRequest> {
 public:
  UploadStream(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate, StallWatch& stalls,
               grpc::CallbackServerContext& context, v1::WriteBlobResponse& response, Uploader uploader)
      : blobs_(blobs),
        pool_(pool),
        context_(context),
        stall_(stalls, context),
        response_(response),
        uploader_(std::move(uploader)) {
    try {
      pass_ = gate.enter(uploader_.limited_as);
    } catch (...) {
      finish(std::current_exception());
      return;
    }
    read();
  }

  void OnReadDone(bool is_ok) override {
    stall_.moved();
    post([this, is_ok] { is_ok ? receive() : complete(); });
  }

  void OnDone() override { delete this; }

 private:
  template <class Task>
  void post(Task task) {
    pool_.post([this, task = std::move(task)] {
      try {
        task();
      } catch (...) {
        finish(std::current_exception());
      }
    });
  }

  void read() {
    stall_.waits();
    StartRead(&request_);
  }

  void receive() {
    if (is_begun_) {
      if ((!request_.digest().empty() && request_.digest() != upload_->digest()) ||
          (request_.size() != 0 && request_.size() != upload_->size()))
        throw InvalidInput("digest or size differs from the first message; send them there only");
      return take();
    }
    is_begun_ = true;
    validate_upload(request_);
    response_.set_digest(request_.digest());
    response_.set_size(request_.size());
    if (blobs_.has(request_.digest(), request_.size())) return finish(nullptr);
    upload_ = blobs_.begin({request_.digest(), request_.size(), request_.upload_id(), request_.write_offset(),
                            uploader_.owner, uploader_.quota});
    prepare();
  }

  void prepare() {
    if (!upload_->prepare(kPrepareBytes)) return post([this] { prepare(); });
    take();
  }

  void take() {
    if (request_.data().size() > limits::kUploadChunkBytes)
      throw InvalidInput("data has " + std::to_string(request_.data().size()) + " bytes; send at most " +
                         std::to_string(limits::kUploadChunkBytes) + " in one message");
    upload_->append(request_.data());
    read();
  }

  /// The client has ended its side, or the stream was cut.
  void complete() {
    if (!is_begun_)
      throw InvalidInput("digest is not set; the first message must name the digest and size of the blob");
    upload_->seal();
    blobs_.commit(upload_, [this](std::exception_ptr error) { finish(error); });
  }

  /// The client must find its bytes safe, or nothing left, and its place free when it has the answer.
  void finish(std::exception_ptr error) {
    if (error && upload_) park();
    // Whoever commits may hold the upload a little longer; its claim must not count beside the stored bytes.
    if (upload_) upload_->claim.reset();
    upload_.reset();
    pass_.reset();
    Finish(status_of(error, context_));
  }

  void park() {
    try {
      upload_->park();
    } catch (const Refusal&) {
      // The disk is full or has failed, which is known elsewhere by now: less is safe, and the first error is told.
    }
  }

  BlobCatalog& blobs_;
  TaskPool& pool_;
  grpc::CallbackServerContext& context_;
  StallWatch::Stream stall_;
  v1::WriteBlobResponse& response_;
  const Uploader uploader_;
  StreamGate::Pass pass_;
  v1::WriteBlobRequest request_;
  std::shared_ptr<BlobUpload> upload_;
  bool is_begun_ = false;
};

}  // namespace

grpc::ServerReadReactor<v1::WriteBlobRequest>* receive_blob(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate,
                                                            StallWatch& stalls, grpc::CallbackServerContext& context,
                                                            v1::WriteBlobResponse& response, Uploader uploader) {
  return new UploadStream(blobs, pool, gate, stalls, context, response, std::move(uploader));
}

}  // namespace saltus::server
