#pragma once

#include <filesystem>
#include <string>

namespace saltus::crash {

/// What a power cut took.
struct Losses {
  int files = 0;  ///< cut down to what was synced of them
  int names = 0;  ///< taken back: the folder was not synced since the file got its name
};

/// Takes from the disk what a machine without power may not have there, as far as `record` tells (SALTUS_DISK_RECORD,
/// server/store/disk_record.h): bytes of blobs and uploads that no sync of the file came after, and names that no sync
/// of the folder came after. The database's own files are left as they are: SQLite syncs them at each commit, and to
/// lose nothing of them is the worst for the files that rows name. No process may use the files; `record` is removed.
Losses cut_power(const std::filesystem::path& record);

}  // namespace saltus::crash
