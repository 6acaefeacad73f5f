#pragma once

#include "server/jobs/blob_store.h"

#include <filesystem>
#include <functional>

namespace saltus::server {

/// Blobs as files: blobs/ab/cdef... for sha256:abcdef..., written beside as uploads/*.part. Both folders must be on one
/// filesystem.
class BlobDirectory final : public BlobStore {
 public:
  BlobDirectory(std::filesystem::path blobs, std::filesystem::path uploads);

  std::unique_ptr<BlobUpload> begin(const std::string& digest, std::int64_t size) override;
  void publish(BlobUpload& upload) override;
  bool holds(const std::string& digest, std::int64_t size) const override;
  std::unique_ptr<BlobReader> open(const std::string& digest, std::int64_t size) override;
  void remove(const std::string& digest) override;

  /// Removes files that `is_known` does not know by digest: what a crash left between two steps. Returns how many.
  int remove_unknown(const std::function<bool(const std::string& digest)>& is_known);

 private:
  std::filesystem::path path_of(const std::string& digest) const;

  std::filesystem::path blobs_;
  std::filesystem::path uploads_;
};

}  // namespace saltus::server
