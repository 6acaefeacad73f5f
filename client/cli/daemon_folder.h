#pragma once

#include <filesystem>

namespace saltus::cli {

/// The folder of a private daemon: new, in $TMPDIR or else /tmp, open to this user alone, gone with the object.
///
/// Who is killed cannot clear up, and what is left are a patient's images. So each new folder is made only after those
/// beside it are removed that this user's commands made on this machine and that nobody uses any more. Proof of life is
/// a lock on a file in the folder: the kernel takes it off when the last process ends that has it open.
class DaemonFolder {
 public:
  /// Throws FileError when none can be made.
  DaemonFolder();
  ~DaemonFolder();
  DaemonFolder(const DaemonFolder&) = delete;
  DaemonFolder& operator=(const DaemonFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  /// For a socket; as long as a socket's path may be.
  std::filesystem::path socket() const { return path_ / "socket"; }
  /// What holds the lock, also in a process that inherits it; negative where files cannot be locked. The folder is
  /// then never taken for one that was left.
  int lock() const { return lock_; }

 private:
  std::filesystem::path path_;
  int lock_ = -1;
};

}  // namespace saltus::cli
