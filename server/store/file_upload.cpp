#include "server/store/file_upload.h"

#include "server/jobs/refusal.h"
#include "server/store/disk_errors.h"

#include <algorithm>
#include <cerrno>
#include <stdexcept>

namespace saltus::server {

FileUpload::FileUpload(UploadParts& parts, std::shared_ptr<UploadPart> part, FileDescriptor descriptor,
                       const UploadPlan& plan, std::unique_ptr<DiskReserve::Claim> room)
    : parts_(parts),
      part_(std::move(part)),
      descriptor_(std::move(descriptor)),
      plan_(plan),
      turn_(part_->turn),
      room_(std::move(room)),
      written_(plan.offset) {
  part_->is_held = true;
}

FileUpload::~FileUpload() {
  const std::lock_guard lock(part_->mutex);
  if (part_->is_gone || part_->turn != turn_) return;
  part_->is_held = false;
  part_->touched = parts_.clock_.wall();
  // Nobody can ask for it again.
  if (!part_->is_kept) drop();
}

void FileUpload::require_turn() const {
  if (part_->is_gone || part_->turn != turn_)
    throw Refusal(RefusalKind::Aborted, "UPLOAD_TAKEN_OVER",
                  "another stream goes on with this upload; use an upload_id of your own");
}

bool FileUpload::prepare(std::int64_t budget) {
  const std::lock_guard lock(part_->mutex);
  require_turn();
  std::string piece;
  while (hashed_ < plan_.offset && budget > 0) {
    piece.resize(static_cast<std::size_t>(std::min({plan_.offset - hashed_, budget, kHashPiece})));
    const ssize_t count = ::pread(descriptor_.get(), piece.data(), piece.size(), hashed_);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw system_failure("cannot read " + part_->file.string());
    if (count == 0) throw std::runtime_error(part_->file.string() + " is shorter than it was");
    hash_.add(std::string_view(piece).substr(0, static_cast<std::size_t>(count)));
    hashed_ += count;
    budget -= count;
  }
  return hashed_ == plan_.offset;
}

void FileUpload::append(std::string_view bytes) {
  const std::lock_guard lock(part_->mutex);
  require_turn();
  parts_.state_.require_writable();
  if (hashed_ != written_) throw std::logic_error("an upload must be prepared before bytes are appended");
  const auto count = static_cast<std::int64_t>(bytes.size());
  if (count > plan_.size - written_) throw wrong_size("more");
  hash_.add(bytes);
  hashed_ += count;
  while (!bytes.empty()) {
    const ssize_t done = parts_.disk_.write(descriptor_.get(), bytes.data(), bytes.size(), written_);
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) fail_write(parts_.state_, "cannot write " + part_->file.string());
    bytes.remove_prefix(static_cast<std::size_t>(done));
    written_ += done;
    room_->use(done);
  }
  if (written_ - *part_->committed >= parts_.limits_.sync_bytes) {
    // Other programs may have taken what was promised here.
    parts_.reserve_.require_room();
    commit();
  }
}

void FileUpload::commit() {
  if (parts_.disk_.sync_data(descriptor_.get()) != 0) {
    const int reason = errno;
    drop();
    errno = reason;
    fail_sync(parts_.state_, "cannot sync " + part_->file.string());
  }
  part_->committed = written_;
}

void FileUpload::drop() {
  ::unlink(part_->file.c_str());
  part_->is_gone = true;
}

void FileUpload::park() {
  const std::lock_guard lock(part_->mutex);
  if (!part_->is_kept || part_->is_gone || part_->turn != turn_) return;
  if (written_ > *part_->committed) commit();
}

void FileUpload::seal() {
  const std::lock_guard lock(part_->mutex);
  require_turn();
  parts_.state_.require_writable();
  if (written_ != plan_.size) throw wrong_size(std::to_string(written_));
  const std::string found = "sha256:" + hash_.hex();
  if (found != plan_.digest) {
    drop();
    throw Refusal(RefusalKind::InvalidArgument, "DIGEST_MISMATCH",
                  "digest is " + plan_.digest + ", but the bytes sent have " + found +
                      "; send the bytes that belong to the digest");
  }
  if (parts_.disk_.sync(descriptor_.get()) != 0) {
    const int reason = errno;
    drop();
    errno = reason;
    fail_sync(parts_.state_, "cannot sync " + part_->file.string());
  }
  part_->committed = written_;
  is_sealed_ = true;
}

Refusal FileUpload::wrong_size(const std::string& sent) const {
  return {RefusalKind::InvalidArgument, "SIZE_MISMATCH",
          "size is " + std::to_string(plan_.size) + ", but " + sent +
              " bytes were sent; send the size of the whole blob, and all of it"};
}

}  // namespace saltus::server
