#include "server/worker/work_folder.h"

#include "core/support/errors.h"

#include <cerrno>
#include <cstring>

#include <stdlib.h>

namespace saltus::worker {

namespace fs = std::filesystem;

WorkFolder::WorkFolder() {
  std::string name = fs::temp_directory_path() / "saltus-worker-XXXXXX";
  if (!mkdtemp(name.data())) throw FileError(name + " cannot be made: " + std::strerror(errno));
  path_ = name;
}

void WorkFolder::remove() {
  fs::path doomed = path_;
  doomed += ".removed";
  std::error_code error;
  fs::rename(path_, doomed, error);
  if (!error) fs::remove_all(doomed, error);
}

}  // namespace saltus::worker
