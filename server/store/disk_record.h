#pragma once

/// What a power cut would take: a killed process loses nothing that it has written, a machine without power does. Only
/// the daemon built for tests says so (`saltusd-failpoints`, see tests/crash/power_cut.h): the environment's
/// SALTUS_DISK_RECORD names a file that gets a line for each of these. Elsewhere they are nothing.
///
/// WRITE comes before bytes are written, SYNC after a file or folder was synced, NEW_NAME before a file gets a name, or
/// after a folder was made (then `from` is "").
#ifdef SALTUS_FAILPOINTS
#include <sys/types.h>
namespace saltus::server {
void record_write(int descriptor, off_t offset);
void record_sync(int descriptor);
void record_new_name(const char* from, const char* to);
}  // namespace saltus::server
#define SALTUS_RECORD_WRITE(descriptor, offset) ::saltus::server::record_write(descriptor, offset)
#define SALTUS_RECORD_SYNC(descriptor) ::saltus::server::record_sync(descriptor)
#define SALTUS_RECORD_NEW_NAME(from, to) ::saltus::server::record_new_name(from, to)
#else
#define SALTUS_RECORD_WRITE(descriptor, offset) static_cast<void>(0)
#define SALTUS_RECORD_SYNC(descriptor) static_cast<void>(0)
#define SALTUS_RECORD_NEW_NAME(from, to) static_cast<void>(0)
#endif
