#pragma once

#include <filesystem>

namespace saltus {

/// The name of a file that is written beside `target` and then takes its place, so that `target` holds the old file or
/// the whole new one. The name ends like the target's, because writers look at the suffix. What has not been moved when
/// this goes out of scope is removed.
class TemporaryFile {
 public:
  /// Throws FileError when the folder of `target` does not exist. Makes no file.
  explicit TemporaryFile(std::filesystem::path target);
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  /// Renames the file to the target. Throws FileError.
  void take_place();

 private:
  std::filesystem::path target_;
  std::filesystem::path path_;
};

}  // namespace saltus
