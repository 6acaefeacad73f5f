#pragma once

#include <filesystem>
#include <random>
#include <string>

namespace saltus::crash {

/// What power cuts took.
struct Losses {
  int files = 0;    ///< cut down to what was synced of them
  int names = 0;    ///< taken back: the folder was not synced since the file got its name
  int sectors = 0;  ///< of the database's files, with other bytes than before
};

/// Takes from the disk what a machine without power may not have there, as far as `record` tells (SALTUS_DISK_RECORD,
/// server/store/disk_record.h): bytes of blobs and uploads that no sync of the file came after, and names that no sync
/// of the folder came after. No process may use the files; `record` is removed.
void cut_power(const std::filesystem::path& record, Losses& losses);

/// The same for the database `file` and what belongs to it, of which `copies` has what was synced (synced_copy.h). A
/// disk may have written what it was not told to: of each file that was not synced the disk has nothing since the sync,
/// or everything, or any sectors, as chance has it. To lose nothing is the worst for the blobs that rows name, to lose
/// everything for what was acknowledged.
void cut_power_of_database(const std::filesystem::path& file, const std::filesystem::path& copies,
                           std::mt19937& generator, Losses& losses);

}  // namespace saltus::crash
