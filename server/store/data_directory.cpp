#include "server/store/data_directory.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace saltus::server {
namespace fs = std::filesystem;

DataDirectory::DataDirectory(fs::path root) {
  std::error_code error;
  fs::create_directories(root, error);
  if (error) throw std::runtime_error("--data is " + root.string() + ", which cannot be made: " + error.message());
  root_ = fs::canonical(root);
  const fs::path file = root_ / "lock";
  lock_ = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock_ < 0)
    throw std::runtime_error("--data is " + root_.string() + ", which cannot be written: " + std::strerror(errno));
  if (flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    close(lock_);
    throw std::runtime_error("--data is " + root_.string() +
                             ", which another saltusd is using; stop that one or choose another folder");
  }
  // The group may pass to the socket, which has permissions of its own, and see nothing else.
  chmod(root_.c_str(), 0710);
  for (const fs::path& folder : {blobs(), uploads(), run(), logs()}) fs::create_directories(folder);
  for (const auto& entry : fs::directory_iterator(uploads())) fs::remove(entry.path());
}

DataDirectory::~DataDirectory() { close(lock_); }

}  // namespace saltus::server
