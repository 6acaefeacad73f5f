#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>

namespace saltus::server {

struct DiskSpace {
  std::int64_t total = 0;      ///< bytes of the file system
  std::int64_t available = 0;  ///< bytes that this process may still write
};

/// The calls by which bytes reach the disk and come back, for blobs; a test replaces them to let the disk be full or
/// fail. All answer like the POSIX calls that they are: -1 and errno. Thread-safe.
class Disk {
 public:
  virtual ~Disk() = default;
  virtual ssize_t write(int descriptor, const char* bytes, std::size_t count, off_t offset);  ///< pwrite
  virtual ssize_t read(int descriptor, char* bytes, std::size_t count);                       ///< read
  virtual int sync_data(int descriptor);                                                      ///< fdatasync
  virtual int sync(int descriptor);                                                           ///< fsync
  virtual int rename(const char* from, const char* to);
  virtual int space(const char* path, DiskSpace& space);  ///< statvfs
};

}  // namespace saltus::server
