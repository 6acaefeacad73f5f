#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace saltus::client {

/// SHA-256 of bytes that come in pieces. Not thread-safe.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void add(std::string_view data);
  /// "sha256:<64 hex digits>", the name of a blob. To be called once, at the end.
  std::string digest();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

struct FileDigest {
  std::string digest;
  std::int64_t size = 0;
};

/// Reads the whole file. Throws LocalFileError.
FileDigest digest_of_file(const std::filesystem::path& file);

}  // namespace saltus::client
