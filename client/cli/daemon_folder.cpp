#include "client/cli/daemon_folder.h"

#include "core/support/errors.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* folder_prefix = "saltus-";
constexpr const char* folder_letters = "XXXXXX";  // which mkdtemp replaces
constexpr const char* lock_name = "lock";
constexpr std::size_t longest_socket_path = 107;  // sun_path of unix(7), less its final zero

/// Where several machines share a folder, locks may be known to the one alone that took them.
std::string name_of_machine() {
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 ? name : "";
}

std::string content_of_lock(int lock) {
  char text[256];
  const ssize_t got = ::pread(lock, text, sizeof text, 0);
  return got > 0 ? std::string(text, static_cast<std::size_t>(got)) : "";
}

/// The file gets its name when it is locked, so nobody ever sees the lock of a new folder free.
int make_lock(const fs::path& folder) {
  const fs::path unnamed = folder / "lock.new";
  const int lock = ::open(unnamed.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (lock < 0) return -1;
  const std::string machine = name_of_machine();
  if (::flock(lock, LOCK_EX | LOCK_NB) == 0 &&
      ::write(lock, machine.data(), machine.size()) == static_cast<ssize_t>(machine.size()) &&
      ::rename(unnamed.c_str(), (folder / lock_name).c_str()) == 0)
    return lock;
  ::close(lock);
  ::unlink(unnamed.c_str());
  return -1;
}

/// The lock goes last: whoever is killed meanwhile leaves a folder that the next one recognises.
void remove_with_lock(const fs::path& folder) {
  std::error_code ignored;  // nothing can be done about what cannot be removed, and nothing depends on it
  std::error_code at_end;
  for (fs::directory_iterator at(folder, at_end), end; !at_end && at != end; at.increment(at_end))
    if (at->path().filename() != lock_name) fs::remove_all(at->path(), ignored);
  fs::remove_all(folder, ignored);
}

bool is_own(const struct stat& about) { return about.st_uid == ::geteuid(); }

void remove_if_left(const fs::path& folder) {
  struct stat about {};
  if (::lstat(folder.c_str(), &about) != 0 || !S_ISDIR(about.st_mode) || !is_own(about)) return;
  const int lock = ::open((folder / lock_name).c_str(), O_RDWR | O_NOFOLLOW | O_CLOEXEC);
  if (lock < 0) return;
  // No name any more: another command has just removed it.
  if (::flock(lock, LOCK_EX | LOCK_NB) == 0 && ::fstat(lock, &about) == 0 && S_ISREG(about.st_mode) && is_own(about) &&
      about.st_nlink > 0 && content_of_lock(lock) == name_of_machine())
    remove_with_lock(folder);
  ::close(lock);
}

void remove_what_was_left(const fs::path& parent) {
  const std::size_t length = std::strlen(folder_prefix) + std::strlen(folder_letters);
  std::error_code at_end;  // a parent that cannot be listed may still take a new folder
  for (fs::directory_iterator at(parent, at_end), end; !at_end && at != end; at.increment(at_end))
    if (const std::string name = at->path().filename().string();
        name.size() == length && name.starts_with(folder_prefix))
      remove_if_left(at->path());
}

}  // namespace

DaemonFolder::DaemonFolder() {
  int reason = ENAMETOOLONG;
  std::error_code missing;  // then it is empty, and the next one is tried
  for (const fs::path& parent : {fs::temp_directory_path(missing), fs::path("/tmp")}) {
    if (parent.empty()) continue;
    std::string name = parent / (std::string(folder_prefix) + folder_letters);
    if (name.size() + std::strlen("/socket") > longest_socket_path) continue;
    remove_what_was_left(parent);
    if (mkdtemp(name.data())) {
      path_ = name;
      lock_ = make_lock(path_);
      return;
    }
    reason = errno;
  }
  throw FileError(std::string("the private saltusd could not be started: no temporary folder can be made: ") +
                  std::strerror(reason) + "; use --server to name a running one");
}

DaemonFolder::~DaemonFolder() {
  remove_with_lock(path_);
  if (lock_ >= 0) ::close(lock_);
}

}  // namespace saltus::cli
