#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace saltus::server {

/// Bytes on their way in. Discarded on destruction unless published. One thread at a time.
class BlobUpload {
 public:
  virtual ~BlobUpload() = default;
  virtual const std::string& digest() const = 0;
  virtual std::int64_t size() const = 0;  ///< as announced
  /// Throws Refusal when more bytes come than announced or the disk is full.
  virtual void append(std::string_view bytes) = 0;
  /// Checks size and digest, and makes the bytes durable. Throws Refusal DIGEST_MISMATCH or SIZE_MISMATCH.
  virtual void seal() = 0;
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
  /// The next bytes, at most `limit`. Throws Refusal BLOB_CORRUPT.
  virtual std::string read(std::size_t limit) = 0;
};

/// Immutable bytes by digest, "sha256:<64 hex digits>". All calls may block. Thread-safe.
class BlobStore {
 public:
  virtual ~BlobStore() = default;
  virtual std::unique_ptr<BlobUpload> begin(const std::string& digest, std::int64_t size) = 0;
  /// Gives a sealed upload its final name, durably.
  virtual void publish(BlobUpload& upload) = 0;
  /// The bytes are there with this size.
  virtual bool holds(const std::string& digest, std::int64_t size) const = 0;
  /// Throws Refusal BLOB_CORRUPT when the bytes are missing or have another size.
  virtual std::unique_ptr<BlobReader> open(const std::string& digest, std::int64_t size) = 0;
  virtual void remove(const std::string& digest) = 0;
};

}  // namespace saltus::server
