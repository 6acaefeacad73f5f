#pragma once

#include "server/jobs/clock.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace saltus::server {

/// A file gets its name just before its row: a younger one without a row is an upload that is about to succeed.
inline constexpr std::chrono::hours kOrphanAge{1};

/// What a client announces before it sends bytes.
struct UploadPlan {
  std::string digest;
  std::int64_t size = 0;    ///< of the whole blob
  std::string id;           ///< letters, digits, '-' and '_': the upload can be continued by this name; "" it cannot
  std::int64_t offset = 0;  ///< where the bytes to come begin
  std::string owner = {};   ///< who alone can go on with it, and whose bytes they are; "": anybody on this machine
  std::int64_t quota = 0;   ///< bytes that the owner may have on the server; 0: no limit
};

/// Bytes on their way in. Discarded on destruction unless published or parked. One thread at a time.
class BlobUpload {
 public:
  virtual ~BlobUpload() = default;
  virtual const std::string& digest() const = 0;
  virtual std::int64_t size() const = 0;  ///< as announced
  virtual const std::string& owner() const = 0;
  /// Reads again what earlier streams left, at most `budget` bytes of it, for the digest. True when all was read; only
  /// then bytes can be appended.
  virtual bool prepare(std::int64_t budget) = 0;
  /// Throws Refusal when more bytes come than announced, no file may be so large (FILE_TOO_LARGE), the disk
  /// is full (STORAGE_FULL) or fails (STORE_UNAVAILABLE), or another stream goes on with this upload
  /// (UPLOAD_TAKEN_OVER).
  virtual void append(std::string_view bytes) = 0;
  /// Makes what came durable and keeps it for a later stream, if the upload has an id. For streams that were cut.
  virtual void park() = 0;
  /// Checks size and digest, and makes the bytes durable. Throws Refusal DIGEST_MISMATCH, after which nothing is left,
  /// or SIZE_MISMATCH.
  virtual void seal() = 0;

  std::shared_ptr<void> claim;  ///< on the owner's quota, until the upload is over
};

/// Bytes on their way out, in order. The content is checked against its digest on the way: the piece with the last byte
/// is only given away when all is right. One thread at a time.
class BlobReader {
 public:
  virtual ~BlobReader() = default;
  virtual std::int64_t size() const = 0;
  virtual std::int64_t position() const = 0;
  /// Moves towards `target`, reading at most `budget` bytes for the check. True when it is reached.
  virtual bool advance(std::int64_t target, std::int64_t budget) = 0;
  /// The next bytes, at most `limit`. Throws Refusal BLOB_CORRUPT; the bytes then count as missing, so that they can be
  /// uploaded again.
  virtual std::string read(std::size_t limit) = 0;
};

/// Immutable bytes by digest, "sha256:<64 hex digits>". All calls may block. Thread-safe.
class BlobStore {
 public:
  virtual ~BlobStore() = default;
  /// Throws Refusal OFFSET_MISMATCH when the bytes to come do not begin where those that are safe end; STORAGE_FULL
  /// when the blob would not leave the disk its reserve; STORE_UNAVAILABLE.
  virtual std::unique_ptr<BlobUpload> begin(const UploadPlan& plan) = 0;
  /// How many bytes of an upload are durable; 0 for one that nobody knows. Its time to expire begins anew, for as long
  /// as this store lives: what the caller is told must not be gone a moment later.
  virtual std::int64_t committed(const UploadPlan& plan) = 0;
  /// Bytes of the plan's owner that wait to be continued, of other uploads than the plan's.
  virtual std::int64_t waiting_beside(const UploadPlan& plan) = 0;
  /// Throws Refusal STORAGE_FULL when the disk has no more than its reserve.
  virtual void require_room() = 0;
  /// Gives a sealed upload its final name, durably.
  virtual void publish(BlobUpload& upload) = 0;
  /// The bytes are there with this size.
  virtual bool holds(const std::string& digest, std::int64_t size) const = 0;
  /// Throws Refusal BLOB_CORRUPT when the bytes are missing or have another size.
  virtual std::unique_ptr<BlobReader> open(const std::string& digest, std::int64_t size) = 0;
  virtual void remove(const std::string& digest) = 0;

  /// Digests of all bytes that have had their names since before `before`, in any order.
  virtual std::vector<std::string> named_before(WallTime before) = 0;
  struct Leftovers {
    int count = 0;
    std::int64_t bytes = 0;
  };
  /// Removes uploads that no stream has been at, and nobody has asked this store about, for `age`.
  virtual Leftovers expire_uploads(std::chrono::milliseconds age) = 0;
  /// Uploads that are under way or wait to be continued.
  virtual int uploads_left() = 0;
  /// Bytes that were found damaged and set aside, for somebody to look at.
  virtual int set_aside() = 0;
};

}  // namespace saltus::server
