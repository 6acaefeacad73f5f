#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/refusal.h"
#include "server/store/disk.h"
#include "server/store/file_descriptor.h"
#include "server/store/sha256.h"

#include <functional>

namespace saltus::server {

/// BLOB_CORRUPT.
Refusal blob_corrupt(const std::string& digest);

/// A blob's file, checked against its digest as it is read.
class FileReader final : public BlobReader {
 public:
  /// `on_corrupt` is called with the file's descriptor when the bytes turn out to be others than `digest` says, or
  /// cannot be read any more.
  FileReader(Disk& disk, FileDescriptor descriptor, std::string digest, std::int64_t size,
             std::function<void(int descriptor)> on_corrupt)
      : disk_(disk),
        descriptor_(std::move(descriptor)),
        digest_(std::move(digest)),
        size_(size),
        on_corrupt_(std::move(on_corrupt)) {}

  std::int64_t size() const override { return size_; }
  std::int64_t position() const override { return position_; }
  bool advance(std::int64_t target, std::int64_t budget) override;
  std::string read(std::size_t limit) override;

 private:
  [[noreturn]] void fail();

  Disk& disk_;
  const FileDescriptor descriptor_;
  const std::string digest_;
  const std::int64_t size_;
  const std::function<void(int)> on_corrupt_;
  std::int64_t position_ = 0;
  Sha256 hash_;
  bool is_checked_ = false;
};

}  // namespace saltus::server
