#pragma once

#include <filesystem>

namespace saltus::server {

/// The daemon's folder, held by one daemon at a time. Its files are for the owner only when the umask is 0077.
///
///     saltusd.db   blobs/sha256/ab/cdef...   uploads/*.part   corrupt/*   run/*.token   logs/*.log   audit.log   lock
class DataDirectory {
 public:
  /// Makes what is missing and takes the lock. Throws std::runtime_error when another daemon holds the folder, with the
  /// number of its process, or it cannot be written.
  explicit DataDirectory(std::filesystem::path root);
  ~DataDirectory();
  DataDirectory(const DataDirectory&) = delete;
  DataDirectory& operator=(const DataDirectory&) = delete;

  /// Throws std::runtime_error when there are blobs and no database that knows them: a daemon that began with an empty
  /// one would take them all for leftovers and remove them.
  void require_database_of_blobs() const;

  std::filesystem::path database() const { return root_ / "saltusd.db"; }
  std::filesystem::path blobs() const { return root_ / "blobs" / "sha256"; }
  std::filesystem::path uploads() const { return root_ / "uploads"; }
  std::filesystem::path corrupt() const { return root_ / "corrupt"; }
  std::filesystem::path run() const { return root_ / "run"; }
  std::filesystem::path logs() const { return root_ / "logs"; }
  std::filesystem::path work() const { return root_ / "work"; }
  /// What the Slurm jobs of this daemon are named after.
  std::filesystem::path slurm_tag() const { return root_ / "slurm.tag"; }
  std::filesystem::path audit() const { return root_ / "audit.log"; }

 private:
  std::filesystem::path root_;
  int lock_ = -1;
};

}  // namespace saltus::server
