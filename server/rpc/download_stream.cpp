#include "server/rpc/download_stream.h"

#include "server/jobs/refusal.h"
#include "server/rpc/crc32c.h"
#include "server/rpc/limits.h"
#include "server/rpc/status_map.h"
#include "server/rpc/validate_request.h"

#include <memory>

namespace saltus::server {
namespace {

// How much one task may read before the others get their turn.
constexpr std::int64_t kSkipBytes = 8 << 20;

/// At any moment either a write or a task is under way, or the stream is finished; whoever has the turn may touch the
/// members.
class DownloadStream final : public grpc::ServerWriteReactor<v1::ReadBlobResponse> {
 public:
  DownloadStream(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate, StallWatch& stalls,
                 grpc::CallbackServerContext& context, const v1::ReadBlobRequest& request)
      : blobs_(blobs),
        pool_(pool),
        context_(context),
        stall_(stalls, context),
        digest_(request.digest()),
        offset_(request.offset()) {
    try {
      validate(request);
      pass_ = gate.enter();
    } catch (...) {
      finish(std::current_exception());
      return;
    }
    post();
  }

  void OnWriteDone(bool is_ok) override {
    stall_.moved();
    if (!is_ok) return Finish(grpc::Status::CANCELLED);
    post();
  }

  void OnDone() override { delete this; }

 private:
  void post() {
    pool_.post([this] {
      try {
        produce();
      } catch (...) {
        finish(std::current_exception());
      }
    });
  }

  void produce() {
    if (context_.IsCancelled()) return Finish(grpc::Status::CANCELLED);
    if (!reader_) open();
    if (!reader_->advance(offset_, kSkipBytes)) return post();
    if (reader_->position() == reader_->size() && is_answered_) return finish(nullptr);
    const std::int64_t position = reader_->position();
    std::string bytes = reader_->read(limits::kDownloadChunkBytes);
    response_.set_offset(position);
    response_.set_size(reader_->size());
    response_.set_crc32c(crc32c(bytes));
    response_.set_data(std::move(bytes));
    is_answered_ = true;
    stall_.waits();
    StartWrite(&response_);
  }

  void open() {
    reader_ = blobs_.open(digest_);
    if (offset_ > reader_->size())
      throw Refusal(RefusalKind::OutOfRange, "OFFSET_BEYOND_END",
                    "offset is " + std::to_string(offset_) + ", but the blob has " + std::to_string(reader_->size()) +
                        " bytes; begin at 0 or where the last download stopped");
  }

  /// The client must find its place free when it has the answer.
  void finish(std::exception_ptr error) {
    reader_.reset();
    pass_.reset();
    Finish(status_of(error, context_));
  }

  BlobCatalog& blobs_;
  TaskPool& pool_;
  grpc::CallbackServerContext& context_;
  StallWatch::Stream stall_;
  const std::string digest_;
  const std::int64_t offset_;
  StreamGate::Pass pass_;
  std::unique_ptr<BlobReader> reader_;
  v1::ReadBlobResponse response_;
  bool is_answered_ = false;  // even an empty rest is told, so that the client learns the size
};

}  // namespace

grpc::ServerWriteReactor<v1::ReadBlobResponse>* send_blob(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate,
                                                          StallWatch& stalls, grpc::CallbackServerContext& context,
                                                          const v1::ReadBlobRequest& request) {
  return new DownloadStream(blobs, pool, gate, stalls, context, request);
}

}  // namespace saltus::server
