#pragma once

#include "server/jobs/blob_store.h"
#include "server/jobs/clock.h"
#include "server/jobs/storage_state.h"
#include "server/store/disk.h"
#include "server/store/disk_reserve.h"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace saltus::server {

/// The file of one upload that has begun. Whoever touches the file or the members holds `mutex`.
struct UploadPart {
  std::mutex mutex;
  std::filesystem::path file;
  bool is_kept = false;    ///< has an id: stays when its stream is cut
  std::uint64_t turn = 0;  ///< of the stream that may write; another that goes on takes the next
  bool is_held = false;    ///< a stream is at it
  bool is_given = false;   ///< a worker of this machine has put the file there
  /// Published or removed. Read without the mutex as well, whose holder may be waiting for the disk.
  std::atomic<bool> is_gone = false;
  /// How many bytes are durable, or, of a given file, there. Nothing: an earlier daemon left the file, and this one has
  /// not synced it yet, or has not looked at one that is given.
  std::optional<std::int64_t> committed = 0;
  WallTime touched{};
};

/// The folder of uploads: one file for each that has begun, named [<owner>.]<id>.<size>.<hex of the digest>.part, or
/// without these when it cannot be continued. <owner> is a hash: an identity may hold what no file name can.
/// Thread-safe.
///
/// A worker on this machine may put a file there itself, under an id that begins with `kGivenId`: an upload of which
/// all bytes that it has are there. It keeps the file under its own name too until the blob is stored, so these bytes
/// are synced when the upload is sealed, and not before somebody is told of them, who would wait for the disk. The
/// worker takes the name here away again if it likes.
///
/// Only bytes that were synced count as committed; what else a stream that was cut has written is cut off when another
/// goes on. After a crash of the daemon the whole file counts, once it has been synced. If a failure of the power has
/// spoilt it, the digest says so at the end.
class UploadParts {
 public:
  static constexpr const char* kGivenId = "given-";

  struct Limits {
    std::int64_t sync_bytes = 8 << 20;  ///< so much comes between two syncs
    std::size_t kept = 256;             ///< parts that wait to be continued; the oldest makes room for another
  };

  /// Removes what cannot be continued: call it before any upload begins.
  UploadParts(std::filesystem::path folder, Disk& disk, StorageState& state, DiskReserve& reserve, const Clock& clock,
              Limits limits);

  /// As BlobStore::begin and BlobStore::committed; the digest's form has been checked.
  std::unique_ptr<BlobUpload> begin(const UploadPlan& plan);
  std::int64_t committed(const UploadPlan& plan);
  /// As BlobStore::waiting_beside.
  std::int64_t waiting_beside(const UploadPlan& plan);

  /// Renames a sealed upload's file; the caller syncs the folder it went to.
  void move(BlobUpload& upload, const std::filesystem::path& target);

  /// A blob's file that has no row becomes an upload again, all of it committed: the next upload or question with its
  /// digest and size gets it, whatever its id. A daemon that ended between a file's name and its row has left it, and
  /// the bytes of that upload were promised to survive.
  void take_back(const std::filesystem::path& file, const std::string& digest);

  /// Removes parts that no stream has been at, and that nobody has asked about since the start, for `age`.
  BlobStore::Leftovers expire(std::chrono::milliseconds age);
  /// Parts that wait to be continued or are being written.
  int count();

 private:
  friend class FileUpload;

  std::shared_ptr<UploadPart> part_of(const UploadPlan& plan);
  std::shared_ptr<UploadPart> find(const UploadPlan& plan);
  void load();
  void add(const std::string& name, WallTime touched);
  void insert(const std::string& name, WallTime touched);
  static bool is_missing(const UploadPart& part);
  void adopt(const UploadPlan& plan);
  void notice(const UploadPlan& plan);
  void notice_all();
  bool is_known(const std::string& name) const;
  void make_room();
  void sync(UploadPart& part, int descriptor);
  void learn_committed(UploadPart& part);
  std::int64_t remove(UploadPart& part);

  const std::filesystem::path folder_;
  Disk& disk_;
  StorageState& state_;
  DiskReserve& reserve_;
  const Clock& clock_;
  const Limits limits_;

  std::mutex mutex_;  // of the map; never taken while a part's mutex is held
  std::map<std::string, std::shared_ptr<UploadPart>> parts_;
};

}  // namespace saltus::server
