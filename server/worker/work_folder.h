#pragma once

#include <filesystem>

namespace saltus::worker {

/// A new folder below $TMPDIR (or /tmp) that only this user can open; it goes with all its files.
class WorkFolder {
 public:
  /// Throws FileError.
  WorkFolder();
  ~WorkFolder() { remove(); }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

  /// Whether files can still be written there: tries it.
  bool can_be_written() const;

  /// May be called while another thread still writes: the folder is renamed first, so that no new file appears in it.
  void remove();

 private:
  std::filesystem::path path_;
};

}  // namespace saltus::worker
