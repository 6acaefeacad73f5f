#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/storage_state.h"
#include "server/store/disk.h"
#include "server/store/disk_reserve.h"
#include "server/store/upload_parts.h"

#include <filesystem>
#include <functional>
#include <mutex>

namespace saltus::server {

struct BlobFolders {
  std::filesystem::path blobs;    ///< ab/cdef... for sha256:abcdef...
  std::filesystem::path uploads;  ///< *.part
  std::filesystem::path corrupt;  ///< bytes that are not what their name says, under that name
};

/// Blobs as files. All folders must be on one file system. A blob whose bytes turn out to be damaged is moved aside, so
/// that it counts as missing and the next upload heals it.
class BlobDirectory final : public BlobStore {
 public:
  /// Removes what uploads left that cannot be continued.
  BlobDirectory(BlobFolders folders, StorageState& state, const Clock& clock, ReserveSettings reserve = {},
                UploadParts::Limits limits = {}, Disk& disk = real_disk());

  std::unique_ptr<BlobUpload> begin(const UploadPlan& plan) override;
  std::int64_t committed(const UploadPlan& plan) override;
  std::int64_t waiting_beside(const UploadPlan& plan) override { return uploads_.waiting_beside(plan); }
  void require_room() override { reserve_.require_room(); }
  void publish(BlobUpload& upload) override;
  bool holds(const std::string& digest, std::int64_t size) const override;
  std::unique_ptr<BlobReader> open(const std::string& digest, std::int64_t size) override;
  void remove(const std::string& digest) override;

  /// Takes the files that `is_known` does not know by digest back to the uploads, where they can be continued or
  /// expire: they are what a crash left between a file's name and its row, or between the end of the row and of the
  /// file. Returns how many. Syncs the names of the folders, which a daemon that was killed may have left without.
  int take_back_unknown(const std::function<bool(const std::string& digest)>& is_known);

  std::vector<std::string> named_before(WallTime before) override;
  Leftovers expire_uploads(std::chrono::milliseconds age) override { return uploads_.expire(age); }
  int uploads_left() override { return uploads_.count(); }
  int set_aside() override;

 private:
  static Disk& real_disk();
  std::filesystem::path path_of(const std::string& digest) const;
  void sync_folder(const std::filesystem::path& folder);
  void move_aside(const std::string& digest, int descriptor);

  const BlobFolders folders_;
  StorageState& state_;
  Disk& disk_;
  DiskReserve reserve_;
  UploadParts uploads_;
  std::mutex names_mutex_;  // of the names in blobs: what is set aside must be what was read
};

}  // namespace saltus::server
