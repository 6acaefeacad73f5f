#include "server/store/data_directory.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

/// Who holds the lock: ", process 123" from what it has written into the file; "" while it has not.
std::string holder(int lock) {
  char text[16] = {};
  const ssize_t count = pread(lock, text, sizeof text - 1, 0);
  const std::string number(text, count > 0 ? static_cast<std::size_t>(count) : 0);
  const bool is_number = !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
  return is_number ? ", process " + number + "," : "";
}

}  // namespace

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
    const std::string who = holder(lock_);
    close(lock_);
    throw std::runtime_error("--data is " + root_.string() + ", which another saltusd" + who +
                             " is using; stop that one or choose another folder");
  }
  const std::string number = std::to_string(getpid());
  if (ftruncate(lock_, 0) != 0 || pwrite(lock_, number.data(), number.size(), 0) < 0) {
    const std::string reason = std::strerror(errno);
    close(lock_);
    throw std::runtime_error("--data is " + root_.string() + ", which cannot be written: " + reason);
  }
  // The group may pass to the socket, which has permissions of its own, and see nothing else.
  chmod(root_.c_str(), 0710);
  for (const fs::path& folder : {blobs(), uploads(), corrupt(), run(), logs()}) fs::create_directories(folder);
}

void DataDirectory::require_database_of_blobs() const {
  std::error_code error;
  const auto size = fs::file_size(database(), error);
  if (!error && size > 0) return;
  for (const auto& folder : fs::directory_iterator(blobs()))
    if (folder.is_directory() && !fs::is_empty(folder.path()))
      throw std::runtime_error("the database " + database().string() + " is " + (error ? "gone" : "empty") +
                               " although there are blobs in " + blobs().string() +
                               "; put a backup of it in its place, or move the blobs away and begin with none");
}

DataDirectory::~DataDirectory() { close(lock_); }

}  // namespace saltus::server
