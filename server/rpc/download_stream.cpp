#include "server/rpc/download_stream.h"

#include "proto/crc32c.h"
#include "server/jobs/refusal.h"
#include "server/rpc/limits.h"
#include "server/rpc/pooled_writer.h"
#include "server/rpc/validate_request.h"

#include <memory>

namespace saltus::server {
namespace {

// How much one task may read before the others get their turn.
constexpr std::int64_t kSkipBytes = 8 << 20;

class DownloadStream final : public PooledWriter<v1::ReadBlobResponse> {
 public:
  DownloadStream(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate, StallWatch& stalls,
                 grpc::CallbackServerContext& context, const v1::ReadBlobRequest& request,
                 const std::string& limited_as)
      : PooledWriter(pool, stalls, context), blobs_(blobs), digest_(request.digest()), offset_(request.offset()) {
    begin(gate, limited_as, [&] { validate(request); });
  }

 private:
  void step() override {
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
    write();
  }

  void open() {
    reader_ = blobs_.open(digest_);
    if (offset_ > reader_->size())
      throw Refusal(RefusalKind::OutOfRange, "OFFSET_BEYOND_END",
                    "offset is " + std::to_string(offset_) + ", but the blob has " + std::to_string(reader_->size()) +
                        " bytes; begin at 0 or where the last download stopped");
  }

  void release() override { reader_.reset(); }

  BlobCatalog& blobs_;
  const std::string digest_;
  const std::int64_t offset_;
  std::unique_ptr<BlobReader> reader_;
  bool is_answered_ = false;  // even an empty rest is told, so that the client learns the size
};

}  // namespace

grpc::ServerWriteReactor<v1::ReadBlobResponse>* send_blob(BlobCatalog& blobs, TaskPool& pool, StreamGate& gate,
                                                          StallWatch& stalls, grpc::CallbackServerContext& context,
                                                          const v1::ReadBlobRequest& request,
                                                          const std::string& limited_as) {
  return new DownloadStream(blobs, pool, gate, stalls, context, request, limited_as);
}

}  // namespace saltus::server
