#include "server/rpc/fsck_stream.h"

#include "server/rpc/pooled_writer.h"

#include <algorithm>
#include <memory>

namespace saltus::server {
namespace {

// How much one task may read before the others get their turn.
constexpr std::int64_t kStepBytes = 8 << 20;
constexpr std::int64_t kTellBytes = 1 << 30;
constexpr std::size_t kFindingsPerMessage = 1000;

v1::FsckFinding::Kind to_message(FsckFinding::Kind kind) {
  switch (kind) {
    case FsckFinding::Kind::Corrupt:
      return v1::FsckFinding::KIND_CORRUPT;
    case FsckFinding::Kind::Missing:
      return v1::FsckFinding::KIND_MISSING;
    case FsckFinding::Kind::Orphan:
      return v1::FsckFinding::KIND_ORPHAN;
  }
  return v1::FsckFinding::KIND_UNSPECIFIED;
}

class FsckStream final : public PooledWriter<v1::FsckResponse> {
 public:
  FsckStream(Maintenance& maintenance, TaskPool& pool, StreamGate& gate, StallWatch& stalls,
             grpc::CallbackServerContext& context)
      : PooledWriter(pool, stalls, context), maintenance_(maintenance) {
    begin(gate, "", [] {});
  }

 private:
  void step() override {
    if (!fsck_) fsck_ = maintenance_.fsck();
    if (is_told_) return finish(nullptr);
    if (!is_over_) is_over_ = !fsck_->step(kStepBytes);
    for (FsckFinding& finding : fsck_->take_findings()) findings_.push_back(std::move(finding));
    const FsckReport& report = fsck_->report();
    if (!is_over_ && findings_.empty() && report.bytes - told_bytes_ < kTellBytes) return post();
    tell(report);
  }

  void tell(const FsckReport& report) {
    told_bytes_ = report.bytes;
    response_.Clear();
    const std::size_t count = std::min(findings_.size(), kFindingsPerMessage);
    for (std::size_t i = 0; i < count; ++i) {
      auto* finding = response_.add_findings();
      finding->set_kind(to_message(findings_[i].kind));
      finding->set_digest(findings_[i].digest);
    }
    findings_.erase(findings_.begin(), findings_.begin() + static_cast<std::ptrdiff_t>(count));
    is_told_ = is_over_ && findings_.empty();
    response_.set_is_done(is_told_);
    response_.set_blobs(report.blobs);
    response_.set_bytes(report.bytes);
    response_.set_corrupt(report.corrupt);
    response_.set_missing(report.missing);
    response_.set_orphans(report.orphans);
    response_.set_uploads(report.uploads);
    response_.set_set_aside(report.set_aside);
    write();
  }

  void release() override { fsck_.reset(); }

  Maintenance& maintenance_;
  std::unique_ptr<Fsck> fsck_;
  std::vector<FsckFinding> findings_;
  std::int64_t told_bytes_ = 0;
  bool is_over_ = false;
  bool is_told_ = false;
};

}  // namespace

grpc::ServerWriteReactor<v1::FsckResponse>* check_store(Maintenance& maintenance, TaskPool& pool, StreamGate& gate,
                                                        StallWatch& stalls, grpc::CallbackServerContext& context) {
  return new FsckStream(maintenance, pool, gate, stalls, context);
}

}  // namespace saltus::server
