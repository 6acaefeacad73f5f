#include "server/launch/worker_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>
#include <vector>

namespace saltus::server {
namespace fs = std::filesystem;

std::string file_name_of(const AttemptKey& key) { return key.job_id + "-" + std::to_string(key.attempt); }

void write_secret(const fs::path& file, const std::string& text) {
  const auto fail = [](int code) {
    throw std::runtime_error(std::string("cannot write the token file: ") + std::strerror(code));
  };
  fs::remove(file);
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (descriptor < 0) fail(errno);
  const ssize_t count = ::write(descriptor, text.data(), text.size());
  const int code = errno;
  ::close(descriptor);
  if (count != static_cast<ssize_t>(text.size())) fail(code);
}

void keep_newest(const fs::path& folder, std::size_t most) {
  std::vector<std::pair<fs::file_time_type, fs::path>> files;
  for (const auto& entry : fs::directory_iterator(folder)) files.emplace_back(entry.last_write_time(), entry.path());
  if (files.size() <= most) return;
  std::sort(files.begin(), files.end());
  for (std::size_t i = 0; i < files.size() - most; ++i) fs::remove(files[i].second);
}

}  // namespace saltus::server
