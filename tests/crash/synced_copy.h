#pragma once

#include <filesystem>

namespace saltus::crash {

/// While this object is there, SQLite's files that are opened in this process are watched: `folder` has a copy of each,
/// under its own name, as it was last synced. What a killed process has written and not synced comes into the copy with
/// the next sync, as it would come to the disk. A name that was removed stays in `folder` until the folder of the file
/// is synced. One object at a time, and it outlives the files.
///
/// A program built for tests has one from its start on when the environment's SALTUS_SYNCED_COPY names a folder.
/// Failpoints: `database.sync.before` and `database.sync.after`.
class SyncedCopies {
 public:
  explicit SyncedCopies(const std::filesystem::path& folder);
  ~SyncedCopies();
  SyncedCopies(const SyncedCopies&) = delete;
  SyncedCopies& operator=(const SyncedCopies&) = delete;
};

}  // namespace saltus::crash
