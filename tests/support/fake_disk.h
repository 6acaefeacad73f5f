#pragma once

#include "server/store/disk.h"

#include <atomic>
#include <cerrno>

namespace saltus::testing_support {

/// The real disk, until the test lets it be full or fail.
class FakeDisk final : public server::Disk {
 public:
  ssize_t write(int descriptor, const char* bytes, std::size_t count, off_t offset) override {
    if (write_error != 0) {
      errno = write_error;
      return -1;
    }
    return Disk::write(descriptor, bytes, count, offset);
  }
  ssize_t read(int descriptor, char* bytes, std::size_t count) override {
    return fails(read_error) ? -1 : Disk::read(descriptor, bytes, count);
  }
  int sync_data(int descriptor) override {
    ++syncs;
    return fails(sync_error) ? -1 : Disk::sync_data(descriptor);
  }
  int sync(int descriptor) override {
    ++syncs;
    return fails(sync_error) ? -1 : Disk::sync(descriptor);
  }
  int rename(const char* from, const char* to) override { return fails(rename_error) ? -1 : Disk::rename(from, to); }
  int space(const char* path, server::DiskSpace& space) override {
    if (available < 0) return Disk::space(path, space);
    space = {total, available};
    return 0;
  }

  std::atomic<int> read_error{0};
  std::atomic<int> write_error{0};
  std::atomic<int> sync_error{0};
  std::atomic<int> rename_error{0};
  std::atomic<int> syncs{0};
  std::atomic<std::int64_t> total{0};
  std::atomic<std::int64_t> available{-1};  ///< -1: what the real one has

 private:
  static bool fails(int error) {
    if (error != 0) errno = error;
    return error != 0;
  }
};

}  // namespace saltus::testing_support
