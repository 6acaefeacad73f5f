#include "server/store/file_reader.h"

#include "server/store/disk_errors.h"

#include <algorithm>
#include <cerrno>

namespace saltus::server {

Refusal blob_corrupt(const std::string& digest) {
  return {RefusalKind::DataLoss, "BLOB_CORRUPT",
          "the stored bytes of " + digest + " are damaged; upload it again or run the job again"};
}

void FileReader::fail() {
  on_corrupt_(descriptor_.get());
  throw blob_corrupt(digest_);
}

bool FileReader::advance(std::int64_t target, std::int64_t budget) {
  while (position_ < target && budget > 0) {
    const auto wanted = std::min<std::int64_t>({target - position_, budget, kHashPiece});
    budget -= static_cast<std::int64_t>(read(static_cast<std::size_t>(wanted)).size());
  }
  return position_ >= target;
}

std::string FileReader::read(std::size_t limit) {
  std::string bytes(
      static_cast<std::size_t>(std::min<std::int64_t>(static_cast<std::int64_t>(limit), size_ - position_)), '\0');
  std::size_t filled = 0;
  while (filled < bytes.size()) {
    const ssize_t count = disk_.read(descriptor_.get(), bytes.data() + filled, bytes.size() - filled);
    if (count < 0 && errno == EINTR) continue;
    // A part of the disk that cannot be read any more.
    if (count == 0 || (count < 0 && errno == EIO)) fail();
    if (count < 0) throw system_failure("cannot read " + digest_);
    filled += static_cast<std::size_t>(count);
  }
  hash_.add(bytes);
  position_ += static_cast<std::int64_t>(bytes.size());
  if (position_ == size_ && !is_checked_) {
    is_checked_ = true;
    if ("sha256:" + hash_.hex() != digest_) fail();
  }
  return bytes;
}

}  // namespace saltus::server
