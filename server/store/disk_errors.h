#pragma once

#include "server/jobs/refusal.h"
#include "server/jobs/storage_state.h"

#include <cstdint>
#include <string>
#include <system_error>

namespace saltus::server {

/// STORAGE_FULL. Room comes back when jobs are deleted or garbage is collected, which takes its time.
Refusal storage_full();
/// FILE_TOO_LARGE: of a limit that somebody has to raise.
Refusal file_too_large();
/// Throws that where this process may not write a file of so many bytes (RLIMIT_FSIZE).
void require_file_size(std::int64_t bytes);
/// `what` and errno.
std::system_error system_failure(const std::string& what);

/// A change of the disk did not succeed, errno says why. Throws STORAGE_FULL when there is no room and FILE_TOO_LARGE
/// when no file may have that size. When the disk itself has failed, `state` is told and STORE_UNAVAILABLE thrown; any
/// other errno is a fault of ours, std::system_error.
[[noreturn]] void fail_write(StorageState& state, const std::string& what);
/// A sync did not succeed: whatever errno says but for a lack of room, bytes may be lost, and the disk counts as
/// failed.
[[noreturn]] void fail_sync(StorageState& state, const std::string& what);

}  // namespace saltus::server
