#include "server/worker/work_folder.h"

#include "core/support/errors.h"

#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

namespace saltus::worker {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t probe_bytes = 1 << 16;

}  // namespace

WorkFolder::WorkFolder() {
  std::string name = fs::temp_directory_path() / "saltus-worker-XXXXXX";
  if (!mkdtemp(name.data())) throw FileError(name + " cannot be made: " + std::strerror(errno));
  path_ = name;
}

bool WorkFolder::can_be_written() const {
  const fs::path probe = path_ / "probe";
  const int descriptor = ::open(probe.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (descriptor < 0) return false;
  const std::string bytes(probe_bytes, 'x');
  const bool is_written =
      ::write(descriptor, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()) && ::fsync(descriptor) == 0;
  ::close(descriptor);
  ::unlink(probe.c_str());
  return is_written;
}

void WorkFolder::remove() {
  fs::path doomed = path_;
  doomed += ".removed";
  std::error_code error;
  fs::rename(path_, doomed, error);
  if (!error) fs::remove_all(doomed, error);
}

}  // namespace saltus::worker
