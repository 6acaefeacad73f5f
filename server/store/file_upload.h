#pragma once

#include "server/store/file_descriptor.h"
#include "server/store/sha256.h"
#include "server/store/upload_parts.h"

namespace saltus::server {

/// One stream's writing to an upload's file, for as long as no other stream goes on with it.
class FileUpload final : public BlobUpload {
 public:
  /// `turn` is the part's at the moment; `descriptor` is open for reading and writing; the first `plan.offset` bytes of
  /// the file are there and count; `room` is kept for the others.
  FileUpload(UploadParts& parts, std::shared_ptr<UploadPart> part, FileDescriptor descriptor, const UploadPlan& plan,
             std::unique_ptr<DiskReserve::Claim> room);
  ~FileUpload() override;

  const std::string& digest() const override { return plan_.digest; }
  std::int64_t size() const override { return plan_.size; }
  const std::string& owner() const override { return plan_.owner; }
  bool prepare(std::int64_t budget) override;
  void append(std::string_view bytes) override;
  void park() override;
  void seal() override;

 private:
  friend class UploadParts;

  void require_turn() const;
  void commit();
  /// After a failed sync nobody knows what is on the disk.
  void drop();
  Refusal wrong_size(const std::string& sent) const;

  UploadParts& parts_;
  const std::shared_ptr<UploadPart> part_;
  const FileDescriptor descriptor_;
  const UploadPlan plan_;
  const std::uint64_t turn_;
  const std::unique_ptr<DiskReserve::Claim> room_;
  Sha256 hash_;
  std::int64_t hashed_ = 0;
  std::int64_t written_;
  bool is_sealed_ = false;
};

}  // namespace saltus::server
