#include "server/store/disk.h"

#include "core/support/failpoint.h"
#include "server/store/disk_record.h"

#include <sys/statvfs.h>
#include <unistd.h>

#include <cstdio>

namespace saltus::server {

ssize_t Disk::write(int descriptor, const char* bytes, std::size_t count, off_t offset) {
  SALTUS_RECORD_WRITE(descriptor, offset);
  return ::pwrite(descriptor, bytes, count, offset);
}

ssize_t Disk::read(int descriptor, char* bytes, std::size_t count) { return ::read(descriptor, bytes, count); }

int Disk::sync_data(int descriptor) {
  SALTUS_FAILPOINT("sync_data.before");
  const int code = ::fdatasync(descriptor);
  if (code == 0) SALTUS_RECORD_SYNC(descriptor);
  SALTUS_FAILPOINT("sync_data.after");
  return code;
}

int Disk::sync(int descriptor) {
  SALTUS_FAILPOINT("sync.before");
  const int code = ::fsync(descriptor);
  if (code == 0) SALTUS_RECORD_SYNC(descriptor);
  SALTUS_FAILPOINT("sync.after");
  return code;
}

int Disk::rename(const char* from, const char* to) {
  SALTUS_FAILPOINT("rename.before");
  SALTUS_RECORD_NEW_NAME(from, to);
  const int code = std::rename(from, to);
  SALTUS_FAILPOINT("rename.after");
  return code;
}

int Disk::space(const char* path, DiskSpace& space) {
  struct statvfs status {};
  if (::statvfs(path, &status) != 0) return -1;
  const auto unit = static_cast<std::int64_t>(status.f_frsize);
  space = {unit * static_cast<std::int64_t>(status.f_blocks), unit * static_cast<std::int64_t>(status.f_bavail)};
  return 0;
}

}  // namespace saltus::server
